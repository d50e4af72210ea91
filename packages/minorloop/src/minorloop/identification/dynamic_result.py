"""Result of the identification of an operator with dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop.dynamics.cascade import Cascade, CascadeInversion
from minorloop.errors import counted
from minorloop.figures import Drawn
from minorloop.identification.accuracy import Accuracy, accuracy, scores_of
from minorloop.identification.baseline import percent
from minorloop.identification.preparation import NOTHING, RecordAdvice
from minorloop.identification.result import Identification
from minorloop.identification.scores import accuracy_rows
from minorloop.operators.inversion import Unreachable
from minorloop.operators.memory import Start

_SHORT = 3.0
"""Time constants that a record must be long."""


@dataclass(frozen=True)
class TriedDynamics:
    """Dynamics that were compared, on a coarse plane."""

    ahead: int
    behind: int
    """``ahead`` and ``behind``: number of poles before and behind the operator."""
    dead_time: float
    """In seconds."""
    creep: bool
    """Whether there is creep."""
    error: float
    """Error on left-out pieces of the record, over the range of the output."""
    chosen: bool = False
    """Whether these were chosen."""
    near: bool = False
    """Whether their errors cannot be told from those of the chosen ones."""

    @property
    def structure(self) -> tuple[int, int, bool]:
        """Numbers of poles before and behind the operator, and whether there is creep."""
        return self.ahead, self.behind, self.creep

    @property
    def what(self) -> str:
        """The parts, in the order in which signals pass them."""
        before = f"{counted(self.ahead, 'pole')}, " if self.ahead else ""
        after = f", {counted(self.behind, 'pole')}" if self.behind or not self.ahead else ""
        return f"{before}operator{after}{', creep' if self.creep else ''}"

    def __str__(self) -> str:
        mark = "  chosen" if self.chosen else "  as good" if self.near else ""
        error = f"{percent(self.error)} of range on left-out pieces{mark}"
        return f"{self.what}, dead time {self.dead_time:.3g} s: {error}"


@dataclass(frozen=True, eq=False)
class DynamicIdentification(Drawn):
    """An operator with dead time, linear dynamics and creep, identified from a record."""

    model: Cascade
    """The model. Its linear part has DC gain 1, and so has its creep."""
    static: Identification
    """The operator, with what it alone would have given plus the residual of the model, and the
    measured outputs, over whose range its errors are given."""
    t: FloatArray
    u: FloatArray
    y: FloatArray
    """Shape (T,). The record; y is NaN where nothing was measured."""
    fitted: BoolArray
    held_out: BoolArray
    """Shape (T,). Samples that were fitted, and samples that were held out."""
    tried: tuple[TriedDynamics, ...]
    """Dynamics that were compared."""
    startup: int = 0
    """Number of first rows that the other rows do not predict; 0 if there are none."""
    startup_fitted: bool = True
    """Whether these are fitted all the same, because they make the model of the others no worse."""
    told: RecordAdvice = NOTHING
    """What was found in the record as it was read."""

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return self.predict(self.t, self.u)

    @cached_property
    def accuracy(self) -> Accuracy:
        """Errors on the fitted samples."""
        return accuracy(self.u, self.y, self.prediction, self.fitted, self.static.curves)

    @cached_property
    def holdout_accuracy(self) -> Accuracy | None:
        """Errors on the samples held out; None if none were."""
        if not self.held_out.any():
            return None
        return accuracy(self.u, self.y, self.prediction, self.held_out, self.static.curves)

    @property
    def nrmse(self) -> float:
        """Error on the fitted samples, over their range."""
        return self.accuracy.nrmse

    @property
    def holdout_nrmse(self) -> float | None:
        """Error on the samples held out, over their range; None if none were."""
        return None if self.holdout_accuracy is None else self.holdout_accuracy.nrmse

    @property
    def lag(self) -> int:
        """0: dead time is a part of the model."""
        return 0

    @property
    def lag_seconds(self) -> float:
        """0, as `lag`."""
        return 0.0

    @property
    def scores(self) -> dict[str, float | None]:
        """Scores that a model file keeps; those on held-out samples are None if there are none."""
        return scores_of(self.accuracy, self.holdout_accuracy)

    @property
    def dynamic(self) -> bool:
        """Whether there are dead time, poles or creep."""
        delay = self.model.linear.delay
        return self._times.size > 0 or delay > 0 or self.model.creep is not None

    @property
    def _times(self) -> FloatArray:
        """Time constants before and behind the operator, slowest first."""
        parts = [part for part in (self.model.ahead, self.model.linear) if part is not None]
        return np.sort(np.concatenate([part.time_constants for part in parts]))[::-1]

    def predict(self, t: npt.ArrayLike, u: npt.ArrayLike) -> FloatArray:
        """Predict the outputs for another input, as `Result.predict`.

        u[k] is applied from the sample before; the first has been applied for long.
        """
        return self.model.simulate(t, u, self.static.start)

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        *,
        before: float,
        start: Start | None = None,
        filter_time: float | None = None,
        unreachable: Unreachable = "raise",
    ) -> CascadeInversion:
        """Return the input, held between samples, with which the output follows a trajectory.

        Parameters and errors are those of `Cascade.invert`; the start is that of the record if not
        given.
        """
        return self.model.invert(
            t,
            targets,
            self.static.start if start is None else start,
            before=before,
            filter_time=filter_time,
            unreachable=unreachable,
            between="held",
        )

    @cached_property
    def advice(self) -> tuple[str, ...]:
        """Sentences about what is weak and what to do; empty if nothing is weak."""
        texts = list(self.static.advice)
        times = self._times
        interval, seconds = float(self.t[1] - self.t[0]), float(self.t[-1])
        if times.size and times[-1] < interval:
            texts.append(
                f"the fastest time constant is {times[-1]:.3g} s and the sampling interval "
                f"{interval:.3g} s; sample faster to know it"
            )
        if times.size and _SHORT * times[0] > seconds:
            texts.append(
                f"the slowest time constant is {times[0]:.3g} s and the record {seconds:.3g} s "
                "long; record three time constants at least"
            )
        if self.startup and self.startup_fitted:
            texts.append(
                f"the first {self.startup} rows move the output as no later row does, so nothing "
                "shows whether the memory was known before them: if the actuator was not moved "
                "over its whole range and back before the record, leave them out with "
                f"skip={self.startup} (--skip {self.startup}); or record large loops twice"
            )
        elif self.startup:
            texts.append(
                f"the first {self.startup} rows are not fitted: with them the other rows fit "
                "worse, so the record seems to begin with another memory than the model assumes, "
                "such as that of an actuator that rested for long; move it over its whole range "
                "and back before the record, or give the start state that it has (--start)"
            )
        near = [one for one in self.tried if one.near]
        if near:
            texts.append(
                f"the structure of the dynamics is too close to call: {near[0].what} and "
                f"{self._chosen.what} are equally good on left-out pieces of the record; record "
                "faster or larger reversals, or give the order that the physics has, such as "
                'first="operator" (--dynamics operator)'
            )
        if not self.dynamic:
            texts.append(
                "with dead time, poles or creep the model is no better than with the operator alone"
            )
        static = self.static
        samples = bool(static.findings or static.codes or static.suspects)
        return self.told.with_model(self.warnings, texts, samples=samples)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The part of the advice that says why the model is not to be trusted."""
        return (*self.told.warnings, *self.static.warnings)

    @property
    def chosen(self) -> tuple[str, ...]:
        """What was chosen and not given: columns of the record and options, one sentence each."""
        return (*self.told.chosen, *self.static.chosen)

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Rows of a table, label and value: errors, then dynamics."""
        linear, creep, held = self.model.linear, self.model.creep, self.holdout_nrmse
        order = "dynamics, then operator"
        sides = [("time constants", linear)]
        if self.model.ahead is not None:
            order = "dynamics, operator, dynamics"
            sides = [("time constants before", self.model.ahead), ("time constants behind", linear)]
        elif self.model.first == "operator":
            order = "operator, then dynamics"
        rows = [
            ("error on fitted data", f"{percent(self.nrmse)} of range"),
            ("error on held-out data", "-" if held is None else f"{percent(held)} of range"),
            *accuracy_rows(self.accuracy, self.holdout_accuracy),
            ("order", order),
            *self._runner_up(),
            *((name, _seconds(part.time_constants)) for name, part in sides),
            ("dead time", f"{linear.delay:.4g} s" if linear.delay else "none"),
        ]
        poles = np.concatenate([part.poles for _, part in sides])
        oscillating = poles[poles.imag > 0]
        if oscillating.size:
            size = abs(oscillating[0])
            rows.append(("resonance", f"{size / (2 * np.pi):.4g} Hz"))
            rows.append(("damping ratio", f"{-oscillating[0].real / size:.3g}"))
        if creep is not None:
            used = creep.times[creep.strengths > 0][[0, -1]]
            within = " to ".join(dict.fromkeys(f"{time:.3g} s" for time in used))
            rows.append(("creep", f"{creep.strengths.sum():.1%} of the output, within {within}"))
        return rows

    def _runner_up(self) -> list[tuple[str, str]]:
        """Return rows on the choice and its runner-up; none where no other was tried."""
        other = self.runner_up
        if other is None:
            return []
        chosen = self._chosen
        return [
            ("chosen", f"{chosen.what}: {percent(chosen.error)} of range on left-out pieces"),
            ("runner-up", f"{other.what}: {percent(other.error)}{', as good' * other.near}"),
        ]

    @property
    def _chosen(self) -> TriedDynamics:
        return next(one for one in self.tried if one.chosen)

    @property
    def runner_up(self) -> TriedDynamics | None:
        """The best of the structures that do not contain the chosen one; None without one.

        One that contains it, with more poles, is always nearly as good.
        """
        chosen = self._chosen.structure
        others = [
            one
            for one in self.tried
            if any(a < b for a, b in zip(one.structure, chosen, strict=True))
        ]
        return min(others, key=lambda one: one.error, default=None)

    def __str__(self) -> str:
        lines = [f"{name:<24} {value}" for name, value in self.rows]
        tried = [f"tried: {one}" for one in self.tried]
        return "\n".join([*lines, *tried, *(f"advice: {text}" for text in self.advice)])


def _seconds(times: FloatArray) -> str:
    return ", ".join(f"{time:.4g} s" for time in times) or "none"
