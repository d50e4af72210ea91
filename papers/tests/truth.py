"""Hide what is private in simulated actuators: parameters, state, output without noise."""

import sys
from contextlib import contextmanager
from pathlib import Path

from minorloop.twins.simulated_actuator import SimulatedPlant


@contextmanager
def hidden_truth():
    """Fail where anything but a twin reads the truth of one."""

    def read(twin, name):
        hidden = name.startswith("_") and not name.startswith("__")
        reader = Path(sys._getframe(1).f_code.co_filename)
        if hidden and "twins" not in reader.parts:
            raise AssertionError(f"{reader} reads {name} of a twin")
        return object.__getattribute__(twin, name)

    SimulatedPlant.__getattribute__ = read
    try:
        yield
    finally:
        del SimulatedPlant.__getattribute__
