"""Motion of points in the image, against finite differences of the geometry."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from minorloop_head.geometry import Mount, Pinhole, wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.servo import pan_tilt_jacobian

CAMERA = CalibratedCamera(
    Pinhole(k1=-0.12),
    Mount(offset=(0.5e-3, -1e-3), roll=0.7, squint=0.05, camera_roll=-0.1),
    np.zeros((3, 3)),
)
coordinates = st.floats(-0.6, 0.6)
angles = st.floats(-0.5, 0.5)


def seen(point, pan, tilt):
    """Normalised coordinates of a point of the pipe."""
    local = CAMERA.mount.pose(pan, tilt).to_camera(point)
    return local[:2] / local[2]


@given(pan=angles, tilt=angles, phi=st.floats(-3, 3), z=st.floats(15e-3, 40e-3))
def test_pan_and_tilt_move_a_point_of_the_wall_as_finite_differences_say(pan, tilt, phi, z):
    point, h = wall_point(phi, z, 10e-3), 1e-6
    local = CAMERA.mount.pose(pan, tilt).to_camera(point)
    assume(local[2] >= 2e-3 and np.abs(local[:2] / local[2]).max() <= 1.5)
    columns = [
        (seen(point, pan + h * a, tilt + h * b) - seen(point, pan - h * a, tilt - h * b)) / (2 * h)
        for a, b in ((1, 0), (0, 1))
    ]
    found = pan_tilt_jacobian(
        seen(point, pan, tilt), tilt, lever=8e-3, depth=float(local[2]), camera=CAMERA.mount.camera
    )
    np.testing.assert_allclose(found, np.transpose(columns), rtol=1e-5, atol=1e-5)
