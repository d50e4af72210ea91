import numpy as np
import pytest

from benchmarks.flooded_reach import bent
from minorloop_head.geometry import Probe
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Surroundings, convection
from papers.catheter import scoring
from papers.catheter.mission import TEMPERATURES, needed, reach_figures, water


def test_the_default_raster_needs_less_than_one_that_is_bent_or_on_the_warm_side():
    rolled, cold = needed(), bent(Probe())
    warm = bent(Probe(squint=np.radians(72.0), azimuth=0.0))
    assert rolled[:, 1].max() < 17.0
    assert np.ptp(rolled, axis=1).max() < 12.0
    assert cold[1, 1] > 40.0
    assert warm[0, 1] == pytest.approx(30.0 + 18.0 + np.degrees(0.08), abs=1.0)


def test_warmer_water_lets_a_wire_reach_farther_and_a_bare_one_reaches_nothing():
    reached = [scoring.ends(Head(1000), water(t))[:, 1] for t in TEMPERATURES]
    assert (np.diff(reached, axis=0) > -0.5).all()
    assert (reached[1] > reached[0] + 5.0).all()
    bare = Surroundings(ambient=20.0, convection=convection("flooded"))
    assert scoring.ends(Head(1000), bare) == pytest.approx(0.0, abs=0.1)
    assert not scoring.reaches(Head(1000), bare, needed())


def test_a_head_reaches_its_raster_from_ten_degrees_on():
    assert reach_figures(1000) == {f"at_{t}_c": 1.0 for t in (10, 20, 30, 40)}
