"""Checks of a record and of the options before it is fitted."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from minorloop.arrays import LARGEST, BoolArray, FloatArray, IntArray, Levels, as_finite, as_levels
from minorloop.errors import ParameterError, SignalError
from minorloop.identification.design_matrix import check_bands
from minorloop.identification.levels import levels_for
from minorloop.lab.faults import FEWEST, Fault


def split(
    y: FloatArray, holdout: float, coded: Sequence[Fault], skipped: BoolArray | None = None
) -> tuple[BoolArray, BoolArray]:
    """Samples to be fitted, and samples held out at the end, both without skipped samples."""
    number = isinstance(holdout, float | int | np.floating | np.integer)
    if not number or isinstance(holdout, bool) or not 0 <= holdout <= 0.9:
        raise ParameterError(f"holdout is {holdout!r}; give a share from 0 to 0.9")
    measured = np.isfinite(y) if skipped is None else np.isfinite(y) & ~skipped
    places = np.flatnonzero(measured)
    if places.size < FEWEST:
        raise ParameterError(
            f"skip leaves {places.size} measured rows; at least {FEWEST} are needed"
        )
    kept = places.size - round(float(holdout) * places.size)
    if kept < FEWEST:
        count = sum(len(fault.samples) for fault in coded)
        without = f", {count} codes of the instrument left out" if coded else ""
        raise ParameterError(
            f"holdout {holdout} leaves {kept} of {places.size} measured samples to fit{without}; "
            f"at least {FEWEST} are needed"
        )
    fitted = measured.copy()
    fitted[places[kept:]] = False
    if np.ptp(y[fitted]) == 0:
        raise SignalError(
            "the output does not change in the part to be fitted; give a smaller holdout or "
            "other rows"
        )
    return fitted, measured & ~fitted


def as_skip(skip: int, positions: IntArray) -> BoolArray:
    """(T,) rows that drive the memory and are not fitted: the first rows of each curve."""
    whole = isinstance(skip, int | np.integer) and not isinstance(skip, bool)
    if not whole or not 0 <= int(skip) < positions.size:
        raise ParameterError(f"skip is {skip!r}; give whole rows from 0 to {positions.size - 1}")
    return np.asarray(positions < skip)


def grid(u: FloatArray, y: FloatArray, levels: int | npt.ArrayLike, spacing: str) -> Levels:
    """Given thresholds, or thresholds of a given number of bands."""
    if not np.isscalar(levels):
        return as_levels(levels)
    count = levels
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ParameterError(
            f"levels is {levels!r}; give a whole number of bands of at least 1, or thresholds"
        )
    check_bands(int(count))
    largest = float(np.abs(u).max())
    # Least width of a band, in distances of neighbouring numbers: areas are shares of bands
    if np.ptp(u) < 4 * int(count) * np.spacing(largest):
        raise SignalError(
            f"the input changes only by {np.ptp(u):g}, at about {largest:g}, where rounding leaves "
            f"no room for {count} bands; give fewer, or subtract a constant before rounding"
        )
    return levels_for(u, y, int(count), spacing)


def as_lag(lag: int | str, samples: int) -> int:
    """Return a number of samples by which the output is late, after a check."""
    whole = isinstance(lag, int | np.integer) and not isinstance(lag, bool)
    if not whole or not 0 <= int(lag) < samples:
        raise ParameterError(
            f'lag is {lag!r}; give "auto" or whole samples from 0 to {samples - 1}'
        )
    return int(lag)


def as_noise(
    noise: float | npt.ArrayLike | None, fitted: BoolArray
) -> tuple[float | None, FloatArray | None]:
    """Check standard deviations of measured outputs; return one for all, or one for each."""
    if noise is None:
        return None, None
    if np.ndim(noise):
        sd = _each(np.asarray(noise, dtype=np.float64), fitted)
        return (0.0, None) if sd is None else (None, sd)
    if isinstance(noise, bool | np.bool_):
        raise ParameterError(f"noise is {noise}; give a standard deviation in the output's unit")
    number = as_finite("noise", noise)  # type: ignore[arg-type]
    if not 0 <= number <= LARGEST:
        raise ParameterError(
            f"noise is {noise}; give a standard deviation >= 0 and up to {LARGEST:g}"
        )
    return number, None


def _each(sd: FloatArray, fitted: BoolArray) -> FloatArray | None:
    """Return a standard deviation above 0 for each output; None if all are 0."""
    if sd.shape != fitted.shape:
        raise SignalError(f"noise has shape {sd.shape}; give one for each of {fitted.size} outputs")
    known = sd[fitted & ~np.isnan(sd)]
    if not known.size or not ((known >= 0) & (known <= LARGEST)).all():
        row = int(np.argmax(fitted & ~((sd >= 0) & (sd <= LARGEST))))
        raise SignalError(
            f"noise is {sd[row]} at index {row}; give standard deviations >= 0 and up to "
            f"{LARGEST:g}, or NaN if not known"
        )
    if not known.any():
        return None
    # Smaller standard deviations count as this share of their median
    least = 0.1 * float(np.median(known[known > 0]))
    return np.maximum(np.where(np.isnan(sd), known.max(), sd), least)


def check_flags(**flags: object) -> None:
    """Raise an error if an option is neither True nor False."""
    for name, flag in flags.items():
        if not isinstance(flag, bool | np.bool_):
            raise ParameterError(f"{name} is {flag!r}; give True or False")
