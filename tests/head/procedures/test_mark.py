import numpy as np
import pytest

from minorloop.head.geometry import wall_point
from minorloop.head.procedures.centre import CONE
from minorloop.head.procedures.go import Go
from minorloop.head.procedures.mark import APPROACH, Marking, aim_at

from .fakes import CALIBRATION, Loop, eye

PLACE, CATHETER = (0.5, 20e-3), (1e-3, 0.0)


def test_an_aim_looks_at_its_place_or_stops_at_the_cone():
    pan, tilt = aim_at(CALIBRATION, PLACE, CATHETER)
    assert eye().place(eye().lens.centre, pan, tilt) == pytest.approx(PLACE, abs=1e-9)
    near = aim_at(CALIBRATION, (0.5, 5e-3), CATHETER)
    assert np.hypot(*near) == pytest.approx(CONE.half)


def test_a_mark_turns_part_of_the_way_meters_and_centres():
    loop = Loop(place=CATHETER, sees=True)
    marking = Marking(calibration=CALIBRATION, go=Go(still=0.08))
    state = loop.run(marking, marking.begin(PLACE))
    assert (state.go.done, state.meter.done, state.centre.done) == (True, True, True)
    turned = next(request.angles for request in loop.asked if request.angles is not None)
    full = np.array(eye().mount.aim(wall_point(*PLACE, 10e-3)))
    assert turned == pytest.approx(APPROACH * full)
    assert state.gain != 1.0
