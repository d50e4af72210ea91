"""Result of the identification of an operator with dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray
from minorloop.dynamics.cascade import Cascade, CascadeInversion, First
from minorloop.errors import counted
from minorloop.figures import NotebookView, figure_of
from minorloop.identification.accuracy import Accuracy, accuracy, scores_of
from minorloop.identification.baseline import percent
from minorloop.identification.result import Identification
from minorloop.identification.scores import accuracy_rows
from minorloop.operators.inversion import Unreachable
from minorloop.operators.memory import Start

_CLOSE = 1.1
"""Error of the other order, over that of the chosen one, up to which the order is not known."""
_SHORT = 3.0
"""Time constants that a record must be long."""


@dataclass(frozen=True)
class TriedDynamics:
    """Dynamics that were compared, on a coarse plane.

    Parameters
    ----------
    first : {"operator", "linear"}
        Which of operator and linear dynamics receives the input.
    poles : int
        Number of poles.
    dead_time : float
        In seconds.
    creep : bool
        Whether there is creep.
    error : float
        Error on the fitted samples, over the range of the output.
    chosen : bool
        Whether these were chosen.
    """

    first: First
    poles: int
    dead_time: float
    creep: bool
    error: float
    chosen: bool = False

    @property
    def what(self) -> str:
        """The parts, in the order in which signals pass them."""
        poles = counted(self.poles, "pole")
        order = f"operator, {poles}" if self.first == "operator" else f"{poles}, operator"
        return f"{order}, creep" if self.creep else order

    def __str__(self) -> str:
        mark = "  chosen" if self.chosen else ""
        error = f"{percent(self.error)} of range{mark}"
        return f"{self.what}, dead time {self.dead_time:.3g} s: {error}"


@dataclass(frozen=True, eq=False)
class DynamicIdentification(NotebookView):
    """An operator with dead time, linear dynamics and creep, identified from a record.

    Parameters
    ----------
    model : Cascade
        The model. Its linear part has DC gain 1, and so has its creep.
    static : Identification
        The operator, with what it alone would have given plus the residual of the model, and the
        measured outputs, over whose range its errors are given.
    t, u, y : (T,) arrays
        The record; y is NaN where nothing was measured.
    fitted, held_out : (T,) arrays of bool
        Samples that were fitted, and samples that were held out.
    tried : tuple of TriedDynamics
        Dynamics that were compared.
    """

    model: Cascade
    static: Identification
    t: FloatArray
    u: FloatArray
    y: FloatArray
    fitted: BoolArray
    held_out: BoolArray
    tried: tuple[TriedDynamics, ...]

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
        linear = self.model.linear
        return linear.order > 0 or linear.delay > 0 or self.model.creep is not None

    def predict(self, t: npt.ArrayLike, u: npt.ArrayLike) -> FloatArray:
        """Predict the outputs for another input, from the same start as the record.

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds.
        u : (T,) array_like
            Inputs; u[k] is applied from the sample before. The first has been applied for long.

        Returns
        -------
        (T,) array

        Raises
        ------
        SignalError
            If the shapes differ or times do not increase.
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

        Parameters
        ----------
        t : (T,) array_like
            Strictly increasing times in seconds.
        targets : (T,) array_like
            Wanted outputs.
        before : float
            Input at which the actuator had settled before.
        start : start state, optional
            Memory before ``before`` was applied; that of the record if not given.
        filter_time, unreachable
            As in `Cascade.invert`.

        Returns
        -------
        CascadeInversion

        Raises
        ------
        NotInvertibleError, UnreachableError
            As in `Cascade.invert`.
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
        times = self.model.linear.time_constants
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
        other = self.other_order
        if other and other.error < _CLOSE * next(one.error for one in self.tried if one.chosen):
            texts.append(
                "which of operator and dynamics comes first is too close to call: the errors of "
                f"both orders differ by less than {_CLOSE - 1:.0%}; record faster or larger "
                'reversals, or give the order that the physics has, such as first="operator" '
                "(--dynamics operator)"
            )
        if not self.dynamic:
            texts.append(
                "with dead time, poles or creep the model is no better than with the operator alone"
            )
        return tuple(texts)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The part of the advice that says why the model is not to be trusted."""
        return self.static.warnings

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Rows of a table, label and value: errors, then dynamics."""
        linear, creep, held = self.model.linear, self.model.creep, self.holdout_nrmse
        after = self.model.first == "operator"
        times = ", ".join(f"{time:.4g} s" for time in linear.time_constants) or "none"
        rows = [
            ("error on fitted data", f"{percent(self.nrmse)} of range"),
            ("error on held-out data", "-" if held is None else f"{percent(held)} of range"),
            *accuracy_rows(self.accuracy, self.holdout_accuracy),
            ("order", "operator, then dynamics" if after else "dynamics, then operator"),
            *self._margin(),
            ("time constants", times),
            ("dead time", f"{linear.delay:.4g} s" if linear.delay else "none"),
        ]
        oscillating = linear.poles[linear.poles.imag > 0]
        if oscillating.size:
            size = abs(oscillating[0])
            rows.append(("resonance", f"{size / (2 * np.pi):.4g} Hz"))
            rows.append(("damping ratio", f"{-oscillating[0].real / size:.3g}"))
        if creep is not None:
            used = creep.times[creep.strengths > 0][[0, -1]]
            within = " to ".join(dict.fromkeys(f"{time:.3g} s" for time in used))
            rows.append(("creep", f"{creep.strengths.sum():.1%} of the output, within {within}"))
        return rows

    def _margin(self) -> list[tuple[str, str]]:
        """Return a row on the other order; none where it makes no difference or was not tried."""
        other = self.other_order
        if other is None:
            return []
        chosen = next(one for one in self.tried if one.chosen)
        errors = f"{percent(other.error)} of range, not {percent(chosen.error)}"
        return [("the other order", errors)]

    @property
    def other_order(self) -> TriedDynamics | None:
        """The best fit that was tried with operator and dynamics the other way round."""
        chosen = next((one for one in self.tried if one.chosen), None)
        others = [one for one in self.tried if one.poles and one.first != self.model.first]
        if chosen is None or not chosen.poles or not others:
            return None
        return min(others, key=lambda one: one.error)

    def __str__(self) -> str:
        lines = [f"{name:<24} {value}" for name, value in self.rows]
        tried = [f"tried: {one}" for one in self.tried]
        return "\n".join([*lines, *tried, *(f"advice: {text}" for text in self.advice)])

    def plot(self, *, input_label: str = "input", output_label: str = "output") -> Any:
        """Draw the record with the model, the operator, the residual and the step response.

        Parameters
        ----------
        input_label, output_label : str
            Names and units of input and output.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return figure_of(self, input_label=input_label, output_label=output_label)
