"""Plan powers for targets that are known in advance.

The inverse of the operator and of the lag uses only the next target. If a wire cannot cool as fast
as the targets fall, that is too late; a plan that looks ahead cools early and does not overheat.
It begins with the best of several inverses that look ahead by different times, and is never worse
than the one that does not look ahead.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_samples, as_whole, check_kind
from minorloop.errors import SignalError
from minorloop_head.control.controller import HIGHEST_CURRENT, heating, within
from minorloop_head.heated_wire import HeatedState, HeatedWire
from papers.catheter.control import _planning_kernels as _kernels

MOST_TARGETS = 100_000
MOST_DEGREES = 1e6
"""Largest target: beyond any wire, and its square does not overflow."""
_DIFFERENCE_STEP = 1e-4
"""Step of the differences, as a share of full power."""
_DAMPINGS = np.array([1e-4, 1e-2, 1e-1, 1.0, 10.0])
_STRIDES = np.array([1.0, 0.5, 0.2])
"""Dampings, relative to the largest diagonal element, and lengths of the steps that are tried."""
_ENOUGH = 1e-4
"""Relative decrease of the cost that ends the sweeps."""


@dataclass(frozen=True, eq=False)
class PlannedPowers:
    """A sequence of powers, and its result.

    Parameters
    ----------
    power : (N,) array
        In A^2, each held for one interval.
    y : (N,) array
        Angles at the ends of the intervals, in degrees.
    targets : (N,) array
        Wanted angles.
    cost : float
        Sum of the squared errors, plus the cost of changes of the power.
    feedforward_cost : float
        That of the inverse feedforward.
    interval : float
        In seconds.
    """

    power: FloatArray
    y: FloatArray
    targets: FloatArray
    cost: float
    feedforward_cost: float
    interval: float

    @property
    def current(self) -> FloatArray:
        """(N,) currents in A."""
        return np.asarray(np.sqrt(self.power))

    @property
    def rms(self) -> float:
        """Root-mean-square error in degrees."""
        return float(np.sqrt(np.mean((self.y - self.targets) ** 2)))

    @property
    def gain(self) -> float:
        """Cost over that of the inverse feedforward; 1 if that is 0."""
        return self.cost / self.feedforward_cost if self.feedforward_cost > 0 else 1.0

    def __str__(self) -> str:
        rows = [
            ("targets", f"{self.targets.size}, one every {self.interval:g} s"),
            ("error, rms [deg]", f"{self.rms:.3g}"),
            ("cost [deg^2]", f"{self.cost:.4g}"),
            ("inverse feedforward", f"{self.feedforward_cost:.4g}"),
        ]
        return "\n".join(f"{name:<24} {value}" for name, value in rows)

    def plot(self) -> Any:
        """Draw targets and angles, and the currents below; return the matplotlib figure."""
        from matplotlib.figure import Figure

        t = self.interval * np.arange(1, self.targets.size + 1)
        figure = Figure(figsize=(7, 5), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(t, self.targets, label="target")
        above.plot(t, self.y, label="plan")
        above.set_ylabel("angle [deg]")
        above.legend()
        below.step(t, self.current, where="pre")
        below.set_ylabel("current [A]")
        below.set_xlabel("time [s]")
        return figure


@dataclass(frozen=True, eq=False, kw_only=True)
class Planner:
    """Planner of powers over a receding horizon.

    Parameters
    ----------
    wire : HeatedWire
        The model.
    interval : float
        Time between two targets in seconds, for which a power is held.
    highest : float
        Largest current in A.
    effort : float
        Cost of a change of the power, in degrees squared for a change from nothing to full
        squared.
    horizon : int
        Number of targets that a plan looks ahead, 1 to 200.
    sweeps : int
        Improvements of the plan at each target.
    parts : int
        Implicit steps of the heat balance in an interval.

    Raises
    ------
    ParameterError
        If a number is out of its range.

    Notes
    -----
    An improvement is a damped Gauss-Newton step on the powers of the horizon, within their limits,
    with sensitivities of the angles by differences: the branches of the operator are smooth between
    reversals. Steps that do not lower the cost are rejected.

    References
    ----------
    Iyer, Tan and Krishnaprasad, IEEE Trans. Automatic Control 50, 2005, for inverses of the
    operator alone.
    """

    wire: HeatedWire
    interval: float = 0.5
    highest: float = HIGHEST_CURRENT
    effort: float = 0.0
    horizon: int = 24
    sweeps: int = 4
    parts: int = 4

    def __post_init__(self) -> None:
        check_kind("wire", self.wire, HeatedWire)
        numbers = {
            "interval": within("interval", self.interval, 1e-3, 600.0, "s"),
            "highest": within("highest", self.highest, 1e-6, HIGHEST_CURRENT, "A"),
            "effort": within("effort", self.effort, 0.0, 1e12),
            "horizon": as_whole("horizon", self.horizon, 1, 200),
            "sweeps": as_whole("sweeps", self.sweeps, 1, 1000),
            "parts": as_whole("parts", self.parts, 1, 1000),
        }
        for name, value in numbers.items():
            object.__setattr__(self, name, value)

    def feedforward(
        self, targets: npt.ArrayLike, start: HeatedState | None = None, *, ahead: int = 0
    ) -> PlannedPowers:
        """Return powers by the inverse of the operator and of the heating lag, target by target.

        Parameters
        ----------
        targets : (N,) array_like
            Wanted angles at the ends of the intervals, in degrees.
        start : HeatedState, optional
            State of the wire before; cold without it.
        ahead : int
            Number of targets that the inverse looks ahead, 0 to 100,000.

        Raises
        ------
        SignalError
            If the targets are not finite numbers in one dimension.
        ParameterError
            If the start is not a state of the wire, or ``ahead`` is out of its range.
        """
        as_whole("ahead", ahead, 0, MOST_TARGETS)
        wanted, state = self._as_targets(targets), self._start(start)
        power = self._inverse(wanted, state, ahead)
        return self._plan(power, wanted, state)

    def plan(self, targets: npt.ArrayLike, start: HeatedState | None = None) -> PlannedPowers:
        """Return the powers of least cost that was found, at most that of inverse feedforward.

        Parameters
        ----------
        targets : (N,) array_like
            Wanted angles at the ends of the intervals, in degrees.
        start : HeatedState, optional
            State of the wire before; cold without it.

        Raises
        ------
        SignalError
            If the targets are not finite numbers in one dimension.
        ParameterError
            If the start is not a state of the wire.
        """
        wanted, state = self._as_targets(targets), self._start(start)
        looks = range(min(self.horizon, wanted.size))
        tries = [self._plan(self._inverse(wanted, state, n), wanted, state) for n in looks]
        tries.append(self._receding(min(tries, key=lambda plan: plan.cost), state))
        best = min(tries, key=lambda plan: plan.cost)
        return replace(best, feedforward_cost=tries[0].cost)

    def _receding(self, first: PlannedPowers, start: HeatedState) -> PlannedPowers:
        """Improve the powers of a horizon, keep the first, and move on by one target."""
        power, state = first.power.copy(), start
        before = state.power
        for k in range(power.size):
            window = slice(k, min(k + self.horizon, power.size))
            wanted, ahead = first.targets[window], power[window]
            for _ in range(self.sweeps):
                better = self._improved(ahead, wanted, state, before)
                if better is ahead:
                    break
                ahead = better
            power[window] = ahead
            before = float(ahead[0])
            for _ in range(self.parts):
                state = self.wire.step(state, before, self.interval / self.parts)
        return self._plan(power, first.targets, start)

    def _improved(
        self, power: FloatArray, wanted: FloatArray, state: HeatedState, before: float
    ) -> FloatArray:
        """Return powers of lower cost, or the same array if no step lowers it enough."""
        most = self.highest**2
        difference = _DIFFERENCE_STEP * most
        signs = np.where(power + difference <= most, difference, -difference)
        rows = np.vstack([power, power + np.diag(signs)])
        y = self._angles(rows, state)
        jacobian = ((y[1:] - y[0]) / signs[:, None]).T * most
        change = self._differences(power, before)
        residual = np.concatenate([y[0] - wanted, change])
        cost = float(residual @ residual)
        full = np.vstack([jacobian, self._weight * _difference_matrix(power.size)])
        candidates = self._candidates(power, full, residual)
        errors = self._angles(candidates, state) - wanted
        changes = np.array([self._differences(row, before) for row in candidates])
        costs = (errors**2).sum(axis=1) + (changes**2).sum(axis=1)
        best = int(costs.argmin())
        return candidates[best] if costs[best] < cost * (1 - _ENOUGH) else power

    def _candidates(
        self, power: FloatArray, jacobian: FloatArray, residual: FloatArray
    ) -> FloatArray:
        """Return powers after steps of several dampings and lengths; those at a limit stay."""
        most = self.highest**2
        gradient = jacobian.T @ residual
        free = ~(((power <= 0) & (gradient > 0)) | ((power >= most) & (gradient < 0)))
        if not free.any():
            return power[None]
        part = jacobian[:, free]
        normal = part.T @ part
        scale = max(float(normal.diagonal().max()), 1e-12)
        steps = np.zeros((_DAMPINGS.size, power.size))
        for row, damping in zip(steps, _DAMPINGS, strict=True):
            damped = normal + damping * scale * np.eye(len(normal))
            row[free] = -np.linalg.solve(damped, gradient[free])
        moves = (_STRIDES[:, None, None] * steps * most).reshape(-1, power.size)
        return np.asarray(np.clip(power + moves, 0.0, most))

    def _inverse(self, wanted: FloatArray, state: HeatedState, ahead: int) -> FloatArray:
        power = np.empty_like(wanted)
        for k in range(wanted.size):
            target = float(wanted[min(k + ahead, wanted.size - 1)])
            requested = heating(self.wire, state, target, response=self.interval)
            power[k] = min(max(requested, 0.0), self.highest**2)
            for _ in range(self.parts):
                state = self.wire.step(state, float(power[k]), self.interval / self.parts)
        return power

    def _angles(self, powers: FloatArray, state: HeatedState) -> FloatArray:
        """Return the angles (C, N) under C sequences of powers (C, N)."""
        operator = self.wire.operator
        stack, rows = operator.stack(state.tracker.memory, 2)
        out = np.empty(powers.shape)
        _kernels.courses(
            operator.tables,
            stack,
            rows,
            np.array([state.power, state.angle]),
            np.array([self.wire.lag, self.wire.latent]),
            np.ascontiguousarray(powers),
            self.interval / self.parts,
            self.parts,
            out,
        )
        return out

    def _plan(self, power: FloatArray, wanted: FloatArray, state: HeatedState) -> PlannedPowers:
        y = self._angles(power[None], state)[0]
        changes = self._differences(power, state.power)
        cost = float(((y - wanted) ** 2).sum() + (changes**2).sum())
        return PlannedPowers(power, y, wanted, cost, cost, self.interval)

    def _differences(self, power: FloatArray, before: float) -> FloatArray:
        return np.asarray(self._weight * np.diff(power, prepend=before) / self.highest**2)

    @property
    def _weight(self) -> float:
        return math.sqrt(self.effort)

    def _start(self, start: HeatedState | None) -> HeatedState:
        if start is None:
            return self.wire.begin()
        check_kind("start", start, HeatedState)
        return start

    def _as_targets(self, targets: npt.ArrayLike) -> FloatArray:
        wanted = as_samples(targets, name="targets")
        if wanted.ndim != 1 or not 1 <= wanted.size <= MOST_TARGETS:
            raise SignalError(
                f"targets have shape {wanted.shape}; give (N,), N from 1 to {MOST_TARGETS}"
            )
        largest = float(np.abs(wanted).max())
        if largest > MOST_DEGREES:
            raise SignalError(
                f"the targets reach {largest:g} degrees; give angles of at most {MOST_DEGREES:g}"
            )
        return wanted


def _difference_matrix(size: int) -> FloatArray:
    return np.eye(size) - np.eye(size, k=-1)
