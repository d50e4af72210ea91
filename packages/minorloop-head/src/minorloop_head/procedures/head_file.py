"""Files of heads: identified wires, coupling, limits, and calibration of the camera, as JSON.

::

    {"format": "minorloop head", "version": 1, "serial": "H-07",
     "identified": {"on": "2026-01-31T12:00:00Z", "minorloop": "0.1.0", "address": "twin:head",
                    "stores": {"pan-loop.sqlite": "9f86..."}, "highest": 0.4,
                    "wires": [{"kind": "heated-wire", ...}, ...],
                    "coupling": [[1, 0.07], [0.06, 1]], "limits": {"hottest": 150, ...},
                    "check": [{"rms": 0.4, "largest": 1.1}, ...], "advice": []},
     "calibrated": {"on": "2026-01-30T09:00:00Z", "calibration": {"lens": {...}, ...},
                    "measured": [{"name": "focal length", "value": 521.3, "sd": 0.2,
                                  "unit": "px"}, ...]}}

Wires are as in model files (`minorloop.modelfile`), pan first; ``coupling``, ``limits`` and
``calibration`` have the parameters of `HeadControl`, `WireLimits` and `HeadCalibration`. ``stores``
are the runs that the wires were identified from, with digests; ``check`` has errors in degrees;
``measured`` has the results of ``minorloop head calibrate`` with standard deviations. A file may
lack ``identified`` or ``calibrated``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from minorloop._modelschema import AnyModel, build, kind_of, layout, plain, reason
from minorloop.arrays import FloatArray
from minorloop.errors import ModelFileError, ParameterError, counted
from minorloop.files import PathLike, check_name, check_writable, kind_of_file, write_atomically
from minorloop.version import __version__
from minorloop_head.control.controller import within
from minorloop_head.control.head import LEAD, HeadControl, camera_control, head_control
from minorloop_head.control.limits import WireLimits
from minorloop_head.geometry import AXES
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import ALL_LIGHTS
from minorloop_head.vision.measured import Measured

FORMAT, VERSION = "minorloop head", 1
_BYTE, _KEY = re.compile(r"\(byte (\d+)\)"), re.compile(rb'"([^"\\]*)"\s*:')
_NO_NUMBER = re.compile(rb"-?(NaN|nan|Infinity|Inf|inf)\b")
_GIVE = "give one that head identify or head calibrate has written"
_LARGEST = 2**24
"""Largest size of a file in bytes: wires of some 500 bands."""

_CLOCKS_DIFFER = timedelta(days=1)
"""Tolerated lead of the clock of the machine that wrote a file."""
_LAGS = 0.01, 600.0
"""Least and largest lag of a wire in seconds: the thinnest in water, and rods in still air."""
_Moment = Annotated[datetime, msgspec.Meta(tz=True)]


@dataclass(frozen=True)
class CheckedAxis:
    """Errors of an identified wire under an input that it was not identified from."""

    rms: float
    largest: float
    """Root-mean-square and largest error of settled angles, in degrees."""


_TRUSTED = 0.05
"""Largest rms error in the check of a trusted wire, as a share of its range. A target missed by as
much counts as not reached."""


@dataclass(frozen=True, eq=False, kw_only=True)
class IdentifiedWires:
    """Wires of a head as identified."""

    on: datetime
    """Beginning of their measurement."""
    wires: tuple[HeatedWire, ...]
    """Wires of pan and tilt."""
    coupling: FloatArray
    """Shape (2, 2). As in `HeadControl`."""
    limits: WireLimits
    highest: float
    """Largest current in A, to which they were identified."""
    check: tuple[CheckedAxis, ...] = ()
    advice: tuple[str, ...] = ()
    """Weaknesses of the identification."""
    address: str = ""
    """Address of the actuator that was measured."""
    stores: Mapping[str, str]
    """Names of the runs and their SHA-256 digests."""
    minorloop: str = __version__
    """The version that identified them."""

    @property
    def untrusted(self) -> tuple[str, ...]:
        """A sentence on each wire whose model is off by more than 5 % of its range in the check."""
        found = []
        for axis, wire, check in zip(AXES, self.wires, self.check, strict=False):
            low, high = wire.operator.range
            if check.rms > _TRUSTED * (high - low):
                found.append(
                    f"{axis}: the model is off by {check.rms:.2g} degrees rms in the check, "
                    f"{check.rms / (high - low):.0%} of its range; do not trust it: give longer "
                    "holds, or more bands, and check that nothing moves the head meanwhile"
                )
        return tuple(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class HeadFile:
    """A head that was identified or calibrated."""

    serial: str
    """Serial number of the head."""
    identified: IdentifiedWires | None = None
    calibration: HeadCalibration | None = None
    """Calibration of its camera and probe."""
    calibrated: datetime | None = None
    """Time of the calibration."""
    measured: tuple[Measured, ...] = ()
    """Results of the calibration."""

    def check_fits(self, serial: str | None, name: PathLike) -> None:
        """Refuse the file of another head, and wires older than the calibration.

        Raises a `ModelFileError` if the file cannot be used with this head.

        ``serial``: serial number of the head that is there; not compared if it is not known.
        ``name``: name of the file, for the message.
        """
        if serial is not None and serial != self.serial:
            raise ModelFileError(
                f"{name} is of head {self.serial!r}, and the head here is {serial!r}; give the "
                "file of this head"
            )
        known = self.identified
        if known is not None and self.calibrated is not None and known.on < self.calibrated:
            raise ModelFileError(
                f"the wires in {name} were measured on {known.on:%Y-%m-%d %H:%M} UTC, before its "
                f"calibration on {self.calibrated:%Y-%m-%d %H:%M} UTC; identify them again with "
                "minorloop head identify"
            )

    def check_lights(self, lines: int, name: PathLike) -> None:
        """Refuse a calibration with another number of LEDs than are switched.

        Raises a `ModelFileError` if the calibration has another number of LEDs than `ALL_LIGHTS`,
        or the bench has lines for another number.

        ``lines``: lines of the bench that switch LEDs; 0 if there are none, then the LEDs are not
        counted. ``name``: name of the file, for the message.
        """
        wanted = len(ALL_LIGHTS)
        known = wanted if self.calibration is None else len(self.calibration.leds)
        if known != wanted:
            raise ModelFileError(
                f"{name} has {counted(known, 'LED')}, and acquisitions switch {wanted}; give their "
                f"places with minorloop head calibrate --leds, {wanted} of them"
            )
        if lines not in (0, wanted):
            raise ModelFileError(
                f"{name} has {counted(known, 'LED')}, and the bench has {counted(lines, 'line')} "
                f"for LEDs; give it the lines led 1 to led {wanted}"
            )

    def control(self, *, by_camera: bool = False, **options: Any) -> HeadControl:
        """Return the control of the head.

        ``by_camera``: whether the angles are those of pictures, see `minorloop_head.control.head`;
        ``**options``: as in `head_control`. Raises a `ModelFileError` if the wires were not
        identified.
        """
        known = self.identified
        if known is None:
            raise ModelFileError(
                f"the wires of head {self.serial!r} were not identified; identify them with "
                "minorloop head identify"
            )
        make = partial(camera_control, lead=LEAD) if by_camera else head_control
        return make(
            "observer",
            known.wires,
            coupling=known.coupling,
            limits=known.limits,
            highest=known.highest,
            **options,
        )


class _HeadPart(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    """Part of a file; unknown keys are refused."""


class _Identified(_HeadPart):
    on: _Moment
    minorloop: str
    address: str
    stores: dict[str, str]
    highest: float
    wires: Annotated[list[AnyModel], msgspec.Meta(min_length=2, max_length=2)]
    coupling: list[list[float]]
    limits: WireLimits
    check: tuple[CheckedAxis, ...]
    advice: tuple[str, ...]


class _Calibrated(_HeadPart):
    on: _Moment
    calibration: dict[str, Any]
    measured: list[Measured] = []


class _Content(_HeadPart):
    format: str
    version: int
    serial: str
    identified: _Identified | None = None
    calibrated: _Calibrated | None = None


def read_head(path: PathLike) -> HeadFile:
    """Read the file of a head.

    Raises a `ModelFileError` if there is no such file, or it is damaged, too large, not one of a
    head, or of a newer version.
    """
    data = _bytes_of(path)
    try:
        kind = kind_of_file(path, data)
        if kind not in ("", "a JSON file", "a head file"):
            raise ParameterError(f"it is {kind}, which has no format {FORMAT!r}; {_GIVE}")
        header = _decoded(data)
        if not isinstance(header, dict) or header.get("format") != FORMAT:
            raise ParameterError(f"it has no format {FORMAT!r}; {_GIVE}")
        if header.get("version") != VERSION:
            raise ParameterError(
                f"it has version {header.get('version')!r}, and this minorloop reads {VERSION}; "
                "install a newer one"
            )
        content = msgspec.json.decode(data, type=_Content)
        check_name("the serial number", content.serial)
        identified = None if content.identified is None else _wires(content.identified)
        calibrated = content.calibrated
        view = None if calibrated is None else HeadCalibration.from_dict(calibrated.calibration)
        for part in (content.identified, calibrated):
            if part is not None and part.on > datetime.now(UTC) + _CLOCKS_DIFFER:
                raise ParameterError(
                    f"it has the date {part.on:%Y-%m-%d %H:%M} UTC, which is in the future; "
                    "correct it, or the clock of this machine"
                )
        found = HeadFile(
            serial=content.serial,
            identified=identified,
            calibration=view,
            calibrated=None if calibrated is None else calibrated.on,
            measured=() if calibrated is None else tuple(calibrated.measured),
        )
        if identified is not None:
            found.control()  # refuses limits and coupling that cannot be
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path} is not a valid file of a head: {reason(error)}") from None
    return found


def save_head(head: HeadFile, path: PathLike, *, force: bool = False) -> None:
    """Write the file of a head, completely or not at all.

    ``force``: whether a file that exists may be replaced. Raises an `OutputError` if the file
    cannot be written, or exists and ``force`` is false; a `ParameterError` if the serial number
    cannot be printed.
    """
    target = check_writable(path, force=force)
    check_name("the serial number", head.serial)
    content: dict[str, Any] = {"format": FORMAT, "version": VERSION, "serial": head.serial}
    known = head.identified
    if known is not None:
        content["identified"] = {
            **{name: getattr(known, name) for name in ("minorloop", "address", "highest")},
            "on": _moment(known.on),
            "stores": dict(known.stores),
            "wires": [{"kind": kind_of(wire), **plain(wire)} for wire in known.wires],
            "coupling": known.coupling.tolist(),
            "limits": asdict(known.limits),
            "check": [asdict(axis) for axis in known.check],
            "advice": list(known.advice),
        }
    if head.calibration is not None and head.calibrated is not None:
        view = head.calibration.to_dict()
        content["calibrated"] = {"on": _moment(head.calibrated), "calibration": view}
        if head.measured:
            content["calibrated"]["measured"] = [asdict(each) for each in head.measured]
    write_atomically(target, f"{layout(content)}\n")


def _decoded(data: bytes) -> Any:
    """Return the object in a file; name the key of a number that JSON does not have."""
    try:
        return msgspec.json.decode(data)
    except msgspec.DecodeError as error:
        at = _BYTE.search(str(error))
        before = data[: int(at[1])] if at else b""
        strange, keys = _NO_NUMBER.match(data, len(before)), _KEY.findall(before)
        if at is None or strange is None or not keys:
            raise
        name, value = keys[-1].decode(errors="replace"), strange[0].decode()
        raise ParameterError(f"{name!r} has the value {value}; give a number") from None


def _wires(part: _Identified) -> IdentifiedWires:
    wires = tuple(build(wire) for wire in part.wires)
    for name, wire in zip(AXES, wires, strict=True):
        if not isinstance(wire, HeatedWire):
            raise ParameterError(f"a wire is of kind {kind_of(wire)!r}; it has to be heated-wire")
        within(f"the lag of {name}", wire.lag, *_LAGS, "s")
    known = {name: getattr(part, name) for name in part.__struct_fields__}
    return IdentifiedWires(**known | {"wires": wires, "coupling": np.array(part.coupling, float)})


def _moment(when: datetime) -> str:
    return f"{when.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}"


def _bytes_of(path: PathLike) -> bytes:
    file = Path(path)
    try:
        if not file.is_file():
            raise ModelFileError(f"there is no file {path}; {_GIVE}")
        if file.stat().st_size > _LARGEST:
            raise ModelFileError(f"{path} has more than {_LARGEST} bytes; it is of no head")
        return file.read_bytes()
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {reason(error)}") from None
