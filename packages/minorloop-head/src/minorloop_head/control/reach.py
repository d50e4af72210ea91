"""Whether a target can be reached in the present surroundings, and if not, why.

While a wire is heated towards a target, it is simulated under many hypotheses about ambient and
convection. Hypotheses that do not explain the readings lose weight. A target is unreachable if
nearly all of the weight is on hypotheses under which full current is not enough; a wire that is
only slow leaves weight on those under which it arrives. Until a wire turns, its readings tell only
how late it is, and the weight is mostly that from before the heating: the target is then
unreachable if every single hypothesis under which the wire arrives is unlikely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop_head.control.controller import Loop
from minorloop_head.control.hypotheses import Bank, Hypotheses
from minorloop_head.control.observer import Estimate
from minorloop_head.heated_wire import HeatedWire

Reason: TypeAlias = Literal[
    "beyond the stroke",
    "convection too high",
    "ambient too cold",
    "colder surroundings or stronger cooling",
    "no motion",
    "load or ageing",
]

_STILL_DEGREES, _STILL_SECONDS = 0.3, 3.0
"""A wire that moves less than this, for so long, has stopped; the noise is 0.05 degrees."""
_PATIENCE = 2.3
"""Lags of full current before a wire counts as stopped: 90 % of the heat have arrived."""
_RISEN = 0.9
"""Share of the full current: if the current rose from below it and the wire did not move at all, no
surroundings explain that."""
_BEGUN = 2.0
"""Least motion in degrees of a wire that has begun to turn, about three times the model's error.
With less motion, a late wire looks like one that never turns."""
_JUDGED = 0.2
"""Seconds between two checks for a verdict."""
_DEADLINE = 9.5
"""Seconds after which a verdict is given even if its reason is not clear."""
_CLEAR, _LIKELY = 0.9, 0.8
"""Share of the weight that makes a reason clear, and least share with which it is given at the
deadline; below, both reasons are given."""
_UNSURE, _OFF = 0.05, 0.7
"""Error of a predicted motion in addition to the spread of the hypotheses: as a share of it, and
that of the model in degrees."""
_RARE = 0.01
"""Density over the largest: a wire that has not begun to turn does not arrive if every hypothesis
under which it would has less."""
_NEGLIGIBLE = 1e-7
"""Share of the largest weight below which a hypothesis is left out: all of them are below 0.2 %."""
_BAND = 0.95
"""Weight of the hypotheses within the stated reach."""
_WORSE, _POOR = 12.0, 6.0
"""Excess cost over the best hypothesis above which others do not explain the readings, and cost per
independent reading above which no hypothesis does."""
_CORRECTED, _FAR = 20.0, 10.0
"""Seconds of full current after which a verdict is corrected, and least distance in degrees between
the wire and its predicted reach for that."""
STROKE_SHARE = 0.97
"""Share of the stroke beyond which a wire is not heated: at its end the angle does not depend on
the temperature."""


@dataclass(frozen=True)
class Unreachable:
    """A target that cannot be reached."""

    reason: Reason
    """Why."""
    reference: float
    """Target in degrees."""
    reach: float
    """Largest angle that the wire is expected to reach, in degrees."""
    after: float
    """Duration of the trial, in seconds."""
    least: float = math.nan
    most: float = math.nan
    """Bounds of that angle: the largest reached angle, and that allowed by the model, which was
    identified in other surroundings; NaN for the reach itself."""

    def __str__(self) -> str:
        known = f"{_shown(self.least)} to {_shown(self.most)}"
        if math.isnan(self.least) or math.isnan(self.most):
            known = f"at most {_shown(self.reach)}"
        target = f"target {_shown(self.reference)} degrees"
        if self.reason == "no motion":
            return (
                f"{target} is unreachable: no motion at {_shown(self.reach)} degrees; the wire is "
                "stuck or broken, or the sensor does not turn with it"
            )
        return f"{target} is unreachable: {self.reason}; the wire would reach {known} degrees"


@dataclass(frozen=True, eq=False)
class Trial:
    """A heating towards a target."""

    bank: Bank
    """The simulated hypotheses."""
    began: float
    mark: float
    """Angle at the beginning, and after the last motion, in degrees."""
    seconds: float = 0.0
    """Since it began."""
    full: float = 0.0
    """Seconds of full current without a break."""
    still: float = 0.0
    """Seconds without motion."""
    least: float = math.inf
    """Smallest applied current, in A."""
    evidence: float = 0.0
    """Cost of the best hypothesis of a stronger cooling less that of the best one of a colder
    ambient, when they differed most: they differ during the heating, but not at its end."""


@dataclass(frozen=True, eq=False)
class ReachState:
    """State of the present target."""

    trial: Trial | None = None
    """The trial before a verdict."""
    verdict: Unreachable | None = None
    """The target cannot be reached."""
    age: float = 0.0
    full: float = 0.0
    """Seconds since the verdict, and of full current since then without a break."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReachWatch(Loop):
    """Decides whether targets can be reached."""

    wire: HeatedWire
    """The model."""
    rise: float = 676.0
    """Steady rise of the temperature of a hot wire for a heating power, in K per A^2."""
    cold_resistance: float = 0.8
    """Resistance of a cold wire over that of a hot one."""
    tolerance: float = 1.0
    """Degrees beyond the reach from which a target is unreachable."""
    certainty: float = 0.995
    """Least weight of the hypotheses under which it is unreachable."""
    retry: float = 60.0
    """Seconds after which an unreachable target is tried again."""

    def step(
        self,
        state: ReachState,
        reference: float,
        measurement: float,
        current: float,
        estimate: Estimate,
    ) -> ReachState:
        """Return the state one interval later.

        ``reference``: target in degrees. ``measurement``: reading in degrees; NaN where there is
        none. ``current``: applied, in A. ``estimate``: of the wire now.
        """
        if state.verdict is not None:
            state = self._keep_verdict(state, state.verdict, reference, measurement, current)
            if state.verdict is not None:
                return state
        low, top = self.wire.operator.range
        end = STROKE_SHARE * top
        if reference > end + self.tolerance:
            return ReachState(verdict=Unreachable("beyond the stroke", reference, end, 0.0))
        reference = min(reference, end)
        angle = measurement if np.isfinite(measurement) else estimate.angle
        if reference - angle <= 0.5 * self.tolerance:
            return ReachState()
        trial = state.trial
        if trial is None:
            moving = angle > low + self.tolerance
            bank = self._hypotheses.begin(estimate, moving=moving)
            trial = Trial(bank, angle, angle)
        trial = self._follow(trial, measurement, angle, current)
        return ReachState(trial, self._verdict(trial, reference, angle))

    def _keep_verdict(
        self,
        state: ReachState,
        verdict: Unreachable,
        reference: float,
        measurement: float,
        current: float,
    ) -> ReachState:
        """Keep a verdict until the target is within reach or changes, or the verdict is old.

        If the wire stays far from the predicted reach under full current, the reach is corrected. A
        verdict is withdrawn if the wire comes to its target, or farther than the model allows.
        """
        full = state.full + self.interval if self._is_full(current) else 0.0
        if full > _CORRECTED and measurement < verdict.reach - _FAR:
            verdict = replace(verdict, reach=measurement, least=measurement, most=measurement)
            state = replace(state, verdict=verdict)
        same = abs(reference - verdict.reference) <= 0.5 * self.tolerance
        within_reach = reference <= verdict.reach - self.tolerance
        beyond = verdict.reason != "beyond the stroke" and reference > verdict.reach
        reached = measurement > verdict.reference - 0.5 * self.tolerance
        refuted = reached or measurement > verdict.most + self.tolerance
        if within_reach or refuted or state.age > self.retry or not (same or beyond):
            return ReachState()
        return replace(state, age=state.age + self.interval, full=full)

    def _is_full(self, current: float) -> bool:
        return current >= 0.95 * self.highest

    def _follow(self, trial: Trial, measurement: float, angle: float, current: float) -> Trial:
        """Return the trial one interval later."""
        moved = abs(angle - trial.mark) > _STILL_DEGREES
        bank = self._hypotheses.step(trial.bank, current, measurement, self.interval)
        return Trial(
            bank=bank,
            began=trial.began,
            mark=angle if moved else trial.mark,
            seconds=trial.seconds + self.interval,
            full=trial.full + self.interval if self._is_full(current) else 0.0,
            still=0.0 if moved else trial.still + self.interval,
            least=min(trial.least, current),
            evidence=max(bank.colder, trial.evidence, key=abs),
        )

    def _verdict(self, trial: Trial, reference: float, angle: float) -> Unreachable | None:
        """Return a verdict once it is certain, and its reason is clear or the time is over."""
        due = round(trial.seconds / self.interval) % max(round(_JUDGED / self.interval), 1) == 0
        if not due or trial.full < self.wire.lag or reference - angle <= self.tolerance:
            return None
        begun = angle > self.wire.operator.range[0] + _BEGUN
        still = trial.still > _STILL_SECONDS and trial.full > _PATIENCE * self.wire.lag
        stopped = still and begun
        weights = self._hypotheses.weights(trial.bank)
        likely = np.flatnonzero(weights > _NEGLIGIBLE * weights.max())
        weight = weights[likely]
        final = self._hypotheses.final(trial.bank, angle, self.highest, likely)
        farthest = final + _OFF + _UNSURE * np.maximum(final - angle, 0.0)
        if begun:  # While the wire turns, an error of the branch feeds back like the angle.
            off = farthest - final
            farthest = self._hypotheses.final(trial.bank, angle, self.highest, likely, off)
        short = farthest < reference - self.tolerance
        if begun:
            open_still = float(weight[~short].sum()) > 1.0 - self.certainty
        else:  # Single ones: the many under which it never turns would outweigh one.
            single = weight * self._hypotheses.density[likely]
            open_still = float(single[~short].max(initial=0.0) / single.max()) > _RARE
        if open_still and not stopped:
            return None
        if stopped:
            short = final < reference + self.tolerance
        late = stopped or trial.seconds > _DEADLINE
        falling = np.zeros_like(weights)
        falling[likely[short]] = weight[short]
        unmoved = abs(angle - trial.began) < 0.5 * self.tolerance
        stuck = stopped and unmoved and trial.least < _RISEN * self.highest
        reason = "no motion" if stuck else self._reason(trial, falling, angle, late=late)
        if reason is None:
            return None
        reach = angle if stopped else max(float(weight @ final), angle)
        order = np.argsort(farthest)
        at = int(np.searchsorted(np.cumsum(weight[order]), _BAND))
        most = max(float(farthest[order[min(at, order.size - 1)]]), reach)
        return Unreachable(reason, reference, reach, trial.seconds, angle, most)

    def _reason(
        self, trial: Trial, weight: FloatArray, angle: float, *, late: bool
    ) -> Reason | None:
        """Return the reason with the largest effect on the reach, both if two are equal.

        None if it is not clear yet before the deadline.
        """
        cost, total = trial.bank.cost, float(weight.sum())
        best, independent = float(cost.min()), self._hypotheses.independent(trial.seconds)
        likely = cost[weight > 0]
        lost = likely.size == 0 or float(likely.min()) > best + max(_WORSE, independent)
        if lost or best > _POOR * independent:
            if not late:  # If no hypothesis explains the wire, none predicts it.
                return None
            still = angle - trial.began < 0.5 * self.tolerance
            return "no motion" if still else "load or ageing"
        share = float(weight @ self._hypotheses.colder) / total
        if abs(trial.evidence) > _WORSE:
            share = float(trial.evidence > 0)
        if max(share, 1.0 - share) > (_LIKELY if late else _CLEAR):
            return "ambient too cold" if share > 0.5 else "convection too high"
        return "colder surroundings or stronger cooling" if late else None

    @cached_property
    def _hypotheses(self) -> Hypotheses:
        return Hypotheses(
            wire=self.wire,
            rise=self.rise,
            cold_resistance=self.cold_resistance,
            highest=self.highest,
        )


def _shown(angle: float) -> str:
    """Return an angle in degrees to one decimal: readings have a noise of 0.05."""
    return f"{round(angle, 1) + 0.0:g}"
