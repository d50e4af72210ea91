import numpy as np
import pytest

from papers import design, design_report
from papers.claims import claim_table, figure


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
        assert figures[twin]["beats_baseline_at_12"]
        assert 0.75 <= figures[twin]["coverage_16_28"] <= 1.0
        assert 0.4 <= figures[twin]["width_ratio"] <= 2.5


def test_every_method_sees_the_same_plant_and_noise(study):
    for one in study.twins.values():
        assert set(one.curves) == set(design.METHODS)
        assert one.inputs[0] == one.plant.low
        assert (one.inputs >= one.plant.low).all()
        assert (one.inputs <= one.plant.high).all()


def test_shares_and_means_are_gathered(study):
    figures = study.figures()
    other = {**figures, "rough": {"holdout_28": 0.5, "baseline_28": 0.2, "baseline_56": 0.1}}
    found = design.gather([figures, other])
    assert found["rough"]["mean_28"] == pytest.approx((figures["rough"]["holdout_28"] + 0.5) / 2)
    assert found["rough"]["better"] in (0.0, 0.5)
    assert found["ipmc"]["beats_baseline_at_12"] == 1.0
    rows = claim_table(design_report.STUDY.claims, found).rows
    assert len(rows) == len(design_report.STUDY.claims)
    for claim in design_report.STUDY.claims:
        assert np.isfinite(figure(found, claim.key))


@pytest.mark.usefixtures("without_pictures")
def test_the_report_has_the_curves_and_the_bands(study):
    figures = study.figures()
    html = design_report.STUDY.report(study, design.gather([figures]), [figures]).html()
    assert html.count("<img") == 3
    assert "Bands after twelve holds" in html


def test_rough_planes_differ_and_repeat():
    plants = [design._rough(seed) for seed in (0, 1)]
    inputs = [0.0, 0.9, 0.3, 0.6]
    for plant in plants:
        one, again = (plant.begin(0.0, 0) for _ in range(2))
        assert [one(u) for u in inputs] == [again(u) for u in inputs]
    first, second = (plant.begin(0.0, 0) for plant in plants)
    assert [first(u) for u in inputs] != [second(u) for u in inputs]
