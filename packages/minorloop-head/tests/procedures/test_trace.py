import numpy as np
import pytest

from minorloop_head.procedures import trace
from minorloop_head.procedures.trace import (
    SAME,
    between,
    nearest,
    one_course,
    patch_about,
    whole_course,
)
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole

RADIUS = 10e-3


def line(z, length=4e-3, widths=None):
    course = np.stack([np.linspace(0.0, length / RADIUS, 41), np.full(41, z)], axis=1)
    return TracedCrack(course, np.full(41, 0.2e-3) if widths is None else widths, length, 0.5)


def test_the_far_view_gives_the_course_only_if_it_shows_much_more():
    near = line(0.02)
    assert whole_course(near, line(0.02, 4.2e-3)) is near
    longer = line(0.02, 6e-3)
    assert whole_course(near, longer) is longer


@pytest.mark.parametrize(("width", "count"), [(3e-6, 0), (20e-6, 0), (40e-6, 1)])
def test_a_line_that_is_not_open_from_nearer_is_no_crack(monkeypatch, width, count):
    known = line(0.02)
    near = line(0.02, widths=np.full(41, width))
    near.widths[15:26] = 60e-6  # by noise
    monkeypatch.setattr(trace, "traces_of", lambda *_, **__: (near, line(0.03)))
    assert len(trace.traced_again(None, known.places, RADIUS)) == count


def test_courses_beside_one_another_are_one_and_a_patch_holds_them():
    here, beside = line(0.02).places, line(0.0204).places
    assert one_course(here, beside, RADIUS)
    assert not one_course(here, line(0.021).places, RADIUS)
    assert between(here[:1], beside[:1], RADIUS) == pytest.approx(0.4e-3)
    patch = patch_about(here, RADIUS)
    assert patch.z < 0.02 < patch.z + patch.rows * patch.step


def hole(z, evidence=1.0, phi=0.5):
    return Hole(np.array([phi, z]), 1e-3, evidence, "dark", np.empty((0, 2)))


def test_the_nearest_hole_is_chosen_unless_it_is_too_far():
    holes = [hole(20e-3, 9.0), hole(21e-3, 1.0)]
    assert nearest(holes, (0.5, 20.9e-3), 10e-3) is holes[1]
    assert nearest(holes, (0.5 + 2 * np.pi, 20e-3), 10e-3) is holes[0]
    assert nearest(holes, (0.5, 21e-3 + 1.1 * SAME), 10e-3) is None
    assert nearest([], (0.5, 20e-3), 10e-3) is None
