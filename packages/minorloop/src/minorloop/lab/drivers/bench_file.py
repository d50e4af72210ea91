"""Open a bench from a file, TOML or JSON: ``bench:bench.toml``.

::

    tick = 0.04                  # s
    serial = "A-07"              # of the plant

    [devices.board]
    driver = "serial"            # visa, serial, daqmx, labjack, modbus, or one of another package
    resource = "ASRL/dev/ttyACM0::INSTR"

    [[sources]]
    name = "current"
    unit = "A"
    device = "board"
    low = 0.0
    high = 0.4
    rate = 10.0                  # A/s
    rest = 0.0                   # the safe value
    channel = 0                  # this and other keys are for the driver

    [[sensors]]
    name = "angle"
    unit = "deg"
    device = "board"
    of = "current"               # the source that it belongs to
    low = -10.0
    high = 90.0
    conversion = {linear = [18.0, -9.0], reading = "V"}
    channel = 0

    [[lines]]
    name = "valve"
    device = "board"
    rest = true
    channel = 0

A conversion is ``linear = [gain, offset]``, ``polynomial = [c0, c1, ...]``, ``table = "FILE"`` or
``laser = [d0, h0]``. The conversion of a sensor maps the number of the instrument to the unit of
the sensor. The conversion of a source maps the unit of the source to the number of the instrument,
and only rises or only falls between the limits of the source. ``reading`` is the unit of the
instrument. The other keys are those of the driver; see its module in ``minorloop.lab.drivers``.

A bench with one channel has a short description::

    {"library": "@py",
     "source": {"resource": "GPIB0::5::INSTR", "set": "VOLT {:.9g}", "on": ["OUTP ON"],
                "safe": ["VOLT 0", "OUTP OFF"], "confirm": "VOLT?"},
     "meter": {"resource": "GPIB0::7::INSTR", "read": "READ?", "scale": 0.001},
     "input": {"name": "voltage", "unit": "V", "low": -1.2, "high": 1.2, "rate": 10},
     "output": {"name": "displacement", "unit": "m", "low": 0, "high": 0.03},
     "rest": 0, "tick": 0.05, "timeout": 2, "safe_within": 10}

The output is ``scale * (reading - zero)``. A board of the driver ``serial`` may replace source and
meter: ``"board": {"resource": "ASRL/dev/ttyACM0::INSTR", "baud": 115200}``.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minorloop.errors import InstrumentError, MinorloopError, ParameterError
from minorloop.files import PathLike, kind_of_file
from minorloop.lab.actuator import Channel
from minorloop.lab.conversion import (
    CalibrationPolynomial,
    CalibrationTable,
    Conversion,
    LaserCurvature,
    linear,
)
from minorloop.lab.drivers.bench import Bench, check_rest
from minorloop.lab.drivers.device import (
    Device,
    DeviceChannel,
    DevicePlan,
    Section,
    Wired,
    Wiring,
    converted,
    parsed,
)
from minorloop.registry import loaded, registered

DRIVERS = "minorloop.drivers"
"""Group of the entry points of drivers."""
_UNRELATED = "timeout", "baud", "safe_within", "safe_query", "safe_answer", "done"
"""Keys that do not affect readings; they may change before a run is resumed."""
_LARGEST = 1_000_000
"""Bytes of the largest file."""


class _ConversionRow(Section, kw_only=True):
    linear: tuple[float, float] | None = None
    polynomial: tuple[float, ...] | None = None
    table: str | None = None
    laser: tuple[float, float] | None = None
    reading: str | None = None


class _Input(Section, kw_only=True):
    name: str
    low: float
    high: float
    unit: str = ""
    rate: float = float("inf")


class _Output(Section, kw_only=True):
    name: str
    unit: str = ""
    low: float = float("-inf")
    high: float = float("inf")


class _SourceRow(_Input, kw_only=True):
    device: str
    rest: float = 0.0
    conversion: _ConversionRow | None = None


class _SensorRow(_Output, kw_only=True):
    device: str
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


class _Meter(Section, kw_only=True):
    resource: str
    read: str = "READ?"
    scale: float = 1.0
    zero: float = 0.0
    baud: int | None = None


class _Board(Section, kw_only=True):
    resource: str
    baud: int | None = None


class _SingleFile(Section, kw_only=True):
    """A bench with one channel; the keys of its source are those of the driver ``visa``."""

    input: _Input
    output: _Output
    source: dict[str, Any] | None = None
    meter: _Meter | None = None
    board: _Board | None = None
    library: str = "@py"
    rest: float = 0.0
    tick: float = 0.05
    timeout: float = 2.0
    safe_within: float = 10.0


class _Rows:
    """Channels of one kind: their keys for the bench, and their keys for the drivers."""

    def __init__(self, kind: type[Section], rows: Sequence[Mapping[str, Any]], what: str) -> None:
        self.known: list[Any] = []
        self._keys: list[dict[str, Any]] = []
        self._what, self._names = what, kind.__struct_fields__
        for number, row in enumerate(rows, 1):
            own = {key: value for key, value in row.items() if key in self._names}
            self.known.append(parsed(kind, own, f"{what} {row.get('name', number)!r}", what))
            self._keys.append({k: value for k, value in row.items() if k not in self._names})
        said = [each.name for each in self.known]
        for name in said:
            if said.count(name) > 1:
                raise ParameterError(f"there are two {what}s {name!r}; give each another name")

    def of(self, device: str) -> tuple[int, ...]:
        """Return the numbers of the channels of a device."""
        return tuple(k for k, each in enumerate(self.known) if each.device == device)

    def wires(
        self, device: str, numbers: Callable[[int, Any], dict[str, Any]]
    ) -> tuple[DeviceChannel, ...]:
        """Return the channels of a device; ``numbers`` returns limits, rest and unit of each."""
        own: dict[str, Any] = {"what": self._what, "bench_keys": self._names}
        return tuple(
            DeviceChannel(self.known[k].name, self._keys[k], **own, **numbers(k, self.known[k]))
            for k in self.of(device)
        )


def open_bench(path: PathLike) -> Bench:
    """Return the actuator that a file describes; make it safe and read it first.

    ``path``: the file, TOML or JSON. Raises a `ParameterError` if the file cannot be read, or does
    not describe a bench; a `MissingExtraError` if the library of a driver is not installed; an
    `InstrumentError` if a device is missing, busy, or does not answer; a `SafetyError` if it does
    not confirm that it is safe.
    """
    path = Path(path)
    content = _read_description(path)
    description = relevant(content)
    if "input" in content:
        single = parsed(_SingleFile, content, path)
        content, description = _several(single, path), _without_defaults(single)
    described = parsed(_BenchFile, content, path)
    try:
        return _opened(described, description, path.parent)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _read_description(path: Path) -> dict[str, Any]:
    """Return the content of a file, TOML if its name ends in ``.toml``, JSON otherwise.

    Raises a `ParameterError` if it cannot be read, or is not a table.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise ParameterError(f"{path} is larger than {_LARGEST} bytes; give a bench file")
        content = path.read_bytes()
        kind = kind_of_file(path, content)
        if kind not in ("", "a JSON file", "a TOML file"):
            raise ParameterError(f"{path} is {kind}, not a bench file; give the file of a bench")
        if path.suffix.lower() == ".toml":
            return tomllib.loads(content.decode())
        found = msgspec.json.decode(content)
    except MinorloopError:
        raise
    except OSError as error:
        raise ParameterError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, RecursionError) as error:
        raise ParameterError(f"{path} does not describe a bench: {error}") from None
    if not isinstance(found, dict):
        kind = type(found).__name__
        raise ParameterError(f"{path} does not describe a bench: it has {kind}, not a table")
    return found


