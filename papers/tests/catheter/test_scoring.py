"""Scores against the truth of twins."""

import numpy as np
import pytest

from minorloop_head.geometry import Mount
from minorloop_head.twins.pipe import Bore
from minorloop_head.twins.rig import Rig
from papers.catheter import scoring


def test_a_straight_head_points_along_the_pipe_and_past_a_bore():
    plant = Rig()
    assert scoring.line_of_sight(plant) == pytest.approx(np.radians([-30.0, -30.0]))
    seen = scoring.middle_of(Mount(), plant, (0.0, 20e-3), 10e-3)
    assert np.linalg.norm(seen) > 0.01


def test_places_are_apart_straight_through_the_pipe():
    bore = Bore(0.0, 20e-3, 1e-3)
    assert scoring.apart((np.pi, 20e-3), bore, 10e-3) == pytest.approx(20e-3)
    assert scoring.apart((0.0, 21e-3), bore, 10e-3) == pytest.approx(1e-3)
