"""Defects and marks on the wall of a pipe."""

import math

import numpy as np
import pytest

from minorloop_head.twins.pipe import Bore, Crack, Pipe


def test_what_is_drawn_is_as_large_as_promised():
    pipe = Pipe.draw(1, holes=40, pits=40, cracks=20)
    holes = [bore for bore in pipe.bores if bore.through]
    pits = [bore for bore in pipe.bores if not bore.through]
    assert len(holes) == len(pits) == 40
    assert all(0.85e-3 <= bore.diameter <= 1.15e-3 for bore in holes)
    assert all(0.85e-3 <= bore.diameter <= 1.5e-3 and 0.2e-3 <= bore.depth <= 1e-3 for bore in pits)
    assert {bore.inside for bore in holes} == {"dark", "backlit", "white"}
    assert all(0.4 <= patch.albedo <= 0.9 for patch in pipe.dirt)
    assert all(max(crack.widths) <= 0.3e-3 for crack in pipe.cracks)


def test_depth_is_that_of_the_deepest_thing_there():
    pit = Bore(0.5, 10e-3, 1e-3, depth=0.5e-3, floor_tilt=(0.1, 0.0))
    crack = Crack(((1.0, 20e-3), (1.0, 24e-3)), (0.2e-3, 0.2e-3), depth=0.7e-3)
    pipe = Pipe(bores=(pit, Bore(-1.0, 10e-3, 1e-3)), cracks=(crack,))
    phi = np.array([0.5, 0.5 + 0.03, -1.0, 1.0, 0.0, 0.5 + 2 * np.pi])
    z = np.array([10e-3, 10e-3, 10e-3, 22e-3, 0.0, 10e-3])
    expected = [0.5e-3, 0.5e-3 + 0.03 * 1e-3, math.inf, 0.7e-3, 0.0, 0.5e-3]
    np.testing.assert_allclose(pipe.depth(phi, z), expected, rtol=1e-9)


def test_a_dished_floor_is_shallower_at_its_rim():
    pipe = Pipe(bores=(Bore(0.0, 10e-3, 1e-3, depth=0.5e-3, dish=0.1e-3),))
    middle, rim = pipe.depth(np.zeros(2), np.array([10e-3, 10.4999e-3]))
    assert middle == pytest.approx(0.5e-3)
    assert rim == pytest.approx(0.4e-3, rel=1e-3)
