"""Checks of the records that a heated wire is identified from.

Settled holds give the operator, one transient gives the lag. A fit accepts any numbers; these
checks refuse records without information, for which the result would be the initial guess.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_samples, as_waveform
from minorloop.errors import SignalError

LAGS = (0.3, 60.0)
"""Shortest and longest lag that is looked for, in seconds."""
_FEWEST, _MOST = 10, 100_000
"""Samples of a step, by trial: fewer do not show a lag, and more only take longer."""
_LONGEST = 3600.0
"""Longest step in seconds, 60 times the longest lag: a longer one has its times in another unit."""
_LEAST_INSIDE = 0.9
"""Least share of the currents within the levels, by trial. A few beyond them do no harm, as the
operator saturates there; many mean that one of the two is not in A."""
_TOLERANCE = 0.01
"""Part of the range of the levels by which a current may exceed them, by trial."""
_LEAST_SPAN = 0.5
"""Least part of the range of the levels that the holds cover, by trial: outside of the holds, the
weights are guesses."""
_LEAST_MOTION = 0.25
"""Least movement in the step, over that in the holds; by trial."""
_AT_BOUND = 0.02
"""Relative distance from an end of `LAGS` within which a lag is the bound, by trial."""
_MOST_UNEXPLAINED = 0.5
"""Largest rms residual over the standard deviation of the angles, by trial: the fit explains three
quarters of the variance at least."""
_ROUGH = 0.05
"""Rms residual, over the range of the holds, above which the lag counts as rough; by trial."""


@dataclass(frozen=True, eq=False)
class Transient:
    """A record of a step of the current."""

    t: FloatArray
    current: FloatArray
    angle: FloatArray
    """Shape (N,). In s, A and degrees."""

    @property
    def interval(self) -> float:
        """Median time between two samples in seconds."""
        return float(np.median(np.diff(self.t)))


def as_holds(
    current: npt.ArrayLike, angle: npt.ArrayLike, *, gaps: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Return currents (T,) and settled angles (T,) of holds; refuse them unless both change."""
    i, y = as_samples(current, name="current"), as_samples(angle, name="angle", gaps=gaps)
    if i.ndim != 1 or i.shape != y.shape:
        raise SignalError(
            f"current has shape {i.shape} and angle {y.shape}; give (T,) holds and the angle "
            "after each of them"
        )
    _check_sign(i, "a current")
    seen = y[np.isfinite(y)]
    if seen.size < 2:
        raise SignalError(f"{seen.size} holds were measured; give those of a loop at least")
    for what, values in (("current", i), ("angle", seen)):
        if np.ptp(values) == 0:
            raise SignalError(
                f"the {what} of the holds is {values[0]:g} throughout; hold currents over the "
                "whole range, at which the wire moves"
            )
    return i, y


def check_holds(current: FloatArray, angle: FloatArray, levels: Levels) -> None:
    """Refuse holds that do not cover the plane of the levels."""
    low, high = float(levels[0]), float(levels[-1])
    _check_sign(levels, "a level")
    enough, measured = 2 * (levels.size - 1), int(np.isfinite(angle).sum())
    if measured < enough:
        raise SignalError(
            f"{measured} holds were measured for {levels.size - 1} bands; give at least "
            f"{enough}, such as excitation.reversal_curves(levels), or fewer levels"
        )
    _check_inside(current, levels, "holds")
    if np.ptp(current) < _LEAST_SPAN * (high - low):
        raise SignalError(
            f"the holds go from {current.min():g} to {current.max():g} A and the levels from "
            f"{low:g} to {high:g} A; give both in A, over the same range"
        )


def as_transient(
    step: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], levels: Levels
) -> Transient:
    """Return the record of a step; refuse one that shows no lag.

    Raises
    ------
    SignalError
        If it is not t, current and angle of 10 to 100,000 samples within an hour, or its
        current is negative, beyond the levels or always the same.
    """
    try:
        t, current, angle = step
    except (TypeError, ValueError):
        raise SignalError("the step is not three arrays; give (t, current, angle)") from None
    times, currents = as_waveform(t, current, name="current")
    y = as_samples(angle, name="angle of the step")
    if y.shape != times.shape:
        raise SignalError(f"the step has {times.size} times and {y.size} angles; give as many")
    _check_sign(currents, "a current of the step")
    if not _FEWEST <= times.size <= _MOST:
        raise SignalError(f"the step has {times.size} samples; give {_FEWEST} to {_MOST}")
    if times[-1] - times[0] > _LONGEST:
        raise SignalError(
            f"the step lasts {times[-1] - times[0]:g} s; give times in seconds, at most "
            f"{_LONGEST:g} s in all"
        )
    _check_inside(currents, levels, "samples of the step")
    if np.ptp(currents) == 0:
        raise SignalError(
            f"the current of the step is {currents[0]:g} A throughout; begin cold, at 0 A, and "
            "switch on a current that moves the wire"
        )
    return Transient(times, currents, y)


def moves_enough(angle: FloatArray, width: float) -> bool:
    """Return whether the angles of a step move by enough of the range of a wire, in degrees."""
    return bool(np.ptp(angle) >= _LEAST_MOTION * width > 0)


def check_motion(step: Transient, width: float) -> None:
    """Refuse a step that moves the wire by too little of its range, in degrees."""
    if not moves_enough(step.angle, width):
        moved = float(np.ptp(step.angle))
        raise SignalError(
            f"the angle moves by {moved:.3g} degrees in the step and by {width:.3g} in the "
            f"holds; give a step, in degrees, over at least {_LEAST_MOTION:.0%} of the range"
        )


def check_lag(step: Transient, lag: float, rms: float) -> None:
    """Refuse a lag that the step does not tell: at its bounds, unsampled, or of a poor fit."""
    low, high = LAGS
    if min(lag / low, high / lag) < 1 + _AT_BOUND:
        raise SignalError(
            f"the lag comes out at {lag:.3g} s, the end of the {low:g} to {high:g} s that are "
            "looked for; give times in seconds and the angles of that very step"
        )
    if step.interval >= lag:
        raise SignalError(
            f"the step is sampled every {step.interval:.3g} s and the lag is {lag:.3g} s; sample "
            "it several times in a lag, and give times in seconds"
        )
    spread = float(np.std(step.angle))
    if rms > _MOST_UNEXPLAINED * spread:
        raise SignalError(
            f"the step is followed to {rms:.3g} degrees rms only, and its angles vary by "
            f"{spread:.3g}; give the angles of that very step, of the wire of the holds, that "
            "begins settled and cold"
        )


def advice(rms: float, width: float) -> Iterator[str]:
    """Yield advice on a weak fit to a step."""
    if rms > _ROUGH * width:
        yield (
            f"the step is followed to {rms / width:.0%} of the range only, so the lag is rough: "
            "begin it settled and cold, let it come to rest, and sample it more finely"
        )


def _check_sign(values: FloatArray, what: str) -> None:
    if values.size and values.min() < 0:
        raise SignalError(
            f"{what} is negative, {values.min():g}; heating does not tell the sign, so give its "
            "size"
        )


def _check_inside(current: FloatArray, levels: Levels, what: str) -> None:
    low, high = float(levels[0]), float(levels[-1])
    slack = _TOLERANCE * (high - low)
    inside = float(np.mean((current >= low - slack) & (current <= high + slack)))
    if inside < _LEAST_INSIDE:
        raise SignalError(
            f"{1 - inside:.0%} of the {what} lie outside of the levels, {low:g} to {high:g} A, "
            f"the greatest at {current.max():g} A; give both in A, over the same range"
        )
