"""Looks in a direction that the wires may not reach, and at a place beyond the cone."""

import math

import numpy as np
import pytest

from minorloop_head.geometry import wrapped
from minorloop_head.procedures.mark import aim_at
from minorloop_head.procedures.steps import centre, look

from .fakes import CALIBRATION, Loop

RING = math.radians(25.0)


class Rig(Loop):
    """A head whose joints come to 10 degrees and not farther, or as far as they are said to."""

    calibration = CALIBRATION

    def __init__(self, *, travels=True, most=10.0, **known):
        super().__init__(**known)
        self.top, self.travels = most, travels
        self.most, self.said = np.full(2, np.inf), []

    def tick(self, request):
        super().tick(request)
        joints = np.minimum(CALIBRATION.joints(self.angles), self.top)
        self.angles = CALIBRATION.line_of_sight(np.radians(joints))

    def say(self, what, outcome, *, succeeded=True):
        self.said.append((what, outcome, succeeded))


@pytest.mark.parametrize("way", np.radians([-20.0, 60.0, 130.0]))
def test_a_head_that_does_not_reach_a_direction_is_rolled_to_look_there(way):
    rig = Rig()
    assert not look(rig, "view 1", RING * np.array([math.cos(way), math.sin(way)]))
    pan, tilt = rig.angles
    seen = math.atan2(tilt, pan) + rig.place[1]
    assert float(wrapped(seen - way)) == pytest.approx(0.0, abs=math.radians(1.0))
    ((what, outcome, succeeded),) = rig.said
    assert (what, succeeded) == ("view 1", False)
    assert outcome.startswith("out of reach: ")
    assert ", has 10" in outcome
    assert outcome.endswith(" degrees instead")
    assert rig.most.min() == pytest.approx(10.0, abs=0.1)


@pytest.mark.parametrize("known", [{"most": 45.0}, {"travels": False}])
def test_a_head_that_falls_short_in_the_right_direction_or_has_no_catheter_is_not_rolled(known):
    rig = Rig(**known)
    assert not look(rig, "view 1", np.array([RING, 0.0]))
    assert rig.said[0][1].endswith(f", has {rig.top:.0f}")
    assert rig.place.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("off", "reached"), [(29.0, True), (31.0, False)])
def test_a_place_beyond_the_cone_is_said_to_be_out_of_reach_and_tried_once(off, reached):
    place = np.array([0.5, 1e-3 + CALIBRATION.radius / math.tan(math.radians(off))])
    before = 0.7 * aim_at(CALIBRATION, place, (1e-3, 0.0))
    rig = Rig(most=90.0, sees=True, angles=before, place=(1e-3, 0.0))
    centre(rig, place)
    ((what, outcome, succeeded),) = rig.said
    assert (what, succeeded) == ("centre", reached)
    assert outcome.startswith("out of reach: ") != reached
    assert rig.t < 16.0
