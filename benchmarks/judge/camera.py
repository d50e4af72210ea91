"""A camera that takes frames of a rendered scene, with the noise of an instrument."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from benchmarks.judge.scenes import HEIGHT, LEVER, RADIUS, WIDTH, Scene
from minorloop_head.geometry import Mount, Pinhole
from minorloop_head.procedures.meter import LIMITS
from minorloop_head.sources import Frame
from minorloop_head.vision.calibrated_camera import CalibratedCamera

_ELECTRONS, _READ, _UNEVEN = 30.0, 0.9, 0.006
"""Electrons for a grey level at gain 1, read noise in grey levels, and relative spread of the
sensitivity of pixels: those of a small sensor of 10 um^2 pixels."""
_VEIL, _VEIL_WIDTH = 0.03, 30.0
"""Share of the light that the lens scatters, and over how many pixels."""
_PIVOT = 0.2e-3
"""Error of the place of the pivot, in metres: the one for which recall is required."""
_METERED = 6
"""Frames by which the gain is set: as many as the head's metering takes in its second."""


class RenderedCamera:
    """Frames of a scene, under any of its lights.

    Parameters
    ----------
    scene : Scene
    radiance : (4, HEIGHT, WIDTH) array
        Of each LED, and from behind, as `light.radiance` returns it.
    """

    def __init__(self, scene: Scene, radiance: np.ndarray) -> None:
        self._rng = np.random.default_rng([scene.seed, scene.hole is not None, 31])
        v, u = np.mgrid[0:HEIGHT, 0:WIDTH]
        rays = scene.rays(np.stack([u, v], axis=-1).astype(float))
        falloff = (rays**2).sum(axis=-1) ** -2  # cos^4
        seen = radiance.astype(np.float64) * falloff
        lit = seen[:3].sum(axis=0)
        # Grey levels at 10 ms and gain 1: a wall of middling brightness needs a gain of about 1.
        self._levels = seen * 95.0 * scene.brightness / np.minimum(lit, 6 * lit.mean()).mean()
        if scene.hole is not None and scene.hole.light:
            # The light behind is as bright as the wall about the place, times the drawn factor.
            self._levels[3] = falloff * radiance[3] * 95.0 * scene.brightness
        self._uneven = 1 + _UNEVEN * self._rng.standard_normal((HEIGHT, WIDTH))
        self._on, self._exposure, self._gain = (True, True, True), 0.01, 1.0

    def switch(self, lights: Sequence[bool]) -> None:
        """Switch the LEDs."""
        self._on = tuple(lights)

    def expose(self, exposure: float, gain: float) -> None:
        """Set exposure time in seconds, and gain."""
        self._exposure, self._gain = exposure, gain

    def frame(self) -> Frame:
        """Return a frame with new noise."""
        share = self._exposure / 0.01
        light = share * self._levels[[*self._on, True]].sum(axis=0)
        wide = ndimage.zoom(
            ndimage.gaussian_filter(
                light.reshape(HEIGHT // 8, 8, WIDTH // 8, 8).mean(axis=(1, 3)), _VEIL_WIDTH / 8
            ),
            8,
            order=1,
        )
        light = ((1 - _VEIL) * light + _VEIL * wide) * self._uneven
        electrons = light * _ELECTRONS
        electrons = electrons + np.sqrt(electrons) * self._rng.standard_normal(light.shape)
        grey = self._gain * (
            electrons / _ELECTRONS + _READ * self._rng.standard_normal(light.shape)
        )
        return Frame(0.0, np.clip(np.rint(grey), 0, 255).astype(np.uint8))


def metered(camera: RenderedCamera) -> float:
    """Return the gain that the head's metering sets."""
    gain = 1.0
    for _ in range(_METERED):
        camera.expose(LIMITS.exposure, gain)
        gain = LIMITS.gain(gain, camera.frame().image)
    return gain


def calibrated(scene: Scene) -> tuple[CalibratedCamera, np.ndarray]:
    """Return the camera as a calibration with small errors knows it, and measured angles (2,)."""
    lens = Pinhole(
        WIDTH,
        HEIGHT,
        scene.focal * (1 + scene.known["focal"]),
        scene.centre,
        k1=scene.k1,
        k2=scene.k2,
    )
    way = scene.known["pivot"]
    mount = Mount(
        lever=LEVER / 1e3,
        offset=(
            scene.offset[0] / 1e3 + _PIVOT * math.cos(way),
            scene.offset[1] / 1e3 + _PIVOT * math.sin(way),
        ),
        roll=scene.roll,
        advance=scene.advance / 1e3,
    )
    camera = CalibratedCamera(lens, mount, scene.leds / 1e3, RADIUS / 1e3)
    return camera, np.array([scene.pan + scene.known["pan"], scene.tilt + scene.known["tilt"]])
