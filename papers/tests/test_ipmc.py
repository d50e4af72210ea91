import pytest

from papers import ipmc, ipmc_report
from papers.claims import figure


@pytest.fixture(scope="module")
def study():
    return ipmc.run_study(3)


def test_one_specimen_keeps_every_bound(study):
    figures = study.figures()
    rows = {
        claim.key: claim.row(figures)
        for claim in ipmc_report.STUDY.claims
        if claim.key != "seconds"
    }
    assert {key: row[-1] for key, row in rows.items() if row[-1] == "not met"} == {}
    assert figure(figures, "recursive.twin_over_fixed") < 0.6
    assert figure(figures, "gain_spread.ratio_below_half_hz") <= 0.2
    assert figure(figures, "positioning.rms_ratio_min") >= 3.3


def test_the_cascade_follows_better_than_the_operator_alone(study):
    errors = study.sweep.figures()
    assert errors["rms_cascade"] < 0.5 * errors["rms_operator"]
    assert study.dynamics.model.dc_gain == pytest.approx(1, abs=1e-9)
    assert study.dynamics.model.stable


def test_what_no_model_can_follow_explains_most_of_the_error(study):
    found = study.figures()["representability"]
    assert 0 < found["floor"] <= found["preisach_nrmse"] * (1 + 1e-9)
    assert found["floor"] > 0.5 * found["preisach_nrmse"]
    assert found["preisach_nrmse"] < found["plays_nrmse"] < found["quadratic_nrmse"]


@pytest.mark.usefixtures("without_pictures")
def test_the_report_shows_every_figure_of_the_paper(study):
    figures = study.figures()
    report = ipmc_report.STUDY.report(study, figures, [figures, figures])
    html = report.html()
    for number in ("Fig 4", "Figs 7 to 9", "Fig 11", "Figs 12 to 14", "Figs 15, 16"):
        assert number in html
    assert html.count("<img") == 12
    assert "the strip is a twin" in html.lower()
    assert "gives the radius" in html
