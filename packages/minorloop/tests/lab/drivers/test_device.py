import sys
from importlib import import_module

import numpy as np
import pytest

from minorloop.errors import InstrumentError, LimitError, MissingExtraError, ParameterError
from minorloop.lab.conversion import CalibrationTable, linear
from minorloop.lab.drivers.device import DeviceChannel, DevicePlan, Wired, Wiring, all_done


class FakeDevice:
    def __init__(self, readings=(), broken=False):
        self.readings, self.broken, self.done = np.array(readings), broken, []

    def set(self, values):
        self.done.append(values.tolist())

    def read(self):
        return self.readings

    def switch(self, values):
        self.done.append(dict(values))

    def safe(self):
        self.done.append("safe")
        if self.broken:
            raise InstrumentError("no answer")

    def close(self):
        self.done.append("closed")
        raise OSError


def wired(**options):
    first, second = FakeDevice([1.0], **options), FakeDevice([2.0, 3.0])
    parts = [
        Wired(first, (1,), (2,), ("valve",)),
        Wired(second, (0, 2), (0, 1), ("lamp 1", "lamp 2")),
    ]
    commands = [None, linear(10.0, 1.0), CalibrationTable(readings=(0, 1), values=(0, 5))]
    readings = [None, linear(2.0), linear(100.0, -1.0)]
    return Wiring(parts, commands, readings), first, second


def test_each_channel_goes_to_its_device_in_the_numbers_of_the_instrument():
    wiring, first, second = wired()
    wiring.set(np.array([0.5, 0.2, 0.4]))
    assert first.done == [[3.0]]
    assert second.done == [[0.5, 2.0]]
    np.testing.assert_array_equal(wiring.read(), [2.0, 6.0, 99.0])
    assert wiring.names == ("valve", "lamp 1", "lamp 2")
    wiring.switch({"lamp 2": True, "lamp 1": False})
    assert (first.done[1:], second.done[1:]) == ([], [{0: False, 1: True}])


def test_an_input_that_a_conversion_does_not_cover_is_not_sent_to_any_device():
    wiring, first, second = wired()
    with pytest.raises(LimitError, match=r"input 1.5 is not covered"):
        wiring.set(np.array([0.5, 0.2, 1.5]))
    assert first.done == second.done == []


def test_all_are_made_safe_and_closed_even_if_one_fails():
    wiring, first, second = wired(broken=True)
    with pytest.raises(InstrumentError, match="no answer"):
        wiring.safe()
    wiring.close()
    assert first.done == second.done == ["safe", "closed"]


def test_the_first_error_of_several_steps_is_raised_when_all_were_done():
    done = []

    def step(error):
        done.append(error)
        raise error

    errors = OSError("a"), ValueError("b")
    with pytest.raises(OSError, match="a"):
        all_done([lambda: step(errors[0]), lambda: step(errors[1])])
    assert tuple(done) == errors


DRIVERS = {
    "daqmx": ("nidaqmx", {"device": "Dev1"}, {"channel": "ao0"}, {"channel": "port0/line0"}),
    "labjack": ("labjack", {}, {"channel": "DAC0"}, {"channel": "FIO0"}),
    "modbus": ("pymodbus.client", {"host": "127.0.0.1", "port": 1}, {"register": 0}, {"coil": 3}),
}


@pytest.mark.parametrize("name", DRIVERS)
@pytest.mark.parametrize("wrong", ["device", "source", "sensor", "line"])
def test_unknown_keys_are_refused_before_anything_is_opened(name, wrong):
    library, *known = DRIVERS[name]
    pytest.importorskip(library, reason=f"needs {library}")
    keys, source, line = ({**each} for each in known)
    parts = {"device": keys, "source": source, "sensor": {**source}, "line": line}
    parts[wrong]["bit"] = 3
    channels = [
        (DeviceChannel("one", parts[what], what=what),) for what in ("source", "sensor", "line")
    ]
    driver = import_module(f"minorloop.lab.drivers.{name}")
    with pytest.raises(ParameterError, match=f"{wrong} 'one' does not .*`bit`; the fields there"):
        driver.open_device(DevicePlan("one", parts["device"], *channels))


@pytest.mark.parametrize("name", DRIVERS)
def test_without_the_library_of_a_driver_its_extra_is_named(name, monkeypatch):
    monkeypatch.setitem(sys.modules, DRIVERS[name][0], None)
    driver = import_module(f"minorloop.lab.drivers.{name}")
    with pytest.raises(MissingExtraError, match=rf"minorloop\[{name}\]"):
        driver.open_device(DevicePlan("one", DRIVERS[name][1]))
    assert getattr(driver, "found", list)() == [] or name != "labjack"
