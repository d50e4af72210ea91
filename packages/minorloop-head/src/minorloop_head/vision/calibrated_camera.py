"""The calibrated camera, and images of the wall unrolled with it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, SignalError
from minorloop_head.geometry import Mount, Pinhole, meet_wall, wall_point, wrapped
from minorloop_head.vision import _kernels
from minorloop_head.vision.imaging import Image32

Image = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class CalibratedCamera:
    """A calibrated camera in a pipe of known radius."""

    lens: Pinhole
    """The calibrated lens."""
    mount: Mount
    """Estimated place of the head in the pipe."""
    leds: FloatArray
    """Shape (N, 3). Places of the LEDs in the camera, in metres."""
    radius: float = 10e-3
    """Radius of the pipe, in metres."""

    def place(self, pixels: npt.ArrayLike, pan: float, tilt: float) -> FloatArray:
        """Return phi and z (..., 2) on the wall of pixels (..., 2), at pan and tilt in radians."""
        pose = self.mount.pose(pan, tilt)
        rays = self.lens.rays(pixels) @ pose.rotation.T
        return meet_wall(pose.position, rays, self.radius)[..., :2]

    def pixel(self, places: npt.ArrayLike, pan: float, tilt: float) -> FloatArray:
        """Return pixels (..., 2) of phi and z (..., 2) on the wall; NaN behind the camera."""
        where = np.asarray(places, dtype=np.float64)
        points = wall_point(where[..., 0], where[..., 1], self.radius)
        return self.lens.project(self.mount.pose(pan, tilt).to_camera(points))

    def shifted(self, places: npt.ArrayLike, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return phi and z (..., 2) where places (..., 2) appear to be after an unknown turn.

        The head is at angles ``after`` (2,), but the places are computed for the angles ``before``
        (2,); NaN behind the camera. They are the places of the pixels, without lens distortion and
        its inverse.
        """
        where = np.asarray(places, dtype=np.float64)
        points = wall_point(where[..., 0], where[..., 1], self.radius)
        seen = self.mount.pose(*after.tolist()).to_camera(points)
        seen[~(seen[..., 2] > 0)] = np.nan
        pose = self.mount.pose(*before.tolist())
        return meet_wall(pose.position, seen @ pose.rotation.T, self.radius)[..., :2]

    def inside(self, pan: float, tilt: float) -> bool:
        """Return whether pan and tilt are finite and put the lens inside the pipe."""
        if not (math.isfinite(pan) and math.isfinite(tilt)):
            return False
        x, y = self.mount.pose(pan, tilt).position[:2]
        return math.hypot(x, y) < self.radius

    def check(self, image: Any) -> None:
        """Refuse an image that is not from this camera.

        Raises a `SignalError` if its shape or type is wrong.
        """
        shape = (self.lens.height, self.lens.width)
        if not isinstance(image, np.ndarray):
            raise SignalError(
                f"a frame is a {type(image).__name__}; this camera gives an array of uint8 of "
                f"shape {shape}"
            )
        if image.shape != shape or image.dtype != np.uint8:
            raise SignalError(
                f"a frame is {image.dtype} of shape {image.shape}; this camera gives uint8 of "
                f"shape {shape}"
            )


@dataclass(frozen=True)
class Window:
    """A rectangle of the unrolled wall: x = radius * (phi - phi0) in columns, z in rows.

    Raises a `ParameterError` if it is empty.
    """

    phi: float
    z: float
    """Centre of the first texel."""
    step: float
    """Size of a texel, in metres."""
    rows: int
    columns: int
    """Texels along and around the pipe."""

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1 or not self.step > 0:
            raise ParameterError(
                f"a window of {self.rows} by {self.columns} texels of {self.step} m is empty"
            )

    def finer(self, radius: float) -> Window:
        """Return the window with each texel divided into four."""
        off = 0.25 * self.step
        return Window(
            self.phi - off / radius, self.z - off, self.step / 2, 2 * self.rows, 2 * self.columns
        )

    def place(self, x: npt.ArrayLike, y: npt.ArrayLike, radius: float) -> FloatArray:
        """Return phi and z (..., 2) of columns x and rows y."""
        columns, rows = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        return np.stack(
            [self.phi + columns * self.step / radius, self.z + rows * self.step], axis=-1
        )

    def texels(self, places: npt.ArrayLike, radius: float) -> FloatArray:
        """Return columns x and rows y (..., 2) of places phi and z, within half a turn of it."""
        phi, z = np.moveaxis(np.asarray(places, dtype=np.float64), -1, 0)
        half = 0.5 * (self.columns - 1)
        around = wrapped(phi - self.phi - half * self.step / radius)
        return np.stack([around * radius / self.step + half, (z - self.z) / self.step], axis=-1)


