import sys
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop.lab.drivers import labjack
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan


class LJMError(Exception):
    pass


class Library:
    """The calls of the LJM library that the driver makes, on a dictionary of registers."""

    LJMError = LJMError

    def __init__(self):
        self.registers = {"AIN0": 1.5, "AIN1": -2.0}
        self.opened, self.broken, self.stuck = None, False, False

    def openS(self, *given):
        self._check()
        self.opened = given
        return 7

    def close(self, handle):
        assert handle == 7
        self.opened = None

    def eWriteNames(self, handle, count, names, values):
        self._check()
        assert (handle, count, len(names)) == (7, len(values), count)
        if not self.stuck:
            self.registers.update(zip(names, values, strict=True))

    def eReadNames(self, handle, count, names):
        self._check()
        assert (handle, count) == (7, len(names))
        return [self.registers.get(name, 0.0) for name in names]

    def listAllS(self, *given):
        return 1, [7], [1], [470012345], [0]

    def _check(self):
        if self.broken:
            raise LJMError("LJM library error code 1227 LJME_DEVICE_NOT_FOUND")


PLAN = DevicePlan(
    "jack",
    {"model": "T7", "connection": "USB"},
    (
        DeviceChannel("x", {"channel": "DAC0"}, low=0.0, high=4.0),
        DeviceChannel("y", {"channel": "DAC1"}, low=0.0, high=4.0, rest=0.5),
    ),
    (
        DeviceChannel("a", {"channel": "AIN0", "range": 1.0}),
        DeviceChannel("b", {"channel": "AIN1"}),
    ),
    (DeviceChannel("lamp", {"channel": "FIO0"}, rest=1.0),),
)


@pytest.fixture
def library(monkeypatch):
    found = Library()
    monkeypatch.setitem(sys.modules, "labjack", SimpleNamespace(ljm=found))
    return found


def test_voltages_and_lines_are_written_read_back_and_made_safe(library):
    device = labjack.open_device(PLAN)
    assert library.opened == ("T7", "USB", "ANY")
    assert library.registers["AIN0_RANGE"] == 1.0
    device.set(np.array([1.0, 2.0]))
    device.switch({0: False})
    assert [library.registers[name] for name in ("DAC0", "DAC1", "FIO0")] == [1.0, 2.0, 0.0]
    np.testing.assert_array_equal(device.read(), [1.5, -2.0])
    device.safe()
    assert [library.registers[name] for name in ("DAC0", "DAC1", "FIO0")] == [0.0, 0.5, 1.0]
    device.close()
    assert library.opened is None
    assert labjack.found() == ["T7 470012345"]


def test_what_was_not_set_is_not_taken_for_set(library):
    device = labjack.open_device(PLAN)
    library.stuck = True
    with pytest.raises(InstrumentError, match="DAC0 of LabJack T7 ANY was set to 1 and has 0"):
        device.set(np.array([1.0, 0.0]))
    with pytest.raises(InstrumentError, match=r"DAC1 .* was set to 0.5 and has 0"):
        device.safe()
    with pytest.raises(InstrumentError, match=r"FIO0 .* was set to 1 and has 0"):
        device.switch({0: True})


def test_a_device_that_is_missing_is_one_sentence(library):
    device = labjack.open_device(PLAN)
    library.broken = True
    for act in (device.read, device.safe, lambda: labjack.open_device(PLAN)):
        with pytest.raises(InstrumentError, match=r"cannot be used: .*DEVICE_NOT_FOUND"):
            act()


def test_without_the_library_of_the_manufacturer_the_sentence_says_so():
    pytest.importorskip("labjack", reason="needs labjack-ljm: minorloop[labjack]")
    if labjack._library().ljm._staticLib is not None:
        pytest.skip("the LJM library is installed")
    with pytest.raises(InstrumentError, match="the LJM library is missing"):
        labjack.open_device(PLAN)
