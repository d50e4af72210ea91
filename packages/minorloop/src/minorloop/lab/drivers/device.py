"""Interfaces of drivers and benches: sources, meters, devices with several channels, and wiring.

A driver is a module with ``open_device(plan)``, which returns a `Device` for a `DevicePlan`. It is
found by its entry point of the group ``minorloop.drivers``. It may have ``found()``, which lists
connected devices, and ``NEEDS``, its library and the extra that installs it. Numbers of a device
are those of the instrument, such as volts; `Wiring` converts them to the units of the bench.
"""

import math
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import msgspec
import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, LimitError, ParameterError, all_done
from minorloop.lab.actuator import Value
from minorloop.lab.conversion import Conversion


class Source(Protocol):
    """Sets the inputs of a plant."""

    def set(self, value: Any) -> None:
        """Apply inputs, a number for one, an array for several; return only when they are on."""

    def safe(self) -> None:
        """Go to a safe state; raise an error unless this is confirmed."""


class Meter(Protocol):
    """Reads the outputs of a plant."""

    def read(self) -> Value:
        """Return the outputs now, a number for one, an array for several."""


class Lines(Protocol):
    """Digital lines, such as for lamps and valves."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lines."""

    def switch(self, values: Mapping[str, bool]) -> None:
        """Switch lines on or off by their names; return only when they are."""


class Closable(Protocol):
    """An object that a bench closes at its end."""

    def close(self) -> None:
        """Close the connection."""


