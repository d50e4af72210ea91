"""Devices with several channels, and how the channels of a bench are wired to them.

A driver is a module with ``open_device(plan)``, which returns a `Device` for a `DevicePlan`. It is
found by its entry point of the group ``minorloop.drivers``. It may have ``found()``, which lists
the devices that are there, and ``NEEDS``, its library and the extra that installs it. Numbers of a
device are those of the instrument, such as volts; conversions to the units of the bench are made
here.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, LimitError
from minorloop.lab.conversion import Conversion
from minorloop.lab.drivers.description import Parsed, parsed

__all__ = ["Device", "DeviceChannel", "DevicePlan", "Wired", "Wiring", "all_done"]


class Device(Protocol):
    """A connection with several sources, sensors and digital lines, each numbered from 0."""

    def set(self, values: FloatArray) -> None:
        """Set all sources; return only when they are on."""

    def read(self) -> FloatArray:
        """Return the readings of all sensors."""

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off by their numbers; return only when they are."""

    def safe(self) -> None:
        """Set sources and lines to rest, even if one fails; raise an error unless confirmed."""

    def close(self) -> None:
        """Close the connection."""


@dataclass(frozen=True)
class DeviceChannel:
    """A channel of a device, in the numbers of the instrument."""

    name: str
    """Of the channel of the bench."""
    keys: Mapping[str, Any]
    """What the file says of it to the driver."""
    unit: str | None = None
    """Unit that the instrument must have; None if it is not known."""
    low: float = -np.inf
    high: float = np.inf
    rest: float = 0.0
    """``low``, ``high`` and ``rest``: limits and rest of a source; rest of a line is 0 or 1."""
    rate: float = np.inf
    """Fastest change of a source in units of the bench in a second."""
    what: str = "channel"
    """``source``, ``sensor`` or ``line``."""
    bench_keys: tuple[str, ...] = ()
    """What the file may say of it to the bench."""

    def parsed(self, kind: type[Parsed]) -> Parsed:
        """Return what the file says of it to the driver as a structure.

        Raises a `ParameterError` if a key is missing, unknown, or of another type.
        """
        where = f"{self.what} {self.name!r}"
        return parsed(kind, self.keys, where, self.what, self.bench_keys)


@dataclass(frozen=True)
class DevicePlan:
    """What a driver has to open."""

    name: str
    """Of the device in the file."""
    keys: Mapping[str, Any]
    """What the file says of it to the driver."""
    sources: tuple[DeviceChannel, ...] = ()
    sensors: tuple[DeviceChannel, ...] = ()
    lines: tuple[DeviceChannel, ...] = ()
    folder: Path = Path()
    """Of the file; paths in it are relative to this."""

    @property
    def rest(self) -> FloatArray:
        """(sources,) rest, in the numbers of the instrument."""
        return np.array([wire.rest for wire in self.sources])

    @property
    def resting_lines(self) -> dict[int, bool]:
        """Rest of each line."""
        return {number: bool(wire.rest) for number, wire in enumerate(self.lines)}


@dataclass(frozen=True)
class Wired:
    """A device, and which channels of the bench are its own."""

    device: Device
    sources: tuple[int, ...] = ()
    sensors: tuple[int, ...] = ()
    """``sources`` and ``sensors``: numbers on the bench of its sources and sensors, in their order
    on the device."""
    lines: tuple[str, ...] = ()
    """Names of its lines."""


@dataclass(eq=False)
class Wiring:
    """All devices of a bench: a source, a meter and lines in one."""

    parts: Sequence[Wired]
    commands: Sequence[Conversion | None]
    readings: Sequence[Conversion | None]
    """``commands`` and ``readings``: for each source from its unit to the number of the instrument;
    for each sensor from the number of the instrument to its unit. None where both are the same."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lines."""
        return tuple(name for part in self.parts for name in part.lines)

    def set(self, value: Any) -> None:
        """Set all sources.

        Raises
        ------
        LimitError
            If a conversion does not cover an input; nothing is sent then.
        InstrumentError
            If a device fails.
        """
        values = np.atleast_1d(np.asarray(value, dtype=np.float64))
        raw = np.array([converted(each, v) for each, v in zip(self.commands, values, strict=True)])
        if not np.isfinite(raw).all():
            raise LimitError(
                f"input {values[~np.isfinite(raw)][0]:g} is not covered by the conversion of its "
                "source; nothing was applied"
            )
        for part in self.parts:
            if part.sources:
                part.device.set(raw[list(part.sources)])

    def read(self) -> FloatArray:
        """Return the outputs; NaN where a conversion does not cover a reading."""
        raw = np.full(len(self.readings), np.nan)
        for part in self.parts:
            if part.sensors:
                found = np.asarray(part.device.read(), dtype=np.float64)
                if found.shape != (len(part.sensors),):
                    raise InstrumentError(
                        f"the device gives {found.size} readings for {len(part.sensors)} sensors"
                    )
                raw[list(part.sensors)] = found
        return np.array([converted(each, v) for each, v in zip(self.readings, raw, strict=True)])

    def switch(self, values: Mapping[str, bool]) -> None:
        """Switch lines on or off by their names."""
        for part in self.parts:
            own = {n: values[name] for n, name in enumerate(part.lines) if name in values}
            if own:
                part.device.switch(own)

    def safe(self) -> None:
        """Make all devices safe, even if one fails; raise the first error."""
        all_done(part.device.safe for part in self.parts)

    def close(self) -> None:
        """Close all connections."""
        for part in self.parts:
            with suppress(Exception):
                part.device.close()


def converted(conversion: Conversion | None, value: float) -> float:
    """Return a converted number; the number itself without a conversion."""
    return value if conversion is None else float(conversion.convert(value))


def all_done(steps: Iterable[Callable[[], None]]) -> None:
    """Do every step, even if an earlier one fails; then raise the first error.

    Parameters
    ----------
    steps : iterable of callable
    """
    first: Exception | None = None
    for step in steps:
        try:
            step()
        except Exception as error:
            first = first or error
    if first is not None:
        raise first
