import numpy as np
import pytest

from minorloop_head.geometry import wall_point
from minorloop_head.vision.reflectance_map import LitFrame, finite_angles, lay_flat, median

from .walls import CAMERA, photograph

AIM = CAMERA.mount.aim(wall_point(0.5, 20e-3, 10e-3))
ALONE = tuple(tuple(bool(n == led) for n in range(3)) for led in range(3))


def frames(gains=(1.0, 1.0, 1.0)):
    """A frame for each light, of a wall that is evenly bright."""
    return [
        LitFrame(photograph(*AIM, seed=n, gain=gain), *AIM, lights)
        for n, (lights, gain) in enumerate(zip(ALONE, gains, strict=True))
    ]


def test_the_map_is_unknown_where_a_frame_does_not_show_the_wall():
    found = lay_flat(frames(), CAMERA)
    seen = np.isfinite(found.stack)
    assert (seen == seen[0]).all()
    assert 0 < seen[0].mean() < 1
    assert found.glow is None
    assert (found.brightest >= found.darkest)[seen[0]].all()


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_the_median_of_a_stack_is_that_of_numpy(count):
    stack = np.random.default_rng(count).normal(size=(count, 5, 7)).astype(np.float32)
    np.testing.assert_array_equal(median(stack), np.median(stack, axis=0).astype(np.float32))


def test_light_from_behind_is_no_reflectance():
    window = np.zeros((CAMERA.lens.height, CAMERA.lens.width), np.uint8)
    window[:, 200:400] = 40
    plain = frames()
    lit = [LitFrame(look.image + window, *AIM, look.lights) for look in plain]
    found = lay_flat([*lit, LitFrame(window, *AIM, (False,) * 3)], CAMERA)
    np.testing.assert_allclose(found.stack, lay_flat(plain, CAMERA).stack, atol=0.15)
    assert np.nanmax(found.glow) == pytest.approx(np.log(11))
    off = np.abs(lay_flat(lit, CAMERA).stack - found.stack)
    assert np.nanmax(off) > 0.3  # without the frame that shows it, it is not known


def test_angles_are_finite_numbers():
    assert finite_angles(0.1, -0.2)
    assert not finite_angles(np.nan, 0.0)
    assert not finite_angles("ahead", 0.0)