def relevant(values: Any) -> Any:
    """Return all values that affect readings; timeouts do not."""
    if isinstance(values, Mapping):
        kept = {key: value for key, value in values.items() if key not in _UNRELATED}
        return {key: relevant(value) for key, value in kept.items()}
    return [relevant(value) for value in values] if isinstance(values, list) else values


def _without_defaults(described: msgspec.Struct) -> dict[str, Any]:
    """Return the fields of a bench with one channel that differ from their defaults."""
    kept = {
        each.name: value
        for each in msgspec.structs.fields(described)
        if (value := getattr(described, each.name)) != each.default and each.name not in _UNRELATED
    }
    return {
        name: _without_defaults(value) if isinstance(value, msgspec.Struct) else relevant(value)
        for name, value in kept.items()
    }


def _several(single: _SingleFile, path: Path) -> dict[str, Any]:
    """Return the same content as a file of several channels."""
    source, meter, board = single.source, single.meter, single.board
    common = {"library": single.library, "timeout": single.timeout}
    sensor: dict[str, Any] = {}
    if board is not None:
        if source or meter:
            raise ParameterError(
                f"{path} has a board and a source or a meter; give one or the other"
            )
        resource, keys = board.resource, dict[str, Any]()
        devices = {resource: {"driver": "serial", "baud": board.baud}}
    elif source is None or meter is None:
        raise ParameterError(f"{path} needs a source and a meter, or a board")
    elif "resource" not in source:
        raise ParameterError(f"the source in {path} has no resource; give its VISA address")
    else:
        keys = {key: value for key, value in source.items() if key not in ("resource", "baud")}
        resource = source["resource"]
        devices = {meter.resource: {"driver": "visa", "baud": meter.baud}}
        devices |= {resource: {"driver": "visa", "baud": source.get("baud")}}
        sensor = {"device": meter.resource, "read": meter.read}
        if (meter.scale, meter.zero) != (1.0, 0.0):
            sensor["conversion"] = {"linear": [meter.scale, -meter.scale * meter.zero]}
    input, output = msgspec.structs.asdict(single.input), msgspec.structs.asdict(single.output)
    return {
        "devices": {name: {"resource": name, **common, **own} for name, own in devices.items()},
        "sources": [{**input, "device": resource, "rest": single.rest, **keys}],
        "sensors": [{**output, "device": resource, **sensor}],
        "tick": single.tick,
        "safe_within": single.safe_within,
    }


