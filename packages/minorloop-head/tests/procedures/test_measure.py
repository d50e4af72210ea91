import numpy as np

from minorloop_head.procedures.measure import MOST_OFF, NO_COUPLING, burst_of, has_coupling
from minorloop_head.sources import Shot

from .fakes import CALIBRATION

EAR = CALIBRATION.probe_at((12e-3, 0.2))
AIM = np.array([-0.35, 0.0])


def silent(count=4):
    rng = np.random.default_rng(1)
    return [Shot(1e-3 * k, 1e-3 * rng.standard_normal(2000), 1e-8) for k in range(count)]


def test_a_burst_without_an_echo_reports_no_coupling_until_one_before_it_had_one():
    first = burst_of(silent(), AIM, AIM, EAR, coupled=False)
    later = burst_of(silent(), AIM, AIM, EAR, coupled=True)
    assert (first.verdict, first.used, first.trace.size) == (NO_COUPLING, 0, 0)
    assert (later.verdict, later.used) == ("", 4)
    np.testing.assert_allclose(later.angles, AIM)


def test_a_raster_whose_first_burst_meets_a_flank_is_coupled():
    lost = burst_of(silent(), AIM, AIM, EAR, coupled=False)
    kept = burst_of(silent(), AIM, AIM, EAR, coupled=True)
    assert has_coupling([lost, kept])
    assert not has_coupling([lost, lost])
    assert not has_coupling([])


def test_a_burst_far_off_its_point_is_refused():
    per_radian = 8e-3
    for share, verdict in ((0.6, ""), (2.0, "off target")):
        off = AIM + np.array([share * MOST_OFF / per_radian, 0.0])
        assert burst_of(silent(), off, AIM, EAR, coupled=True).verdict == verdict
