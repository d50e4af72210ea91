from dataclasses import replace

import numpy as np

from minorloop.fleet.summary import Outcome, Summary


def outcome(k, nrmse=0.01, opening=0.3):
    rng = np.random.default_rng(k)
    return Outcome(
        f"s{k}",
        nrmse=nrmse * rng.uniform(0.9, 1.1),
        low=-1.0 * rng.uniform(0.9, 1.1),
        high=1.0 * rng.uniform(0.9, 1.1),
        opening=opening * rng.uniform(0.9, 1.1),
        samples=100,
        seconds=0.1,
    )


def test_only_the_specimen_that_is_far_off_is_an_outlier():
    outcomes = [outcome(k) for k in range(20)] + [outcome(99, nrmse=0.2)]
    (found,) = Summary(outcomes).outliers()
    assert (found.specimen, found.figure) == ("s99", "nrmse")
    assert found.deviations > 5


def test_equal_specimens_have_no_outliers_and_few_are_not_judged():
    same = [Outcome(str(k), nrmse=0.1, low=-1.0, high=1.0, opening=0.2) for k in range(20)]
    assert not Summary(same).outliers()
    few = [outcome(k) for k in range(5)] + [outcome(99, nrmse=5.0)]
    assert not Summary(few).outliers()


def test_distributions_are_over_identified_specimens():
    outcomes = [*(outcome(k) for k in range(10)), Outcome("lost", error="no file")]
    summary = Summary(outcomes)
    values = [one.nrmse for one in outcomes[:10]]
    found = summary.distributions()["nrmse"]
    assert found["median"] == np.median(values)
    assert (found["min"], found["max"]) == (min(values), max(values))
    assert [one.specimen for one in summary.failures] == ["lost"]
    assert "10 of 11 specimens identified" in str(summary)
    assert "failed lost: no file" in str(summary)
    assert Summary(outcomes[10:]).plain()["figures"] == {}


def test_a_model_not_to_be_trusted_is_listed():
    summary = Summary([outcome(0), replace(outcome(1), warning="the output is stuck")])
    assert summary.plain()["warnings"] == {"s1": "the output is stuck"}
    assert "warning s1: the output is stuck" in str(summary)
