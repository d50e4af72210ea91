"""Result of the identification of an operator with after-effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, as_waveform, writable
from minorloop.errors import counted
from minorloop.figures import Drawn
from minorloop.identification.bands import Prediction, as_probability
from minorloop.identification.curves import Curves, as_curves
from minorloop.identification.model_error import NORMAL_PARTS
from minorloop.identification.preparation import NOTHING, RecordAdvice
from minorloop.operators import _after_effect_kernels as _kernels
from minorloop.operators.after_effect import AfterEffect, State
from minorloop.operators.inversion import Inversion, Unreachable

_WIDTH = 0.06
_BINS = 60
"""Width, in ranges of the input, and number of the averages of squared errors along it, as in
`minorloop.identification.leave_out`."""
_FEW = 1e-12
"""Weight of rows below which none is near."""
_CHANGE = 0.01
"""Change of the input over its range that needs a row of its own in a gap of the times."""
_CREEPS = 0.98
"""Ratio of the left-out errors with and without time above which time explains nothing."""
_LIKELY = 0.1
"""Likelihood, over that of the best fit, from which a settling time is named."""
_NEAR = 3
"""Intervals on either side that an interval is compared with: of so many the median ignores one
that is long too, and four slow rows in a row are a rate of their own."""
_LONGER = 5.0
"""Ratio to those on both sides from which an interval is a gap, as in the times of a log."""


@dataclass(frozen=True, eq=False)
class TriedLaw:
    """A law that was tried.

    ``law`` is its name, ``numbers`` are the logarithms of its constants, ``error`` is that on rows
    left out over the range of the output, ``smoothness`` the strength of smoothing.
    """

    law: str
    numbers: FloatArray
    error: float
    smoothness: float


class Uncertain(Protocol):
    """Uncertainty of the weights of a fit."""

    def variance(self, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
        """Variance (T,) of the output along an input."""


@dataclass(frozen=True, eq=False)
class AfterEffectIdentification(Drawn):
    """An operator with after-effect identified from a record."""

    model: AfterEffect
    """The operator."""
    law: str
    """The law of its change with time."""
    tried: tuple[TriedLaw, ...]
    """All laws that were compared."""
    t: FloatArray
    u: FloatArray
    y: FloatArray
    """Shape (T,). The record."""
    fitted: BoolArray
    left_out: BoolArray
    """Shape (T,). Rows that were fitted, and those of them that were left out to compare laws."""
    curves: Curves
    """Where the memory is reset."""
    without: AfterEffect
    """The operator fitted without the rows left out."""
    directions: tuple[tuple[AfterEffect, AfterEffect], ...] = ()
    """Operators one standard deviation of the constants away, in both directions, along each
    principal axis."""
    settlings: tuple[tuple[AfterEffect, float], ...] = ()
    """Operators with other settling times, and how likely they are over the best."""
    groups: IntArray | None = None
    """Shape (T,). Number of the run of each row."""
    weights: Uncertain | None = None
    """Uncertainty of the weights."""
    lag: int = 0
    lag_seconds: float = 0.0
    """Lag of the output in rows and in seconds, for model files: none."""
    told: RecordAdvice = NOTHING
    """What was found in the record as it was read."""

    @cached_property
    def prediction(self) -> FloatArray:
        """(T,) outputs of the model along the record."""
        return along(self.model, self.t, self.u, self.curves)

    @property
    def nrmse(self) -> float:
        """Root-mean-square error of the fitted rows over the range of the output."""
        error = (self.prediction - self.y)[self.fitted]
        return float(np.sqrt(np.mean(error**2))) / self._range

    @property
    def left_out_error(self) -> float:
        """Root-mean-square error of rows left out, predicted by a fit to the others."""
        return next(one.error for one in self.tried if one.law == self.law)

    @property
    def without_time(self) -> float:
        """The same for the model without time."""
        return self.tried[0].error

    @property
    def scores(self) -> Mapping[str, float | None]:
        """Scores that a model file keeps."""
        return {
            "nrmse": self.nrmse,
            "left_out_nrmse": self.left_out_error,
            "left_out_nrmse_without_time": self.without_time,
        }

    @property
    def warnings(self) -> tuple[str, ...]:
        """Why the model is not to be trusted."""
        moved = np.abs(np.diff(self.u)) > _CHANGE * float(np.ptp(self.u))
        moved[self.curves.begins[1:] - 1] = False
        long = np.flatnonzero(isolated_long(np.diff(self.t)) & moved)
        if not long.size:
            return ()
        row = int(long[0])
        return (
            f"the input changes in {counted(long.size, 'gap')} of the times, first from "
            f"{self.u[row]:.4g} to {self.u[row + 1]:.4g} between {self.t[row]:.6g} and "
            f"{self.t[row + 1]:.6g} s; it "
            "counts as changed at the beginning of the gap, so give a row where it really changed",
        )

    @property
    def advice(self) -> tuple[str, ...]:
        """Warnings, and what to measure next."""
        said = [*self.warnings, *self.told.notes]
        ratio = self.left_out_error / self.without_time if self.without_time else 1.0
        if self.law == "none" or ratio > _CREEPS:
            said.append(
                "time explains nothing in this record beyond the hysteresis; to see after-effect, "
                "hold the input at a few reversals ten times as long as now"
            )
            return tuple(said)
        longest = longest_hold(self.t, self.u, self.curves)
        model = self.model
        likely = [one.settling for one, share in self.settlings if share > _LIKELY]
        least, most = (pick([model.settling, *likely]) for pick in (min, max))
        if most > longest and not self.law.startswith("viscous"):
            seconds = f"{least:.3g} to {most:.3g}" if likely else f"{most:.3g}"
            said.append(
                f"the effective input settles in {seconds} s, and no hold is longer than "
                f"{longest:.3g} s; for predictions beyond it, hold a few reversals that long"
            )
        if model.times.size and np.abs(model.creep[-1]).sum() > np.abs(model.creep[:-1]).sum():
            said.append(
                f"most creep has the longest time constant, {model.times[-1]:.3g} s; hold longer "
                "to separate it from drift"
            )
        return tuple(said)

    def predict(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        bands: float | None = None,
        curves: npt.ArrayLike | None = None,
    ) -> FloatArray | Prediction:
        """Predict the outputs for another input, as `Result.predict`.

        The variance of bands is that of errors on rows left out, near the same input, of the
        weights and of the constants of the law. Where the record has runs, the band is that of
        another run.
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

    @property
    def rows(self) -> list[tuple[str, str]]:
        """What was found, for tables: names and values."""
        rows = [
            ("law", self.law),
            ("error", f"{self.nrmse:.3%} of range"),
            ("error on rows left out", f"{self.left_out_error:.3%}"),
            ("  without time", f"{self.without_time:.3%}"),
        ]
        model = self.model
        if model.field.size:
            field = f"{model.field.min():.4g} to {model.field.max():.4g}"
            rows.append(("fluctuation field", field))
            rows.append(("settling time", f"{model.settling:.4g} s"))
        whole = float(np.abs(model.settled.weights).sum()) or 1.0
        for time, weights in zip(model.times, model.creep, strict=True):
            rows.append((f"creep, {time:.3g} s", f"{weights.sum() / whole:+.2%} of the weights"))
        for one in self.tried:
            rows.append((f"law {one.law}", f"{one.error:.3%} on rows left out"))
        return rows

    def __str__(self) -> str:
        text = [f"{name:<24} {value}" for name, value in self.rows]
        return "\n".join([*text, *(f"advice: {said}" for said in self.advice)])

    @property
    def _range(self) -> float:
        return float(np.ptp(self.y[self.fitted])) or 1.0

    def _deviation(self, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
        """Standard deviation (T,) of the output along an input."""
        variance = np.interp(u, *self._variance)
        for down, up in self.directions:
            apart = along(up, t, u, curves) - along(down, t, u, curves)
            variance = variance + apart**2 / 4
        total = 1 + sum(share for _, share in self.settlings)
        for other, share in self.settlings:
            apart = along(other, t, u, curves) - along(self.model, t, u, curves)
            variance = variance + share / total * apart**2
        if self.weights is not None:
            variance = variance + self.weights.variance(t, u, curves)
        return np.asarray(np.sqrt(variance))

    @cached_property
    def _errors(self) -> FloatArray:
        """Errors of the rows left out, predicted by a fit to the others."""
        found = along(self.without, self.t, self.u, self.curves)
        return np.asarray((found - self.y)[self.left_out])

    @cached_property
    def _variance(self) -> tuple[FloatArray, FloatArray]:
        """Mean squares of these errors along the input: inputs, and variances."""
        u = self.u[self.left_out]
        inputs = np.linspace(self.u.min(), self.u.max(), _BINS)
        width = _WIDTH * float(np.ptp(self.u)) or 1.0
        near = np.exp(-0.5 * ((inputs[:, None] - u) / width) ** 2)
        total = near.sum(axis=1)
        squares = self._errors**2
        mean = (near @ squares + _FEW * squares.mean()) / (total + _FEW)
        return inputs, mean

    def _factor(self, probability: float) -> float:
        """Factor with which bands of this probability contain that share of the rows left out.

        Errors of one run are alike. So with runs the band is that of Student's distribution with
        one degree of freedom less than runs, as in `GroupScatter`.
        """
        from scipy.special import ndtri, stdtrit  # scipy.stats takes a second to import

        sd = np.sqrt(np.interp(self.u[self.left_out], *self._variance))
        scores = np.abs(self._errors) / np.where(sd > 0, sd, 1.0)
        side = (1 + probability) / 2
        normal = float(ndtri(side))
        found = float(np.quantile(scores, probability)) / normal
        runs = 1 if self.groups is None else np.unique(self.groups[self.fitted]).size
        if runs < 2:
            return found
        share = runs / (runs + NORMAL_PARTS)
        return float(stdtrit(runs - 1, side)) / normal * (share * found + 1 - share)


def along(model: AfterEffect, t: FloatArray, u: FloatArray, curves: Curves) -> FloatArray:
    """(T,) outputs of a model along curves; see `held` for the intervals."""
    u, y, steps = writable(u), np.empty_like(u), held(t, curves)
    for first, last in curves.parts(u.size):
        part = slice(first, last)
        stack, rows, creep, _ = model.stack(curves.start, last - first)
        _kernels.simulate(model.tables, stack, rows, creep, steps[part], u[part], y[part], True)
    return y


def held(t: FloatArray, curves: Curves) -> FloatArray:
    """(T,) seconds for which each input is held; the shortest of all at the begin of a curve."""
    steps = np.diff(t, prepend=t[0])
    steps[curves.begins] = steps[1:].min()
    return np.asarray(steps)


def longest_hold(t: FloatArray, u: FloatArray, curves: Curves) -> float:
    """Seconds of the longest time for which one input is held, within a curve."""
    begins = np.append(True, np.diff(u) != 0)
    begins[curves.begins] = True
    return float(np.add.reduceat(held(t, curves), np.flatnonzero(begins)).max())


def isolated_long(steps: FloatArray) -> BoolArray:
    """Return which intervals are far longer than those before and those after.

    Where the rate of a record changes, intervals are as long as those on one side.

    Parameters
    ----------
    steps : (N,) array
        Intervals in seconds.

    Returns
    -------
    (N,) array of bool
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
    return np.asarray(steps > _LONGER * usual)
