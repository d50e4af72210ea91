"""An operator with dynamics fitted to a record: its scores and advice."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.dynamics.cascade import Cascade, CascadeInversion
from minorloop.errors import counted
from minorloop.identification.baseline import percent
from minorloop.identification.plane_result import Identification
from minorloop.identification.result import ERRORS, MORE_ERRORS, Fit, Rule, ScoreRow
from minorloop.modelfile import plain
from minorloop.operators.inversion import Unreachable
from minorloop.operators.memory import Start
from minorloop.report import Report, Table

_OF_OPERATOR = (
    *("samples fitted", "samples held out", "rows skipped", "unknowns", "free parameters"),
    *("effective parameters", "rank", "cells excited", "optimality (KKT)"),
    "standard deviation predicted",
)
"""Scores of the operator that are shown beside dynamics."""


@dataclass(frozen=True)
class TriedDynamics:
    """Dynamics that were compared, on a coarse plane of the operator."""

    ahead: int
    behind: int
    """``ahead`` and ``behind``: number of poles before and behind the operator."""
    dead_time: float
    """Dead time in seconds."""
    creep: bool
    """Whether there is creep."""
    error: float
    """Error on left-out pieces of the record, over the range of the output."""
    chosen: bool = False
    """Whether these dynamics were chosen."""
    near: bool = False
    """Whether the errors do not distinguish these dynamics from the chosen ones."""

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


def _times(fit: DynamicIdentification) -> Iterator[str]:
    """Say which time constants the record does not determine."""
    times, interval, seconds = fit.times, float(fit.t[1] - fit.t[0]), float(fit.t[-1])
    if times.size and times[-1] < interval:
        yield (
            f"the fastest time constant is {times[-1]:.3g} s and the sampling interval "
            f"{interval:.3g} s; sample faster to determine it"
        )
    # Least length of a record in time constants
    if times.size and 3.0 * times[0] > seconds:
        yield (
            f"the slowest time constant is {times[0]:.3g} s and the record is {seconds:.3g} s "
            "long; record at least three time constants"
        )


def _startup(fit: DynamicIdentification) -> Iterator[str]:
    """Say what to do about first rows that contradict the other rows."""
    if fit.startup:
        yield (
            f"the first {fit.startup} rows are not fitted: with them the other rows fit "
            "worse, so the record seems to begin with another memory than the model assumes, "
            "such as that of an actuator after a long rest; move it over its whole range "
            "and back before the record, or give its start state (--record start)"
        )


def _structure(fit: DynamicIdentification) -> Iterator[str]:
    """Say whether the structure is uncertain, or no better than the operator alone."""
    near = [one for one in fit.tried if one.near]
    if near:
        yield (
            f"the structure of the dynamics is uncertain: {near[0].what} and "
            f"{fit.best.what} are equally good on left-out pieces of the record; record "
            "faster or larger reversals, or give the order that follows from the physics, such as "
            'first="operator" (--law dynamics:first=operator)'
        )
    if not fit.dynamic:
        yield "with dead time, poles or creep the model is no better than with the operator alone"


def _chosen(one: TriedDynamics) -> str:
    return f"{one.what}: {percent(one.error)} of range on left-out pieces"


def _of_static(score: ScoreRow) -> ScoreRow:
    """Return a score of the operator as a score of the whole fit."""
    label = score.label if score.label in _OF_OPERATOR else ""
    name = "" if score.name in ("chosen", *(one.name for one in _ERRORS)) else score.name
    return replace(
        score, value=lambda fit: score.of(fit.static), label=label, name=name, kept=False
    )


def _figures(fit: DynamicIdentification) -> dict[str, Any]:
    """Dynamics as ``--json`` prints them."""
    model = fit.model
    return {
        "first": model.first,
        "ahead": None if model.ahead is None else plain(model.ahead),
        "numerator": model.linear.numerator,
        "denominator": model.linear.denominator,
        "dead_time": model.linear.delay,
        "time_constants": model.linear.time_constants,
        "creep": None if model.creep is None else plain(model.creep),
        "tried": fit.tried,
    }


_ERRORS = (*ERRORS, *MORE_ERRORS)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DynamicIdentification(Fit[Cascade]):
    """An operator with dead time, linear dynamics and creep, identified from a record."""

    HEADLINE: ClassVar[str] = (
        "{output} against {input}: Preisach, {fit.static.model.bands} bands, with dynamics"
    )
    CAPTION: ClassVar[str] = (
        "The record with the model, held-out samples shaded; the operator alone, which is the "
        "output for slow inputs; the residual; the unit step response of the dynamics."
    )
    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        *ERRORS,
        ScoreRow("", "_order", "order"),
        ScoreRow("", "_times_text", "time constants"),
        ScoreRow("", lambda fit: fit.model.linear.delay or None, "dead time", "{:.4g} s", "none"),
        *MORE_ERRORS,
        ScoreRow("", "resonance", "resonance", "{0[0]:.4g} Hz, damping ratio {0[1]:.3g}"),
        ScoreRow("", "_creep_text", "creep"),
        ScoreRow("", "best", "chosen", _chosen),
        ScoreRow("dynamics", _figures),
        ScoreRow("chosen", "chosen"),
        *map(_of_static, Identification.SCORES),
    )
    WARNINGS: ClassVar[tuple[Rule, ...]] = (lambda fit: iter(fit.static.warnings),)
    REMARKS: ClassVar[tuple[Rule, ...]] = (
        lambda fit: iter(fit.static.advice),
        *(_times, _startup, _structure),
    )

    t: FloatArray
    """Shape (T,). Time of each row in seconds."""
    static: Identification
    """The identification of the operator. Its outputs are those of the operator alone plus the
    residual of the model; its errors are over the range of the measured outputs."""
    tried: tuple[TriedDynamics, ...]
    """Dynamics that were compared."""
    startup: int = 0
    """Number of first rows that are not fitted, because they make the model of other rows worse."""

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return self.predict(self.t, self.u)

    @property
    def unknowns(self) -> int:
        """Weights of the operator, and its offset and slope where fitted."""
        return self.static.unknowns

    @property
    def dynamic(self) -> bool:
        """Whether there are dead time, poles or creep."""
        delay = self.model.linear.delay
        return self.times.size > 0 or delay > 0 or self.model.creep is not None

    @property
    def times(self) -> FloatArray:
        """Time constants before and behind the operator in seconds, slowest first."""
        parts = [part for part in (self.model.ahead, self.model.linear) if part is not None]
        return np.sort(np.concatenate([part.time_constants for part in parts]))[::-1]

    @property
    def chosen(self) -> tuple[str, ...]:
        """Choices of the identification: columns of the record and options, one sentence each."""
        return (*self.of_record.chosen, *self.static.chosen)

    @property
    def details(self) -> tuple[str, ...]:
        """Lines to print after the scores."""
        return (*(f"tried {one}" for one in self.tried), *super().details)

    @property
    def best(self) -> TriedDynamics:
        """The dynamics that were chosen."""
        return next(one for one in self.tried if one.chosen)

    @property
    def saved(self) -> Fit[Any]:
        """The operator alone if there are no dynamics."""
        return self if self.dynamic else self.static

    def predict(self, t: npt.ArrayLike, u: npt.ArrayLike) -> FloatArray:
        """Predict the outputs for another input, as `Result.predict`.

        u[k] is applied from the previous sample; the first input has been applied for a long time.
        """
        return self.model.simulate(t, u, self.curves.start)

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

        Parameters and errors are those of `Cascade.invert`; the default start is that of the
        record.
        """
        return self.model.invert(
            t,
            targets,
            self.curves.start if start is None else start,
            before=before,
            filter_time=filter_time,
            unreachable=unreachable,
            between="held",
        )

    @property
    def _names_samples(self) -> bool:
        return self.static._names_samples

    @property
    def _order(self) -> str:
        if self.model.ahead is not None:
            return "dynamics, operator, dynamics"
        operator = self.model.first == "operator"
        return "operator, then dynamics" if operator else "dynamics, then operator"

    @property
    def _times_text(self) -> str:
        behind = _seconds(self.model.linear.time_constants)
        if self.model.ahead is None:
            return behind
        return f"before: {_seconds(self.model.ahead.time_constants)}; behind: {behind}"

    @property
    def resonance(self) -> tuple[float, float] | None:
        """Frequency in Hz and damping ratio of the first oscillation; None if there is none."""
        parts = [part.poles for part in (self.model.ahead, self.model.linear) if part is not None]
        poles = np.concatenate(parts)
        oscillating = poles[poles.imag > 0]
        if not oscillating.size:
            return None
        size = abs(oscillating[0])
        return float(size / (2 * np.pi)), float(-oscillating[0].real / size)

    @property
    def _creep_text(self) -> str:
        creep = self.model.creep
        if creep is None:
            return ""
        used = creep.times[creep.strengths > 0][[0, -1]]
        within = " to ".join(dict.fromkeys(f"{time:.3g} s" for time in used))
        return f"{creep.strengths.sum():.1%} of the output, within {within}"

    def _summary(self, source: str) -> str:
        held = self.holdout_nrmse
        held_out = "" if held is None else f", {percent(held, 2)} on held-out data"
        return (
            f"A Preisach model of {self.static.model.bands} bands with dynamics, identified from "
            f"{source}: {percent(self.nrmse, 2)} of range on fitted data{held_out}."
        )

    def _add_to(self, report: Report, labels: Mapping[str, str], of: str = "") -> None:
        super()._add_to(report, labels, of)
        compared = [(one.what, f"{one.dead_time:.3g}", percent(one.error)) for one in self.tried]
        report.add(
            "Dynamics that were compared",
            text=f"Chosen: {self.best.what}.",
            table=Table(("", "dead time [s]", "error, of range"), compared),
        )
        self.static._add_to(report, labels, ": the operator, without dynamics")


def _seconds(times: FloatArray) -> str:
    return ", ".join(f"{time:.4g} s" for time in times) or "none"
