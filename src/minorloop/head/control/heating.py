"""Identification of a heated wire: an operator on the heating power, and its lag.

A current heats a wire, the heat lags, and the temperature drives the hysteresis. The input of the
operator is therefore the heating power, the square of the current, after a lag. The latent heat of
the transformation makes the lag longer while the wire moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_finite, as_levels, as_samples, as_whole
from minorloop.errors import ParameterError, SignalError
from minorloop.head.control.transient import (
    LAGS,
    Transient,
    advice,
    as_holds,
    as_transient,
    as_waveform,
    check_holds,
    check_lag,
    check_motion,
)
from minorloop.identification.fit import identify
from minorloop.identification.levels import adaptive_levels
from minorloop.identification.result import Identification
from minorloop.operators.memory import Start
from minorloop.operators.plane import Relay
from minorloop.operators.preisach import Diagonal, Preisach
from minorloop.operators.tracker import Tracker

SMALLEST_CHANGE = 1e-15
"""Change of the effective power in A^2 that counts as none: slopes would be rounding errors."""
_LONGEST_STEP = 0.1
"""Longest implicit step in seconds: a fortieth of a usual lag."""
_SOLVES = 2
"""Fixed-point iterations for the slope in a step."""
_HALVINGS = 40
"""Bisections for the past of a wire: 1e-12 of the range."""
_NEAR = 0.01
"""Tolerance of an angle as a share of the range."""
_FLOOR = 0.15
"""Share of the levels that is spread evenly, so that a flat part has some."""
_FIRST_LAG = 4.0
"""First guess of the lag in seconds: that of a wire of 0.2 mm in air."""
_MOST_BANDS = 1000


@dataclass(frozen=True, eq=False)
class HeatedState:
    """State of a heated wire: effective power and memory of its operator.

    Parameters
    ----------
    power : float
        Effective power: the steady power that would hold the present temperature, in A^2.
    angle : float
        Output of the operator, in its unit.
    tracker : Tracker
        Memory of the operator; it is copied and never pushed.
    """

    power: float
    angle: float
    tracker: Tracker[Preisach]


@dataclass(frozen=True, eq=False)
class HeatedWire:
    """An operator on the heating power, with the lag of the heat before it.

    tau dw/dt + q dy/dt = p - w, y = Gamma[w], with the power p, the effective power w, the lag
    tau and the latent heat q of a unit of output.

    Parameters
    ----------
    operator : Preisach
        From effective power in A^2 to angle in degrees; monotone.
    lag : float
        tau in seconds, of a wire that does not move; positive.
    latent : float
        q in A^2 s per degree; not negative.

    Raises
    ------
    ParameterError
        If the lag is not positive or the latent heat negative.

    References
    ----------
    Boudjabi, Ferreira and Krupa, Proc. IEEE ICRA 2003, section 4: a heating lag and a Preisach
    operator in series.
    """

    operator: Preisach
    lag: float
    latent: float = 0.0

    def __post_init__(self) -> None:
        for name in ("lag", "latent"):
            object.__setattr__(self, name, as_finite(name, getattr(self, name)))
        if self.lag <= 0:
            raise ParameterError(f"lag is {self.lag}; give a positive number of seconds")
        if self.latent < 0:
            raise ParameterError(f"latent is {self.latent}; give at least 0 A^2 s per degree")

    def begin(self, power: float = 0.0, start: Start = "negative") -> HeatedState:
        """Return the state of a wire that has settled under a power.

        Parameters
        ----------
        power : float
            Heating power, in A^2.
        start : {"negative", "positive", "demagnetised"} or Memory
            Memory before it.
        """
        tracker = self.operator.track(start)
        return HeatedState(as_finite("power", power), tracker.push(power), tracker)

    def found(self, power: float, angle: float) -> HeatedState:
        """Return the state of a wire that has settled under a power, at an angle.

        Its past is not known; it is assumed to be a rise to some power and a return. If none
        gives the angle to within 1 % of the range, the effective power is the one that gives it
        from cold.

        Parameters
        ----------
        power : float
            In A^2.
        angle : float
            In degrees; clipped to the range of the operator.
        """
        cold = self.begin()
        least, top = self.begin(power), float(self.operator.levels[-1])
        most = self.moved(self.moved(cold, top), power)
        near = _NEAR * float(np.ptp(self.operator.range))
        if abs(angle - least.angle) <= near:
            return least
        if not least.angle < angle <= most.angle + near:
            return self.moved(cold, cold.tracker.aim(angle))
        low, high = power, top
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            state = self.moved(self.moved(cold, middle), power)
            low, high = (middle, high) if state.angle < angle else (low, middle)
        return state

    def step(
        self,
        state: HeatedState,
        power: float,
        interval: float,
        *,
        ambient: float = 0.0,
        cooling: float = 1.0,
    ) -> HeatedState:
        """Return the state after a power was held for an interval; the old state is unchanged.

        tau dw/dt + q dy/dt = p - c (w - a) with the changes of the surroundings a and c.

        Parameters
        ----------
        state : HeatedState
            Before.
        power : float
            In A^2.
        interval : float
            In seconds, short against the lag.
        ambient : float
            a: effective power of a wire that is not heated, in A^2; above 0 if it is warmer than
            at identification.
        cooling : float
            c: convection over that at identification.
        """
        gap = interval * (power - cooling * (state.power - ambient))
        stiff = self.lag + cooling * interval
        change = gap / stiff
        if abs(change) < SMALLEST_CHANGE:
            return state
        if self.latent > 0:
            for _ in range(_SOLVES):
                moved = state.tracker.peek(state.power + change) - state.angle
                change = gap / (stiff + self.latent * moved / change)
        return self.moved(state, state.power + change)

    def moved(self, state: HeatedState, power: float) -> HeatedState:
        """Return the state after the effective power has moved monotonically to a value.

        Parameters
        ----------
        state : HeatedState
            Before the move.
        power : float
            Effective power afterwards, in A^2.
        """
        tracker = state.tracker.copy()
        return HeatedState(power, tracker.push(power), tracker)

    def simulate(
        self, t: npt.ArrayLike, current: npt.ArrayLike, start: Start = "negative"
    ) -> FloatArray:
        """Return the angles for a sampled current, held from each sample to the next.

        Parameters
        ----------
        t : (T,) array_like
            Increasing times in seconds.
        current : (T,) array_like
            In A; the wire has settled under the first.
        start : start state of the operator

        Returns
        -------
        (T,) array

        Raises
        ------
        SignalError
            If shapes differ or times do not increase.
        """
        times, currents = as_waveform(t, current)
        power = currents**2
        state = self.begin(float(power[0]), start)
        angles = np.empty_like(times)
        angles[0] = state.angle
        for k, gap in enumerate(np.diff(times).tolist()):
            parts = max(int(np.ceil(gap / _LONGEST_STEP - 1e-9)), 1)
            for _ in range(parts):
                state = self.step(state, float(power[k]), gap / parts)
            angles[k + 1] = state.angle
        return angles


@dataclass(frozen=True, eq=False)
class HeatedIdentification:
    """An identified heated wire.

    Parameters
    ----------
    model : HeatedWire
        The result.
    steady : Identification
        Fit of the operator to the settled holds.
    step_rms : float
        Root-mean-square error of the simulated step that the lag was fitted to, in degrees.
    """

    model: HeatedWire
    steady: Identification
    step_rms: float

    @property
    def advice(self) -> tuple[str, ...]:
        """Weaknesses of the identification and their remedies; empty if there are none."""
        width = float(np.ptp(self.model.operator.range))
        return (*self.steady.advice, *advice(self.step_rms, width))

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
        Settled holds in A, such as `excitation.reversal_curves` of ``levels``; at least two
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
    steady = identify(
        currents**2,
        angles,
        levels=grid**2,
        relay=relay,
        diagonal=diagonal,
        start=start,
        smoothness=0.0,
        holdout=holdout,
    )
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
