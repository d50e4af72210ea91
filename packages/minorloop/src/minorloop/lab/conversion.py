"""Convert the readings of a sensor to a quantity, with its uncertainty.

A conversion gives NaN for a reading that it does not cover. ``sd`` is the uncertainty of the
conversion itself, from the calibration or the geometry. It is common to all samples of a log, so it
is not noise.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, frozen
from minorloop.errors import ParameterError, RecordError, counted
from minorloop.files import PathLike
from minorloop.lab.columns import opened
from minorloop.lab.headers import split_header
from minorloop.lab.records import Quantity
from minorloop.values import called, numbers, parsed

_LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "cm": 1e-2}
"""Units of length that a laser may have, in metres."""
_POWERS = {"n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "": 0, "k": 3, "M": 6, "G": 9}
"""Powers of ten of the prefixes of the SI."""
_UNIT = re.compile(r"([nuµμmckMG]?)((?:m|s|g|A|V|N|Pa|T|Oe|Hz|W|J|rad|[Oo]hm|Ω|bar)(?:/[^/]+)?)")
"""A prefix and a unit, perhaps divided by another unit; powers and products have no prefix."""
_COUNTS = range(2, 21)
"""Possible numbers of coefficients of a polynomial in a text."""


def unit_factor(found: str, wanted: str) -> float | None:
    """Return the factor from one unit to another; None if they differ by more than a prefix.

    ``found`` and ``wanted``: units that may have a prefix of the SI, such as ``mV`` and ``V``, or
    ``kA/m`` and ``A/m``.
    """
    if found == wanted:
        return 1.0
    one, other = _UNIT.fullmatch(found), _UNIT.fullmatch(wanted)
    if one is None or other is None or one[2] != other[2]:
        return None
    return float(f"1e{_POWERS[one[1]] - _POWERS[other[1]]}")


class Conversion(Protocol):
    """A map from readings to a quantity."""

    def convert(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the quantity for each reading; NaN where a reading is not covered."""

    def sd(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the standard deviation of the conversion for each reading."""

    def quantity(self, reading: Quantity) -> Quantity:
        """Return name and unit of the result, from those of the reading."""

    @property
    def covered(self) -> str:
        """The covered readings, for a message."""

    @property
    def turns(self) -> FloatArray:
        """(N,) readings, increasing, between which the quantity only rises or only falls."""


@dataclass(frozen=True)
class _Calibration:
    """Name and unit of the result of a calibration; by default those of the reading."""

    name: str | None = None
    unit: str | None = None
    calibration_sd: float = 0.0
    """Standard deviation of the calibration, in the unit of the result."""

    def __post_init__(self) -> None:
        if as_finite("calibration_sd", self.calibration_sd) < 0:
            raise ParameterError(
                f"calibration_sd is {self.calibration_sd}; give a standard deviation >= 0"
            )

    def sd(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the standard deviation of the calibration for each reading."""
        return np.full(np.shape(readings), float(self.calibration_sd))

    def quantity(self, reading: Quantity) -> Quantity:
        """Return name and unit of the result, from those of the reading."""
        return Quantity(
            reading.name if self.name is None else self.name,
            reading.unit if self.unit is None else self.unit,
        )

    @property
    def covered(self) -> str:
        """Which readings are covered, for a message."""
        return "finite readings"


@dataclass(frozen=True)
class CalibrationPolynomial(_Calibration):
    """A polynomial: c0 + c1 x + c2 x^2 + ..."""

    coefficients: tuple[float, ...] = (0.0, 1.0)
    """Coefficients, the constant first."""

    def __post_init__(self) -> None:
        super().__post_init__()
        found = tuple(as_finite("coefficient", value) for value in self.coefficients)
        if not any(found[1:]):
            raise ParameterError(
                f"the coefficients are {found}, a constant; give more than the constant, such as "
                "0,1"
            )
        object.__setattr__(self, "coefficients", found)

    def convert(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the polynomial at each reading."""
        values = np.asarray(readings, dtype=np.float64)
        return np.asarray(np.polynomial.polynomial.polyval(values, self.coefficients))

    @property
    def turns(self) -> FloatArray:
        """(N,) readings, increasing, between which it only rises or only falls."""
        slope = np.polynomial.Polynomial(self.coefficients).deriv().trim()
        # Rounding can make a double root complex: then its real part is the root.
        return np.sort(np.real(slope.roots()))


def linear(
    gain: float,
    offset: float = 0.0,
    *,
    name: str | None = None,
    unit: str | None = None,
    calibration_sd: float = 0.0,
) -> CalibrationPolynomial:
    """Return the conversion offset + gain x."""
    return CalibrationPolynomial(name, unit, calibration_sd, (offset, gain))


@dataclass(frozen=True, eq=False)
class CalibrationTable(_Calibration):
    """A table with straight lines between its points."""

    readings: npt.ArrayLike = ()
    values: npt.ArrayLike = ()
    """``readings`` and ``values``: shape (N,). The readings, increasing or decreasing, and their
    values."""

    def __post_init__(self) -> None:
        super().__post_init__()
        x, y = np.asarray(self.readings, np.float64), np.asarray(self.values, np.float64)
        if x.ndim != 1 or x.shape != y.shape or x.size < 2:
            raise ParameterError(
                f"the table has {counted(x.size, 'reading')} and {counted(y.size, 'value')}; give "
                "two or more of each"
            )
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ParameterError("the table has a number that is not finite; give finite numbers")
        if x[0] > x[-1]:
            x, y = x[::-1], y[::-1]
        if not (np.diff(x) > 0).all():
            place = int(np.argmin(np.diff(x) > 0))
            raise ParameterError(
                f"the readings of the table are {x[place]:g} and then {x[place + 1]:g}; give "
                "readings that always increase, or always decrease"
            )
        object.__setattr__(self, "readings", frozen(x))
        object.__setattr__(self, "values", frozen(y))

    @classmethod
    def from_csv(
        cls,
        path: PathLike,
        *,
        name: str | None = None,
        unit: str | None = None,
        calibration_sd: float = 0.0,
    ) -> CalibrationTable:
        """Read a table from a file with two columns: readings, and values with their unit.

        ``name`` and ``unit`` replace those of the second column.
        """
        with opened(path) as table:
            if len(table.headers) != 2:
                raise ParameterError(
                    f"{path} has {counted(len(table.headers), 'column')}; a calibration table has "
                    "two, the reading and the value"
                )
            readings, values = table.read(table.headers).values()
        own = split_header(table.headers[1])
        return cls(name or own[0], unit or own[1] or None, calibration_sd, readings, values)

    def convert(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the value for each reading; NaN beyond the table."""
        x = np.asarray(readings, dtype=np.float64)
        known = np.asarray(self.readings)
        return np.asarray(np.interp(x, known, np.asarray(self.values), np.nan, np.nan))

    @property
    def turns(self) -> FloatArray:
        """(N,) readings, increasing, between which it only rises or only falls."""
        return np.asarray(self.readings)

    @property
    def covered(self) -> str:
        """Which readings are covered, for a message."""
        known = np.asarray(self.readings)
        return f"the table, {known[0]:g} to {known[-1]:g}"


@dataclass(frozen=True)
class LaserCurvature:
    """Conversion of the distance that a laser measures to the curvature of a strip, in 1/m.

    The curvature is positive if the strip bends towards the laser, to a distance below ``d0``.
    """

    d0: float
    h0: float
    """``d0`` and ``h0``: distance to the straight strip, and height of the laser above the clamp,
    in the unit of the reading; see `minorloop.lab.curvature`."""
    sd_d0: float = 0.0
    sd_h0: float = 0.0
    """``sd_d0`` and ``sd_h0``: standard deviations of ``d0`` and ``h0``."""
    unit: str = "mm"
    """Unit of the reading: m, cm, mm, um or nm."""

    def __post_init__(self) -> None:
        if self.unit not in _LENGTHS:
            raise ParameterError(
                f"the laser reads in {self.unit or 'a pure number'}; a distance must be in one of "
                f"{', '.join(_LENGTHS)}: write it in the header, such as distance [mm]"
            )
        as_finite("d0", self.d0)
        if as_finite("h0", self.h0) <= 0:
            raise ParameterError(f"h0 is {self.h0:g} {self.unit}; give a positive height")
        for name in ("sd_d0", "sd_h0"):
            if as_finite(name, getattr(self, name)) < 0:
                raise ParameterError(
                    f"{name} is {getattr(self, name):g} {self.unit}; give a standard deviation >= 0"
                )

    def convert(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the curvature for each distance; NaN past a quarter circle."""
        x, h0 = self._bent(readings)
        return np.asarray(2 * x / (x**2 + h0**2))

    def sd(self, readings: npt.ArrayLike) -> FloatArray:
        """Return the standard deviation of the curvature because of the geometry, to first order.

        The errors of ``d0`` and ``h0`` are the same for every sample of a run.
        """
        x, h0 = self._bent(readings)
        square, metres = (x**2 + h0**2) ** 2, _LENGTHS[self.unit]
        by_d0, by_h0 = 2 * (h0**2 - x**2) / square, 4 * x * h0 / square
        return np.asarray(np.hypot(by_d0 * self.sd_d0 * metres, by_h0 * self.sd_h0 * metres))

    def _bent(self, readings: npt.ArrayLike) -> tuple[FloatArray, float]:
        """Return the deflection of the strip at the laser, and the laser's height, in metres."""
        metres = _LENGTHS[self.unit]
        x = self.d0 * metres - np.asarray(readings, dtype=np.float64) * metres
        return np.where(np.abs(x) <= self.h0 * metres, x, np.nan), self.h0 * metres

    def quantity(self, reading: Quantity) -> Quantity:
        """Return ``curvature [1/m]``."""
        return Quantity("curvature", "1/m")

    @property
    def turns(self) -> FloatArray:
        """(0,) readings: the curvature always falls."""
        return np.empty(0)

    @property
    def covered(self) -> str:
        """Which readings are covered, for a message."""
        low, high = self.d0 - self.h0, self.d0 + self.h0
        return f"{low:g} to {high:g} {self.unit}, a quarter circle to either side"


_KINDS = {"laser": LaserCurvature, "polynomial": CalibrationPolynomial, "table": CalibrationTable}


def as_json(conversion: Conversion) -> dict[str, Any]:
    """Return the kind of a conversion with its fields, for JSON."""
    (kind,) = (kind for kind, known in _KINDS.items() if isinstance(conversion, known))
    fields = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in vars(conversion).items()
    }
    return {kind: fields}


def from_json(content: Mapping[str, Any]) -> Conversion:
    """Return the conversion that `as_json` described.

    Raises a `ParameterError` if the content is not a conversion.
    """
    try:
        ((kind, fields),) = content.items()
        found: Conversion = _KINDS[kind](**fields)
        return found
    except (KeyError, TypeError, ValueError):
        raise ParameterError(f"{content} is not a conversion") from None


def from_text(text: str, reading: Quantity) -> Conversion:
    """Return the conversion of a reading that a text describes.

    Raises a `ParameterError` if the text does not describe a conversion.

    ``text``: ``laser:D0,H0[,SD,SD]``, ``linear:GAIN[,OFFSET]``, ``polynomial:C0,C1,...`` or
    ``table:FILE``; all but the first may also have ``name=``, ``unit=`` and ``calibration_sd=``;
    ``reading``: name and unit of the reading.
    """
    value = parsed(text)
    kind, what, options = value.kind, value.what, value.options
    where = f"the conversion {text!r}"
    if kind == "laser":
        if options:
            raise ParameterError(f"{where} gives curvature [1/m]; leave {next(iter(options))} out")
        d0, h0, *sds = numbers(what, (2, 4), where, "laser:D0,H0[,SD,SD]")
        sd_d0, sd_h0 = sds or (0.0, 0.0)
        return LaserCurvature(d0, h0, sd_d0, sd_h0, reading.unit)
    if kind == "linear":
        gain, *offset = numbers(what, (1, 2), where, "linear:GAIN[,OFFSET]")
        return called(linear, where, options, gain=gain, offset=sum(offset))
    if kind == "polynomial":
        powers = tuple(numbers(what, _COUNTS, where, "polynomial:C0,C1,..."))
        return called(CalibrationPolynomial, where, options, coefficients=powers)
    if kind == "table":
        return called(CalibrationTable.from_csv, where, options, path=what)
    raise ParameterError(f"{where} has an unknown kind; give laser, linear, polynomial or table")


def read_column(path: PathLike, column: str, unit: str = "", of: str = "the model") -> FloatArray:
    """Return one column of a table, without gaps, in a given unit.

    Raises a `RecordError` if its header has a unit that differs by more than a prefix. An empty
    unit is not compared; ``of`` names the object with this unit, for the message.
    """
    with opened(path) as table:
        header = table.find(column)
        found = split_header(header)[1]
        factor = unit_factor(found, unit) if found and unit else 1.0
        if factor is None:
            raise RecordError(
                f"column '{header}' of {path} is in {found} and {of} in {unit}; "
                f"give the column in {unit}"
            )
        values: FloatArray = table.read([column])[column]
    return values if factor == 1 else factor * values
