import numpy as np

from minorloop_head.procedures.extract import SAME, acquisition, nearest
from minorloop_head.vision.defects import SEQUENCE, Hole
from minorloop_head.vision.reflectance_map import ALONE

from .fakes import Loop


def hole(z, evidence=1.0, phi=0.5):
    return Hole(np.array([phi, z]), 1e-3, evidence, "dark", np.empty((0, 2)))


def test_each_frame_is_under_its_lights_and_all_are_on_afterwards():
    loop = Loop(sees=True)
    frames = loop.run(acquisition(3.0))
    assert [frame.lights for frame in frames] == list(SEQUENCE)
    asked = [request for request in loop.asked if request.lights is not None]
    assert [request.lights for request in asked] == list(SEQUENCE)
    longer = [request.exposure[0] / loop.asked[-1].exposure[0] for request in asked]
    np.testing.assert_allclose(longer, [ALONE] * 4 + [1.0])
    assert {request.exposure[1] for request in asked} == {3.0}


def test_the_nearest_hole_is_chosen_unless_it_is_too_far():
    holes = [hole(20e-3, 9.0), hole(21e-3, 1.0)]
    assert nearest(holes, (0.5, 20.9e-3), 10e-3) is holes[1]
    assert nearest(holes, (0.5 + 2 * np.pi, 20e-3), 10e-3) is holes[0]
    assert nearest(holes, (0.5, 21e-3 + 1.1 * SAME), 10e-3) is None
    assert nearest([], (0.5, 20e-3), 10e-3) is None
