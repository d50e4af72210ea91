from types import SimpleNamespace

import numpy as np
import pytest

from minorloop import InstrumentError, ParameterError, SafetyError
from minorloop.lab.drivers import bench_file
from minorloop.lab.drivers.bench_file import open_bench
from minorloop.lab.wrapped_actuator import single_channel

BENCH = """
tick = 0.001
safe_within = 0.001
[devices.one]
driver = "fake"
port = 3
[[sources]]
name = "voltage"
unit = "V"
device = "one"
low = -1.0
high = 1.0
rest = 0.5
conversion = {linear = [1000.0, 5.0], reading = "mV"}
pin = 7
[[sensors]]
name = "curvature"
unit = "1/m"
device = "one"
low = -50.0
high = 50.0
conversion = {laser = [20.0, 5.0], reading = "mm"}
[[sensors]]
name = "force"
unit = "N"
device = "one"
of = "voltage"
conversion = {polynomial = [0.0, 1.0, 1.0]}
[[lines]]
name = "valve"
device = "one"
rest = true
"""


class Recorder:
    """A device that keeps what it is asked to do."""

    def __init__(self):
        self.done, self.readings = [], [19.9, 2.0]

    def set(self, values):
        self.done.append(values.tolist())

    def read(self):
        return np.array(self.readings)

    def switch(self, values):
        self.done.append(dict(values))

    def safe(self):
        self.done.append("safe")

    def close(self):
        self.done.append("closed")


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Opens a bench of a text with one driver, which notes its plan."""
    device, plans = Recorder(), []

    def open_device(plan):
        plans.append(plan)
        return device

    monkeypatch.setattr(bench_file, "registered", lambda group: {"fake": group})
    monkeypatch.setattr(
        bench_file, "loaded", lambda point, name: SimpleNamespace(open_device=open_device)
    )

    def opened(text=BENCH, name="bench.toml"):
        (tmp_path / name).write_text(text)
        return open_bench(tmp_path / name), device, plans

    return opened


def test_channels_are_converted_limited_and_wired_as_the_file_says(opened):
    bench, device, (plan,) = opened()
    assert device.done == ["safe"]
    assert [str(channel) for channel in bench.outputs] == ["curvature [1/m]", "force [N]"]
    assert (bench.measures, bench.lines, bench.rest.tolist()) == ((0, 0), ("valve",), [0.5])
    (source,) = plan.sources
    assert (source.low, source.high, source.rest) == (-995.0, 1005.0, 505.0)
    assert (source.unit, source.keys, plan.keys) == ("mV", {"pin": 7}, {"port": 3})
    assert [sensor.unit for sensor in plan.sensors] == ["mm", None]
    assert plan.resting_lines == {0: True}
    y = bench.exchange(0.25)
    assert device.done[-1] == [255.0]
    assert y == pytest.approx([2 * 1e-4 / (1e-4**2 + 5e-3**2), 6.0])
    bench.switch({"valve": False})
    assert device.done[-1] == {0: False}
    with pytest.raises(ParameterError, match="there is no line 'lamp'; there is valve"):
        bench.switch({"lamp": True})
    bench.close()
    assert device.done[-1] == "closed"


def test_a_bench_that_does_not_confirm_that_it_is_safe_is_not_opened(opened, monkeypatch):
    monkeypatch.setattr(Recorder, "safe", lambda self: 1 / 0)
    with pytest.raises(SafetyError, match="may still be on, switch it off by hand"):
        opened()


def leave(plan):
    raise SystemExit(7)


@pytest.mark.parametrize(
    ("open_device", "said"),
    [(lambda plan: {}["port"], "KeyError: 'port'"), (leave, "SystemExit: 7")],
)
def test_a_driver_that_fails_is_one_sentence(opened, monkeypatch, open_device, said):
    def loaded(point, name):
        return SimpleNamespace(open_device=open_device)

    monkeypatch.setattr(bench_file, "loaded", loaded)
    with pytest.raises(InstrumentError, match=f"device 'one' cannot be opened: {said}"):
        opened()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('driver = "fake"', 'driver = "usb"', "has driver 'usb'; the drivers are fake"),
        ('device = "one"\nlow = -1.0', 'device = "two"\nlow = -1.0', "'two'; the devices are one"),
        ("rest = 0.5", "rest = 1.5", r"rest 1.5 is beyond the limits \[-1, 1\] of voltage"),
        ("low = -1.0\nhigh = 1.0", "low = 1.0\nhigh = -1.0", "give low below high"),
        ('name = "force"', 'name = "curvature"', "two sensors 'curvature'"),
        ('of = "voltage"', 'of = "current"', "is of 'current'; the sources are voltage"),
        ('of = "voltage"', "", "sensor 'force' has no source; name it with the key of"),
        ("linear = [1000.0, 5.0]", "linear = [0.0, 5.0]", "the conversion of voltage: .*constant"),
        ("linear = [1000.0, 5.0],", "", "conversion of voltage has nothing; give one of linear"),
        ("tick = 0.001", "tock = 1", "unknown field `tock`; the fields there are devices, sou"),
    ],
)
def test_files_that_describe_no_bench(opened, old, new, sentence):
    assert old in BENCH
    with pytest.raises(ParameterError, match=sentence) as found:
        opened(BENCH.replace(old, new, 1))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    "conversion",
    ["polynomial = [0.0, 1.0, -1.0]", "polynomial = [0.0, 0.0, 1.0]", 'table = "turns.csv"'],
)
def test_a_source_whose_conversion_turns_between_its_limits_is_refused(
    opened, tmp_path, conversion
):
    (tmp_path / "turns.csv").write_text("u [V],sent [mV]\n-1,0\n0.5,9\n1,1\n")
    text = BENCH.replace("linear = [1000.0, 5.0]", conversion)
    sentence = r"of source 'voltage' is not monotone over its limits \[-1, 1\]: it sends .*; give"
    with pytest.raises(ParameterError, match=sentence):
        opened(text)


def test_a_bench_may_have_no_sensors(opened):
    bench, _, _ = opened(BENCH.partition("[[sensors]]")[0])
    assert bench.outputs == ()
    assert bench.exchange([0.5]).shape == (0,)
    with pytest.raises(ParameterError, match="the actuator has no output; give it one"):
        single_channel(bench)
