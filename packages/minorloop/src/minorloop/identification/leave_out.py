"""Validation on left-out groups.

Each group of rows is predicted by a fit of the same structure to the other groups, from which
smoothness or hyperparameters are chosen too. The errors contain what the residuals of one fit do
not: differences between curves, days or specimens.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import ParameterError
from minorloop.identification.fitting import FitRecord, FittedPlane

FOLDS = 10
"""Fits without a part of the groups, at most."""
FEWEST_GROUPS = 3
"""Groups below which their scatter is not estimated."""


def validate(
    record: FitRecord,
    found: FittedPlane,
    lag: int,
    groups: IntArray,
    say: Callable[[str], None] = lambda stage: None,
) -> FloatArray:
    """(T,) outputs of each group, predicted without it; NaN where a row was not fitted.

    Raises a `ParameterError` if all fitted rows are of one group.

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
    """
    rows = replace(record, fitted=found.fitted).rows(lag)
    predicted = left_out(record, found, lag, folds(groups, rows), say)
    everywhere = np.full(record.u.size, np.nan)
    everywhere[rows] = predicted[rows]
    return everywhere


def folds(groups: IntArray, rows: IntArray) -> IntArray:
    """(T,) number of the fold of each row, of which those of the groups of some rows are fitted.

    Raises a `ParameterError` if these rows are of one group.
    """
    names = check_several_groups(groups[rows])
    return np.searchsorted(names, groups) % min(names.size, FOLDS)


def check_several_groups(groups: IntArray) -> IntArray:
    """Return the numbers of the groups of the fitted rows, two or more.

    Raises a `ParameterError` if all rows are of one group.
    """
    names = np.unique(groups)
    if names.size < 2:
        raise ParameterError(
            "all fitted rows are of one group, so none can be left out; give two groups or more, "
            "or leave groups (--record groups=COLUMN) out"
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
