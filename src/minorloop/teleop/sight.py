"""What the seat makes of the image: what could be a defect, where a point went, how to centre it.

`Sight` is what the loop needs; `PlainSight` does it plainly: spots that differ from their
surroundings, a template that is looked for near where it was, and a servo on one point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.teleop.imaging import opencv
from minorloop.teleop.plant import View

Image: TypeAlias = npt.NDArray[np.uint8]
_SIGMAS = (2.0, 3.2, 5.0, 8.0)
_LEAST_CONTRAST = 14.0
_MOST_CANDIDATES = 8
_HALF = 14
_SEARCH = 22
_LOST = 0.45


@dataclass(frozen=True)
class Spot:
    """Something that could be a defect.

    Parameters
    ----------
    u, v : float
        Pixel of its middle.
    diameter : float
        In pixels.
    contrast : float
        Grey levels by which it is brighter than its surroundings; negative if darker.
    """

    u: float
    v: float
    diameter: float
    contrast: float


@dataclass(frozen=True)
class Place:
    """Where a ray meets the wall.

    Parameters
    ----------
    phi, z : float
        Angle about the axis of the pipe in radians, and metres along it from the pivot.
    far : float
        From the lens, in metres.
    scale : float
        Diameter in metres of a round mark there, for each pixel of the diameter of a disc of
        the same area in the image.
    """

    phi: float
    z: float
    far: float
    scale: float


@dataclass(frozen=True, eq=False)
class Target:
    """A point of the image that is followed.

    Parameters
    ----------
    u, v : float
        Pixel where it was seen last.
    score : float
        How well it was recognised then, up to 1.
    seen : bool
        Whether it is in sight.
    template : array
        What it looks like.
    """

    u: float
    v: float
    score: float
    seen: bool
    template: npt.NDArray[np.float32]


class Sight(Protocol):
    """What the loop needs of image processing."""

    def spots(self, image: Image) -> list[Spot]:
        """What could be a defect, the most likely first."""

    def begin(self, image: Image, u: float, v: float) -> Target:
        """Take up the point at a pixel."""

    def follow(self, target: Target, image: Image) -> Target:
        """Find the point again, near where it was."""

    def rates(self, target: Target, pan: float, tilt: float) -> tuple[float, float]:
        """Rates of pan and tilt in degrees per second that centre the point."""

    def place(self, u: float, v: float, pan: float, tilt: float) -> Place:
        """Where the ray of a pixel meets the wall."""


@dataclass(frozen=True, kw_only=True)
class PlainSight:
    """Spots, templates and a servo.

    Parameters
    ----------
    view : View
        The camera. Angles are in degrees about the axis of the pipe.
    gain : float
        How fast the servo brings the point to the middle, in 1/s.
    """

    view: View
    gain: float = 0.5

    def spots(self, image: Image) -> list[Spot]:
        """What could be a defect: maxima of the difference of Gaussians over place and size."""
        cv2 = opencv()
        scale = max(1, round(self.view.width / 320))
        grey = image[::scale, ::scale].astype(np.float32)
        blurred = [cv2.GaussianBlur(grey, (0, 0), s) for s in (*_SIGMAS, _SIGMAS[-1] * 1.6)]
        steps = np.array([a - b for a, b in pairwise(blurred)])
        size = np.abs(steps)
        best = size.max(axis=0)
        peaks = (best == cv2.dilate(best, np.ones((9, 9), np.uint8))) & (best > _LEAST_CONTRAST)
        peaks[:6] = peaks[-6:] = False
        peaks[:, :6] = peaks[:, -6:] = False
        rows, columns = np.nonzero(peaks)
        order = np.argsort(-best[rows, columns])[:_MOST_CANDIDATES]
        return [self._spot(grey, steps, int(rows[k]), int(columns[k]), scale) for k in order]

    def begin(self, image: Image, u: float, v: float) -> Target:
        """Take up the brightest or darkest spot near a pixel, or the pixel itself."""
        near = [s for s in self.spots(image) if math.hypot(s.u - u, s.v - v) < 2.0 * _HALF]
        if near:
            spot = min(near, key=lambda s: math.hypot(s.u - u, s.v - v))
            u, v = spot.u, spot.v
        cu, cv = self._inside(u, v)
        return Target(cu, cv, 1.0, True, _patch(image, cu, cv, _HALF))

    def follow(self, target: Target, image: Image) -> Target:
        """Normalised correlation with the template, to a fraction of a pixel."""
        u, v = target.u, target.v
        reach = _HALF + _SEARCH
        scores = opencv().matchTemplate(
            _patch(image, u, v, reach), target.template, opencv().TM_CCOEFF_NORMED
        )
        row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
        score = float(scores[row, column])
        if not score > _LOST:
            return replace(target, score=max(score, 0.0), seen=False)
        du, dv = _top(scores[row, :], int(column)), _top(scores[:, column], int(row))
        found = self._inside(u + column + du - _SEARCH, v + row + dv - _SEARCH)
        template = target.template
        if score > 0.8:  # what is well seen may slowly change its looks
            fresh = _patch(image, *found, _HALF)
            template = (0.95 * template + 0.05 * fresh).astype(np.float32)
        return Target(float(found[0]), float(found[1]), score, True, template)

    def rates(self, target: Target, pan: float, tilt: float) -> tuple[float, float]:
        """Rates that centre the point: the image Jacobian of pan and tilt with the lever arm.

        The rows of the interaction matrix are those of Boudjabi, Ferreira and Krupa (2003),
        equation 9, with the columns of the translation that the lever arm brings.
        """
        x, y = self._normalised(target.u, target.v)
        depth = self.place(target.u, target.v, pan, tilt).far / math.sqrt(1 + x * x + y * y)
        lever = self.view.lever
        turning = np.array([[x * y, -(1 + x * x), y], [1 + y * y, -x * y, -x]])
        # A turn about x moves the lens down, one about y to the right.
        turning[:, 0] -= lever * np.array([0.0, -1.0]) / depth
        turning[:, 1] += lever * np.array([-1.0, 0.0]) / depth
        t = math.radians(tilt)
        joints = np.array([[0.0, 1.0], [math.cos(t), 0.0], [-math.sin(t), 0.0]])
        rates = -self.gain * np.linalg.solve(turning @ joints, np.array([x, y]))
        return math.degrees(rates[0]), math.degrees(rates[1])

    def place(self, u: float, v: float, pan: float, tilt: float) -> Place:
        """Where the ray of a pixel meets the wall."""
        turn = turned(pan, tilt)
        x, y = self._normalised(u, v)
        ray = turn @ np.array([x, y, 1.0])
        slant = float(np.linalg.norm(ray))
        ray /= slant
        lens = self.view.lever * turn[:, 2]
        a = max(float(ray[0] ** 2 + ray[1] ** 2), 1e-9)
        b = float(lens[0] * ray[0] + lens[1] * ray[1])
        c = float(lens[0] ** 2 + lens[1] ** 2) - self.view.radius**2
        far = (-b + math.sqrt(max(b * b - a * c, 0.0))) / a
        x, y, z = (lens + far * ray).tolist()
        facing = max(float(x * ray[0] + y * ray[1]) / self.view.radius, 0.02)
        scale = far / self.view.focal / slant**1.5 / math.sqrt(facing)
        return Place(math.atan2(y, x), z, far, scale)

    def _normalised(self, u: float, v: float) -> tuple[float, float]:
        view = self.view
        return (u - (view.width - 1) / 2) / view.focal, (v - (view.height - 1) / 2) / view.focal

    def _inside(self, u: float, v: float) -> tuple[float, float]:
        return min(max(u, 0.0), self.view.width - 1.0), min(max(v, 0.0), self.view.height - 1.0)

    def _spot(
        self,
        grey: npt.NDArray[np.float32],
        steps: FloatArray,
        row: int,
        column: int,
        scale: int,
    ) -> Spot:
        """Middle and size from the half level between the spot and its surroundings."""
        level = int(np.argmax(np.abs(steps[:, row, column])))
        sign = float(np.sign(steps[level, row, column]))
        # Wide enough for its border to lie outside the spot.
        reach = min(max(12, round(3.5 * _SIGMAS[level])), row, column)
        part = sign * grey[row - reach : row + reach + 1, column - reach : column + reach + 1]
        inside = float(grey[row - 1 : row + 2, column - 1 : column + 2].mean()) * sign
        border = np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]])
        outside = float(np.median(border))
        high = part > 0.5 * (inside + outside)
        marked = opencv().connectedComponents(high.astype(np.uint8))[1]
        here = marked == marked[min(reach, marked.shape[0] - 1), min(reach, marked.shape[1] - 1)]
        here &= high
        area = max(float(here.sum()), 1.0)
        rows, columns = np.nonzero(here)
        v, u = (float(n.mean()) if n.size else float(reach) for n in (rows, columns))
        return Spot(
            scale * (column - reach + u),
            scale * (row - reach + v),
            scale * 2.0 * math.sqrt(area / math.pi),
            sign * (inside - outside),
        )


def turned(pan: float, tilt: float) -> FloatArray:
    """(3, 3) from the camera to the pipe, for angles in degrees: the tilt first, then the pan."""
    p, t = math.radians(pan), math.radians(tilt)
    about_y = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(t), -math.sin(t)], [0, math.sin(t), math.cos(t)]])
    return np.asarray(about_y @ about_x, dtype=np.float64)


def _patch(image: Image, u: float, v: float, half: int) -> npt.NDArray[np.float32]:
    """(2 half + 1) squared pixels about a place that need not be whole; edges are repeated."""
    size = (2 * half + 1, 2 * half + 1)
    patch = opencv().getRectSubPix(image, size, (float(u), float(v)))
    return np.asarray(patch, dtype=np.float32)


def _top(scores: npt.NDArray[np.float32], index: int) -> float:
    """Where between samples a parabola through the highest three has its top."""
    if not 0 < index < len(scores) - 1:
        return 0.0
    left, middle, right = (float(s) for s in scores[index - 1 : index + 2])
    bend = left - 2 * middle + right
    return 0.0 if bend >= 0 else min(max(0.5 * (left - right) / bend, -0.5), 0.5)
