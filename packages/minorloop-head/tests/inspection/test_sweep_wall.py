"""A sweep keeps each burst at once, and resumes from any line of its journal."""

import base64
import json
import math
import signal
from contextlib import contextmanager
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import OutputError, RecordError
from minorloop_head.control.head import head_control
from minorloop_head.inspection import InspectedHead, Water, sweep, sweep_wall
from minorloop_head.inspection.journal import plain
from minorloop_head.inspection.lines import BurstLine
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.wall_echoes import SweptBurst
from scripted_inspection import TRACE, VIEW
from wires import identified

BEGUN = {"actuator": "twin:pipe", "specimen": 1000, "seed": 1000, **Water().noted()}
AROUND, ALONG = (0.0, math.pi), (19e-3, 19.5e-3)


class Script:
    """A head that ends each sweep at once; a test changes ``run``, which is given the area."""

    def __init__(self, folder):
        self.folder, self.safe, self.told = folder, False, []
        self.run = lambda area, told: setattr(area, "trouble", "stopped")

    @contextmanager
    def opened(self, logged):
        plant = SimpleNamespace(safe=lambda: setattr(self, "safe", True))
        control = head_control("observer", (identified().model,) * 2)
        rig = SimpleNamespace(t=0.0, calibration=VIEW, control=control, plant=plant)
        rig.run = lambda *given: self.run(*given)
        yield rig

    def sweep(self, along=ALONG, *, resume=True):
        head = InspectedHead({"head": "H-07", **BEGUN}, VIEW, self.opened)
        told = lambda text, *, kept=False: self.told.append(text)  # noqa: E731
        return sweep(head, self.folder, AROUND, along, resume=resume, told=told)

    @property
    def file(self):
        return self.folder / "journal.jsonl"

    def write(self, bursts=3, **changes):
        """Write the journal of a sweep that was cut off, with changes of its second burst."""
        burst = Burst(TRACE, 1e-8, np.array([-0.35, -0.27]), 4, 4, 0.005)
        area = {"around [deg]": [0.0, 180.0], "along [mm]": [19.0, 19.5]}
        lines = [{"what": "begin", "t": 0.0, **BEGUN, **area, "began": "2026-01-01T00:00:00Z"}]
        for n in range(bursts):
            phi = 0.1 + 0.02 * n
            spot = np.array([phi, 19.1e-3, 8e-3])
            one = SweptBurst(10.0 + n, np.array([19.2e-3, phi - 3.0]), spot, burst)
            lines.append(plain(BurstLine(t=1.0 + n, **BurstLine.values(one))))
        lines[2].update(changes)
        self.folder.mkdir()
        self.file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))


@pytest.fixture
def script(tmp_path, monkeypatch):
    monkeypatch.setattr(sweep_wall.ProbeSweep, "sweep", lambda _, area: area)
    return Script(tmp_path / "swept")


@pytest.fixture
def unreported(monkeypatch):
    monkeypatch.setattr(sweep_wall, "written", lambda *given: None)


