"""A calibration that pictures of a sweep correct."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import SignalError
from minorloop_head.geometry import Mount
from minorloop_head.twins.camera import LENS, Camera
from minorloop_head.twins.pipe import Pipe
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.wall_angles import WallAngles
from minorloop_head.vision.wall_refinement import CameraDoubt, refined

REST = np.radians([-30.0, -30.0])


@pytest.fixture(scope="module")
def sweep():
    """Pictures of a pan up and a tilt up from rest, and what is known of the camera."""
    camera = Camera(Pipe.draw(1006, length=51.2e-3), Mount(), LENS.scaled(0.5), seed=1)
    camera.focus_at(10e-3)
    frames = []
    way = [(pan, -30.0) for pan in np.arange(-30.0, 16.0, 1.5)]
    way += [(-30.0, tilt) for tilt in np.arange(-30.0, 10.0, 2.0)]
    for pan, tilt in [(-30.0, -30.0)] * 9 + way:
        camera.look(*np.radians([pan, tilt]))
        camera.expose(0.01, 0.7 + 0.6 * min(abs(pan + 30), abs(30 - abs(tilt)) + 10) / 30)
        frames.append(camera.frame())
    known = CalibratedCamera(camera.calibration, Mount(), camera.leds)
    return frames[8:], known


def error(camera, rest, frames):
    """Of the angle after the pan, from the one at rest, in degrees."""
    eyes = WallAngles(camera)
    _, state = eyes.begin(frames[0].image, rest, frames[0].t)
    for frame in frames[1:32]:
        sight, state = eyes.step(state, frame.image, frame.t)
    return float(np.degrees(sight.angles - rest)[0] - 45.0)


def test_pictures_correct_the_angles_of_a_camera_whose_lever_is_wrong(sweep):
    frames, true = sweep
    off = replace(true, mount=replace(true.mount, lever=true.mount.lever + 0.2e-3))
    found, rest = refined(WallAngles(off), frames, REST, CameraDoubt(length=0.2e-3))
    assert abs(error(true, REST, frames)) < 0.15
    assert error(off, REST, frames) < -0.5
    # The looks of patches change as the head turns, so that some of the error stays.
    assert abs(error(found, rest, frames)) < 0.5 * abs(error(off, REST, frames))


def test_a_sweep_that_shows_no_wall_is_refused(sweep):
    frames, known = sweep
    dark = [replace(frame, image=np.zeros_like(frame.image)) for frame in frames[1:]]
    with pytest.raises(SignalError, match="1 pictures of the sweep show the angles, and 10"):
        refined(WallAngles(known), [frames[0], *dark], REST)
