from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import wall_point
from minorloop_head.procedures.centre import (
    CONE,
    LOST_FOR,
    STUCK_FOR,
    STUCK_PX,
    TWO_TICKS,
    Centred,
    Centring,
)
from minorloop_head.vision.tracking import TRACKED

from .fakes import CALIBRATION, Loop, eye

PLACE = (0.5, 22e-3)
AIM = np.array(eye().mount.aim(wall_point(*PLACE, 10e-3)))


def test_a_point_is_brought_to_the_middle_and_held_there():
    loop = Loop(AIM + np.array([0.05, -0.03]), (1e-3, 0.0), share=1.0, sees=True)
    centring = Centring(calibration=CALIBRATION, gain=1.8, patience=8.0)
    state = loop.run(centring.centre(Centred(place=PLACE)))
    assert state.verdict == "tracked"
    assert state.error < centring.in_middle
    assert loop.angles == pytest.approx(AIM, abs=0.01)
    assert loop.t < 8.0
    wanted = [request.angles for request in loop.asked if request.angles is not None]
    assert all(np.hypot(*each) <= CONE.half + 1e-9 for each in wanted)


class GoingDark(Loop):
    """A loop whose pictures are black after 0.3 s."""

    def reading(self, request=None):
        now = super().reading(request)
        dark = now.image is not None and self.t > 0.3
        return replace(now, image=np.zeros_like(now.image)) if dark else now


@pytest.mark.parametrize(("still", "ends"), [(0.44, 0.3 + LOST_FOR), (np.inf, 4.0)])
def test_a_point_that_is_lost_is_given_up_unless_it_is_to_be_held(still, ends):
    loop = GoingDark(AIM, (1e-3, 0.0), share=1.0, sees=True)
    centring = Centring(
        calibration=CALIBRATION, still=still, in_middle=0.0, patience=4.0, interval=TWO_TICKS
    )
    assert loop.run(centring.centre(Centred(place=PLACE))).verdict != TRACKED
    assert loop.t == pytest.approx(ends, abs=0.2)


@pytest.mark.parametrize(("still", "ends"), [(0.44, STUCK_FOR), (np.inf, 8.0)])
def test_a_head_that_comes_no_nearer_is_stuck_unless_the_point_is_to_be_held(still, ends):
    loop = Loop(AIM + np.array([0.1, 0.0]), (1e-3, 0.0), share=0.0, sees=True)
    centring = Centring(calibration=CALIBRATION, still=still, patience=8.0, interval=TWO_TICKS)
    state = loop.run(centring.centre(Centred(place=PLACE)))
    assert state.verdict == TRACKED
    assert state.stuck == np.isfinite(still)
    assert state.error > STUCK_PX
    assert loop.t == pytest.approx(ends, abs=0.5)


def test_without_sensors_the_angles_follow_from_the_image():
    true = AIM + np.array([0.02, 0.0])
    loop = Loop(true, (1e-3, 0.0), share=0.0, sees=True)
    centring = Centring(calibration=CALIBRATION, by_image=True, patience=0.4)
    loop.run(centring.centre(Centred(place=PLACE)))
    told = [request.sighted for request in loop.asked if request.sighted is not None]
    assert told
    assert told[-1] == pytest.approx(true, abs=2e-3)
