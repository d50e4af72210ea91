"""Average a record that repeats over its periods, without those in which it has not settled."""

from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import SignalError
from minorloop.identification.baseline import rms
from minorloop.identification.output_error import correlation_time

_FEWEST = 48
"""Samples of a beginning at least, so that its scatter is known to a tenth."""
_UNSETTLED = 2.0
"""Ratio of the scatter at the beginning to that of what follows from which it matters."""


@dataclass(frozen=True, eq=False)
class _MeanPeriod:
    """Mean of the periods of a record."""

    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (N,). Force and displacement; NaN where nothing was measured."""
    noise: float | None
    """Standard deviation of ``y``, from the differences between periods; None for one period."""
    unsettled: int
    """Periods at the beginning of the record that are not in the mean, because they differ from the
    later ones."""


def mean_period(u: FloatArray, y: FloatArray, period: int) -> _MeanPeriod:
    """Return the mean of the settled periods of a record.

    Raises a `SignalError` if T is no multiple of the period, or the force does not repeat.

    ``u``, ``y`` (T,): force and displacement; NaN in y where nothing was measured; ``period``:
    samples of a period.
    """
    turns, rest = divmod(u.size, period)
    if rest or not turns:
        raise SignalError(
            f"the record has {u.size} samples, which is not a whole number of periods of {period}; "
            "cut it, or leave period out"
        )
    forces, outputs = u.reshape(turns, period), y.reshape(turns, period)
    apart = np.abs(forces - forces.mean(axis=0)).max()
    if apart > 0.01 * np.ptp(u):
        raise SignalError(
            f"the force differs between periods of {period} samples by {apart / np.ptp(u):.1%} of "
            "its range; give its period in samples, or leave period out"
        )
    unsettled = 0
    while unsettled < turns - 1 and _differs(outputs[unsettled], outputs[unsettled + 1 :]):
        unsettled += 1
    return _MeanPeriod(forces[unsettled:].mean(axis=0), *_average(outputs[unsettled:]), unsettled)


def larger_beginning(errors: FloatArray) -> float:
    """Return how many times as large errors (N,) are at the beginning as later; 0 if not larger."""
    early = _early(errors.size)
    later = rms(errors[early:])
    ratio = rms(errors[:early]) / max(later, np.finfo(float).tiny)
    return ratio if ratio > _UNSETTLED else 0.0


def _early(size: int) -> int:
    # Share of a period, and of a record, at the beginning of which a transient shows most
    return min(max(int(0.1 * size), _FEWEST), size // 2)


def _differs(first: FloatArray, later: FloatArray) -> bool:
    """Whether a period differs at its beginning from the later ones more than these do.

    Where there is only one later period: more than in the second half.
    """
    early = _early(first.size)
    number, mean = _mean(later)
    known = np.isfinite(first) & (number > 0)
    # Of noise alone, the difference has this standard deviation over that of a sample.
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
    # Difference of periods over their range that counts as none, as in the simulation of a period
    least = 1e-6 * float(np.ptp(mean[number > 0]))
    return scatter is not None and found > max(_limit(others, early, free) * scatter, least)


def _limit(others: FloatArray, early: int, free: int) -> float:
    """Return the ratio to the scatter of ``others`` (P, N) that noise alone hardly exceeds.

    Of ``early`` samples to ``free`` degrees of freedom, fewer where the noise is correlated.
    """
    from scipy.special import fdtri  # scipy.stats takes a second to import

    each = correlation_time([np.nan_to_num(one) for one in others])
    # Probability with which noise may count as a motion that has not settled: a period that is left
    # out by chance costs little, one that has not settled spoils the model
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
    """Return how many periods (P, N) are known at each sample, and their mean, 0 for none."""
    number = np.isfinite(outputs).sum(axis=0)
    return number, np.nansum(outputs, axis=0) / np.maximum(number, 1)
