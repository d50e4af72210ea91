from importlib.metadata import EntryPoint

import pytest

from minorloop.errors import ParameterError
from minorloop.registry import loaded, registered


def test_the_drivers_of_bench_files_are_registered_and_can_be_loaded():
    drivers = registered("minorloop.drivers")
    assert set(drivers) >= {"visa", "serial", "daqmx", "labjack", "modbus"}
    for name, point in drivers.items():
        assert callable(loaded(point, name).open_device)


@pytest.mark.parametrize(
    ("value", "sentence"),
    [
        ("minorloop_no_such_module:x", "stage:a needs minorloop_no_such_module, which is not inst"),
        ("minorloop.errors:Nothing", "the driver of stage:a cannot be loaded: .*Nothing"),
    ],
)
def test_an_entry_point_that_leads_nowhere_is_refused(value, sentence):
    with pytest.raises(ParameterError, match=sentence):
        loaded(EntryPoint("stage", value, "minorloop.actuators"), "stage:a")
