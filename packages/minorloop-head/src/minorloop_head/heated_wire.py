"""An operator on the heating power of a wire, with the lag of the heat.

A current heats a wire, the heat lags, and the temperature drives the hysteresis. The input of the
operator is therefore the heating power, the square of the current, after a lag. The latent heat of
the transformation makes the lag longer while the wire moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_waveform
from minorloop.errors import ParameterError
from minorloop.operators._kernels import push_balance
from minorloop.operators.memory import Start
from minorloop.operators.preisach import Preisach
from minorloop.operators.tracker import Tracker

SMALLEST_CHANGE = 1e-15
"""Least change of the effective power in A^2: with less, slopes would be rounding errors."""
_LONGEST_STEP = 0.1
"""Longest implicit step in seconds: a fortieth of a usual lag."""
SOLVES = 2
"""Fixed-point iterations for the slope in a step."""
_HALVINGS = 40
"""Number of bisections for the past of a wire: to 1e-12 of the range."""
_GRID = 513
"""Number of powers at which the slope of the operator is computed: at least 20 in each band."""
_NEAR = 0.01
"""Tolerance of an angle as a share of the range."""


@dataclass(frozen=True, eq=False)
class HeatedState:
    """State of a heated wire: effective power and memory of its operator."""

    power: float
    """Effective power: the steady power that would hold the present temperature, in A^2."""
    angle: float
    """Output of the operator, in its unit."""
    tracker: Tracker
    """Memory of the operator; it is copied and never pushed."""


@dataclass(frozen=True, eq=False)
class HeatedWire:
    """An operator on the heating power, with the lag of the heat before it.

    tau dw/dt + q dy/dt = p - w, y = Gamma[w], with the power p, the effective power w, the lag
    tau and the latent heat q of a unit of output.

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
    """Operator from effective power in A^2 to angle in degrees; monotone."""
    lag: float
    """tau in seconds, of a wire that does not move; positive."""
    latent: float = 0.0
    """q in A^2 s per degree; not negative."""

    def __post_init__(self) -> None:
        for name in ("lag", "latent"):
            object.__setattr__(self, name, as_finite(name, getattr(self, name)))
        if self.lag <= 0:
            raise ParameterError(f"lag is {self.lag}; give a positive number of seconds")
        if self.latent < 0:
            raise ParameterError(f"latent is {self.latent}; give at least 0 A^2 s per degree")

    @cached_property
    def fastest(self) -> float:
        """Largest rate for a heating power, in degrees a second per A^2.

        With the slope s of the operator, dy/dt = s (p - w) / (tau + q s), which grows with s. No
        branch is steeper than those of the loop between the ends of the levels.
        """
        low, high = self.operator.levels[[0, -1]].tolist()
        grid = np.linspace(low, high, _GRID)
        loop = self.operator.simulate(np.concatenate([grid, grid[-2::-1]]))
        slope = float(np.abs(np.diff(loop)).max()) / float(grid[1] - grid[0])
        return slope / (self.lag + self.latent * slope)

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

        Its past is unknown; a rise to some power and a return is assumed. If none of them gives the
        angle, the rise alone or the longest return is assumed if it comes to within 1 % of the
        range; otherwise the effective power is replaced by the one that gives the angle from cold.

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
        if abs(angle - least.angle) <= near and not least.angle < angle <= most.angle:
            return least
        if not least.angle < angle <= most.angle + near:
            return self.moved(cold, cold.tracker.aim(angle, "clip"))
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
        if abs(gap / stiff) < SMALLEST_CHANGE:
            return state
        tracker = state.tracker.copy()
        after, angle = np.array([state.power]), np.array([state.angle])
        tracker.run(push_balance, gap, stiff, self.latent, SOLVES, after, angle)
        return HeatedState(float(after[0]), float(angle[0]), tracker)

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

        Raises a `SignalError` if shapes differ or times do not increase.

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
        """
        times, currents = as_waveform(t, current, name="current")
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