class Device(Closable, Protocol):
    """A connection with several sources, sensors and digital lines, each numbered from 0.

    It may have ``warnings``, sentences that the user of the bench must know.
    """

    def set(self, values: FloatArray) -> None:
        """Set all sources; return only when they are on."""

    def read(self) -> FloatArray:
        """Return the readings of all sensors."""

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off by their numbers; return only when they are."""

    def safe(self) -> None:
        """Set sources and lines to rest, even if one fails; raise an error unless confirmed."""


class Section(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Part of a bench file; unknown keys and NaN are refused."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if isinstance(value, float) and math.isnan(value):
                raise ValueError(f"{name} is nan; give a number")


_Parsed = TypeVar("_Parsed", bound=Section)


def parsed(
    kind: type[_Parsed],
    values: Mapping[str, Any],
    where: object,
    what: str = "bench",
    also: Sequence[str] = (),
) -> _Parsed:
    """Return part of a file as its structure.

    Raises a `ParameterError` if a key is missing, unknown, or of another type.

    ``kind``: the structure; ``values``: keys and values of the part; ``where``: name of the part,
    for a message; ``what``: what the part describes, for a message; ``also``: keys of the part that
    are read elsewhere, for a message.
    """
    try:
        return msgspec.convert(values, kind)
    except ValueError as error:
        allowed = _allowed(kind, error, also)
        raise ParameterError(f"{where} does not describe a {what}: {error}{allowed}") from None


def _allowed(kind: Any, error: Exception, also: Sequence[str]) -> str:
    """Return a list of the fields, if the error is an unknown field."""
    found = re.search(r"unknown field `.*?`(?: - at `\$\.(\w+)`)?", str(error))
    if not found:
        return ""
    if found[1]:
        (part,) = [each.type for each in msgspec.structs.fields(kind) if each.name == found[1]]
        kinds = [part, *getattr(part, "__args__", ())]
        kind = next((each for each in kinds if hasattr(each, "__struct_fields__")), kind)
        also = ()
    fields = msgspec.structs.fields(kind)
    required = sorted(each.name for each in fields if each.required)
    others = [each.name for each in fields if not each.required]
    return f"; the fields there are {', '.join([*also, *required, *others])}"


@dataclass(frozen=True)
class DeviceChannel:
    """A channel of a device, in the numbers of the instrument."""

    name: str
    """Name of the channel of the bench."""
    keys: Mapping[str, Any]
    """Keys of the channel in the file for the driver."""
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
    """Keys that the channel may have for the bench."""

    def parsed(self, kind: type[_Parsed]) -> _Parsed:
        """Return the keys for the driver as a structure, as `parsed` does."""
        where = f"{self.what} {self.name!r}"
        return parsed(kind, self.keys, where, self.what, self.bench_keys)


@dataclass(frozen=True)
class DevicePlan:
    """Device that a driver has to open."""

    name: str
    """Name of the device in the file."""
    keys: Mapping[str, Any]
    """Keys of the device in the file for the driver."""
    sources: tuple[DeviceChannel, ...] = ()
    sensors: tuple[DeviceChannel, ...] = ()
    lines: tuple[DeviceChannel, ...] = ()
    folder: Path = Path()
    """Folder of the file; paths in it are relative to this."""

    @property
    def rest(self) -> FloatArray:
        """(sources,) rest, in the numbers of the instrument."""
        return np.array([wire.rest for wire in self.sources])

    @property
    def resting_lines(self) -> dict[int, bool]:
        """Rest of each line."""
        return {number: bool(wire.rest) for number, wire in enumerate(self.lines)}


class PlannedDevice:
    """The base of drivers: it parses the keys of a device into structures, and makes it safe.

    A driver states its structures, and defines the methods of a `Device` other than ``safe``.

    Raises a `ParameterError` if a key is missing, unknown, or of another type; a
    `MissingExtraError` if the library of the driver is not installed; an `InstrumentError` if there
    is no such device, it does not answer, or the library of the manufacturer is missing.
    """

    settings: ClassVar[type[Section]] = Section
    source: ClassVar[type[Section]] = Section
    sensor: ClassVar[type[Section]] = Section
    line: ClassVar[type[Section]] = Section
    name = ""
    """Name of the device in messages."""

    def __init__(self, plan: DevicePlan) -> None:
        self._plan = plan
        self._how: Any = parsed(self.settings, plan.keys, f"device {plan.name!r}", "device")
        self._sources: list[Any] = [wire.parsed(self.source) for wire in plan.sources]
        self._sensors: list[Any] = [wire.parsed(self.sensor) for wire in plan.sensors]
        self._lines: list[Any] = [wire.parsed(self.line) for wire in plan.lines]

    def set(self, values: FloatArray) -> None:
        """Set all sources; return only when they are on."""
        raise NotImplementedError

    def switch(self, values: Mapping[int, bool]) -> None:
        """Switch lines on or off by their numbers; return only when they are."""
        raise NotImplementedError

    def safe(self) -> None:
        """Set sources and lines to rest, even if one fails; raise an error unless confirmed."""
        rest, lines = self._plan.rest, self._plan.resting_lines
        all_done([lambda: self.set(rest), lambda: self.switch(lines)])

    def _confirm(
        self, place: object, wanted: float, found: float, tolerance: float = 0.0, has: str = "has"
    ) -> None:
        """Raise an error if a reading of a source or line differs from its set value."""
        if not abs(found - wanted) <= tolerance:  # also refuses NaN
            raise InstrumentError(
                f"{place} of {self.name} was set to {float(wanted):g} and {has} {found:g}"
            )

    def _failed(self, error: object) -> InstrumentError:
        """Return the error to raise for an error of the library."""
        said = " ".join(str(error).split())
        return InstrumentError(f"{self.name} cannot be used: {said[:200]}")


@dataclass(frozen=True)
class Wired:
    """A device, and its channels of the bench."""

    device: Device
    sources: tuple[int, ...] = ()
    sensors: tuple[int, ...] = ()
    """``sources`` and ``sensors``: numbers on the bench of its sources and sensors, in their order
    on the device."""
    lines: tuple[str, ...] = ()
    """Names of the lines of the device."""


@dataclass(eq=False)
class Wiring:
    """All devices of a bench: a source, a meter and lines in one."""

    parts: Sequence[Wired]
    commands: Sequence[Conversion | None]
    readings: Sequence[Conversion | None]
    """``commands`` and ``readings``: conversions of each source from its unit to the number of the
    instrument, and of each sensor from the number of the instrument to its unit. None if both are
    the same."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the lines."""
        return tuple(name for part in self.parts for name in part.lines)

    def set(self, value: Any) -> None:
        """Set all sources.

        Raises a `LimitError` if a conversion does not cover an input, and nothing is sent then; an
        `InstrumentError` if a device fails.
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

    def written(self, u: float) -> float:
        """Return the input that the only source writes for ``u``; nothing is applied."""
        if len(self.commands) != 1 or self.commands[0] is not None:
            return u
        (device,) = (part.device for part in self.parts if part.sources)
        written = getattr(device, "written", None)
        return u if written is None else float(written(u))

    def read(self) -> FloatArray:
        """Return the outputs; NaN if a conversion does not cover a reading."""
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
