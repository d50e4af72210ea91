"""Looks in a direction that the wires may not reach."""

import math

import numpy as np
import pytest

from minorloop_head.geometry import wrapped
from minorloop_head.procedures.steps import look

from .fakes import CALIBRATION, Loop

RING = math.radians(25.0)


class Rig(Loop):
    """A head whose joints come to 10 degrees and not farther, or as far as they are said to."""

    calibration = CALIBRATION

    def __init__(self, *, travels=True, most=10.0):
        super().__init__()
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