def window_in_view(
    camera: CalibratedCamera, pan: float, tilt: float, *, step: float, least: float
) -> Window | None:
    """Return the smallest window that contains all wall in view with enough resolution.

    It is None if no wall in view has this resolution.

    ``camera``: the camera; ``pan``, ``tilt``: of the head, in radians; ``step``: size of a texel,
    in metres; ``least``: least resolution, in pixels per metre of wall, in the direction of the
    lowest.
    """
    u = np.linspace(0, camera.lens.width - 1, 41)
    v = np.linspace(0, camera.lens.height - 1, 31)
    pose = camera.mount.pose(pan, tilt)
    rays = camera.lens.rays(np.stack(np.meshgrid(u, v), axis=-1)) @ pose.rotation.T
    phi, z, length = np.moveaxis(meet_wall(pose.position, rays, camera.radius), -1, 0)
    norm = np.linalg.norm(rays, axis=-1)
    out = (rays[..., 0] * np.cos(phi) + rays[..., 1] * np.sin(phi)) / norm
    with np.errstate(invalid="ignore"):
        large = min(camera.lens.focals) * out / (length * norm) >= least
    if not large.any():
        return None
    middle = float(np.angle(np.exp(1j * phi[large]).sum()))
    x = camera.radius * wrapped(phi[large] - middle)
    left, top = float(x.min()), float(z[large].min())
    return Window(
        middle + left / camera.radius,
        top,
        step,
        int((float(z[large].max()) - top) / step) + 1,
        int((float(x.max()) - left) / step) + 1,
    )


def unroll(
    image: Image,
    camera: CalibratedCamera,
    window: Window,
    pan: float,
    tilt: float,
    *,
    least: float = 0.0,
) -> Image32:
    """Unroll an image on a window of the wall.

    It is (rows, columns): grey levels; NaN where the image does not show the wall.

    ``image`` (H, W): a frame. ``camera``: the camera. ``window``: the texels of the result.
    ``pan``, ``tilt``: of the head when the frame was taken, in radians. ``least``: as in
    ``window_in_view``; wall seen with a lower resolution is left out.
    """
    flat = np.empty((window.rows, window.columns), dtype=np.float32)
    _kernels.unroll(image, flat, *_view_parameters(camera, window, pan, tilt), least)
    return flat


def irradiance(camera: CalibratedCamera, window: Window, pan: float, tilt: float) -> Image32:
    """Return cos / r^2 of each LED on the wall, (N, rows, columns); 1 for 10 mm at right angles."""
    light = np.empty((len(camera.leds), window.rows, window.columns), dtype=np.float32)
    pose = camera.mount.pose(pan, tilt)
    _kernels.irradiance(
        light, window.phi, window.z, window.step, camera.radius, pose.to_pipe(camera.leds)
    )
    return light


def _view_parameters(
    camera: CalibratedCamera, window: Window, pan: float, tilt: float
) -> tuple[float, float, float, float, FloatArray, FloatArray, FloatArray]:
    pose = camera.mount.pose(pan, tilt)
    lens = numbers(camera.lens)
    return window.phi, window.z, window.step, camera.radius, pose.rotation, pose.position, lens


def numbers(lens: Pinhole) -> FloatArray:
    """Return focal lengths, principal point and distortion (9,) of a lens, for the kernels."""
    return np.array([*lens.focals, *lens.centre, *lens.distortion])