def _opened(described: _BenchFile, description: dict[str, Any], folder: Path) -> Bench:
    sources = _Rows(_SourceRow, described.sources, "source")
    sensors = _Rows(_SensorRow, described.sensors, "sensor")
    lines = _Rows(_LineRow, described.lines, "line")
    if not sources.known:
        raise ParameterError("a bench needs a source; give one")
    for channel in (*sources.known, *sensors.known, *lines.known):
        if channel.device not in described.devices:
            known = ", ".join(described.devices) or "none"
            raise ParameterError(
                f"{channel.name} is on device {channel.device!r}; the devices are {known}"
            )
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
                sources=sources.wires(name, lambda k, row: _sent(row, commands[k])),
                sensors=sensors.wires(name, lambda _, row: {"unit": _unit(row)}),
                lines=lines.wires(name, lambda _, row: {"rest": float(row.rest)}),
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
            description=description,
            safe_within=described.safe_within,
            links=(wiring,),
            warnings=[said for part in parts for said in getattr(part.device, "warnings", ())],
            measures=measures,
            lines=wiring,
            serial=described.serial,
        )
        bench.check()
    except BaseException:
        wiring.close()
        raise
    return bench


def _driver(name: str, keys: Mapping[str, Any]) -> Any:
    """Return the module of the driver of a device."""
    drivers = registered(DRIVERS)
    wanted = keys.get("driver")
    if wanted not in drivers:
        known = ", ".join(sorted(drivers))
        raise ParameterError(f"device {name!r} has driver {wanted!r}; the drivers are {known}")
    return loaded(drivers[wanted], f"device {name!r}")


def _device(driver: Any, plan: DevicePlan) -> Device:
    """Return an opened device; any error of its driver becomes one sentence."""
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
            raise ParameterError(f"sensor {sensor.name!r} has no source; name it with the key of")
        found.append(number if sensor.of is None else names.index(sensor.of))
    return found


def _sent(source: _SourceRow, conversion: Conversion | None) -> dict[str, Any]:
    """Return limits, rest, unit and rate of a source, in the numbers of the instrument."""
    ends = [converted(conversion, value) for value in (source.low, source.high, source.rest)]
    if not np.isfinite(ends).all():
        raise ParameterError(
            f"the conversion of {source.name} does not cover its limits [{source.low:g}, "
            f"{source.high:g}] and rest {source.rest:g}"
        )
    if conversion is not None:
        _check_one_way(source, conversion)
    low, high = sorted(ends[:2])
    limits = {"low": low, "high": high, "rest": ends[2]}
    return {"unit": _unit(source), "rate": source.rate, **limits}


def _check_one_way(source: _SourceRow, conversion: Conversion) -> None:
    """Refuse a conversion that turns within the limits: it may send more than at both ends."""
    turns = conversion.turns
    inside = turns[(source.low < turns) & (turns < source.high)]
    places = np.array([source.low, *inside, source.high])
    sent = conversion.convert(places)
    ways = np.diff(sent) * np.sign(sent[-1] - sent[0])
    # A conversion may reverse by this share of its largest number: rounding, far below the
    # resolution of any instrument
    if (ways < -1e-9 * np.abs(sent).max()).any() or sent[0] == sent[-1]:
        back = int(np.argmin(ways))
        shown = ", ".join(
            f"{sent[k]:g} at {places[k]:g}" for k in sorted({0, back, back + 1, len(sent) - 1})
        )
        raise ParameterError(
            f"the conversion of source {source.name!r} is not monotone over its limits "
            f"[{source.low:g}, {source.high:g}]: it sends {shown}; give one that only rises or "
            "only falls between them"
        )


def _unit(channel: _SourceRow | _SensorRow) -> str | None:
    """Return the unit that the instrument must have; None if a conversion does not give it."""
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