@pytest.fixture
def signals_as_before():
    """A command that a signal ends ignores later ones, as its process exits."""
    before = {each: signal.getsignal(each) for each in signal.valid_signals() if each < 30}
    yield
    for each, handler in before.items():
        if handler is not None and signal.getsignal(each) is not handler:
            signal.signal(each, handler)


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("signals_as_before")
def test_an_interrupted_sweep_is_kept(script, ending):
    def interrupted(area, told):
        area.stage, area.progress = "line", 0.25
        told()
        signal.raise_signal(ending)

    script.run = interrupted
    with pytest.raises(KeyboardInterrupt) as ended:
        script.sweep(resume=False)
    (note,) = ended.value.__notes__
    assert note == f"0 finds in 0 bursts on 0 lines; interrupted; kept in {script.folder}"
    kept = {each.name for each in script.folder.iterdir()}
    assert kept == {"journal.jsonl", "findings.csv", "findings.json", "report.html"}
    content = json.loads((script.folder / "findings.json").read_text())
    assert content.pop("began") == json.loads(script.file.read_text().splitlines()[0])["began"]
    assert content == {
        **BEGUN,
        "head": "H-07",
        "around [deg]": [0.0, 180.0],
        "along [mm]": [19.0, 19.5],
        "ended": "interrupted",
        "bursts": 0,
        "lines": 0,
        "mapped": 0.0,
        "water line below the axis [mm]": None,
        "water level": "not seen",
        "findings": [],
    }
    page = (script.folder / "report.html").read_text()
    assert all(words in page for words in ("H-07", "0 to 180 degrees", "20 C", "began"))
    assert script.safe


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"interval": 0.0}, "has 0.0 as 'interval', which must be 1e-09 to 5e-08"),
        ({"spot": [1e300, 0, 0]}, "has [1e+300, 0.0, 0.0] as 'spot', which must be -6.283 to"),
        ({"angles": [math.nan, 0.0]}, "has [nan, 0.0] as 'angles'"),
        ({"fired": 10**400}, "is incomplete: Number out of range"),
        ({"shots": [16, 8]}, "has (16, 8) as 'shots', which must be no more used than fired"),
        ({"trace": base64.b64encode(bytes(24)).decode()}, "has 3 as 'samples of the trace'"),
        ({"trace": base64.b64encode(np.full(2000, 7.0)).decode()}, "has 7.0 as 'trace', which"),
        ({"fired": 10.0, "spot": [0.1, 19.1e-3, 8e-3]}, "has 'a trace again' as 'trace', which"),
    ],
)
def test_a_line_with_an_impossible_value_is_refused_before_a_shot(script, changes, words):
    script.run = lambda *_: pytest.fail("the sweep began")
    script.write(**changes)
    before = script.file.read_bytes()
    with pytest.raises(RecordError) as refused:
        script.sweep()
    assert f"line 3 of {script.file} {words}" in str(refused.value)
    assert "delete this line and all lines after it" in str(refused.value)
    assert script.file.read_bytes() == before
    assert [each.name for each in script.folder.iterdir()] == [script.file.name]


@pytest.mark.usefixtures("unreported")
def test_it_goes_on_from_any_line_with_the_bursts_before(script):
    """Whatever the next line has; the journal as it was is kept beside it."""
    script.write(5)
    lines = script.file.read_bytes().split(b"\n")
    pieces = (lines[3][:300], b"\xff" + lines[3], b"\0" * 400, b"12", b"", b"[" * 10**5)
    for number, piece in enumerate(pieces):
        damaged = b"\n".join([*lines[:3], piece, *lines[4:]])
        script.file.write_bytes(damaged)
        assert script.sweep().content["bursts"] == 2
        copy = script.folder / f"journal.damaged{number or ''}.jsonl"
        assert copy.read_bytes() == damaged
        said = f"line 4 of {script.file} is damaged; kept before it: 2 bursts"
        assert said in script.told[-2]
        assert str(copy) in script.told[-2]
        again = script.file.read_bytes().split(b"\n")
        assert again[:3] == lines[:3]
        assert [json.loads(each)["what"] for each in again[3:-1]] == ["resume", "end"]
    script.file.write_bytes(b"\n".join([b"{", *lines[1:]]))
    with pytest.raises(RecordError, match="is not the journal"):
        script.sweep()


@pytest.mark.usefixtures("unreported")
def test_a_burst_without_a_trace_is_resumed(script):
    """Its numbers are not known, as `average` returns it."""
    nothing = {"interval": 0.0, "noise": math.nan, "angles": [math.nan] * 2, "trace": ""}
    script.write(verdict="dropout", spot=[math.nan] * 3, **nothing)
    assert script.sweep().content["bursts"] == 3


def test_a_full_disk_ends_it_in_one_sentence_once_the_head_is_safe(script, full_disk):
    """What was fired before is kept."""

    def swept(area, told):
        full_disk()
        area.bursts.append(area.bursts[-1])
        told()

    script.run = swept
    script.write()
    with pytest.raises(OutputError, match="No space left on device; free some space") as ended:
        script.sweep()
    assert "--resume goes on from there" in ended.value.__notes__[-1]
    assert script.safe
    lines = [json.loads(line)["what"] for line in script.file.read_text().splitlines()]
    assert lines == ["begin", *["burst"] * 3, "resume"]
