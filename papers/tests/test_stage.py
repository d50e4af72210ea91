import pytest

from minorloop.identification import Dynamics, Plane
from papers import stage
from papers.claims import claim_table


@pytest.fixture(scope="module")
def study():
    """One specimen with a shorter record and fewer targets, to save time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage, "SINES", ((5.0, 0.6), (50.0, 0.12), (200.0, 0.05)))
        patch.setattr(stage, "FREQUENCIES", (50, 100))
        patch.setattr(stage, "PERIODS", 1)
        patch.setattr(stage, "LASTING", 0.05)
        patch.setattr(stage, "Dynamics", quick)
        yield stage.run_study(1000)


def quick():
    """The structure that the search finds, without the search."""
    return Dynamics(Plane(15), first="operator", poles=2, creep=True)


EVERY = stage.FREQUENCIES


@pytest.mark.whole
def test_the_inverse_with_dynamics_meets_its_bounds(study):
    figures = study.figures()
    assert figures["dynamics"]["hz_50"] <= 0.005
    assert figures["ratio_at_100_hz"] >= 5
    assert figures["resonance_off"] < 1e-3
    assert study.tracked[100]["targets"].size == 500


@pytest.mark.whole
@pytest.mark.usefixtures("without_pictures")
def test_the_report_has_every_claim(study):
    figures = study.figures()
    for name in ("dynamics", "without_time"):
        figures[name] = {f"hz_{one}": 0.001 for one in EVERY} | figures[name]
    html = stage.STUDY.report(study, figures, [figures, figures]).html()
    assert html.count("<img") == 3
    assert len(claim_table(stage.STUDY.claims, figures).rows) == len(stage.STUDY.claims)


def test_targets_begin_at_rest_and_stay_within_the_travel():
    wanted, rising = stage.targets(20, 0.3)
    assert rising == 1000
    assert wanted[0] == 0.3
    assert (wanted[rising:].min(), wanted.max()) == pytest.approx((4, 32))
    u = stage.record()
    assert u.min() == 0.0
    assert 90 < u.max() <= 100
