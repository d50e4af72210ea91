import numpy as np
import pytest

from minorloop.identification import identify
from minorloop.identification.scores import score_rows


@pytest.fixture(scope="module")
def found():
    u = np.resize([0.0, 1.0, 0.25, 0.75, 0.5], 60)
    return identify(u, u + 0.1 * (np.arange(60) % 2), levels=2, prior="none", holdout=0.25)


def test_rows_say_what_the_scores_are(found):
    rows = dict(score_rows(found))
    assert rows["error on held-out data"] == f"{found.scores['nrmse_holdout']:.3%} of range"
    assert rows["samples held out"] == "15"
    assert "rank" not in rows
    assert dict(score_rows(found, rank="4"))["rank"] == "4"


def test_an_identification_prints_its_scores(found):
    for label, value in score_rows(found):
        assert f"{label:<24} {value}" in str(found)
