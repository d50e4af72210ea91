"""Scenes of the servo study."""

import numpy as np

from minorloop_head.procedures.calibration import STRAIGHT
from papers.catheter.inspection_servo import STROKE_SHARE, Scene


def test_every_hole_is_within_reach_of_the_wires() -> None:
    """The tilt of this head reaches 49 degrees; a hole at 54 could not be centred."""
    scene = Scene(101)
    own = np.linalg.solve(scene.control.coupling, np.degrees(scene.aim + STRAIGHT))
    top = np.array([axis.observer.wire.operator.range[1] for axis in scene.control.axes])
    assert top.min() < 50
    assert (own < STROKE_SHARE * top).all()
