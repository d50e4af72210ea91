import importlib
import sys

import numpy as np
import pytest

from later import Later
from minorloop import MissingExtraError, ParameterError, Preisach, Smooth

REASON = "needs scikit-learn: minorloop[sklearn]"
base, selection, checks = (
    Later(f"sklearn.{name}", REASON)
    for name in ("base", "model_selection", "utils.estimator_checks")
)
ours = Later("minorloop.export.sklearn", REASON)

RNG = np.random.default_rng(0)
MODEL = Preisach(np.linspace(-1, 1, 9), np.tril(RNG.uniform(size=(8, 8))), 0.2)
X = np.concatenate([[-1.0, 1.0], RNG.uniform(-1, 1, 598)])[:, None]
Y = MODEL.simulate(X[:, 0])


@pytest.fixture(scope="module")
def results():
    found = checks.check_estimator(
        ours.PreisachRegressor(levels=5),
        expected_failed_checks=ours.EXPECTED_FAILURES,
        on_skip=None,
        on_fail=None,
    )
    return {row["check_name"]: row for row in found}


def test_the_checks_of_scikit_learn_pass(results):
    failed = {name for name, row in results.items() if row["status"] == "failed"}
    assert not failed
    assert len(results) > 40


def test_every_declared_check_fails(results):
    for name, reason in ours.EXPECTED_FAILURES.items():
        assert results[name]["status"] == "xfail"
        assert "rows before" in reason


def test_following_rows_begin_with_the_memory_after_the_fit():
    found = ours.PreisachRegressor(levels=8, prior=Smooth(0.0), predict_from="end").fit(
        X[:400], Y[:400]
    )
    np.testing.assert_allclose(found.predict(X[400:]), Y[400:], atol=1e-5)


def test_it_works_in_a_search_with_contiguous_blocks():
    start = ours.PreisachRegressor(prior=Smooth(0.0), predict_from="end")
    splits = selection.TimeSeriesSplit(3, test_size=100)
    scores = selection.cross_val_score(base.clone(start).set_params(levels=8), X, Y, cv=splits)
    assert scores.shape == (3,)
    assert scores.min() > 0.999
    search = selection.GridSearchCV(start, {"levels": [2, 8]}, cv=splits).fit(X, Y)
    assert search.best_params_ == {"levels": 8}


def test_a_wrong_beginning_of_a_prediction_is_refused():
    with pytest.raises(ParameterError, match="predict_from"):
        ours.PreisachRegressor(predict_from="middle").fit(X, Y)


def test_without_scikit_learn_the_message_names_the_extra(monkeypatch):
    for name in ("sklearn", "sklearn.base", "sklearn.utils.validation"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "minorloop.export.sklearn", raising=False)
    with pytest.raises(MissingExtraError, match=r"pip install 'minorloop\[sklearn\]'"):
        importlib.import_module("minorloop.export.sklearn")
