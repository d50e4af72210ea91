import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop_head.console.perception import Perception
from minorloop_head.console.wall_image import STEP, WallImage


@pytest.fixture(scope="module")
def camera():
    """A camera with a metered picture of the pit."""
    found = Perception(tip()[0], view())
    for _ in range(30):
        found.tick(request(towards(PIT, 0.8)))
    return found


def test_a_worse_view_does_not_replace_a_better_one(camera):
    wall = WallImage(view(), 0.1)
    wall.paint(camera.image, towards(PIT, 0.8, (0.0, 0.0, 2e-3, 0.0)))
    before = wall.grey[70:90].copy()
    wall.paint(np.zeros_like(camera.image), (0.0, 0.0, -15e-3, 0.0))
    seen = before > 0
    np.testing.assert_array_equal(wall.grey[70:90][seen], before[seen])


def test_the_window_goes_along_and_stays_on_the_map():
    wall = WallImage(view(), 0.3)
    for advance in (-50e-3, 0.0, 80e-3, 10.0):
        grey, first, last = wall.window(advance)
        assert grey.shape[0] == round((last - first) / STEP)
        assert first >= 0
        assert last <= 0.3 + 1e-12
    assert len(wall.seen) == 1


def test_beyond_the_end_nothing_is_painted():
    wall = WallImage(view(), 0.1)
    wall.paint(np.full((480, 640), 90, np.uint8), (0.0, 0.0, 0.5, 0.0))
    assert not wall.grey.any()
