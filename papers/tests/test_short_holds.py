import numpy as np
import pytest

from papers.ipmc_report import draw_short_holds
from papers.short_holds import DELIVERED, TARGETS, run_short_holds


@pytest.fixture(scope="module")
def found():
    return run_short_holds(1000)


def test_creep_in_the_inverse_reaches_targets_after_ten_seconds(found):
    figures = found.figures()
    assert figures["ratio"] >= 3
    assert figures["rms_creep"] < 0.5 * figures["rms_early"]
    assert figures["minutes_saved"] == pytest.approx(TARGETS * 190 / 60)
    assert np.abs(found.targets).max() <= 7.5


def test_an_input_that_follows_the_creep_keeps_a_target(found):
    figures = found.figures()
    assert found.delivered["creep"].shape == (TARGETS, DELIVERED)
    assert figures["rms_minute_creep"] < figures["rms_minute_settled"] / 3
    # A constant input drifts towards its target; the first reading is that of the short hold.
    drift = np.abs(found.delivered["settled"]).mean(axis=0)
    assert drift[-1] < drift[0]


def test_the_figure_has_both_kinds_of_holds(found):
    left, right = draw_short_holds(found).axes
    assert [len(axes.lines) for axes in (left, right)] == [3, 2 * TARGETS]
