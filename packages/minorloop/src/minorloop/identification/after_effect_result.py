"""An operator with after-effect fitted to a record: its scores, advice and bands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, as_waveform, writable
from minorloop.errors import counted
from minorloop.identification.bands import Prediction, as_probability
from minorloop.identification.curves import Curves, as_curves
from minorloop.identification.model_error import by_input, width
from minorloop.identification.result import Fit, Rule, ScoreRow, of_range
from minorloop.operators import _after_effect_kernels as _kernels
from minorloop.operators.after_effect import AfterEffect, State
from minorloop.operators.inversion import Inversion, Unreachable
from minorloop.report import Picture, Report

_NEAR = 3
"""Number of intervals on either side that an interval is compared with. Their median ignores one
other long interval, and four slow rows in a row count as another rate."""


@dataclass(frozen=True, eq=False)
class TriedLaw:
    """A law that was tried.

    ``law`` is its name, ``numbers`` are the logarithms of its constants, ``error`` is the error on
    left-out rows over the range of the output, ``smoothness`` the strength of smoothing.
    """

    law: str
    numbers: FloatArray
    error: float
    smoothness: float


class _Uncertain(Protocol):
    """Uncertainty of the weights of a fit."""

    def variance(self, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
        """Variance (T,) of the output along an input."""


def _gaps(fit: AfterEffectIdentification) -> Iterator[str]:
    """Name gaps of the times in which the input changes."""
    # Change of the input, over its range, that needs a row inside a gap of the times
    moved = np.abs(np.diff(fit.u)) > 0.01 * float(np.ptp(fit.u))
    moved[fit.curves.begins[1:] - 1] = False
    long = np.flatnonzero(_isolated_long(np.diff(fit.t)) & moved)
    if long.size:
        row = int(long[0])
        yield (
            f"the input changes in {counted(long.size, 'gap')} of the times, first from "
            f"{fit.u[row]:.4g} to {fit.u[row + 1]:.4g} between {fit.t[row]:.6g} and "
            f"{fit.t[row + 1]:.6g} s; the model takes the change at the beginning of the gap, so "
            "add a row at the real time of the change"
        )


def _ends(field: FloatArray) -> str:
    return f"{field.min():.4g} to {field.max():.4g}" if field.size else ""


def _next_holds(fit: AfterEffectIdentification) -> Iterator[str]:
    """Say which holds to measure next."""
    ratio = fit.left_out_error / fit.without_time if fit.without_time else 1.0
    # Ratio of the left-out errors with and without time above which time explains nothing
    if fit.law == "none" or ratio > 0.98:
        yield (
            "time explains nothing in this record beyond the hysteresis; to see after-effect, "
            "hold the input at a few reversals ten times as long as now"
        )
        return
    longest, model = longest_hold(fit.t, fit.u, fit.curves), fit.model
    # Likelihood, over that of the best fit, from which a settling time is named
    likely = [one.settling for one, share in fit.settlings if share > 0.1]
    least, most = (pick([model.settling, *likely]) for pick in (min, max))
    if most > longest and fit.law != "viscous":
        seconds = f"{least:.3g} to {most:.3g}" if likely else f"{most:.3g}"
        yield (
            f"the effective input settles in {seconds} s, and no hold is longer than {longest:.3g} "
            "s; for predictions beyond it, hold a few reversals that long"
        )
    if model.times.size and np.abs(model.creep[-1]).sum() > np.abs(model.creep[:-1]).sum():
        yield (
            f"most creep has the longest time constant, {model.times[-1]:.3g} s; hold longer to "
            "separate it from drift"
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AfterEffectIdentification(Fit[AfterEffect]):
    """An operator with after-effect identified from a record."""

    HEADLINE: ClassVar[str] = (
        "{output} against {input} and time: Preisach, {fit.model.plane.bands} bands"
    )
    CAPTION: ClassVar[str] = "Record, loop, residual, and laws compared."
    SCORES: ClassVar[tuple[ScoreRow, ...]] = (
        ScoreRow("law", "law", "law"),
        ScoreRow("nrmse", "nrmse", "error on fitted data", of_range, kept=True),
        ScoreRow("left_out_nrmse", "left_out_error", "error on rows left out", of_range, kept=True),
        ScoreRow(
            "left_out_nrmse_without_time", "without_time", "  without time", of_range, kept=True
        ),
        ScoreRow(
            "settling", "model.settling", "settling time", lambda s: f"{s:.4g} s" if s else ""
        ),
        ScoreRow("field", "model.field", "fluctuation field", _ends),
        ScoreRow("times", "model.times"),
        ScoreRow("creep", lambda fit: [float(one.sum()) for one in fit.model.creep]),
        ScoreRow("laws", lambda fit: {one.law: one.error for one in fit.tried}),
        ScoreRow("range", "model.range"),
        ScoreRow("samples", lambda fit: int(fit.fitted.sum()), "samples fitted"),
        ScoreRow("levels", "model.plane.bands"),
    )
    WARNINGS: ClassVar[tuple[Rule, ...]] = (_gaps,)
    REMARKS: ClassVar[tuple[Rule, ...]] = (_next_holds,)

    t: FloatArray
    """Shape (T,). Time of each row in seconds."""
    law: str
    """The law by which the output changes with time."""
    tried: tuple[TriedLaw, ...]
    """All laws that were compared."""
    left_out: BoolArray
    """Shape (T,). Fitted rows that were left out to compare laws."""
    without: AfterEffect
    """The operator fitted without the rows left out."""
    settlings: tuple[tuple[AfterEffect, float], ...] = ()
    """Operators with other settling times, and their likelihood over the best."""
    groups: IntArray | None = None
    """Shape (T,). Number of the run of each row."""
    weights: _Uncertain | None = None
    """Uncertainty of the weights."""

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return along(self.model, self.t, self.u, self.curves)

    @property
    def unknowns(self) -> int:
        """Weights of the plane, and of its creep for each time constant."""
        bands = self.model.plane.bands
        return (1 + self.model.times.size) * bands * (bands + 1) // 2

    @property
    def left_out_error(self) -> float:
        """Root-mean-square error of rows left out, predicted by a fit to the others."""
        return next(one.error for one in self.tried if one.law == self.law)

    @property
    def without_time(self) -> float:
        """Root-mean-square error of the model without time on rows left out."""
        return self.tried[0].error

    def _further_rows(self) -> list[tuple[str, str]]:
        model = self.model
        whole = float(np.abs(model.settled.weights).sum()) or 1.0
        creep = [
            (f"creep, {time:.3g} s", f"{weights.sum() / whole:+.2%} of the weights")
            for time, weights in zip(model.times, model.creep, strict=True)
        ]
        return creep + [
            (f"law {one.law}", f"{one.error:.3%} on rows left out") for one in self.tried
        ]

    def _summary(self, source: str) -> str:
        left, without = self.left_out_error, self.without_time
        share = 1 - (left / without) ** 2 if without else 0.0
        return (
            f"Identified from {int(self.fitted.sum())} rows of {source}. On rows that were left "
            f"out, the error is {left:.3%} of the range, and {without:.3%} without time: time "
            f"explains {max(share, 0.0):.0%} of what hysteresis leaves."
        )

    def _add_to(self, report: Report, labels: Mapping[str, str], of: str = "") -> None:
        super()._add_to(report, labels, of)
        report.add(
            "Model",
            text="The loop of inputs that are held for long, and how the output settles in holds.",
            pictures=[
                Picture(self.model.plot(**labels), "Settled loop, and holds on the way down.")
            ],
        )

    def predict(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        bands: float | None = None,
        curves: npt.ArrayLike | None = None,
    ) -> FloatArray | Prediction:
        """Predict the outputs for another input, as `Result.predict`.

        The variance of bands is the sum of the variances of the errors on left-out rows near the
        same input, of the weights and of the settling time. If the record has runs, the band is
        that of another run.
        """
        times, inputs = as_waveform(t, u)
        parts = as_curves(curves, inputs.size, self.curves.start, None)
        y = along(self.model, times, inputs, parts)
        if bands is None:
            return y
        probability = as_probability(bands)
        sd = self._deviation(times, inputs, parts)
        return Prediction(inputs, y, self._factor(probability) * sd, probability)

    def invert(
        self,
        t: npt.ArrayLike,
        targets: npt.ArrayLike,
        start: State | None = None,
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Return the inputs that meet a target at each time, as `AfterEffect.invert`."""
        return self.model.invert(
            t, targets, self.curves.start if start is None else start, unreachable
        )

    def _deviation(self, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
        """Standard deviation (T,) of the output along an input."""
        variance = np.interp(u, *self._variance)
        total = 1 + sum(share for _, share in self.settlings)
        for other, share in self.settlings:
            apart = along(other, t, u, curves) - along(self.model, t, u, curves)
            variance = variance + share / total * apart**2
        if self.weights is not None:
            variance = variance + self.weights.variance(t, u, curves)
        return np.asarray(np.sqrt(variance))

    @cached_property
    def _variance(self) -> tuple[FloatArray, FloatArray]:
        """Inputs (B,), and the mean squared error of the left-out rows near each."""
        squares = self._errors**2
        return by_input(self.u[self.left_out], squares, float(squares.mean()))

    @cached_property
    def _errors(self) -> FloatArray:
        """Errors of the rows left out, predicted by a fit to the others."""
        found = along(self.without, self.t, self.u, self.curves)
        return np.asarray((found - self.y)[self.left_out])

    def _factor(self, probability: float) -> float:
        """Factor that makes bands of this probability contain that share of the left-out rows."""
        sd = np.sqrt(np.interp(self.u[self.left_out], *self._variance))
        scores = np.abs(self._errors) / np.where(sd > 0, sd, 1.0)
        runs = 1 if self.groups is None else np.unique(self.groups[self.fitted]).size
        return width(scores, probability, runs if runs > 1 else scores.size)


def along(model: AfterEffect, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
    """(T,) outputs of a model along curves; see `held` for the intervals."""
    u, y, steps = writable(u), np.empty_like(u), held(t, curves)
    for first, last in curves.parts(u.size):
        part = slice(first, last)
        stack, rows, creep, _ = model.stack(curves.start, last - first)
        _kernels.simulate(model.tables, stack, rows, creep, steps[part], u[part], y[part], True)
    return y


def held(t: FloatArray, curves: Curves) -> FloatArray:
    """(T,) seconds for which each input is held; the least of them where a curve begins."""
    steps = np.diff(t, prepend=t[0])
    steps[curves.begins] = steps[1:].min()
    return np.asarray(steps)


def longest_hold(t: FloatArray, u: FloatArray, curves: Curves) -> float:
    """Seconds of the longest time for which one input is held, within a curve."""
    begins = np.append(True, np.diff(u) != 0)
    begins[curves.begins] = True
    return float(np.add.reduceat(held(t, curves), np.flatnonzero(begins)).max())


def _isolated_long(steps: FloatArray) -> BoolArray:
    """Return (N,) whether each interval is far longer than those before and those after.

    At a change of the rate of a record, intervals are as long as those on one side.

    ``steps`` (N,): intervals in seconds.
    """
    if steps.size < 2:
        return np.zeros(steps.size, dtype=np.bool_)
    nothing = np.full(_NEAR, np.nan)
    windows = np.lib.stride_tricks.sliding_window_view
    near = windows(np.concatenate([nothing, steps, nothing]), _NEAR)
    before, after = near[: steps.size].copy(), near[_NEAR + 1 :].copy()
    # At an end of the record the intervals on the other side count.
    before[0], after[-1] = after[0], before[-1]
    usual = np.maximum(np.nanmedian(before, axis=1), np.nanmedian(after, axis=1))
    # Ratio to the intervals on both sides from which an interval is a gap, as in a log
    return np.asarray(steps > 5.0 * usual)
