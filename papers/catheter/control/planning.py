"""Plan powers for targets that are known in advance.

The inverse of the operator and of the lag uses only the next target. If a wire cannot cool as fast
as the targets fall, that is too late; a plan that looks ahead cools early and does not overheat.
It begins with the best of several inverses that look ahead by different times, and is never worse
than the one that does not look ahead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import HIGHEST_CURRENT, heating
from minorloop_head.heated_wire import HeatedState, HeatedWire
from papers.catheter.control import _planning_kernels as _kernels
from papers.harness import rms

_DIFFERENCE_STEP = 1e-4
"""Step of the differences, as a share of full power."""
_DAMPINGS = np.array([1e-4, 1e-2, 1e-1, 1.0, 10.0])
_STRIDES = np.array([1.0, 0.5, 0.2])
"""Dampings, relative to the largest diagonal element, and lengths of the steps that are tried."""
_ENOUGH = 1e-4
"""Relative decrease of the cost that ends the sweeps."""
_MOST = HIGHEST_CURRENT**2


@dataclass(frozen=True, eq=False)
class PlannedPowers:
    """A sequence of powers, and its result."""

    power: FloatArray
    """Shape (N,). In A^2, each held for one interval."""
    y: FloatArray
    targets: FloatArray
    """Shape (N,). Angles at the ends of the intervals, and wanted ones, in degrees."""
    interval: float
    """In seconds."""

    @property
    def current(self) -> FloatArray:
        """(N,) currents in A."""
        return np.asarray(np.sqrt(self.power))

    @property
    def cost(self) -> float:
        """Sum of the squared errors."""
        return float(((self.y - self.targets) ** 2).sum())

    @property
    def rms(self) -> float:
        """Root-mean-square error in degrees."""
        return rms(self.y - self.targets)


@dataclass(frozen=True, eq=False, kw_only=True)
class Planner:
    """Planner of powers over a receding horizon.

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
    """The model."""
    interval: float = 0.5
    """Time between two targets in seconds, for which a power is held."""
    horizon: int = 24
    """Number of targets that a plan looks ahead."""
    sweeps: int = 4
    """Improvements of the plan at each target."""
    parts: int = 4
    """Implicit steps of the heat balance in an interval."""

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
            Number of targets that the inverse looks ahead.
        """
        wanted = np.asarray(targets, dtype=np.float64)
        first = state = start or self.wire.begin()
        power = np.empty_like(wanted)
        for k in range(wanted.size):
            target = float(wanted[min(k + ahead, wanted.size - 1)])
            requested = heating(self.wire, state, target, response=self.interval)
            power[k] = min(max(requested, 0.0), _MOST)
            state = self._held(state, float(power[k]))
        return self._plan(power, wanted, first)

    def plan(self, targets: npt.ArrayLike, start: HeatedState | None = None) -> PlannedPowers:
        """Return the powers of least cost that was found, at most that of inverse feedforward."""
        state = start or self.wire.begin()
        looks = range(min(self.horizon, np.size(targets)))
        tries = [self.feedforward(targets, state, ahead=n) for n in looks]
        tries.append(self._receding(min(tries, key=lambda plan: plan.cost), state))
        return min(tries, key=lambda plan: plan.cost)

    def _receding(self, first: PlannedPowers, start: HeatedState) -> PlannedPowers:
        """Improve the powers of a horizon, keep the first, and move on by one target."""
        power, state = first.power.copy(), start
        for k in range(power.size):
            window = slice(k, k + self.horizon)
            for _ in range(self.sweeps):
                better = self._improved(power[window], first.targets[window], state)
                if better is None:
                    break
                power[window] = better
            state = self._held(state, float(power[k]))
        return self._plan(power, first.targets, start)

    def _improved(
        self, power: FloatArray, wanted: FloatArray, state: HeatedState
    ) -> FloatArray | None:
        """Return powers of lower cost, None if no step lowers it enough."""
        difference = _DIFFERENCE_STEP * _MOST
        signs = np.where(power + difference <= _MOST, difference, -difference)
        y = self._angles(np.vstack([power, power + np.diag(signs)]), state)
        jacobian = ((y[1:] - y[0]) / signs[:, None]).T * _MOST
        residual = y[0] - wanted
        candidates = _candidates(power, jacobian, residual)
        costs = ((self._angles(candidates, state) - wanted) ** 2).sum(axis=1)
        best = int(costs.argmin())
        return candidates[best] if costs[best] < (1 - _ENOUGH) * (residual @ residual) else None

    def _held(self, state: HeatedState, power: float) -> HeatedState:
        """Return the state after an interval."""
        for _ in range(self.parts):
            state = self.wire.step(state, power, self.interval / self.parts)
        return state

    def _angles(self, powers: FloatArray, state: HeatedState) -> FloatArray:
        """Return the angles (C, N) under C sequences of powers (C, N)."""
        operator = self.wire.operator
        out = np.empty(powers.shape)
        _kernels.courses(
            operator.tables,
            *operator.stack(state.tracker.memory, 2),
            np.array([state.power, state.angle]),
            np.array([self.wire.lag, self.wire.latent]),
            np.ascontiguousarray(powers),
            self.interval / self.parts,
            self.parts,
            out,
        )
        return out

    def _plan(self, power: FloatArray, wanted: FloatArray, state: HeatedState) -> PlannedPowers:
        return PlannedPowers(power, self._angles(power[None], state)[0], wanted, self.interval)


def _candidates(power: FloatArray, jacobian: FloatArray, residual: FloatArray) -> FloatArray:
    """Return powers after steps of several dampings and lengths; those at a limit stay."""
    gradient = jacobian.T @ residual
    free = ~(((power <= 0) & (gradient > 0)) | ((power >= _MOST) & (gradient < 0)))
    if not free.any():
        return power[None]
    part = jacobian[:, free]
    normal = part.T @ part
    scale = max(float(normal.diagonal().max()), 1e-12)
    steps = np.zeros((_DAMPINGS.size, power.size))
    for row, damping in zip(steps, _DAMPINGS, strict=True):
        damped = normal + damping * scale * np.eye(len(normal))
        row[free] = -np.linalg.solve(damped, gradient[free])
    moves = (_STRIDES[:, None, None] * steps * _MOST).reshape(-1, power.size)
    return np.asarray(np.clip(power + moves, 0.0, _MOST))
