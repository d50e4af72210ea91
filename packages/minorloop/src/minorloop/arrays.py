"""Types of arrays, and checks of arguments.

``T`` is the number of samples, ``S`` of independent signals, ``L`` of bands between
``L + 1`` thresholds. Everything inside is float64 and SI.
"""

import math
from collections.abc import Sequence
from dataclasses import fields
from reprlib import repr as short
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.errors import ParameterError, SignalError

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
IntArray: TypeAlias = npt.NDArray[np.int64]
Samples: TypeAlias = FloatArray
"""(T,) or (S, T)."""
Levels: TypeAlias = FloatArray
"""(L + 1,), strictly increasing."""

LARGEST = 1e150
"""Largest magnitude of a signal: its square must not overflow."""
_CLOSEST = 1e-290
"""Least distance of levels: one over it is still a float."""


class ByValue:
    """Base of dataclasses whose fields are compared by value, arrays among them."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        mine: Any = self
        pairs = ((getattr(mine, one.name), getattr(other, one.name)) for one in fields(mine))
        return all(np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b for a, b in pairs)


def as_samples(values: npt.ArrayLike, *, name: str, gaps: bool = False) -> Samples:
    """Return a signal (T,) or (S, T) as a C-ordered float64 array; refuse others.

    Raises a `SignalError` if the values are not numbers, have another shape, or are not finite.

    ``values`` (T,) or (S, T): the samples; ``name``: name of the signal in an error message;
    ``gaps``: whether NaN is allowed; it marks a sample that was not measured.
    """
    if isinstance(values, np.ma.MaskedArray):  # masked samples were not measured
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        samples = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise SignalError(f"{name} is not an array of real numbers: {error}") from None
    if np.iscomplexobj(values):
        raise SignalError(f"{name} is complex; give real numbers")
    if np.ndim(values) not in (1, 2):
        raise SignalError(
            f"{name} has shape {np.shape(values)}; give (T,) samples or (S, T) signals"
        )
    usable = ~np.isinf(samples) if gaps else np.isfinite(samples)
    if not usable.all():
        where = np.argwhere(~usable)[0]
        index = ", ".join(str(i) for i in where)
        raise SignalError(
            f"{name} is {samples[tuple(where)]} at index {index}; every sample must be finite"
            + (" (or NaN where nothing was measured)" if gaps else "; cut or interpolate the gaps")
        )
    return samples


def check_magnitude(name: str, values: FloatArray) -> None:
    """Refuse numbers whose squares overflow; NaN is allowed.

    Raises a `SignalError` if one is beyond 1e150.
    """
    largest = float(np.max(np.abs(values), initial=0.0, where=~np.isnan(values)))
    if largest > LARGEST:
        raise SignalError(f"the {name} reaches {largest:g}; scale it to below {LARGEST:g}")


def check_scale(name: str, values: FloatArray) -> None:
    """Refuse numbers whose squares overflow or all vanish; zeros are allowed.

    Raises a `SignalError` if one is beyond 1e150, or all are below 1e-150.
    """
    check_magnitude(name, values)
    largest = float(np.max(np.abs(values), initial=0.0))
    if 0 < largest < 1 / LARGEST:
        raise SignalError(f"the {name} reaches {largest:g} only; scale it to above {1 / LARGEST:g}")


def as_times(t: npt.ArrayLike, *, fewest: int = 2) -> FloatArray:
    """Return strictly increasing times, (T,).

    Raises a `SignalError` if there are too few, or they are not finite or do not increase.
    """
    times = as_samples(t, name="t")
    if times.ndim != 1 or times.size < fewest:
        raise SignalError(f"t has shape {times.shape}; give (T,) times, T at least {fewest}")
    if not (np.diff(times) > 0).all():
        index = int(np.argmin(np.diff(times) > 0)) + 1
        raise SignalError(f"t does not increase at index {index}; give strictly increasing times")
    return times


def as_waveform(
    t: npt.ArrayLike, u: npt.ArrayLike, *, name: str = "u", channels: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Return times (T,) and the values at these times, (T,) or (channels, T).

    Raises a `SignalError` if the shapes differ or the times do not increase.
    """
    times, values = as_times(t), as_samples(u, name=name)
    shape = times.shape if channels == 1 else (channels, *times.shape)
    if values.shape != shape:
        raise SignalError(
            f"{name} has shape {values.shape} and t {times.shape}; give {name} of shape {shape}"
        )
    return times, values


