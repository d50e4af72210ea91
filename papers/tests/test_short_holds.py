import numpy as np
import pytest

from papers.ipmc import TARGETS, draw_short_holds, run_short_holds


@pytest.fixture(scope="module")
def found():
    return run_short_holds(1000)


def test_creep_in_the_inverse_reaches_targets_after_ten_seconds(found):
    figures = found.figures()
    assert figures["ratio"] >= 3
    assert figures["rms_creep"] < 0.5 * figures["rms_early"]
    assert figures["minutes_saved"] == pytest.approx(TARGETS * 190 / 60)
    assert np.abs(found.targets).max() <= 7.5


def test_the_figure_has_every_inverse(found):
    (axes,) = draw_short_holds(found).axes
    assert [line.get_ydata().size for line in axes.lines] == [TARGETS] * 3
