"""Open a bench with several channels from a file: ``bench:head.toml``.

::

    tick = 0.04                  # s
    serial = "H-07"              # of the plant

    [devices.board]
    driver = "serial"            # visa, serial, daqmx, labjack, modbus, or one of another package
    resource = "ASRL/dev/ttyACM0::INSTR"

    [[sources]]
    name = "pan current"
    unit = "A"
    device = "board"
    low = 0.0
    high = 0.4
    rate = 10.0                  # A/s
    rest = 0.0                   # the safe value
    channel = 0                  # this and other keys are for the driver

    [[sensors]]
    name = "pan"
    unit = "deg"
    device = "board"
    of = "pan current"           # the source that it belongs to
    low = -10.0
    high = 90.0
    conversion = {linear = [18.0, -9.0], reading = "V"}
    channel = 0

    [[lines]]
    name = "led 1"
    device = "board"
    rest = true
    channel = 0

A conversion is ``linear = [gain, offset]``, ``polynomial = [c0, c1, ...]``, ``table = "FILE"`` or
``laser = [d0, h0]``. That of a sensor goes from the number of the instrument to the unit of the
sensor, that of a source from the unit of the source to the number of the instrument, and only rises
or only falls between the limits of the source. ``reading`` is the unit of the instrument. The other
keys are those of the driver; see its module in ``minorloop.lab.drivers``. A file with ``input`` and
``output`` describes one channel, as `minorloop.lab.drivers.visa` says.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minorloop.errors import InstrumentError, MinorloopError, ParameterError
from minorloop.files import PathLike
from minorloop.lab.actuator import Channel
from minorloop.lab.conversion import (
    CalibrationPolynomial,
    CalibrationTable,
    Conversion,
    LaserCurvature,
    linear,
)
from minorloop.lab.drivers.bench import Bench, Clock, check_rest
from minorloop.lab.drivers.description import Section, parsed, read_description, relevant
from minorloop.lab.drivers.device import Device, DeviceChannel, DevicePlan, Wired, Wiring, converted
from minorloop.registry import loaded, registered

__all__ = ["DRIVERS", "open_bench"]

DRIVERS = "minorloop.drivers"
"""Group of the entry points of drivers."""

_ROUNDING = 1e-9
"""Share of the largest number sent that a conversion may go back: rounding, far below the
resolution of any instrument."""


class _ConversionRow(Section, kw_only=True):
    linear: tuple[float, float] | None = None
    polynomial: tuple[float, ...] | None = None
    table: str | None = None
    laser: tuple[float, float] | None = None
    reading: str | None = None


class _SourceRow(Section, kw_only=True):
    name: str
    device: str
    low: float
    high: float
    unit: str = ""
    rate: float = float("inf")
    rest: float = 0.0
    conversion: _ConversionRow | None = None


class _SensorRow(Section, kw_only=True):
    name: str
    device: str
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")
    of: str | None = None
    conversion: _ConversionRow | None = None


class _LineRow(Section, kw_only=True):
    name: str
    device: str
    rest: bool = False


class _BenchFile(Section, kw_only=True):
    devices: dict[str, dict[str, Any]]
    sources: list[dict[str, Any]]
    sensors: list[dict[str, Any]] = msgspec.field(default_factory=list)
    lines: list[dict[str, Any]] = msgspec.field(default_factory=list)
    serial: str | None = None
    tick: float = 0.05
    safe_within: float = 10.0


class _Rows:
    """Channels of one kind: what the bench knows of them, and what is left for their drivers."""

    def __init__(self, kind: type[Section], rows: Sequence[Mapping[str, Any]], what: str) -> None:
        self.known: list[Any] = []
        self.keys: list[dict[str, Any]] = []
        names = kind.__struct_fields__
        self.named: dict[str, Any] = {"what": what, "bench_keys": names}
        for number, row in enumerate(rows, 1):
            own = {key: value for key, value in row.items() if key in names}
            where = f"{what} {row.get('name', number)!r}"
            self.known.append(parsed(kind, own, where, what))
            self.keys.append({key: value for key, value in row.items() if key not in names})
        said = [each.name for each in self.known]
        for name in said:
            if said.count(name) > 1:
                raise ParameterError(f"there are two {what}s {name!r}; give each another name")

    def of(self, device: str) -> tuple[int, ...]:
        """Return the numbers of the channels of a device."""
        return tuple(k for k, each in enumerate(self.known) if each.device == device)


def open_bench(path: PathLike, *, clock: Clock | None = None) -> Bench:
    """Return the actuator that a file describes; make it safe and read it first.

    Parameters
    ----------
    path : str or path
        The file, TOML or JSON.
    clock : Clock, optional
        The clock of the machine if not given.

    Raises
    ------
    ParameterError
        If the file cannot be read, or does not describe a bench.
    MissingExtraError
        If the library of a driver is not installed.
    InstrumentError
        If a device is missing, busy, or does not answer; a `SafetyError` if it does not confirm
        that it is safe.
    """
    path = Path(path)
    content = read_description(path)
    if "input" in content:
        from minorloop.lab.drivers.visa import open_single

        return open_single(content, path, clock)
    described = parsed(_BenchFile, content, path)
    try:
        return _opened(described, relevant(content), path.parent, clock)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _opened(
    described: _BenchFile, description: dict[str, Any], folder: Path, clock: Clock | None
) -> Bench:
    sources = _Rows(_SourceRow, described.sources, "source")
    sensors = _Rows(_SensorRow, described.sensors, "sensor")
    lines = _Rows(_LineRow, described.lines, "line")
    if not sources.known:
        raise ParameterError("a bench needs a source; give one")
    _check_devices(described, (*sources.known, *sensors.known, *lines.known))
    _check_numbers(sources.known, sensors.known)
    inputs = [Channel(e.name, e.unit, e.low, e.high, e.rate) for e in sources.known]
    outputs = [Channel(e.name, e.unit, e.low, e.high) for e in sensors.known]
    rest = np.array([each.rest for each in sources.known])
    check_rest(inputs, rest)
    measures = _measures(sources.known, sensors.known)
    commands = [_conversion(each, folder) for each in sources.known]
    readings = [_conversion(each, folder) for each in sensors.known]
    parts: list[Wired] = []
    wiring = Wiring(parts, commands, readings)
    try:
        for name, keys in described.devices.items():
            plan = DevicePlan(
                name=name,
                keys={key: value for key, value in keys.items() if key != "driver"},
                sources=tuple(_source_wire(sources, commands, k) for k in sources.of(name)),
                sensors=tuple(_sensor_wire(sensors, k) for k in sensors.of(name)),
                lines=tuple(_line_wire(lines, k) for k in lines.of(name)),
                folder=folder,
            )
            named = tuple(wire.name for wire in plan.lines)
            device = _device(_driver(name, keys), plan)
            parts.append(Wired(device, sources.of(name), sensors.of(name), named))
        bench = Bench(
            wiring,
            wiring,
            inputs,
            outputs,
            rest=rest,
            tick=described.tick,
            clock=clock,
            description=description,
            safe_within=described.safe_within,
            links=(wiring,),
            measures=measures,
            lines=wiring,
            serial=described.serial,
        )
        bench.check()
    except BaseException:
        wiring.close()
        raise
    return bench


def _check_devices(described: _BenchFile, channels: Sequence[Any]) -> None:
    """Refuse devices without a driver, and channels of devices that are not there."""
    known = ", ".join(described.devices) or "none"
    for channel in channels:
        if channel.device not in described.devices:
            raise ParameterError(
                f"{channel.name} is on device {channel.device!r}; the devices are {known}"
            )


def _check_numbers(sources: Sequence[_SourceRow], sensors: Sequence[_SensorRow]) -> None:
    """Refuse limits that are not numbers, and limits and rest of sources that are not finite."""
    for source in sources:
        for name in ("low", "high", "rest"):
            value = getattr(source, name)
            if not math.isfinite(value):
                raise ParameterError(
                    f"{name} of source {source.name!r} is {value}; give a finite number"
                )
    for sensor in sensors:
        for name in ("low", "high"):
            if math.isnan(getattr(sensor, name)):
                raise ParameterError(
                    f"{name} of sensor {sensor.name!r} is nan; give a number, or leave it out "
                    "where there is no limit"
                )


def _driver(name: str, keys: Mapping[str, Any]) -> Any:
    """Return the module of the driver of a device."""
    drivers = registered(DRIVERS)
    wanted = keys.get("driver")
    if wanted not in drivers:
        known = ", ".join(sorted(drivers))
        raise ParameterError(f"device {name!r} has driver {wanted!r}; the drivers are {known}")
    return loaded(drivers[wanted], f"device {name!r}")


def _device(driver: Any, plan: DevicePlan) -> Device:
    """Return an opened device; any failure of its driver is one sentence."""
    try:
        device: Device = driver.open_device(plan)
    except MinorloopError:
        raise
    except (Exception, SystemExit) as error:
        said = f"{type(error).__name__}: {error}"
        raise InstrumentError(f"device {plan.name!r} cannot be opened: {said}") from error
    return device


def _measures(sources: Sequence[_SourceRow], sensors: Sequence[_SensorRow]) -> list[int]:
    """Return for each sensor the number of the source that it belongs to."""
    names = [source.name for source in sources]
    found = []
    for number, sensor in enumerate(sensors):
        if sensor.of is not None and sensor.of not in names:
            raise ParameterError(
                f"sensor {sensor.name!r} is of {sensor.of!r}; the sources are {', '.join(names)}"
            )
        if sensor.of is None and number >= len(names):
            raise ParameterError(f"say with of which source sensor {sensor.name!r} belongs to")
        found.append(number if sensor.of is None else names.index(sensor.of))
    return found


def _source_wire(rows: _Rows, commands: Sequence[Conversion | None], k: int) -> DeviceChannel:
    """Return a source in the numbers of the instrument."""
    each: _SourceRow = rows.known[k]
    conversion = commands[k]
    ends = [converted(conversion, value) for value in (each.low, each.high, each.rest)]
    if not np.isfinite(ends).all():
        raise ParameterError(
            f"the conversion of {each.name} does not cover its limits [{each.low:g}, "
            f"{each.high:g}] and rest {each.rest:g}"
        )
    if conversion is not None:
        _check_one_way(each, conversion)
    low, high = sorted(ends[:2])
    return DeviceChannel(
        each.name, rows.keys[k], _unit(each), low, high, ends[2], each.rate, **rows.named
    )


def _check_one_way(source: _SourceRow, conversion: Conversion) -> None:
    """Refuse a conversion that turns within the limits: it may send more than at either end."""
    turns = conversion.turns
    inside = turns[(source.low < turns) & (turns < source.high)]
    places = np.array([source.low, *inside, source.high])
    sent = conversion.convert(places)
    ways = np.diff(sent) * np.sign(sent[-1] - sent[0])
    if (ways < -_ROUNDING * np.abs(sent).max()).any() or sent[0] == sent[-1]:
        back = int(np.argmin(ways))
        shown = ", ".join(
            f"{sent[k]:g} at {places[k]:g}" for k in sorted({0, back, back + 1, len(sent) - 1})
        )
        raise ParameterError(
            f"the conversion of source {source.name!r} is not monotone over its limits "
            f"[{source.low:g}, {source.high:g}]: it sends {shown}; give one that only rises or "
            "only falls between them"
        )


def _sensor_wire(rows: _Rows, k: int) -> DeviceChannel:
    each: _SensorRow = rows.known[k]
    return DeviceChannel(each.name, rows.keys[k], _unit(each), **rows.named)


def _line_wire(rows: _Rows, k: int) -> DeviceChannel:
    each: _LineRow = rows.known[k]
    return DeviceChannel(each.name, rows.keys[k], rest=float(each.rest), **rows.named)


def _unit(channel: _SourceRow | _SensorRow) -> str | None:
    """Return the unit that the instrument must have; None if a conversion does not say."""
    return channel.unit if channel.conversion is None else channel.conversion.reading


def _conversion(channel: _SourceRow | _SensorRow, folder: Path) -> Conversion | None:
    """Return the conversion of a channel; None without one."""
    given = channel.conversion
    if given is None:
        return None
    kinds = {name: getattr(given, name) for name in ("linear", "polynomial", "table", "laser")}
    named = [name for name, value in kinds.items() if value is not None]
    if len(named) != 1:
        raise ParameterError(
            f"the conversion of {channel.name} has {', '.join(named) or 'nothing'}; give one of "
            f"{', '.join(kinds)}"
        )
    try:
        if given.linear is not None:
            return linear(*given.linear)
        if given.polynomial is not None:
            return CalibrationPolynomial(coefficients=given.polynomial)
        if given.table is not None:
            return CalibrationTable.from_csv(folder / given.table)
        assert given.laser is not None
        return LaserCurvature(*given.laser, unit=given.reading or "mm")
    except MinorloopError as error:
        raise ParameterError(f"the conversion of {channel.name}: {error}") from None
