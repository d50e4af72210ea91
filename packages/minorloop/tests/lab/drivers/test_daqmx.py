import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.drivers import daqmx
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan

nidaqmx = pytest.importorskip("nidaqmx", reason="needs nidaqmx: minorloop[daqmx]")


class FakeTask:
    """A task of NI-DAQmx on channels that are kept in a dictionary."""

    voltages: dict = {}  # noqa: RUF012
    broken = False
    opened = 0

    def __init__(self):
        self.channels, self.options = [], []
        self.ao_channels = self.ai_channels = self.do_channels = self
        type(self).opened += 1

    def add_ao_voltage_chan(self, name, *, min_val, max_val):
        self._add(name, (min_val, max_val))

    def add_ai_voltage_chan(self, name, *, min_val, max_val, terminal_config=None):
        self._add(name, (min_val, max_val, terminal_config))

    def add_do_chan(self, name):
        self._add(name, ())

    def _add(self, name, options):
        self.channels.append(name)
        self.options.append(options)

    def write(self, data, auto_start, timeout):
        self._check()
        assert auto_start
        values = data if len(self.channels) > 1 else [data]
        self.voltages.update(zip(self.channels, values, strict=True))

    def read(self, timeout):
        self._check()
        found = [self.voltages.get(name, 0.0) for name in self.channels]
        return found if len(found) > 1 else found[0]

    def close(self):
        type(self).opened -= 1

    def _check(self):
        if self.broken:
            raise nidaqmx.errors.DaqError("Device identifier is invalid.", -200220)


PLAN = DevicePlan(
    "card",
    {"device": "Dev1"},
    (
        DeviceChannel("x", {"channel": "ao0", "confirm": "ai7"}, low=0.0, high=4.0),
        DeviceChannel("y", {"channel": "ao1"}, low=-1.0, high=1.0, rest=0.5),
    ),
    (
        DeviceChannel("a", {"channel": "ai0", "terminals": "rse", "range": [-1, 1]}),
        DeviceChannel("b", {"channel": "ai1"}),
    ),
    (
        DeviceChannel("lamp", {"channel": "port0/line0"}, rest=1.0),
        DeviceChannel("valve", {"channel": "port0/line1"}),
    ),
)


@pytest.fixture
def task(monkeypatch):
    kind = type("FakeTaskOfATest", (FakeTask,), {"voltages": {"Dev1/ai0": 0.7, "Dev1/ai1": -3.0}})
    monkeypatch.setattr(nidaqmx, "Task", kind)
    return kind


def test_voltages_and_lines_are_written_and_made_safe(task):
    device = daqmx.open_device(PLAN)
    assert task.opened == 4
    task.voltages["Dev1/ai7"] = 1.01
    device.set(np.array([1.0, 0.2]))
    device.switch({1: True})
    known = task.voltages
    assert (known["Dev1/ao0"], known["Dev1/ao1"]) == (1.0, 0.2)
    assert (known["Dev1/port0/line0"], known["Dev1/port0/line1"]) == (True, True)
    np.testing.assert_array_equal(device.read(), [0.7, -3.0])
    known["Dev1/ai7"] = 0.0
    device.safe()
    assert (known["Dev1/ao0"], known["Dev1/ao1"]) == (0.0, 0.5)
    assert (known["Dev1/port0/line0"], known["Dev1/port0/line1"]) == (True, False)
    device.close()
    assert task.opened == 0


def test_limits_and_terminals_are_those_of_the_file(task):
    device = daqmx.open_device(PLAN)
    assert device._tasks["sources"].options == [(0.0, 4.0), (-1.0, 1.0)]
    sensors = device._tasks["sensors"].options
    assert [(low, high, kind.name) for low, high, kind in sensors] == [
        (-1.0, 1.0, "RSE"),
        (-10.0, 10.0, "DEFAULT"),
    ]


def test_a_voltage_that_is_not_there_is_not_taken_for_set(task):
    device = daqmx.open_device(PLAN)
    with pytest.raises(InstrumentError, match="ao0 of Dev1 was set to 1 and ai7 reads 0"):
        device.set(np.array([1.0, 0.2]))
    task.voltages["Dev1/ai7"] = 4.0
    with pytest.raises(InstrumentError, match="was set to 0 and ai7 reads 4"):
        device.safe()
    assert task.voltages["Dev1/port0/line0"] is True  # the lines are at rest all the same


def test_a_device_that_was_pulled_is_opened_again(task):
    device = daqmx.open_device(PLAN)
    task.broken = True
    for act in (device.read, device.safe):
        with pytest.raises(InstrumentError, match="Dev1 cannot be used: Device identifier is inv"):
            act()
    assert task.opened == 0
    task.broken = False
    assert device.read().tolist() == [0.7, -3.0]


def test_without_the_driver_of_the_manufacturer_the_sentence_says_so():
    try:
        nidaqmx.Task().close()
    except nidaqmx.errors.Error:
        with pytest.raises(InstrumentError, match="Dev1 cannot be used: Could not find"):
            daqmx.open_device(PLAN)
        assert daqmx.found() == []
    else:
        pytest.skip("the NI-DAQmx driver is installed")
