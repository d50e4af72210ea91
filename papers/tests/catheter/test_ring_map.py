import numpy as np
import pytest

from minorloop.errors import SignalError
from minorloop_head.reconstruction.depth_map import ECHOES, UNSEEN, Patch
from papers.catheter.ring_map import echo_map

PATCH = Patch.around(0.3, 20e-3, size=2e-3)


def test_the_sonar_fills_what_its_footprints_reach():
    wall = echo_map(PATCH, [(0.3, 20e-3), (0.3, 25e-3)], [0.2e-3, 9.0], [1e-6, np.nan])
    middle = PATCH.rows // 2
    assert wall.depth[middle, middle] == pytest.approx(0.2e-3)
    assert wall.source[middle, middle] == ECHOES
    assert wall.source[0, 0] == UNSEEN
    assert np.isnan(wall.depth[0, 0])
    with pytest.raises(SignalError, match="1 spots"):
        echo_map(PATCH, [(0.0, 0.0)], [0.0, 1.0], [1.0])
