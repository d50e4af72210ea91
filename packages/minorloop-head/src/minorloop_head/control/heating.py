"""Identification of a `HeatedWire`: its operator from settled holds, its lag from a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_levels, as_samples, as_whole
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import Plane, Smooth, excitation, identify
from minorloop.identification.levels import adaptive_levels
from minorloop.identification.plane_result import Identification
from minorloop.lab.records import Record
from minorloop.operators.memory import Start
from minorloop.operators.plane import Relay
from minorloop.operators.preisach import Diagonal, Preisach
from minorloop_head.control.transient import (
    LAGS,
    Transient,
    advice,
    as_holds,
    as_transient,
    check_holds,
    check_lag,
    check_motion,
)
from minorloop_head.heated_wire import HeatedWire

_FLOOR = 0.15
"""Share of the levels that is spread evenly, so that a flat part has some."""
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
    """Root-mean-square error of the simulated step that the lag was fitted to, in degrees."""

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
    i, y = as_holds(current, angle)
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
    relay: Relay = "unipolar",
    diagonal: Diagonal = "uniform",
    start: Start = "negative",
    holdout: float = 0.0,
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
    relay, diagonal, start
        As in `Preisach`.
    holdout : float
        Share of the holds, at their end, that is not fitted but scored, as in `identify`.

    Returns
    -------
    HeatedIdentification

    Raises
    ------
    SignalError
        If the records cannot be used: too few holds, or holds outside of the levels; a step of
        fewer than ten samples, of a constant current, with little motion, or without a lag
        between 0.3 and 60 s that follows it.
    ParameterError
        If an option is out of its range.
    """
    currents, angles = as_holds(current, angle, gaps=True)
    grid = as_levels(levels)
    check_holds(currents, angles, grid)
    transient = as_transient(step, grid)
    law = Plane(grid**2, relay, diagonal, slope=False, lag=0)
    record = Record(currents**2, angles, start=start)
    steady = identify(record, law, prior=Smooth(0.0), holdout=holdout)
    width = float(np.ptp(steady.model.range))
    if not width > 0:
        raise SignalError(
            "the settled angles do not rise with the current; change their sign, and check that "
            "each angle belongs to its current"
        )
    check_motion(transient, width)
    model, rms = _fit_lag(steady.model, transient)
    check_lag(transient, model.lag, rms)
    return HeatedIdentification(model, steady, rms)


def identify_coupling(records: Sequence[npt.ArrayLike]) -> FloatArray:
    """Return the change of the sensor of each axis for a degree of every other.

    Parameters
    ----------
    records : sequence of (axes, T) array_like
        One for each axis: readings of all sensors while that axis alone moved, in degrees.

    Returns
    -------
    (axes, axes) array
        Entry [i, j] of sensor i and axis j; 1 on the diagonal.

    Raises
    ------
    SignalError
        If there is not one record for each axis, or its axis did not move.
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


def _fit_lag(operator: Preisach, step: Transient) -> tuple[HeatedWire, float]:
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
