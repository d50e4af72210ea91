import numpy as np
import pytest

from minorloop_head.ultrasound.wall_shape import changes_in_time, smooth_shape, speed_error

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


STANDOFF = 8e-3
ROWS = [(x, y) for row, x in enumerate(SIDE) for y in (SIDE if row % 2 == 0 else SIDE[::-1])]
PLACES = np.array(ROWS)
"""A serpentine raster."""
OUTSIDE = np.flatnonzero(np.linalg.norm(PLACES, axis=1) > 0.65e-3)


@pytest.mark.parametrize("faster", [-0.02, 0.02])
def test_a_speed_that_is_off_by_two_percent_is_corrected_for_the_most_part(faster):
    found, sd = speed_error(-faster * STANDOFF, STANDOFF)
    assert found == pytest.approx(faster, abs=0.5e-2)
    assert abs(found - faster) < sd < 1e-2


def test_errors_of_speed_and_pivot_are_inside_the_stated_band():
    rng = np.random.default_rng(4)
    other = rng.random(4000) < 0.3
    true = rng.normal(0, np.where(other, 20e-3, 0.6e-3))
    beyond = rng.normal(0, 0.05e-3, 4000) - true * STANDOFF
    found, sd = np.array([speed_error(one, STANDOFF) for one in beyond]).T
    assert ((found - true) / sd).std() == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(((found - true)[other] ** 2).mean()) < 0.5 * 20e-3


def change(of_time=None, of_place=None):
    """Whether distances with an inclination and texture of 2 micrometres are those of a change."""
    rng = np.random.default_rng(7)
    depths = PLACES @ np.array([0.01, 0.02]) + rng.normal(0, 2e-6, 36)
    depths = depths + (0.0 if of_time is None else of_time(np.arange(36)))
    depths = depths + (0.0 if of_place is None else of_place(*PLACES.T))
    return changes_in_time(OUTSIDE, PLACES[OUTSIDE], depths[OUTSIDE])


@pytest.mark.parametrize("size", [0.03e-3, 0.07e-3, 0.145e-3, -0.145e-3])
@pytest.mark.parametrize("first", [9, 18, 27])
def test_distances_that_change_at_once_are_those_of_warmer_water(size, first):
    assert change(lambda n: size * (n >= first))


@pytest.mark.parametrize(("height", "size"), [(0.05e-3, 0.4e-3), (0.2e-3, 0.8e-3), (0.7e-3, 2e-3)])
@pytest.mark.parametrize("off", [0.0, 0.6e-3])
def test_a_dent_is_no_change_of_the_water(height, size, off):
    def dent(x, y):
        return height * np.exp(-0.5 * ((x - off) ** 2 + y * y) / size**2)

    assert not change(of_place=dent)
