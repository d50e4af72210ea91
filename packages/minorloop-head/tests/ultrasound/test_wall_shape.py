import numpy as np
import pytest

from minorloop_head.ultrasound.wall_shape import smooth_shape

RADIUS = 0.5e-3
SIDE = np.linspace(-0.8e-3, 0.8e-3, 6)
GRID = np.stack(np.meshgrid(SIDE, SIDE), axis=-1).reshape(-1, 2)
BESIDE = GRID[np.linalg.norm(GRID, axis=1) > RADIUS + 0.1e-3]


def hollow(places):
    """A wall that is 0.05 mm behind the nominal one, inclined and hollow."""
    x, y = np.moveaxis(places, -1, 0)
    return 0.05e-3 + 0.1 * x - 0.05 * y + 60.0 * (x * x + y * y)


def test_a_smooth_wall_is_known_beside_and_under_a_mouth():
    shape = smooth_shape(BESIDE, hollow(BESIDE))
    assert shape.depth(BESIDE) == pytest.approx(hollow(BESIDE), abs=2e-6)
    assert shape.depth(GRID) == pytest.approx(hollow(GRID), abs=5e-6)
    plane, sd = shape.rim(0.0, 0.0, RADIUS)
    assert plane == pytest.approx([0.05e-3 + 60.0 * RADIUS**2, 0.1, -0.05], abs=1e-3)
    assert plane[0] == pytest.approx(0.05e-3 + 60.0 * RADIUS**2, abs=2e-6)
    assert 0 < sd < 3e-6


def test_the_plane_of_a_rim_is_that_of_its_place():
    shape = smooth_shape(GRID, hollow(GRID))
    plane, _ = shape.rim(0.2e-3, 0.0, 0.3e-3)
    middle = float(hollow(np.array([0.2e-3, 0.0]))) + 60.0 * 0.3e-3**2
    assert plane[0] == pytest.approx(middle, abs=2e-6)
    assert plane[1] == pytest.approx(0.1 + 120.0 * 0.2e-3, abs=2e-3)


def test_what_is_unknown_grows_with_the_gap_and_with_what_the_distances_err():
    few = GRID[GRID[:, 0] > 0.4e-3]
    rng = np.random.default_rng(3)
    rough = hollow(BESIDE) + rng.normal(0, 12e-6, len(BESIDE))
    known, beyond, scattered = (
        smooth_shape(places, depths).rim(0.0, 0.0, RADIUS)[1]
        for places, depths in ((BESIDE, hollow(BESIDE)), (few, hollow(few)), (BESIDE, rough))
    )
    assert beyond > 2 * known
    assert scattered > 2 * known
