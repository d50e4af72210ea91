import numpy as np
import pytest

from minorloop.identification import excitation
from papers import fibre
from truth import hidden_truth


@pytest.fixture(scope="module")
def study():
    with hidden_truth():
        return fibre.run_study(1)


def test_one_specimen_keeps_every_bound(study):
    figures = study.figures()
    rows = {claim.key: claim.row(figures) for claim in fibre.STUDY.claims}
    assert {key: row[-1] for key, row in rows.items() if row[-1] == "not met"} == {}


def test_the_way_down_is_slower_and_has_its_own_response(study):
    up, down = study.responses.rising.model, study.responses.falling.model
    t = np.array([30.0])
    assert up.step_response(t)[0] > down.step_response(t)[0] + 0.05


def test_the_square_system_has_as_many_steps_as_dots_and_no_residual(study):
    u, y = fibre._settled(1, 9, excitation.reversal_curves(fibre.LEVELS))
    dots = study.steady.models["square"]
    assert u.size == np.tri(fibre.LEVELS.size).sum()
    np.testing.assert_allclose(dots.simulate(u), y, atol=1e-9)
    assert study.steady.models["dots"].weights.min() >= 0 > dots.weights.min()


def test_the_marker_leaves_the_left_two_columns_on():
    names, states = zip(*fibre.marker_diagrams(), strict=True)
    assert names == ("u4", "u6", "u2", "u4")
    after_u4, after_u6, after_u2, again = (state == 1 for state in states)
    alpha, beta = np.indices(after_u4.shape) + 1
    there = beta <= alpha
    np.testing.assert_array_equal(after_u4, there & (alpha <= 4))
    np.testing.assert_array_equal(after_u6, there)
    np.testing.assert_array_equal(after_u2, there & (beta <= 2))
    np.testing.assert_array_equal(again, there & ((alpha <= 4) | (beta <= 2)))
    assert np.isnan(states[0][~there]).all()


@pytest.mark.usefixtures("without_pictures")
def test_the_report_shows_every_figure_of_the_paper(study):
    figures = study.figures()
    html = fibre.STUDY.report(study, figures, [figures]).html()
    for number in range(2, 6):
        assert f"Fig {number}" in html
    assert html.count("<img") == 8
    assert "Eq. (2)" in html
