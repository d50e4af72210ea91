import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.teleop.plant import MIDDLE, Plant, head_of, open_plant


def test_a_rig_is_a_plant_with_the_camera_that_the_view_describes():
    plant, view = open_plant("twin:rig", specimen=2, seed=1)
    assert isinstance(plant, Plant)
    assert plant.frame().image.shape[:2] == (view.height, view.width)


def test_a_head_that_was_identified_is_brought_to_the_middle():
    control, (plant, _) = head_of("twin:rig", 3), open_plant("twin:rig", specimen=3)
    state, y = control.begin(), np.zeros(4)
    for _ in range(300):
        u, state = control.step(state, [MIDDLE, MIDDLE], y[:2])
        y = plant.exchange(np.concatenate([u, [0.0, 0.0]]))
    assert y[:2] == pytest.approx([MIDDLE, MIDDLE], abs=0.5)


def test_other_addresses_are_refused():
    for ask in (open_plant, lambda address: head_of(address, None)):
        with pytest.raises(ParameterError, match="twin:rig"):
            ask("twin:ipmc")
