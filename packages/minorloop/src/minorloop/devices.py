"""List actuators and other devices, and check that they answer."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from minorloop.connect import addresses, opened
from minorloop.errors import MinorloopError, SafetyError
from minorloop.lab.actuator import Actuator
from minorloop.lab.drivers.bench_file import DRIVERS
from minorloop.registry import loaded, registered

_FILES = ".toml", ".json"
"""Endings of bench files, whose addresses may omit ``bench:``."""
_OTHERS = "minorloop.devices"
"""Entry points of other devices than actuators: modules with ``found()``, which yields rows, and
``probed(address)``, which returns a row, or None for an address of another kind."""


@dataclass(frozen=True)
class DeviceRow:
    """A channel of an actuator, a driver, or another device."""

    address: str
    what: str
    state: str
    error: bool = False


def present() -> Iterator[DeviceRow]:
    """Yield the known addresses, the drivers with their devices, and devices of other kinds."""
    for each in addresses():
        named = each.startswith("twin:")
        yield DeviceRow(
            each, "actuator", "simulated" if named else "give it with a name to probe it"
        )
    for name, point in sorted(registered(DRIVERS).items()):
        driver = loaded(point, name)
        library, extra = getattr(driver, "NEEDS", (None, None))
        if library is not None and find_spec(library) is None:
            yield DeviceRow(name, "driver", f"pip install 'minorloop[{extra}]' brings {library}")
            continue
        yield DeviceRow(name, "driver", "installed")
        for device in getattr(driver, "found", list)():
            yield DeviceRow(device, f"device for {name}", "there; not opened")
    for name, point in registered(_OTHERS).items():
        yield from loaded(point, name).found()


def probed(address: str) -> Iterator[DeviceRow]:
    """Yield another device, or the channels of an actuator, made safe and read, or the error.

    ``address``: as in `minorloop.connect`, a bench file, or the address of another device.
    """
    if Path(address).suffix in _FILES and ":" not in address:
        address = f"bench:{address}"
    for name, point in registered(_OTHERS).items():
        if (row := loaded(point, name).probed(address)) is not None:
            yield row
            return
    rows: list[DeviceRow] = []
    try:
        with opened(address) as plant:
            rows = [DeviceRow(address, "warning", said) for said in getattr(plant, "warnings", ())]
            rows += _channels(address, plant)
            plant.safe()
    except MinorloopError as error:
        said = str(error)
        if isinstance(error, SafetyError) and "by hand" not in said:
            said = f"the actuator may still be on, switch it off by hand: {said}"
        yield DeviceRow(address, "actuator", said, error=True)
        return
    yield from rows


def _channels(address: str, plant: Actuator) -> Iterator[DeviceRow]:
    """Yield the channels of an actuator, at rest."""
    plant.safe()
    rest = np.zeros(len(plant.inputs))
    rest[:] = getattr(plant, "rest", [min(max(0.0, c.low), c.high) for c in plant.inputs])
    y = np.atleast_1d(plant.exchange(rest if rest.size > 1 else float(rest[0])))
    serial = getattr(plant, "serial", None)
    if serial is not None:
        yield DeviceRow(address, "serial number", str(serial))
    for channel, value in zip(plant.inputs, rest, strict=True):
        limits = f"{channel.low:g} to {channel.high:g}"
        if np.isfinite(channel.rate):
            limits += f", {channel.rate:g} a second"
        yield DeviceRow(address, f"input {channel}, {limits}", f"safe at {value:g}")
    for channel, value in zip(plant.outputs, y, strict=True):
        yield DeviceRow(address, f"output {channel}", f"reads {value:.6g}")
    for name in getattr(plant, "lines", ()):
        yield DeviceRow(address, f"line {name}", "at rest")
