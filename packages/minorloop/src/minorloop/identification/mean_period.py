"""Average a periodic record over its periods, without those in which it has not settled."""

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import SignalError
from minorloop.identification.baseline import rms
from minorloop.identification.output_error import correlation_time

_FEWEST = 48
"""Least samples of a beginning, so that its scatter is known to a tenth."""
_UNSETTLED = 2.0
"""Least ratio of the scatters at the beginning and later at which the beginning is unsettled."""


@dataclass(frozen=True, eq=False)
class _MeanPeriod:
    """Mean of the periods of a record."""

    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (N,). Force and displacement; NaN if not measured."""
    noise: float | None
    """Standard deviation of ``y``, from the differences between periods; None for one period."""
    unsettled: int
    """Number of first periods that are not in the mean, because they differ from later periods."""


def mean_period(u: FloatArray, y: FloatArray, period: int) -> _MeanPeriod:
    """Return the mean of the settled periods of a record.

    Raises a `SignalError` if T is not a multiple of the period, or the force does not repeat.

    ``u``, ``y`` (T,): force and displacement; NaN in y if not measured; ``period``: samples of a
    period.
    """
    turns, rest = divmod(u.size, period)
    if rest or not turns:
        raise SignalError(
            f"the record has {u.size} samples, which is not a whole number of periods of {period}; "
            "cut it, or omit period"
        )
    forces, outputs = u.reshape(turns, period), y.reshape(turns, period)
    apart = np.abs(forces - forces.mean(axis=0)).max()
    if apart > 0.01 * np.ptp(u):
        raise SignalError(
            f"the force differs between periods of {period} samples by {apart / np.ptp(u):.1%} of "
            "its range; give its period in samples, or omit period"
        )
    unsettled = 0
    while unsettled < turns - 1 and _differs(outputs[unsettled], outputs[unsettled + 1 :]):
        unsettled += 1
    return _MeanPeriod(forces[unsettled:].mean(axis=0), *_average(outputs[unsettled:]), unsettled)


def larger_beginning(errors: FloatArray) -> float:
    """Return the ratio of errors (N,) at the beginning to later errors; 0 if it is small."""
    early = _early(errors.size)
    later = rms(errors[early:])
    ratio = rms(errors[:early]) / max(later, np.finfo(float).tiny)
    return ratio if ratio > _UNSETTLED else 0.0


def _early(size: int) -> int:
    # A transient shows most in this first share of a period or a record
    return min(max(int(0.1 * size), _FEWEST), size // 2)


def _differs(first: FloatArray, later: FloatArray) -> bool:
    """Whether a period differs at its beginning from later periods more than these from each other.

    If there is only one later period: more than in the second half.
    """
    early = _early(first.size)
    number, mean = _mean(later)
    known = np.isfinite(first) & (number > 0)
    # Scale the difference so that noise alone gives the standard deviation of a sample.
    difference = (first - mean) / np.sqrt(1 + 1 / np.maximum(number, 1))
    begins = np.flatnonzero(known[:early])
    if not begins.size:
        return False
    found = rms(difference[begins])
    if later.shape[0] > 1:
        others = (later - mean)[:, :early]
        scatter, free = _scatter(later[:, :early]), int(np.maximum(number[:early] - 1, 0).sum())
    else:
        others = difference[None, first.size // 2 :]
        free = int(np.isfinite(others).sum())
        scatter = rms(others[np.isfinite(others)]) if free else None
    # Smaller differences over the range do not count, as in the simulation of a period
    least = 1e-6 * float(np.ptp(mean[number > 0]))
    return scatter is not None and found > max(_limit(others, early, free) * scatter, least)


def _limit(others: FloatArray, early: int, free: int) -> float:
    """Return the ratio to the scatter of ``others`` (P, N) that noise alone hardly exceeds.

    It is that of ``early`` samples to ``free`` degrees of freedom; correlated noise has fewer.
    """
    from scipy.special import fdtri  # scipy.stats takes a second to import

    each = correlation_time([np.nan_to_num(one) for one in others])
    # Noise counts as unsettled motion with this probability: a period that is left out by chance
    # does little harm, an unsettled period makes the model wrong
    ratio = fdtri(max(early / each, 1.0), max(free / each, 1.0), 0.99)
    return max(_UNSETTLED, float(np.sqrt(ratio)))


def _average(outputs: FloatArray) -> tuple[FloatArray, float | None]:
    """Return the mean of periods (P, N) and its standard deviation."""
    number, mean = _mean(outputs)
    mean, scatter = np.where(number > 0, mean, np.nan), _scatter(outputs)
    return mean, None if scatter is None else scatter / float(np.sqrt(outputs.shape[0]))


def _scatter(outputs: FloatArray) -> float | None:
    """Return the standard deviation of a sample around the mean of periods (P, N); None for one."""
    number, mean = _mean(outputs)
    spare = int(np.sum(np.maximum(number - 1, 0)))
    squares = float(np.nansum((outputs - mean) ** 2))
    return float(np.sqrt(squares / spare)) if spare else None


def _mean(outputs: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the number of known periods (P, N) at each sample, and their mean, 0 for none."""
    number = np.isfinite(outputs).sum(axis=0)
    return number, np.nansum(outputs, axis=0) / np.maximum(number, 1)
