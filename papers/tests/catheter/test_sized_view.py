"""Views drawn for finding holes and pits of several sizes."""

import math

import pytest

from minorloop_head.geometry import wrapped
from minorloop_head.twins.pipe import Pipe
from papers.catheter.scene_view import DIAMETERS, LEAST_OF_SIZES, draw_sized_view, minor_axis


@pytest.mark.parametrize("hole", [True, False])
def test_every_view_has_slots_and_corrosion_clear_of_a_rim_that_is_large_enough(hole):
    for seed in range(2):
        view = draw_sized_view(seed, hole=hole)
        assert (view.hole is not None) == hole
        assert len(view.marks) >= 2
        if hole:
            low, high = DIAMETERS
            assert low <= view.hole.diameter <= high
            assert minor_axis(view.mount.pose(view.pan, view.tilt), view.hole) >= LEAST_OF_SIZES
            phi, z = view.place
            for there in view.marks:
                x = Pipe.radius * float(wrapped(there[0] - phi))
                assert math.hypot(x, there[1] - z) > view.hole.diameter / 2
