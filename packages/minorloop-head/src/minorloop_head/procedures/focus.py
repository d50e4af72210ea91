"""Sweep the focus about a guess and set it where a region of the image is sharpest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.values import Procedure, Reading, Request, passed
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.focus import FLAT, FocusPeak, peak_of, sharpness

LEAST_TRIES = 5
"""Number of usable frames that a peak needs at least."""
_WIDEST = 0.8
"""Most relative width of the sweep that follows one without a peak."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FocusState:
    """State of a sweep.

    ``pixel`` (2,) is the middle of the region, ``guess`` a distance in metres, ``steps`` (N,) the
    inverse distances in 1/m, ``curve`` the sharpness at those that were tried. The focus was set
    to the next one at ``sent``; ``values`` are the sharpness of its frames. ``sweep`` counts
    from 0.
    """

    pixel: FloatArray
    guess: float
    steps: FloatArray
    curve: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    sent: float | None = None
    sweep: int = 0
    found: FocusPeak | None = None
    done: bool = False


@dataclass(frozen=True, kw_only=True)
class Focusing(Procedure[FocusState]):
    """A sweep of the focus.

    Parameters
    ----------
    lens : Pinhole
        Its size is that of a frame.
    spread : float
        Relative width of the sweep on either side of the guess; further sweeps follow where the
        best is at an end, and one of twice the width where nothing has a peak. The guess is that of
        the calibrated wall, right within some percent.
    tries : int
        Steps of a sweep, even in the inverse of the distance.
    wait, travel : float
        Seconds for which the lens moves to a step, and in addition to the first one.
    frames : int
        Frames at each step.
    sweeps : int
        Most sweeps, each about the best of the one before.
    nearest, farthest : float
        Limits of the focus, in metres.
    """

    lens: Pinhole
    spread: float = 0.3
    tries: int = 9
    wait: float = 0.12
    travel: float = 0.32
    frames: int = 2
    sweeps: int = 3
    nearest: float = 4e-3
    farthest: float = 60e-3

    def begin(self, pixel: npt.ArrayLike, guess: float) -> FocusState:
        """Return the state of a camera that focuses on a pixel (2,) at about a distance in metres.

        Raises
        ------
        ParameterError
            If the guess is not within the limits.
        """
        if not self.nearest <= guess <= self.farthest:
            raise ParameterError(
                f"the guess {guess} m is not within the focus of the camera, "
                f"[{self.nearest:g}, {self.farthest:g}] m"
            )
        region = np.asarray(pixel, dtype=np.float64)
        return FocusState(pixel=region, guess=guess, steps=self._steps(1 / guess, self.spread))

    def _next(self, state: FocusState, reading: Reading) -> tuple[FocusState, Request]:
        if state.sent is None:
            distance = 1 / float(state.steps[len(state.curve)])
            return replace(state, sent=reading.t), Request(
                focus=distance, frame=self._wait_of(state) == 0
            )
        if not passed(state.sent, reading.t, self._wait_of(state)):
            soon = passed(state.sent, reading.t, self._wait_of(state) - 0.05)
            return state, Request(frame=soon)
        if reading.image is None:
            return state, Request(frame=True)
        values = (*state.values, self._sharpness(reading.image, state.pixel))
        if len(values) < self.frames:
            return replace(state, values=values), Request(frame=True)
        good = [value for value in values if not math.isnan(value)]
        level = float(np.mean(good)) if good else math.nan
        state = replace(state, values=(), sent=None, curve=(*state.curve, level))
        if len(state.curve) < self.tries:
            return self._next(state, replace(reading, image=None))
        return self._swept(state, reading)

    def _swept(self, state: FocusState, reading: Reading) -> tuple[FocusState, Request]:
        """Set the focus to the peak of a sweep, or begin another sweep about its best step."""
        levels = np.array(state.curve)
        curve = np.stack([1 / state.steps, levels], axis=1)
        if np.isfinite(levels).sum() >= LEAST_TRIES:
            best = int(np.nanargmax(levels))
            inside = 0 < best < self.tries - 1
            at_limit = state.steps[best] in (1 / self.farthest, 1 / self.nearest)
            if not inside and not at_limit and state.sweep + 1 < self.sweeps:
                steps = self._steps(float(state.steps[best]), self.spread)
                again = replace(state, steps=steps, curve=(), sweep=state.sweep + 1)
                return self._next(again, replace(reading, image=None))
        found = peak_of(curve, state.guess, LEAST_TRIES)
        if found.verdict == FLAT and state.sweep + 1 < self.sweeps:
            # A far wall is sharp over most of a sweep. A wider one is the last.
            steps = self._steps(1 / state.guess, min(2 * self.spread, _WIDEST))
            again = replace(state, steps=steps, curve=(), sweep=self.sweeps - 1)
            return self._next(again, replace(reading, image=None))
        return replace(state, found=found, done=True), Request(focus=found.distance)

    def _steps(self, middle: float, spread: float) -> FloatArray:
        """Return (tries,) inverse distances about one, nearest first."""
        low, high = 1 / self.farthest, 1 / self.nearest
        ends = np.clip([middle * (1 - spread), middle * (1 + spread)], low, high)
        return np.linspace(ends[1], ends[0], self.tries)

    def _wait_of(self, state: FocusState) -> float:
        return self.wait if state.curve else self.travel + self.wait

    def _sharpness(self, image: Image, pixel: FloatArray) -> float:
        """Return the sharpness of the region, NaN if the frame is not usable."""
        good = frame_checks.check_frame(image, self.lens) == frame_checks.GOOD
        return sharpness(image, pixel) if good else math.nan
