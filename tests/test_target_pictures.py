import numpy as np
import pytest

from benchmarks.target_pictures import TargetCamera
from minorloop.errors import ParameterError
from minorloop_head.geometry import rotation_x
from minorloop_head.twins.camera import LENS, ImageSensor

SMALL = LENS.scaled(0.25)
HALF = np.zeros((4, 8), dtype=bool)
HALF[:, 4:] = True
QUIET = ImageSensor(read=0.0, electrons=1e9, lens_dirt=0.0, veil_near=0.0, veil_far=0.0)


def edge_at(camera, row):
    """Column in which a row goes from black to white."""
    line = camera.frame().image[row].astype(float)
    high = line[84:88].mean()
    return float(np.interp(high / 2, line[60:88], np.arange(60, 88)))


def test_an_edge_is_where_the_lens_projects_it():
    camera = TargetCamera(HALF, 2e-3, SMALL, sensor=QUIET)
    turn, place = rotation_x(0.3), np.array([-8e-3, -4e-3, 0.03])
    camera.hold(turn, place)
    for down in (2e-3, 6e-3):
        u, v = SMALL.project(turn @ [8e-3, down, 0.0] + place)
        assert abs(edge_at(camera, round(v)) - u) < 0.1


def test_rows_are_read_one_after_the_other():
    camera = TargetCamera(HALF, 2e-3, SMALL, sensor=QUIET)
    place = [-8e-3, -4e-3, 0.03]
    camera.hold(np.eye(3), place)
    still = [edge_at(camera, row) for row in (50, 70)]
    camera.hold(np.eye(3), place, (0.1, 0.0, 0.0))
    moved = [edge_at(camera, row) for row in (50, 70)]
    later = 20 / SMALL.height * camera.sensor.readout
    slipped = (moved[1] - still[1]) - (moved[0] - still[0])
    assert slipped == pytest.approx(SMALL.focal * 0.1 * later / 0.03, abs=0.05)


def test_a_glossy_target_reflects_the_led_that_is_on():
    camera = TargetCamera(HALF, 2e-3, SMALL, glossy=True, sensor=QUIET)
    camera.hold(np.eye(3), [-8e-3, -4e-3, 0.03])
    camera.expose(2.5e-3)
    camera.switch([False, True, False])
    v, u = np.argwhere(camera.frame().image > 200).mean(axis=0)
    mirrored = camera.leds[1] + [0.0, 0.0, 0.06]
    assert np.abs(SMALL.project(mirrored) - [u, v]).max() < 0.7


def test_refuses_cells_without_a_size():
    with pytest.raises(ParameterError, match="give a positive length"):
        TargetCamera(HALF, 0.0)
