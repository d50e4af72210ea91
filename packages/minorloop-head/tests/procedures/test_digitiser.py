import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop_head.procedures.actuator_plant import BenchTip
from minorloop_head.procedures.digitiser import (
    Digitiser,
    DigitiserSettings,
    PulserSettings,
    open_digitiser,
)
from minorloop_head.sources import EchoSource
from minorloop_head.ultrasound.echoes import DEAD_TIME, Pulse, find_echoes

INTERVAL, AT = 1e-8, 12e-6


class Instrument:
    """A simulated pulser and digitiser on one line: an echo is there after a pulse."""

    name = "simulated"

    def __init__(self, *, short=False, silent=False):
        self.lines, self.short, self.silent, self.fired, self.closed = [], short, silent, 0, False

    def send(self, text):
        self.lines.append(text)
        self.fired += text == "*TRG"

    def ask(self, text):
        if self.silent:
            raise InstrumentError("simulated does not answer")
        if text == "*OPC?":
            return "1"
        if text == "XIN?":
            return f"{INTERVAL:e}"
        first, last = (int(each.split()[1]) for each in text.split(";:")[:2])
        t = INTERVAL * np.arange(first - 1, last)
        trace = np.zeros(t.size)
        if self.fired:
            burst = Pulse().samples(INTERVAL)
            whole = np.zeros(4096)
            begin = round(AT / INTERVAL) - burst.size // 2
            whole[begin : begin + burst.size] = burst
            trace = whole[first - 1 : last]
        return ",".join(str(round(100 * x)) for x in trace[: -1 if self.short else None])

    def close(self):
        self.closed = True


HOW = DigitiserSettings(
    resource="x", read="STAR {first};:STOP {last};:CURV?", samples=2000, interval="XIN?",
    on=["ENC ASCI"], arm="RUN", full_scale=100.0,
)  # fmt: skip
PULSES = PulserSettings(resource="y", fire="*TRG", on=["OUTP ON"], safe=["OUTP OFF"])


def device(**how):
    scope, pulser = Instrument(**how), Instrument()
    scope_sees = pulser.send

    def send(text):
        scope_sees(text)
        scope.fired = pulser.fired

    pulser.send = send
    return Digitiser(HOW, scope, (PULSES, pulser), clock=lambda: 3.0), scope, pulser


def test_a_shot_is_fired_and_its_echo_is_where_the_wall_is():
    probe, scope, pulser = device()
    assert isinstance(probe, EchoSource)
    shot = BenchTip(None, probe).shots(1)[0]
    assert (shot.t, shot.sample_interval, shot.trace.size) == (3.0, INTERVAL, 2000)
    (echo,) = find_echoes(shot.trace, shot.sample_interval, gate=(DEAD_TIME, 1.9e-5), most=1)
    assert echo.time == pytest.approx(AT, abs=INTERVAL)
    assert np.abs(shot.trace).max() == pytest.approx(1.0, abs=0.02)
    assert scope.lines == ["ENC ASCI", "RUN"]
    assert pulser.lines == ["OUTP ON", "*TRG"]


def test_the_pulser_is_switched_off_at_the_end_and_the_rest_is_closed():
    probe, scope, pulser = device()
    probe.close()
    assert pulser.lines[-1] == "OUTP OFF"
    assert (scope.closed, pulser.closed) == (True, True)


@pytest.mark.parametrize(
    ("how", "said"),
    [({"short": True}, "answers 255 numbers"), ({"silent": True}, "does not answer")],
)
def test_a_missing_answer_is_an_error(how, said):
    with pytest.raises(InstrumentError, match=said):
        device(**how)[0].shot()


def test_a_simulated_instrument_is_opened_by_its_file(tmp_path):
    pytest.importorskip("pyvisa_sim")
    (tmp_path / "scope.yaml").write_text(
        'spec: "1.1"\ndevices:\n  scope:\n    eom:\n      ASRL INSTR:\n        q: "\\n"\n'
        '        r: "\\n"\n    error: ERROR\n    dialogues:\n      - q: "*OPC?"\n        r: "1"\n'
        '      - q: "CURV 1 4"\n        r: "1,-2,3,4"\n'
        "resources:\n  ASRL1::INSTR:\n    device: scope\n"
    )
    (tmp_path / "probe.toml").write_text(
        '[digitiser]\nresource = "ASRL1::INSTR"\nlibrary = "scope.yaml@sim"\nsamples = 4\n'
        'interval = 1e-8\nread = "CURV {first} {last}"\nfull_scale = 2.0\n'
    )
    probe = open_digitiser(tmp_path / "probe.toml")
    assert probe.shot().trace.tolist() == [0.5, -1.0, 1.5, 2.0]
    probe.close()
