"""Validation on left-out groups, and the scatter of groups about their predictions.

Each group of rows is predicted by a fit of the same structure to the other groups, from which
smoothness or hyperparameters are chosen too. The errors contain what the residuals of one fit do
not: differences between curves, days or specimens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import ParameterError
from minorloop.identification.baseline import nrmse
from minorloop.identification.fitting import FitRecord, FittedPlane, Regression
from minorloop.identification.posterior import Posterior

FOLDS = 10
"""Fits without a part of the groups, at most."""
FEWEST_GROUPS = 3
"""Groups below which their scatter is not estimated."""
_WIDTH = 0.06
"""Width of the average of squared errors along the input, in ranges."""
_BINS = 60
NORMAL_GROUPS = 8
"""Groups whose weight the normal distribution has against the errors found."""


@dataclass(frozen=True, eq=False)
class GroupScatter:
    """Scatter of the outputs of left-out groups about their predictions.

    Parameters
    ----------
    groups : int
        Number of groups.
    inputs, variance : (B,) arrays
        Variance in addition to that of the posterior, by input.
    scores : (M,) array
        Errors of left-out rows over their standard deviations, in increasing order of magnitude.
    nrmse : float
        Error on left-out groups over the range of the output.
    """

    groups: int
    inputs: FloatArray
    variance: FloatArray
    scores: FloatArray
    nrmse: float

    def deviation(self, u: FloatArray, known: FloatArray, probability: float) -> FloatArray:
        """Standard deviation (T,) of the output of another group.

        Half a normal band of this probability is as wide as the errors of left-out groups were,
        and wider for few groups.

        Parameters
        ----------
        u : (T,) array
            Inputs, delayed as the output is.
        known : (T,) array
            Standard deviation of the posterior; zero without a prior.
        probability : float
            Probability of the band.
        """
        from scipy.special import ndtri, stdtrit

        normal = float(ndtri((1 + probability) / 2))
        found = float(np.quantile(self.scores, probability)) / normal
        share = self.groups / (self.groups + NORMAL_GROUPS)
        few = float(stdtrit(self.groups - 1, (1 + probability) / 2)) / normal
        factor = few * (share * found + (1 - share))
        return np.asarray(factor * np.sqrt(known**2 + self._at(u)))

    def _at(self, u: FloatArray) -> FloatArray:
        return np.interp(u, self.inputs, self.variance)


def validate(
    record: FitRecord,
    found: FittedPlane,
    lag: int,
    groups: IntArray,
    say: Callable[[str], None] = lambda stage: None,
) -> tuple[FloatArray, GroupScatter | None]:
    """Predict the rows of each group without it; the scatter of at least three groups.

    Parameters
    ----------
    record : FitRecord
        The record.
    found : FittedPlane
        The fit to all groups.
    lag : int
        Its lag.
    groups : (T,) array of int
        Number of the group of each row.
    say : callable
        Called with what is done next.

    Returns
    -------
    tuple
        (T,) predictions, NaN where a row was not fitted; and the scatter, or None.

    Raises
    ------
    ParameterError
        If all fitted rows are of one group.
    """
    rows = replace(record, fitted=found.fitted).rows(lag)
    names = check_several_groups(groups[rows])
    fold = np.searchsorted(names, groups) % min(names.size, FOLDS)
    predicted = left_out(record, found, lag, fold, say)
    everywhere = np.full(record.u.size, np.nan)
    everywhere[rows] = predicted[rows]
    if names.size < FEWEST_GROUPS:
        return everywhere, None
    u = record.curves.delayed(record.u, lag)[rows]
    known = _known(found.posterior, found.regression, rows)
    return everywhere, _scatter(names.size, u, record.y[rows], predicted[rows], known)


def check_several_groups(groups: IntArray) -> IntArray:
    """Return the numbers of the groups of the fitted rows, two or more.

    Raises
    ------
    ParameterError
        If all rows are of one group.
    """
    names = np.unique(groups)
    if names.size < 2:
        raise ParameterError(
            "all fitted rows are of one group, so none can be left out; give two groups or more, "
            "or leave groups (--groups) out"
        )
    return names


def left_out(
    record: FitRecord,
    found: FittedPlane,
    lag: int,
    fold: IntArray,
    say: Callable[[str], None] = lambda stage: None,
) -> FloatArray:
    """(T,) outputs of the samples of each fold, predicted by a fit to the others.

    Samples of fold -1 are in all fits, and not predicted.
    """
    regression = found.regression
    part = fold[regression.rows]
    predicted = np.full(record.u.size, np.nan)
    names = np.unique(part[part >= 0])
    for count, k in enumerate(names, 1):
        say(f"leaving out groups, fit {count} of {names.size}")
        x = found.without(part == k, record.signed)
        model = regression.matrix.spec.model(x)
        predicted[fold == k] = record.curves.simulate(model, record.u, lag)[fold == k]
    return predicted


def _scatter(
    groups: int, u: FloatArray, y: FloatArray, predicted: FloatArray, known: FloatArray
) -> GroupScatter:
    error = predicted - y
    low, high = float(u.min()), float(u.max())
    edges = np.linspace(low, high, _BINS + 1)
    inputs = (edges[1:] + edges[:-1]) / 2
    place = np.clip(np.searchsorted(edges, u, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(place, minlength=_BINS).astype(float)
    excess = np.bincount(place, error**2 - known**2, _BINS)
    kernel = np.exp(-0.5 * ((inputs[:, None] - inputs) / (_WIDTH * (high - low) or 1.0)) ** 2)
    mean = float(excess.sum() / count.sum())
    # A mean of few rows is drawn towards that of all.
    smooth = (kernel @ excess + mean) / (kernel @ count + 1)
    floor = 0.01 * float(np.mean(error**2))
    variance = np.maximum(smooth, floor)
    sd = np.sqrt(known**2 + np.interp(u, inputs, variance))
    scores = np.sort(np.abs(error) / np.where(sd > 0, sd, 1.0))
    return GroupScatter(groups, inputs, variance, scores, nrmse(error, y))


def _known(posterior: Posterior | None, regression: Regression, rows: IntArray) -> FloatArray:
    """(M,) standard deviation of the posterior at some rows; zero, (1,), without a prior.

    In a condensed record it is that of the nearest sample that stands for several.
    """
    if posterior is None:
        return np.zeros(1)
    sd = posterior.deviation(regression.inputs, regression.matrix.start, regression.measured)
    order = np.argsort(regression.rows)
    middles = (regression.rows[order][1:] + regression.rows[order][:-1]) / 2
    return np.asarray(sd[order][np.searchsorted(middles, rows)])
