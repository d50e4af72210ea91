"""A scikit-learn regressor for the Preisach operator.

Rows are samples in the order of time. The prediction of a row depends on the rows before it.
`EXPECTED_FAILURES` names the checks of scikit-learn that exclude this, each with its reason.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, as_whole, check_option
from minorloop.errors import MissingExtraError
from minorloop.identification.fit import Plane
from minorloop.identification.prior import Smooth
from minorloop.lab.records import Record
from minorloop.operators.memory import Memory

try:
    from sklearn.base import BaseEstimator, RegressorMixin
    from sklearn.utils.validation import check_is_fitted, validate_data
except ImportError:
    raise MissingExtraError("scikit-learn", "sklearn") from None


_REMEMBERS = "the output depends on the rows before, so {}"
EXPECTED_FAILURES: dict[str, str] = {
    "check_methods_sample_order_invariance": _REMEMBERS.format("their order matters"),
    "check_methods_subset_invariance": _REMEMBERS.format("a part of them is another history"),
}
"""Checks of ``sklearn.utils.estimator_checks.check_estimator`` that a memory fails, and why."""


class PreisachRegressor(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Identify a Preisach operator from rows in the order of time, and simulate it.

    Parameters
    ----------
    levels : int
        Bands between the least and the greatest input.
    column : int
        Column of ``X`` that is the input; other columns are not used.
    law : Plane, optional
        Other options of the plane; its levels and lag are not used. By default, uniform cells
        without a slope.
    prior : "auto", Gaussian or Smooth, optional
        As for `minorloop.identify`; `Smooth` by default.
    start : {"negative", "positive", "demagnetised"}
        Memory before the first fitted row.
    predict_from : {"start", "end"}
        Whether the rows to predict begin from ``start``, or follow the last fitted row, as the
        blocks of ``sklearn.model_selection.TimeSeriesSplit`` do.

    Attributes
    ----------
    model_ : Preisach
        The operator.
    memory_ : Memory
        Memory after the last fitted row.
    n_features_in_ : int
        Columns of ``X``.
    """

    def __init__(
        self,
        levels: int = 20,
        *,
        column: int = 0,
        law: Any = None,
        prior: Any = None,
        start: Any = "negative",
        predict_from: Any = "start",
    ) -> None:
        self.levels, self.column = levels, column
        self.law, self.prior = law, prior
        self.start = start
        self.predict_from = predict_from

    def fit(self, X: Any, y: Any) -> PreisachRegressor:
        """Identify the operator, and return this object.

        Raises a `ParameterError` or a `SignalError` as for `minorloop.identify`; both are
        ValueErrors.

        ``X`` (T, columns): inputs, in the order of time; ``y`` (T,): outputs.
        """
        X, y = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
        check_option("predict_from", self.predict_from, ("start", "end"))
        u = self._input(X)
        law = self.law or Plane(diagonal="uniform", slope=False)
        law = replace(law, levels=self.levels, lag=0)
        record, prior = Record(u, y, start=self.start), self.prior or Smooth()
        self.model_ = law.identify(record, prior).model
        low, high = map(float, self.model_.levels[[0, -1]])
        before = self.model_.memory(self.start).extrema
        self.memory_ = Memory.after([*before, *u], low=low, high=high)
        return self

    def predict(self, X: Any) -> FloatArray:
        """Return the outputs (T,) for inputs in the order of time.

        ``X`` (T, columns): inputs.
        """
        check_is_fitted(self)
        X = validate_data(self, X, dtype=np.float64, reset=False)
        check_option("predict_from", self.predict_from, ("start", "end"))
        start = self.start if self.predict_from == "start" else self.memory_
        return np.asarray(self.model_.simulate(self._input(X), start))

    def _input(self, X: FloatArray) -> FloatArray:
        return np.ascontiguousarray(X[:, as_whole("column", self.column, 0, X.shape[1] - 1)])

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = True  # the rows of the checks are not ordered in time
        return tags
