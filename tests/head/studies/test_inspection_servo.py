"""What a scene asks of its head."""

import numpy as np

from minorloop.head.studies.inspection_servo import STROKE_SHARE, Scene
from minorloop.head.twins.rig import STRAIGHT


def test_no_hole_is_where_a_wire_does_not_get() -> None:
    """The tilt of this head comes to 49 degrees; its scene was drawn at 54 and never settled."""
    scene = Scene(101)
    own = np.linalg.solve(scene.control.coupling, np.degrees(scene.aim) + STRAIGHT)
    top = np.array([axis.observer.wire.operator.range[1] for axis in scene.control.axes])
    assert top.min() < 50
    assert (own < STROKE_SHARE * top).all()
