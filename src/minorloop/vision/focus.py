"""Bring a picked region into focus by what is sharpest, wherever the wall is said to be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Frame
from minorloop.vision import health
from minorloop.vision.eye import Eye

SHARP, FLAT, AT_THE_END, NO_FRAMES = "sharp", "nothing to focus on", "at the end", "no frames"
"""Verdicts of a search."""

_LEAST_GAIN, _SCATTERS = 0.02, 3.0
_SWEEPS = 3


class FocusingCamera(Protocol):
    """A camera whose focus can be sent to a distance."""

    def frame(self) -> Frame:
        """The next image."""

    def focus_at(self, distance: float) -> None:
        """Send the focus to a distance in metres."""


@dataclass(frozen=True, eq=False)
class Focus:
    """Where a region is sharpest.

    Parameters
    ----------
    distance : float
        To which the focus was sent, in metres.
    curve : (N, 2) array
        Distances that were tried, in metres, and how sharp the region was, nearest first.
    verdict : str
        ``sharp``, ``nothing to focus on``, ``at the end`` of what was allowed, or ``no frames``
        where none could be used; the focus is then back at the guess.
    """

    distance: float
    curve: FloatArray
    verdict: str


def sharpness(image: Any, pixel: npt.ArrayLike, *, size: int = 96) -> float:
    """Mean squared slope about a pixel, relative to the brightness; NaN where nothing is seen.

    Parameters
    ----------
    image : (height, width) array of uint8
    pixel : (2,) array_like
        Column and row in the middle of the region.
    size : int
        Side of the region in pixels; what is outside the image is left out.

    Notes
    -----
    Slopes are taken over two pixels of means over three, which keeps most noise out; saturated
    pixels and their neighbours are left out, as they are sharp at any focus. Tenenbaum, 1970.
    """
    u, v = np.asarray(pixel, dtype=np.float64)
    if not (isinstance(image, np.ndarray) and image.ndim == 2 and math.isfinite(u + v)):
        return math.nan
    half = size // 2
    top, left = max(round(v) - half, 0), max(round(u) - half, 0)
    part = image[top : max(round(v) + half, 0), left : max(round(u) + half, 0)].astype(np.float64)
    if min(part.shape) < 8:
        return math.nan
    smooth = _thirds(_thirds(part).T).T
    down = smooth[2:, 1:-1] - smooth[:-2, 1:-1]
    across = smooth[1:-1, 2:] - smooth[1:-1, :-2]
    dull = _thirds(_thirds(part == 255).T).T[1:-1, 1:-1] == 0
    level = float(part.mean())
    if level < 2 or dull.mean() < 0.25:
        return math.nan
    return float((down**2 + across**2)[dull].mean() / (2 * level) ** 2)


def autofocus(
    camera: FocusingCamera,
    eye: Eye,
    pixel: npt.ArrayLike,
    guess: float,
    *,
    spread: float = 0.3,
    tries: int = 9,
    wait: int = 6,
    travel: int = 25,
    nearest: float = 4e-3,
    farthest: float = 60e-3,
) -> Focus:
    """Sweep the focus about a guess and leave it where the region is sharpest.

    Parameters
    ----------
    camera : FocusingCamera
        With the light on and the exposure set; both must stay as they are.
    eye : Eye
        Tells the size of a frame.
    pixel : (2,) array_like
        The region.
    guess : float
        Distance to the wall in metres, such as that of `wall_depth`.
    spread : float
        The sweep goes this share beyond the guess either way, and further where the best is at
        an end.
    tries : int
        Steps of a sweep, even in the inverse of the distance.
    wait : int
        Frames to let pass after a step, while the lens moves.
    travel : int
        Frames to let pass before the first step, while the lens moves all the way.
    nearest, farthest : float
        Limits of the focus, in metres.

    Raises
    ------
    ParameterError
        If the guess is not within the limits, or there are fewer than five tries.
    """
    if not nearest <= guess <= farthest:
        raise ParameterError(
            f"the guess {guess} m is not within the focus of the camera, "
            f"[{nearest:g}, {farthest:g}] m"
        )
    if tries < 5 or not 0 < spread < 1 or min(wait, travel) < 0:
        raise ParameterError("a sweep needs 5 tries or more, a spread in (0, 1) and a wait >= 0")
    low, high = 1 / farthest, 1 / nearest
    middle, curve = 1 / guess, np.empty((0, 2))
    for _ in range(_SWEEPS):
        ends = np.clip([middle * (1 - spread), middle * (1 + spread)], low, high)
        steps = np.linspace(ends[1], ends[0], tries)
        camera.focus_at(1 / steps[0])
        for _ in range(travel):
            camera.frame()
        curve = np.array([(1 / step, _try(camera, eye, pixel, 1 / step, wait)) for step in steps])
        if np.isfinite(curve[:, 1]).sum() < 5:
            camera.focus_at(guess)
            return Focus(guess, curve, NO_FRAMES)
        best = int(np.nanargmax(curve[:, 1]))
        if 0 < best < tries - 1:
            break
        if steps[best] in (low, high):
            break
        middle = float(steps[best])
    return _settle(camera, guess, curve)


def _settle(camera: FocusingCamera, guess: float, curve: FloatArray) -> Focus:
    """Go to the peak of a curve."""
    known = curve[np.isfinite(curve[:, 1])]
    inverse, sharp = 1 / known[:, 0], known[:, 1]
    best = int(sharp.argmax())
    if not _curved(inverse, np.log(sharp)):
        camera.focus_at(guess)
        return Focus(guess, curve, FLAT)
    first = int(np.clip(best - 2, 0, len(sharp) - 5))
    near = slice(first, first + 5)
    a, b, _ = np.polyfit(inverse[near] - inverse[best], np.log(sharp[near]), 2)
    top = inverse[best] - b / (2 * a) if a < 0 else inverse[best]
    top = float(np.clip(top, inverse.min(), inverse.max()))
    camera.focus_at(1 / top)
    return Focus(1 / top, curve, SHARP if 0 < best < len(sharp) - 1 else AT_THE_END)


def _curved(inverse: FloatArray, level: FloatArray) -> bool:
    """Whether a curve bends by more than it scatters."""
    fitted = np.polyval(np.polyfit(inverse - inverse.mean(), level, 2), inverse - inverse.mean())
    return bool(np.ptp(fitted) > _LEAST_GAIN + _SCATTERS * np.std(level - fitted))


def _try(
    camera: FocusingCamera, eye: Eye, pixel: npt.ArrayLike, distance: float, wait: int
) -> float:
    """How sharp the region is with the focus at a distance; NaN without a good frame."""
    camera.focus_at(distance)
    for _ in range(wait):
        camera.frame()
    values = []
    for _ in range(2):
        image = camera.frame().image
        if health.judge(image, eye.lens) == health.GOOD:
            values.append(sharpness(image, pixel))
    return float(np.mean(values)) if values else math.nan


def _thirds(part: npt.NDArray[Any]) -> FloatArray:
    """Means over three rows."""
    values = part.astype(np.float64)
    means: FloatArray = (values[:-2] + values[1:-1] + values[2:]) / 3
    return means
