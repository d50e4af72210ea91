"""A simulated camera on a pan-tilt head in a metal pipe, with three switched LEDs.

Every ray is intersected with the cylinder of the wall. The LEDs are fixed to the head and turn with
it, so that their reflections move over the wall. A loop is::

    camera = Camera(Pipe.draw(3, holes=1))
    camera.look(0.4, 0.1)              # radians; where the head is now
    camera.switch((True, False, False))
    camera.focus_at(0.012)
    frame = camera.frame()             # (480, 640) uint8, then 40 ms have passed
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import LimitError, ParameterError
from minorloop_head.geometry import WATER_INDEX, Mount, Pinhole, Pose, meet_wall, wall_point
from minorloop_head.sources import Frame
from minorloop_head.twins import _camera_kernels as kernels
from minorloop_head.twins._shade_kernels import shade
from minorloop_head.twins.mounted import Mounted
from minorloop_head.twins.pipe import Bore, Crack, Pipe
from minorloop_head.twins.surface import Surface, lay_out, with_dirt
from minorloop_head.twins.turbid_water import FlatPort, TurbidWater

LENS = Pinhole(k1=-0.12, k2=0.02)
LED_CIRCLE = 2.5e-3  # m, radius
_NEAREST, FARTHEST = 4e-3, 60e-3  # m, of the focus
_FOCUS_RATE = 250.0  # of 1/distance, in 1/m per second
_FULL_SCALE = 100.0  # grey levels at radiance 1, 10 ms and gain 1
_NOISE_BANK = 1 << 20
"""Number of normal numbers, drawn once, of which each row of a frame uses a random part: new ones
for each frame would take 6 of the 40 ms between frames."""
_NUDGE = 2.5  # pixels of motion up to which second derivatives describe the blur
_BOX = 19
"""Cells of a mean that scatters light over about 100 pixels if it is taken twice."""
_KINDS = {"pit": 0.0, "hole": 1.0, "white": 2.0}

Bytes = npt.NDArray[np.uint8]


def led_positions() -> FloatArray:
    """Return (3, 3) places of LEDs on a circle round the lens, in the camera, in metres."""
    angles = np.pi / 2 + 2 * np.pi * np.arange(3) / 3
    return LED_CIRCLE * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)


@dataclass(frozen=True)
class ImageSensor:
    """Image sensor and optics: blur, noise, glare and read-out.

    Raises a `ParameterError` if a number is negative, or electrons or interval are 0.
    """

    aperture: float = 0.2e-3
    """Diameter of the entrance pupil, in metres, which sets the depth of field."""
    sharpest: float = 0.5
    """Standard deviation of the blur in focus, in pixels."""
    read: float = 0.8
    """Standard deviation of the read noise at gain 1, in grey levels."""
    electrons: float = 25.0
    """Electrons for one grey level at gain 1."""
    veil_near: float = 0.02
    veil_far: float = 0.02
    """Shares of the light scattered over about 12 and 100 pixels."""
    lens_dirt: float = 0.15
    """Strength of the spots on the lens."""
    readout: float = 8e-3
    """Time from the first row to the last, in seconds; 0 for a global shutter."""
    interval: float = 0.04
    """Time between frames, in seconds."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not as_finite(name, value) >= 0:
                raise ParameterError(f"{name} of the sensor is {value}; give a number >= 0")
        if self.electrons == 0 or self.interval == 0:
            raise ParameterError("a sensor needs electrons and an interval above 0")


