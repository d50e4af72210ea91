"""Pictures of a wall made without the twin: a checkered cylinder, sampled ray by ray."""

from functools import lru_cache

import numpy as np

from minorloop_head.geometry import Mount, Pinhole, meet_wall, wall_point
from minorloop_head.vision.calibrated_camera import CalibratedCamera, Window

LENS = Pinhole(k1=-0.12, k2=0.02)
LEDS = np.array([[2.5e-3, 0, 0], [-1.25e-3, 2.165e-3, 0], [-1.25e-3, -2.165e-3, 0]])
MOUNT = Mount(offset=(0.4e-3, -0.3e-3), roll=0.3, advance=1e-3)
CAMERA = CalibratedCamera(LENS, MOUNT, LEDS)
PLACE = np.array([0.5, 20e-3])
AIM = np.array(CAMERA.mount.aim(wall_point(*PLACE, CAMERA.radius)))
"""Angles that show a place of the wall in the middle."""
SEEN = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1)
RAYS = LENS.rays(SEEN)


def texture(phi, z, seed=0):
    """Smooth random brightness of the wall, 0 to 1, with details of about half a millimetre.

    In single precision, whose cosines take a tenth of the time.
    """
    rng = np.random.default_rng(seed)
    phi, z = np.float32(phi), np.float32(z)
    level = np.zeros(np.shape(phi), np.float32)
    for _ in range(40):
        turns, way, shift = int(rng.integers(2, 40)), rng.normal(0, 2500), rng.uniform(0, 2 * np.pi)
        level += np.cos(turns * phi + way * z + shift)
    return 1 / (1 + np.exp(-level / 4))


@lru_cache(maxsize=8)
def _brightness(pan, tilt, paint, camera):
    pose = camera.mount.pose(pan, tilt)
    phi, z, _ = np.moveaxis(meet_wall(pose.position, RAYS @ pose.rotation.T, camera.radius), -1, 0)
    z = np.where(np.isfinite(z), z, 1.0)
    return paint(phi, np.minimum(z, 1.0))


def photograph(pan, tilt, paint=texture, *, camera=CAMERA, noise=1.5, seed=0, gain=1.0):
    """A frame of a wall painted by ``paint(phi, z)``, evenly lit."""
    level = gain * (20 + 150 * _brightness(pan, tilt, paint, camera))
    level += noise * np.random.default_rng(seed).standard_normal(level.shape)
    return np.clip(np.rint(level), 0, 255).astype(np.uint8)


def lit_at_the_lens(pan, tilt):
    """A frame of a bare pipe lit from the lens, at degrees; by its own rays, not those of above."""
    u, v = np.meshgrid((np.arange(640) - 319.5) / 520, (np.arange(480) - 239.5) / 520)
    (cp, sp), (ct, st) = ((np.cos(a), np.sin(a)) for a in np.radians([pan, tilt]))
    turn = np.array([[cp, sp * st, sp * ct], [0.0, ct, -st], [-sp, cp * st, cp * ct]])
    x, y, z = (row[0] * u + row[1] * v + row[2] for row in turn)
    px, py, _ = 8.0 * turn[:, 2]
    a, b, c = x**2 + y**2, px * x + py * y, px**2 + py**2 - 100.0
    far = (np.sqrt(b**2 - a * c) - b) / np.maximum(a, 1e-9)
    facing = (x * (px + far * x) + y * (py + far * y)) / 10.0
    length = np.sqrt(x**2 + y**2 + z**2)
    light = facing / length / np.maximum(far * length, 1e-6) ** 2
    return np.clip(np.rint(4.0 + 14e3 * light), 0, 250).astype(np.uint8)


def window_around(phi, z, *, size, step=0.05e-3):
    """A square window of ``size`` metres about a place."""
    half = round(size / 2 / step)
    count = 2 * half + 1
    return Window(phi - half * step / CAMERA.radius, z - half * step, step, count, count)
