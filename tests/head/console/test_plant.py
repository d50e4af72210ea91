import msgspec
import numpy as np
import pytest

from console_rig import tip
from minorloop.errors import ModelFileError, ParameterError
from minorloop.head.console.identified_head import head_of
from minorloop.head.console.plant import head_at, open_plant, open_tip
from minorloop.head.procedures.calibration import STRAIGHT, HeadCalibration, joint_degrees
from minorloop.head.procedures.head_file import HeadFile, save_head
from minorloop.head.procedures.values import Plant, Tip


def test_plant_and_tip_are_what_the_console_needs_with_the_camera_that_the_view_describes():
    found, view = tip()
    plant = open_plant("twin:pipe", specimen=2, seed=1)
    assert isinstance(plant, Plant)
    assert isinstance(found, Tip)
    plant.exchange(np.zeros(4))
    found.move_to(plant.stance())
    assert found.frame().image.shape == (view.lens.height, view.lens.width)


def test_a_view_comes_through_a_message_unchanged():
    _, view = open_tip("twin:pipe", specimen=3)
    again = HeadCalibration.from_dict(msgspec.json.decode(msgspec.json.encode(view.to_dict())))
    assert (again.lens, again.probe, again.offset) == (view.lens, view.probe, view.offset)
    known = (view.radius, view.thickness, view.temperature)
    assert (again.radius, again.thickness, again.temperature) == known
    np.testing.assert_array_equal(again.leds, view.leds)


def test_pipe_and_water_are_known_as_well_as_they_can_be_measured():
    tip, view = open_tip("twin:pipe", seed=5)
    assert 0 < abs(view.radius - tip.pipe.radius) < 0.1e-3
    assert 0 < abs(view.thickness / tip.pipe.thickness - 1) <= 0.03
    assert 0 < abs(view.temperature - 20.0) < 1.5


def test_a_head_that_was_identified_is_brought_to_the_middle():
    control, plant = head_of("twin:pipe", 3), open_plant("twin:pipe", specimen=3)
    state, y = control.begin(), np.zeros(4)
    for _ in range(300):
        u, state = control.step(state, joint_degrees([0.0, 0.0]), np.degrees(y[:2]))
        y = plant.exchange(np.concatenate([u, [0.0, 0.0]]))
    assert y[:2] == pytest.approx([STRAIGHT, STRAIGHT], abs=8e-3)


def test_the_file_of_the_head_is_read_and_that_of_another_refused(tmp_path):
    file = tmp_path / "head.json"
    save_head(HeadFile(serial="twin-head-3"), file)
    assert head_at("twin:pipe", 3, file)[0].serial == "twin-head-3"
    with pytest.raises(ModelFileError, match=r"'twin-head-3', and the head here is 'twin-head-4'"):
        head_at("twin:pipe", 4, file)


def test_other_addresses_are_refused():
    for ask in (open_plant, open_tip, lambda address: head_of(address, None)):
        with pytest.raises(ParameterError, match="twin:pipe"):
            ask("twin:ipmc")
