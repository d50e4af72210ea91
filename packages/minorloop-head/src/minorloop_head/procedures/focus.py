"""Sweep the focus about a guess and set it where a region of the image is sharpest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.values import NOW, Procedure, Reading, Request, passed
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import Image

_SHARP, FLAT, _AT_THE_END, _NO_FRAMES = "sharp", "nothing to focus on", "at the end", "no frames"
"""Verdicts of a search."""

_DARK = 2.0
"""Grey level that is added before the logarithm, so that noise in the dark counts little."""
_LEAST_GAIN, _SCATTERS = 0.02, 3.0
"""A sweep has a peak if the logarithm of its sharpness bends by 2 % and three times its scatter."""
_NEAR_TOP = 0.75
"""Share of the greatest sharpness above which values belong to the top of the curve. A far wall is
sharp over most of a sweep: a fit of five values about the greatest would follow their scatter."""
_LEAST_TRIES = 5
"""Least number of usable frames for a peak."""
_TRIES, _FRAMES, _SWEEPS = 9, 2, 3
"""Steps of a sweep, evenly spaced in inverse distance; frames at each step; and largest number of
sweeps, each about the best step of the one before."""
_SPREAD, _WIDEST = 0.3, 0.6
"""Relative half width of a sweep, and of the next sweep if the first has no peak: a far wall is
sharp over most of a sweep. The first guess, from the calibrated wall, is right within some
percent."""
_WAIT, _TRAVEL = 0.12, 0.32
"""Seconds that the lens takes to move to a step, and in addition to the first step."""
_NEAREST, _FARTHEST = 4e-3, 60e-3
"""Limits of the focus, in metres."""


def focus(lens: Pinhole, pixel: npt.ArrayLike, guess: float) -> Procedure[FocusPeak]:
    """Focus on a pixel (2,) that shows something at about a distance in metres.

    Raises a `ParameterError` if the guess is not within the limits of the focus.

    ``lens``: its size is that of a frame; ``pixel`` (2,): middle of the region; ``guess``: in
    metres.
    """
    if not _NEAREST <= guess <= _FARTHEST:
        raise ParameterError(
            f"the guess {guess} m is not within the focus of the camera, "
            f"[{_NEAREST:g}, {_FARTHEST:g}] m"
        )
    region, steps, sweep = np.asarray(pixel, dtype=np.float64), _steps(1 / guess, _SPREAD), 0
    now = yield NOW
    while True:
        now, levels = yield from _swept(lens, region, steps, now)
        sweep += 1
        if np.isfinite(levels).sum() >= _LEAST_TRIES and sweep < _SWEEPS:
            best = int(np.nanargmax(levels))
            at_limit = steps[best] in (1 / _FARTHEST, 1 / _NEAREST)
            if best in (0, _TRIES - 1) and not at_limit:
                steps = _steps(float(steps[best]), _SPREAD)
                continue
        found = peak_of(np.stack([1 / steps, levels], axis=1), guess, _LEAST_TRIES)
        if found.verdict != FLAT or sweep >= _SWEEPS:
            yield Request(focus=found.distance, now=True)
            return found
        steps, sweep = _steps(1 / guess, _WIDEST), _SWEEPS - 1  # the last one


def _swept(
    lens: Pinhole, region: FloatArray, steps: FloatArray, now: Reading
) -> Procedure[tuple[Reading, FloatArray]]:
    """Return the last reading of a sweep, and the sharpness (tries,) at inverse distances.

    It is NaN where no frame was usable.
    """
    levels: list[float] = []
    for inverse in steps.tolist():
        sent, pause, values = now.t, _WAIT if levels else _TRAVEL + _WAIT, list[float]()
        now = yield Request(focus=1 / inverse)
        while not passed(sent, now.t, pause):
            now = yield Request(frame=passed(sent, now.t, pause - 0.05))
        while True:
            if now.image is not None:
                values.append(_sharpness(lens, now.image, region))
            if len(values) == _FRAMES:
                break
            now = yield Request(frame=True)
        good = [value for value in values if not math.isnan(value)]
        levels.append(float(np.mean(good)) if good else math.nan)
    return now, np.array(levels)


def _steps(middle: float, spread: float) -> FloatArray:
    """Return (tries,) inverse distances about a middle one, nearest first."""
    ends = np.clip([middle * (1 - spread), middle * (1 + spread)], 1 / _FARTHEST, 1 / _NEAREST)
    return np.linspace(ends[1], ends[0], _TRIES)


def _sharpness(lens: Pinhole, image: Image, pixel: FloatArray) -> float:
    """Return the sharpness of the region, NaN if the frame is not usable."""
    good = frame_checks.check_frame(image, lens) == frame_checks.GOOD
    return sharpness(image, pixel) if good else math.nan


@dataclass(frozen=True, eq=False)
class FocusPeak:
    """The peak of a focus sweep."""

    distance: float
    """Focus distance at the peak, in metres."""
    curve: FloatArray
    """Shape (N, 2). Distances in metres, nearest first, and the sharpness of the region there."""
    verdict: str
    """``sharp``, ``nothing to focus on``, ``at the end`` of the sweep, or ``no frames`` if too few
    could be used; without a peak, the distance is the guess."""


def sharpness(image: Any, pixel: npt.ArrayLike, *, size: int = 96) -> float:
    """Return the mean squared slope of the logarithm about a pixel; NaN if too dark.

    ``pixel`` (2,): column and row of the centre of the region. ``size``: side of the region in
    pixels; parts outside of the image are left out.

    Notes
    -----
    Slopes are differences, over two pixels, of means over three, which suppresses noise. A slope
    with a saturated pixel in its means is left out: it is steep at any focus. Tenenbaum, 1970. Each
    slope is relative to the local brightness: the nearer part of a slanted wall is brighter, and
    would put the peak 7 % before the pixel.
    """
    u, v = np.asarray(pixel, dtype=np.float64)
    if not (isinstance(image, np.ndarray) and image.ndim == 2 and math.isfinite(u + v)):
        return math.nan
    half = size // 2
    top, left = max(round(v) - half, 0), max(round(u) - half, 0)
    part = image[top : max(round(v) + half, 0), left : max(round(u) + half, 0)].astype(np.float64)
    if min(part.shape) < 8:
        return math.nan
    smooth = _means(part)
    down = smooth[2:, 1:-1] - smooth[:-2, 1:-1]
    across = smooth[1:-1, 2:] - smooth[1:-1, :-2]
    dull = _means(_means(part == 255)) == 0
    level = float(part.mean())
    if level < 2 or dull.mean() < 0.25:
        return math.nan
    here = 2 * (smooth[1:-1, 1:-1] + _DARK)
    return float(((down**2 + across**2) / here**2)[dull].mean())


def peak_of(curve: FloatArray, guess: float, least: int) -> FocusPeak:
    """Find the peak of a sweep: that of a parabola through the top of the curve.

    ``curve`` (N, 2): distances in metres, nearest first, and sharpness; NaN where unknown.
    ``guess``: distance without a peak, in metres. ``least``: least number of known values.
    """
    known = curve[np.isfinite(curve[:, 1])]
    if len(known) < least:
        return FocusPeak(guess, curve, _NO_FRAMES)
    inverse, sharp = 1 / known[:, 0], known[:, 1]
    if not _curved(inverse, np.log(sharp)):
        return FocusPeak(guess, curve, FLAT)
    best = int(sharp.argmax())
    first = int(np.clip(best - 2, 0, len(sharp) - 5))
    upper = np.flatnonzero(sharp > _NEAR_TOP * sharp[best])
    near = slice(min(first, int(upper[0])), max(first + 5, int(upper[-1]) + 1))
    a, b, _ = np.polyfit(inverse[near] - inverse[best], np.log(sharp[near]), 2)
    top = inverse[best] - b / (2 * a) if a < 0 else inverse[best]
    top = float(np.clip(top, inverse.min(), inverse.max()))
    return FocusPeak(1 / top, curve, _SHARP if 0 < best < len(sharp) - 1 else _AT_THE_END)


def _curved(inverse: FloatArray, level: FloatArray) -> bool:
    """Return whether a curve bends by more than it scatters."""
    fitted = np.polyval(np.polyfit(inverse - inverse.mean(), level, 2), inverse - inverse.mean())
    return bool(np.ptp(fitted) > _LEAST_GAIN + _SCATTERS * np.std(level - fitted))


def _means(part: npt.NDArray[Any]) -> FloatArray:
    """Return means over three rows and three columns."""
    rows = part[:-2] + part[1:-1].astype(np.float64) + part[2:]
    means: FloatArray = (rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]) / 9
    return means
