"""Identification of a `HeatedWire`: its operator from settled holds, its lag from a step.

A fit accepts any numbers: records without information are refused, since their result would be the
initial guess.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_levels, as_samples, as_waveform, as_whole
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import Plane, Smooth, excitation, identify
from minorloop.identification.levels import adaptive_levels
from minorloop.identification.plane_result import Identification
from minorloop.lab.records import Record
from minorloop.operators.preisach import Preisach
from minorloop_head.heated_wire import HeatedWire

LAGS = (0.3, 60.0)
"""Shortest and longest fitted lag, in seconds."""
_FEWEST, _MOST = 10, 100_000
"""Fewest and most samples of a step, by trial: fewer do not show a lag, more only take longer."""
_LONGEST = 3600.0
"""Longest step in seconds, 60 times the longest lag: a longer one has its times in another unit."""
_LEAST_INSIDE = 0.9
"""Least share of the currents within the levels, by trial. A few beyond them do no harm, as the
operator saturates there; many mean that one of the two is not in A."""
_TOLERANCE = 0.01
"""Part of the range of the levels by which a current may exceed them, by trial."""
_LEAST_SPAN = 0.5
"""Least share of the range of the levels that holds cover, by trial: outside of the holds, the
weights are guesses."""
_LEAST_MOTION = 0.25
"""Least motion in the step over that in the holds, by trial."""
_AT_BOUND = 0.02
"""Relative distance from an end of `LAGS` within which a lag counts as its bound, by trial."""
_MOST_UNEXPLAINED = 0.5
"""Largest rms residual over the standard deviation of the angles, by trial: the fit explains three
quarters of the variance at least."""
_ROUGH = 0.05
"""Rms residual, over the range of the holds, above which the lag counts as rough; by trial."""
_FLOOR = 0.15
"""Share of the levels that is spread evenly, so that flat parts have levels too."""
_FIRST_LAG = 4.0
"""First guess of the lag in seconds: that of a wire of 0.2 mm in air."""
_MOST_BANDS = 1000
"""Most bands of adaptive levels: a bound against typing errors, chosen without a measurement."""


@dataclass(frozen=True, eq=False)
class HeatedIdentification:
    """An identified heated wire."""

    model: HeatedWire
    """The result."""
    steady: Identification
    """Fit of the operator to the settled holds."""
    step_rms: float
    """Root-mean-square error of the simulated step with the fitted lag, in degrees."""

    @property
    def advice(self) -> tuple[str, ...]:
        """Weaknesses of the identification and their remedies; empty if there are none."""
        return (*self.steady.advice, *self.step_advice)

    @property
    def step_advice(self) -> tuple[str, ...]:
        """Weaknesses of the fit of the step, and their remedies."""
        return tuple(advice(self.step_rms, float(np.ptp(self.model.operator.range))))

    def __str__(self) -> str:
        low, high = self.model.operator.range
        rows = [
            ("angles [deg]", f"{low:.4g} to {high:.4g}"),
            ("bands", f"{self.model.operator.bands}"),
            ("lag [s]", f"{self.model.lag:.4g}"),
            ("latent [A^2 s/deg]", f"{self.model.latent:.4g}"),
            ("step, rms [deg]", f"{self.step_rms:.3g}"),
        ]
        lines = [f"{name:<24} {value}" for name, value in rows]
        return "\n".join(lines + [f"advice: {text}" for text in self.advice])

    def plot(self) -> Any:
        """Draw the operator and return the matplotlib figure."""
        return self.model.operator.plot(input_label="power [A^2]", output_label="angle [deg]")


def moving_levels(current: npt.ArrayLike, angle: npt.ArrayLike, bands: int) -> Levels:
    """Return levels of current that are dense where the wire moves, for reversal curves.

    Parameters
    ----------
    current : (T,) array_like
        Settled holds of a first loop over the whole range, in A.
    angle : (T,) array_like
        Settled angles.
    bands : int
        L.

    Returns
    -------
    (L + 1,) array
        In A. Most of them lie where the wire moves on the way up or on the way down.

    Raises
    ------
    SignalError
        If there is not one angle for each current, a current is negative, or one of them
        never changes.
    ParameterError
        If the bands are not a whole number from 1 to 1000.
    """
    count = as_whole("bands", bands, 1, _MOST_BANDS)
    i, y = _as_holds(current, angle)
    return as_levels(np.sqrt(adaptive_levels(i**2, y, count, floor=_FLOOR)))


def wire_holds(levels: npt.ArrayLike, *, minor_loops: bool = False) -> FloatArray:
    """Return the currents of settled holds that identify a wire.

    Parameters
    ----------
    levels : (L + 1,) array_like
        Strictly increasing, in A, such as those of `moving_levels`.
    minor_loops : bool
        A decaying staircase after the reversal curves. The minor loops of a wire depend on its
        past where those of the operator do not. With it, the operator errs by a tenth less under
        an arbitrary input, on specimens 1000 to 1015, with almost twice the holds.

    Returns
    -------
    (T,) array
        1 + L + L (L + 1) / 2 reversal curves, and 2 + L (L + 1) / 2 steps of the staircase, the
        last one cold, as the curves end.

    Raises
    ------
    ParameterError
        If a level is negative: a current heats in both directions.
    """
    curves = excitation.reversal_curves(levels)
    if curves.min() < 0:
        raise ParameterError(f"levels begin at {curves.min():g} A; give currents of 0 or more")
    if not minor_loops:
        return curves
    return np.concatenate([curves, excitation.decaying_staircase(levels), curves[:1]])


def identify_heating(
    current: npt.ArrayLike,
    angle: npt.ArrayLike,
    *,
    step: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike],
    levels: npt.ArrayLike,
) -> HeatedIdentification:
    """Identify a heated wire from settled holds and one transient.

    Parameters
    ----------
    current : (T,) array_like
        Settled holds in A, such as the `wire_holds` of ``levels``; at least two
        for each band.
    angle : (T,) array_like
        Settled angles in degrees; NaN where none was measured.
    step : tuple of t, current, angle, each (N,) array_like
        A record of a step, in s, A and degrees, that begins settled and cold, with several
        samples in a lag. A step up and down again separates the lag from the latent heat best.
    levels : (L + 1,) array_like
        Thresholds in A; their squares are those of the operator.

    Returns
    -------
    HeatedIdentification

    Raises
    ------
    SignalError
        If the records cannot be used: too few holds, or holds outside of the levels; a step of
        fewer than ten samples, of a constant current, with little motion, or without a lag
        between 0.3 and 60 s that follows it.
    """
    currents, angles = _as_holds(current, angle, gaps=True)
    grid = as_levels(levels)
    _check_holds(currents, angles, grid)
    transient = _as_transient(step, grid)
    law = Plane(grid**2, "unipolar", "uniform", slope=False, lag=0)
    steady = identify(Record(currents**2, angles), law, prior=Smooth(0.0))
    width = float(np.ptp(steady.model.range))
    if not width > 0:
        raise SignalError(
            "the settled angles do not rise with the current; change their sign, and check that "
            "each angle belongs to its current"
        )
    _check_motion(transient, width)
    model, rms = _fit_lag(steady.model, transient)
    _check_lag(transient, model.lag, rms)
    return HeatedIdentification(model, steady, rms)


def identify_coupling(records: Sequence[npt.ArrayLike]) -> FloatArray:
    """Return the change of the sensor of each axis for a degree of every other.

    It is (axes, axes): entry [i, j] of sensor i and axis j; 1 on the diagonal. Raises a
    `SignalError` if there is not one record for each axis, or its axis did not move.

    ``records`` (axes, T): one for each axis: readings of all sensors while that axis alone moved,
    in degrees.
    """
    readings = [as_samples(record, name=f"record {j}") for j, record in enumerate(records)]
    coupling = np.eye(len(readings))
    for j, y in enumerate(readings):
        if y.ndim != 2 or len(y) != len(readings):
            raise SignalError(
                f"record {j} has shape {y.shape}; give ({len(readings)}, T), one for each axis"
            )
        if not y[j].any():
            raise SignalError(f"axis {j} does not move in record {j}; record it while it does")
        coupling[:, j] = y @ y[j] / (y[j] @ y[j])
    return coupling


def _fit_lag(operator: Preisach, step: _Transient) -> tuple[HeatedWire, float]:
    """Fit lag and latent heat to a transient; return the wire and the remaining error."""
    from scipy.optimize import least_squares

    power = float(operator.levels[-1])
    per_degree = power / float(np.ptp(operator.range))

    def wire(x: FloatArray) -> HeatedWire:
        return HeatedWire(operator, float(np.exp(x[0])), float(x[1]) * per_degree)

    def error(x: FloatArray) -> FloatArray:
        return wire(x).simulate(step.t, step.current) - step.angle

    bounds = ([np.log(LAGS[0]), 0.0], [np.log(LAGS[1]), LAGS[1]])
    found = least_squares(
        error, [np.log(_FIRST_LAG), 2.0], bounds=bounds, diff_step=[1e-3, 1e-3], max_nfev=25
    )
    return wire(found.x), float(np.sqrt(np.mean(found.fun**2)))


@dataclass(frozen=True, eq=False)
class _Transient:
    """A record of a step of the current."""

    t: FloatArray
    current: FloatArray
    angle: FloatArray
    """Shape (N,). In s, A and degrees."""

    @property
    def interval(self) -> float:
        """Median time between two samples in seconds."""
        return float(np.median(np.diff(self.t)))


def _as_holds(
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


def _check_holds(current: FloatArray, angle: FloatArray, levels: Levels) -> None:
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


def _as_transient(
    step: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], levels: Levels
) -> _Transient:
    """Return the record of a step; refuse one that shows no lag.

    Raises a `SignalError` if it is not t, current and angle of 10 to 100,000 samples within an
    hour, or its current is negative, beyond the levels or always the same.
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
    return _Transient(times, currents, y)