class Camera(Mounted):
    """640 by 480 grey pixels, 25 frames a second, between three LEDs.

    Raises a `ParameterError` if an option is out of its range, or water fills a pipe that has a
    surface of water.

    ``pipe``: the pipe, with its defects.
    ``mount``: place of the head in the pipe.
    ``optics``: the lens; sizes are multiples of 8 pixels.
    ``specimen``: seed of a specimen: focal length and distortion are drawn within +-10 % of
    nominal, and calibrated to 0.1 %; the principal point moves by up to 1 % of the width; the
    strength of each LED is drawn within +-10 % and not calibrated. Without it, the nominal camera.
    ``seed``: seed of the noise and of the spots on the lens.
    ``sensor``: blur, noise, glare and read-out.
    ``flooded``: water that fills the whole pipe, the camera behind a flat port in it.
    ``calibration`` remains that in air.

    Notes
    -----
    An LED at distance r gives the wall k_d albedo max(n.l, 0) / r^2 + k_s D(h) / (4 (n.v) r^2)
    with D the anisotropic distribution of Trowbridge and Reitz (Burley, Physically based shading
    at Disney, 2012, equation 13), about the slopes of brush marks, dents and beads. Blur follows
    the circle of confusion of a thin lens, motion blurs along its path in the image, glare is
    added, then shot noise, read noise and rounding to 8 bit.
    """

    kind = "camera"

    def __init__(
        self,
        pipe: Pipe,
        mount: Mount | None = None,
        optics: Pinhole = LENS,
        *,
        specimen: int | None = None,
        seed: int = 0,
        sensor: ImageSensor | None = None,
        flooded: TurbidWater | None = None,
    ) -> None:
        if optics.width % kernels.CELL or optics.height % kernels.CELL:
            raise ParameterError(
                f"an image of {optics.width} by {optics.height} pixels; give multiples of 8"
            )
        if flooded is not None and pipe.water is not None:
            raise ParameterError(
                f"the pipe has a surface of water at y = {pipe.water} m; give either that or water "
                "that fills it"
            )
        self.sensor = sensor or ImageSensor()
        self.leds = led_positions()
        self._flooded = flooded
        super().__init__(mount)
        self._pipe = pipe
        self._optics, self.calibration, self._strengths = _specimen(optics, specimen)
        if flooded is not None:
            self._optics = FlatPort.of(self._optics)
        self._rng = np.random.default_rng([seed, 1])
        self._noise = self._rng.standard_normal(_NOISE_BANK, dtype=np.float32)
        self._on = (True,) * len(self.leds)
        self._exposure, self._gain = 0.01, 1.0
        self._focus = self._focus_wanted = 1 / 0.015
        self._prepare()

    @property
    def focus(self) -> float:
        """Distance in focus now, in metres."""
        return 1 / self._focus

    def switch(self, lights: Sequence[bool]) -> None:
        """Switch LEDs on or off from the next frame on.

        Raises a `ParameterError` if the number of truth values is not that of the LEDs.
        """
        if len(lights) != len(self.leds):
            raise ParameterError(f"{len(lights)} lights; give one truth value for each of the 3")
        self._on = tuple(bool(light) for light in lights)

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set the exposure time, in seconds, and the gain.

        Raises a `LimitError` if the exposure is not from 10 us to the interval between frames, or
        the gain not from 0.1 to 32.
        """
        if not 1e-5 <= exposure <= self.sensor.interval:
            raise LimitError(
                f"exposure {exposure} s is beyond the limits [1e-05, {self.sensor.interval:g}] s"
            )
        if not 0.1 <= gain <= 32:
            raise LimitError(f"gain {gain} is beyond the limits [0.1, 32]")
        self._exposure, self._gain = float(exposure), float(gain)

    def focus_at(self, distance: float) -> None:
        """Move the focus to a distance in metres, which takes up to a second.

        Raises a `LimitError` if the distance is not from 4 to 60 mm.
        """
        if not _NEAREST <= distance <= FARTHEST:
            raise LimitError(
                f"focus at {distance} m is beyond the limits [{_NEAREST:g}, {FARTHEST:g}] m"
            )
        self._focus_wanted = 1 / distance

    def frame(self) -> Frame:
        """Return the next image; its time is the middle of the exposure of the middle row."""
        radiance = self._radiance()
        image = self._exposed(radiance)
        t = self._clock + 0.5 * (self._exposure + self.sensor.readout)
        self._advance(self.sensor.interval)
        return Frame(t, image)

    def _advance(self, seconds: float) -> None:
        """Advance the clock: the head continues to turn and the focus to move."""
        super()._advance(seconds)
        reach = seconds * _FOCUS_RATE
        self._focus += min(max(self._focus_wanted - self._focus, -reach), reach)

    def _pose(self, row: float) -> Pose:
        """Return the pose of the camera in the middle of the exposure of a row."""
        after = 0.5 * self._exposure + self.sensor.readout * row / self._optics.height
        return self._mount.pose(
            self._pan + after * self._rates[0], self._tilt + after * self._rates[1]
        )

    def _node_poses(self) -> tuple[FloatArray, FloatArray]:
        """Return rotations (V, 3, 3) and positions (V, 3) of the camera for each row of nodes."""
        count = len(self._rays)
        if self._rates == (0.0, 0.0):
            pose = self._pose(0.0)
            return np.tile(pose.rotation, (count, 1, 1)), np.tile(pose.position, (count, 1))
        # Linear interpolation of such a short turn errs by 1e-6 of a radian.
        ends = [self._pose(0.0), self._pose(float(kernels.CELL * (count - 1)))]
        share = np.linspace(0.0, 1.0, count)[:, None, None]
        first, last = (end.rotation for end in ends)
        start, stop = (end.position for end in ends)
        return first + share * (last - first), start + share[..., 0] * (stop - start)

    def _pixel(self, phi: npt.ArrayLike, z: npt.ArrayLike) -> FloatArray:
        """Return pixels (..., 2) of places of the wall in the next frame. For scoring only."""
        points = wall_point(phi, z, self._pipe.radius)
        found = self._optics.project(self._pose(self._optics.height / 2).to_camera(points))
        for _ in range(3):
            flat = found.reshape(-1, 2)
            rows = np.nan_to_num(flat[:, 1], nan=0.0)
            again = [
                self._optics.project(self._pose(row).to_camera(point))
                for row, point in zip(rows, points.reshape(-1, 3), strict=True)
            ]
            found = np.reshape(again, found.shape)
        return found

    def repaint(self, pipe: Pipe) -> None:
        """Show another state of the wall, such as with a mark on it.

        More dirt, such as a mark, takes less than a frame; other changes take a second.
        """
        before, surface = self._pipe, self._surface
        known = len(before.dirt)
        if replace(pipe, dirt=pipe.dirt[:known]) != before:
            self._pipe = pipe
            self._lay_out(lay_out(pipe))
            return
        for patch in pipe.dirt[known:]:
            surface = with_dirt(surface, pipe, patch)
        self._pipe = pipe
        self._lay_out(surface)

    def _lay_out(self, surface: Surface) -> None:
        """Prepare the wall, with its defects."""
        self._surface, finish = surface, self._pipe.finish
        angle = surface.size[0] / self._pipe.radius
        self._texels, self._shapes = surface.texels, surface.shapes
        self._texel = np.array([*surface.size, angle], dtype=np.float32)
        metal = (
            finish.diffuse,
            finish.specular * (self._flooded.gloss if self._flooded else 1.0),
            finish.roughness_around,
            finish.roughness_along,
            finish.ambient,
        )
        self._metal = np.array(metal, dtype=np.float32)
        self._bores = [_bore_values(bore, self._pipe.thickness) for bore in self._pipe.bores]
        self._cracks = [_corners(crack) for crack in self._pipe.cracks]
        self._outlines = _outlines(self._pipe, self._cracks)

    def _prepare(self) -> None:
        """Prepare the constants of all frames."""
        self._lay_out(lay_out(self._pipe))
        optics = self._optics
        rows, columns = optics.height // kernels.CELL + 1, optics.width // kernels.CELL + 1
        v, u = np.mgrid[0:rows, 0:columns] * float(kernels.CELL)
        self._rays = optics.rays(np.stack([u, v], axis=-1))
        self._lens_dirt = _lens_dirt(optics, self.sensor.lens_dirt, self._rng)
        self._image = np.empty((optics.height, optics.width), dtype=np.float32)
        self._haze = np.zeros((rows, columns), dtype=np.float32)
        self._spare = np.empty_like(self._image)

    def _radiance(self) -> npt.NDArray[np.float32]:
        """Return the light on the sensor (H, W), before glare."""
        on = np.array(self._on)
        turns, lenses = self._node_poses()
        leds, strengths = self.leds[on], self._strengths[on]
        fields = np.empty(
            (kernels.COMMON + kernels.PER_LED * len(leds), *self._rays.shape[:2]), np.float32
        )
        focal = self._optics.focal * (WATER_INDEX if self._flooded else 1.0)
        lens = (focal, self.sensor.aperture, 1 / self._focus, self.sensor.sharpest**2)
        extinction = self._flooded.extinction if self._flooded else 0.0
        kernels.fill_nodes(
            self._rays, turns, lenses, self._pipe.radius, leds, strengths, lens, extinction,
            fields,
        )  # fmt: skip
        if self._flooded:
            self._haze[:] = 0.0
            water = (extinction, self._flooded.scattering * self._flooded.backward)
            kernels.backscatter(
                self._rays, turns, lenses, self._pipe.radius, leds, strengths, water, self._haze
            )
        image = self._image
        shade(fields, self._texels, self._shapes, self._texel, self._metal, image)
        self._add_defects(fields, image)
        if self._pipe.water is not None:
            kernels.add_water(
                fields, self._pipe.radius, self._pipe.water, self._rays, turns, lenses, leds,
                strengths, image,
            )  # fmt: skip
        return self._blurred(fields, image)

    def _add_defects(self, fields: npt.NDArray[np.float32], image: npt.NDArray[np.float32]) -> None:
        metal = self._metal.astype(np.float64)
        boxes = self._boxes()
        count = len(self._bores)
        for n in np.flatnonzero((boxes[:, 0] < boxes[:, 1]) & (boxes[:, 2] < boxes[:, 3])):
            if n < count:
                kernels.add_bore(fields, self._pipe.radius, self._bores[n], boxes[n], metal, image)
            else:
                crack, corners = self._pipe.cracks[n - count], self._cracks[n - count]
                look = crack.albedo, crack.flanks
                kernels.add_crack(fields, self._pipe.radius, corners, look, boxes[n], metal, image)

    def _boxes(self) -> npt.NDArray[np.int64]:
        """Return (N, 4) rows and columns, from and to, that may see each bore and crack."""
        pose = self._pose(self._optics.height / 2)
        local = pose.to_camera(self._outlines)
        ahead = local[..., 2].min(axis=1) > 1e-4
        # Beyond the corners the distortion may fold back into the image; a port has no rays there.
        edge = 1.0 / WATER_INDEX if self._flooded else 1.0
        plain = np.clip(local[..., :2] / np.maximum(local[..., 2:], 1e-4), -edge, edge)
        pixels = self._optics.pixels(plain)
        low, high = pixels.min(axis=1) - 6, pixels.max(axis=1) + 7
        size = (self._optics.width, self._optics.height)
        low, high = np.clip(low, 0, size), np.clip(high, 0, size)
        high[~ahead] = 0
        return np.stack([low[:, 1], high[:, 1], low[:, 0], high[:, 0]], axis=1).astype(np.int64)

    def _blurred(
        self, fields: npt.NDArray[np.float32], image: npt.NDArray[np.float32]
    ) -> npt.NDArray[np.float32]:
        """Return the image after motion blur and defocus."""
        du, dv = self._smear()
        if max(abs(du), abs(dv)) > 0.3:
            move = kernels.nudge if max(abs(du), abs(dv)) < _NUDGE else kernels.drag
            move(image, du, dv, self._spare)
            image, self._spare = self._spare, image
            self._image = image
        kernels.blur(image, fields, self._spare)
        return image

    def _smear(self) -> tuple[float, float]:
        """Return the motion of the middle of the image during an exposure, in pixels."""
        if self._rates == (0.0, 0.0):
            return 0.0, 0.0
        middle = ((self._optics.width - 1) / 2, (self._optics.height - 1) / 2)
        before = self._mount.pose(self._pan, self._tilt)
        phi, z, length = meet_wall(
            before.position, before.rotation @ self._optics.rays(middle), self._pipe.radius
        )
        if not length < 1.0:
            return 0.0, 0.0
        after = self._mount.pose(
            self._pan + self._exposure * self._rates[0],
            self._tilt + self._exposure * self._rates[1],
        )
        point = wall_point(phi, z, self._pipe.radius)
        moved = self._optics.project(after.to_camera(point)) - middle
        return float(moved[0]), float(moved[1])

    def _exposed(self, radiance: npt.NDArray[np.float32]) -> Bytes:
        """Return the grey levels of a radiance image."""
        sensor, optics = self.sensor, self._optics
        scale = _FULL_SCALE * self._gain * self._exposure / 0.01
        starts = self._rng.integers(0, _NOISE_BANK - optics.width, optics.height)
        out = np.empty(radiance.shape, dtype=np.uint8)
        veil = self._veil(radiance, 20 * 255 / scale)
        kernels.expose(
            radiance,
            veil + self._haze if self._flooded else veil,
            self._lens_dirt,
            np.float32(scale),
            self._noise,
            starts,
            np.float32(sensor.read * max(self._gain, 1.0)),
            np.float32(self._gain / sensor.electrons),
            out,
        )
        return out

    def _veil(self, radiance: npt.NDArray[np.float32], most: float) -> npt.NDArray[np.float32]:
        """Return the scattered light at the nodes."""
        rows, columns = (n // kernels.CELL for n in radiance.shape)
        cells = np.empty((rows, columns), dtype=np.float32)
        kernels.shrink(radiance, np.float32(most), cells)
        near = ndimage.gaussian_filter(cells, 1.5, mode="constant", truncate=3.0)
        once = ndimage.uniform_filter(cells, _BOX, mode="constant")
        far = ndimage.uniform_filter(once, _BOX, mode="constant")
        veil = (self.sensor.veil_near * near + self.sensor.veil_far * far).astype(np.float32)
        # The centres of cells lie between the nodes.
        padded = np.pad(veil, 1, mode="edge")
        nodes: npt.NDArray[np.float32] = 0.25 * (
            padded[:-1, :-1] + padded[1:, :-1] + padded[:-1, 1:] + padded[1:, 1:]
        )
        return nodes


def _specimen(optics: Pinhole, specimen: int | None) -> tuple[Pinhole, Pinhole, FloatArray]:
    """Return the true lens, the calibrated one, and the strengths of the LEDs."""
    if specimen is None:
        return optics, optics, np.ones(3)
    rng = np.random.default_rng(specimen)
    spread, doubt = rng.uniform(0.9, 1.1, 3), rng.normal(1.0, 1e-3, 3)
    u, v = optics.centre
    shift = rng.uniform(-0.01, 0.01, 2) * optics.width
    true = replace(
        optics,
        focal=optics.focal * spread[0],
        k1=optics.k1 * spread[1],
        k2=optics.k2 * spread[2],
        centre=(u + shift[0], v + shift[1]),
    )
    seen = replace(true, focal=true.focal * doubt[0], k1=true.k1 * doubt[1], k2=true.k2 * doubt[2])
    return true, seen, rng.uniform(0.9, 1.1, 3)


def _lens_dirt(
    optics: Pinhole, strength: float, rng: np.random.Generator
) -> npt.NDArray[np.float32]:
    """Return the transmission (H, W) of a lens with spots and vignetting."""
    v, u = np.mgrid[0 : optics.height, 0 : optics.width].astype(np.float64)
    fx, fy = optics.focals
    x, y = (u - optics.centre[0]) / fx, (v - optics.centre[1]) / fy
    through = (1 + x * x + y * y) ** -1.5
    for _ in range(6):
        u0, v0 = rng.uniform(0, optics.width), rng.uniform(0, optics.height)
        size = rng.uniform(10, 45)
        depth = strength * rng.uniform(0.2, 1.0)
        through *= 1 - depth * np.exp(-0.5 * ((u - u0) ** 2 + (v - v0) ** 2) / size**2)
    dimmed: npt.NDArray[np.float32] = through.astype(np.float32)
    return dimmed


def _outlines(pipe: Pipe, cracks: list[FloatArray]) -> FloatArray:
    """Return (N, 24, 3) points round each bore and along each crack."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    outlines = []
    for bore in pipe.bores:
        edge = bore.diameter / 2 + bore.chamfer
        outlines.append(
            wall_point(
                bore.phi + edge / pipe.radius * np.cos(angles),
                bore.z + edge * np.sin(angles),
                pipe.radius,
            )
        )
    for corners in cracks:
        along = np.linspace(0, len(corners) - 1, 24)
        phi, z = (np.interp(along, np.arange(len(corners)), corners[:, n]) for n in (0, 1))
        outlines.append(wall_point(phi, z, pipe.radius))
    return np.reshape(outlines, (-1, 24, 3))


def _bore_values(bore: Bore, thickness: float) -> tuple[float, ...]:
    """Return a bore as numbers for its kernel."""
    kind = ("white" if bore.inside == "white" else "hole") if bore.through else "pit"
    lit = bore.through and bore.inside == "backlit"
    return (
        bore.phi,
        bore.z,
        bore.diameter / 2,
        thickness if bore.through else bore.depth,
        _KINDS[kind],
        bore.brightness if kind != "hole" else 0.0,
        bore.chamfer,
        bore.chamfer_slope,
        bore.lining,
        bore.brightness if lit else 0.0,
    )


def _corners(crack: Crack) -> FloatArray:
    """Return (N, 3) phi, without jumps, z and half the width."""
    places = np.array(crack.points)
    return np.stack([np.unwrap(places[:, 0]), places[:, 1], 0.5 * np.array(crack.widths)], axis=1)