def as_pair(u: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return inputs and outputs of equal length (T,); NaN marks a gap in y.

    Raises a `SignalError` if the shapes differ, or a number is not finite or beyond 1e150.
    """
    inputs, outputs = as_samples(u, name="u"), as_samples(y, name="y", gaps=True)
    if inputs.ndim != 1 or inputs.shape != outputs.shape:
        raise SignalError(
            f"u has shape {inputs.shape} and y {outputs.shape}; give (T,) samples of each"
        )
    for name, values in (("input", inputs), ("output", outputs)):
        check_magnitude(name, values)
    return inputs, outputs


def as_levels(values: npt.ArrayLike) -> Levels:
    """Return thresholds (L + 1,), in the unit of the input, as a read-only float64 copy.

    Raises a `ParameterError` if they are not finite, not strictly increasing, or fewer than two.
    """
    levels = _numbers("levels", values)
    if levels.ndim != 1 or levels.size < 2:
        raise ParameterError(
            f"levels have shape {levels.shape}; give L + 1 >= 2 thresholds in one dimension"
        )
    if not np.isfinite(levels).all():
        index = int(np.argmin(np.isfinite(levels)))
        raise ParameterError(f"levels are {levels[index]} at index {index}; all must be finite")
    with np.errstate(over="ignore"):
        steps = np.diff(levels)
    if not (steps > 0).all():
        index = int(np.argmin(steps > 0))
        raise ParameterError(
            f"levels are not strictly increasing: {levels[index]} at index {index} is followed "
            f"by {levels[index + 1]}; sort them and drop repeats"
        )
    if not np.isfinite(float(levels[-1]) - float(levels[0])):
        raise ParameterError("levels span more than a float can hold; scale the input down")
    if steps.min() < _CLOSEST:
        raise ParameterError(
            f"levels are only {steps.min():g} apart, less than {_CLOSEST:g}; scale the input up"
        )
    return frozen(levels)


def _numbers(name: str, values: npt.ArrayLike) -> FloatArray:
    """Return a float64 copy; refuse values that are not an array of numbers."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(f"{name} are not an array of numbers: {error}") from None


def frozen(values: npt.ArrayLike) -> FloatArray:
    """Return a read-only float64 copy, C-ordered."""
    copy = np.array(values, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy


def writable(values: FloatArray) -> FloatArray:
    """Return the array, or a copy if it is read-only.

    Numba takes seconds to compile a loop again for read-only arrays.
    """
    return np.require(values, requirements="W")


def uniform_levels(low: float, high: float, bands: int) -> Levels:
    """Return ``bands + 1`` evenly spaced thresholds from ``low`` to ``high``.

    Raises a `ParameterError` if ``bands`` is not positive or ``low`` is not below ``high``.
    """
    whole = isinstance(bands, int | np.integer | float) and not isinstance(bands, bool)
    if not whole or not 1 <= bands < np.inf or int(bands) != bands:
        raise ParameterError(f"{bands} bands; give a whole number of at least 1")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ParameterError(f"levels from {low} to {high}; give finite low < high")
    if not np.isfinite(float(high) - float(low)):
        raise ParameterError("levels span more than a float can hold; scale the input down")
    return as_levels(np.linspace(low, high, int(bands) + 1))


def as_finite(name: str, value: float) -> float:
    """Return a finite number as a float; refuse others.

    Raises a `ParameterError` if it is not a finite real number.
    """
    try:
        number = float(value)
    except OverflowError:
        raise ParameterError(
            f"{name} is more than a float can hold; give a finite number"
        ) from None
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise ParameterError(f"{name} is {value!r}; give a finite number")
    return number


def as_seconds(name: str, value: float) -> float:
    """Return a positive time as a float; refuse others.

    Raises a `ParameterError` if it is not a positive finite number.
    """
    number = as_finite(name, value)
    if number <= 0:
        raise ParameterError(f"{name} is {value}; give a positive number of seconds")
    return number


def as_whole(name: str, value: int, low: int, high: int | None = None) -> int:
    """Return a whole number within its range as an int; refuse others.

    Raises a `ParameterError` if it is not a whole number from ``low`` to ``high``, or of at least
    ``low``.
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not whole or value < low or (high is not None and value > high):
        allowed = f"of at least {low}" if high is None else f"from {low} to {high}"
        raise ParameterError(f"{name} is {short(value)}; give a whole number {allowed}")
    return int(value)


def check_kind(name: str, value: object, kind: type) -> None:
    """Refuse a value of another class.

    Raises a `ParameterError` that names the right class.
    """
    if not isinstance(value, kind):
        raise ParameterError(f"{name} is {short(value)}; give a {kind.__name__}")


def check_option(name: str, value: object, allowed: Sequence[str]) -> None:
    """Refuse an option that is not one of the allowed words.

    Raises a `ParameterError` that names them.
    """
    if not isinstance(value, str) or value not in allowed:
        words = ", ".join(repr(word) for word in allowed)
        raise ParameterError(f"{name} is {value!r}; give one of {words}")


def as_triangle(values: npt.ArrayLike, size: int, *, name: str) -> FloatArray:
    """Return a lower triangle (size, size), a number for each pair (alpha, beta), beta <= alpha.

    It is read-only float64. Raises a `ParameterError` if the shape is wrong, a number is not
    finite, or one above the diagonal is not zero. ``name`` is that of the values, for a message.
    """
    triangle = _numbers(name, values)
    if triangle.shape != (size, size):
        raise ParameterError(f"{name} have shape {triangle.shape}; the levels need {(size, size)}")
    if not np.isfinite(triangle).all():
        i, j = np.argwhere(~np.isfinite(triangle))[0]
        raise ParameterError(f"{name}[{i}, {j}] is {triangle[i, j]}; all must be finite")
    above = np.triu(triangle, 1)
    if above.any():
        i, j = np.argwhere(above)[0]
        raise ParameterError(
            f"{name}[{i}, {j}] is {triangle[i, j]:g}, but a relay has alpha >= beta; entries "
            "above the diagonal must be zero"
        )
    return frozen(triangle)
