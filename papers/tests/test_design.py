import pytest

from papers import design
from papers.claims import claim_table
from papers.harness import medians


@pytest.fixture(scope="module")
def study():
    """One specimen, with sequences cut short to save time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(design, "HOLDS", (12, 16))
        patch.setattr(design, "ALL_HOLDS", (12, 16, 56))
        yield design.run_study(1)


def test_twelve_holds_beat_fifty_six(study):
    figures = study.figures()
    for twin, at_targets, unseen in (("ipmc", 0.0070, 0.0080), ("fibre", 0.0125, 0.0160)):
        assert figures[twin]["positioning_12"] <= at_targets
        assert figures[twin]["holdout_12"] <= 1.4 * unseen  # the bound is that of the median
        assert figures[twin]["beats_baseline_at_12_mean"]
        assert 0.75 <= figures[twin]["coverage_16_28"] <= 1.0
        assert 0.4 <= figures[twin]["width_ratio"] <= 2.5


def test_every_method_sees_the_same_plant_and_noise(study):
    for one in study.twins.values():
        assert set(one.curves) == set(design.METHODS)
        assert one.inputs[0] == one.plant.low
        assert (one.inputs >= one.plant.low).all()
        assert (one.inputs <= one.plant.high).all()


def test_every_claim_has_a_figure(study):
    rows = claim_table(design.STUDY.claims, medians([study.figures()] * 2)).rows
    assert len(rows) == len(design.STUDY.claims)
    assert medians([study.figures()] * 2)["ipmc"]["beats_baseline_at_12_mean"] == 1.0


@pytest.mark.usefixtures("without_pictures")
def test_the_report_has_the_curves_and_the_bands(study):
    figures = study.figures()
    html = design.STUDY.report(study, figures, [figures]).html()
    assert html.count("<img") == 3
    assert "Bands after twelve holds" in html