def moves_enough(angle: FloatArray, width: float) -> bool:
    """Return whether the angles of a step move by enough of the range of a wire, in degrees."""
    return bool(np.ptp(angle) >= _LEAST_MOTION * width > 0)


def _check_motion(step: _Transient, width: float) -> None:
    """Refuse a step that moves the wire by too little of its range, in degrees."""
    if not moves_enough(step.angle, width):
        moved = float(np.ptp(step.angle))
        raise SignalError(
            f"the angle moves by {moved:.3g} degrees in the step and by {width:.3g} in the "
            f"holds; give a step, in degrees, over at least {_LEAST_MOTION:.0%} of the range"
        )


def _check_lag(step: _Transient, lag: float, rms: float) -> None:
    """Refuse a lag that the step does not determine: at a bound, undersampled, or of a poor fit."""
    low, high = LAGS
    if min(lag / low, high / lag) < 1 + _AT_BOUND:
        raise SignalError(
            f"the fitted lag is {lag:.3g} s, a bound of the allowed {low:g} to {high:g} s; give "
            "times in seconds, and the angles of this step"
        )
    if step.interval >= lag:
        raise SignalError(
            f"the step is sampled every {step.interval:.3g} s and the lag is {lag:.3g} s; sample "
            "it several times in a lag, and give times in seconds"
        )
    spread = float(np.std(step.angle))
    if rms > _MOST_UNEXPLAINED * spread:
        raise SignalError(
            f"the fit of the step has an rms error of {rms:.3g} degrees, and its angles vary by "
            f"{spread:.3g}; give the angles of this step, of the wire of the holds, that begins "
            "settled and cold"
        )


def advice(rms: float, width: float) -> Iterator[str]:
    """Yield advice on a weak fit to a step."""
    if rms > _ROUGH * width:
        yield (
            f"the rms error of the step is {rms / width:.0%} of the range, so the lag is rough: "
            "begin it settled and cold, let it come to rest, and sample it more finely"
        )


def _check_sign(values: FloatArray, what: str) -> None:
    if values.size and values.min() < 0:
        raise SignalError(
            f"{what} is negative, {values.min():g}; heating does not depend on the sign, so give "
            "its size"
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
