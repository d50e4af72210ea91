"""Pictures of rendered scenes, with what was found and where the hole is."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from benchmarks.judge.scenes import Scene
from benchmarks.judge.score import Trial, tried
from minorloop_head.vision.defects import LEAST_EVIDENCE, SWITCHED, Hole

_HALF, _SCALE = 70, 3
"""Half of the side of a detail in pixels of the frame, and its enlargement."""
_GREEN, _RED = (80, 255, 80), (80, 80, 255)


def draw_pictures(pairs: Iterable[tuple[Scene, np.ndarray]], folder: Path) -> None:
    """Write the first acquisitions whole, and details of each miss and each false finding."""
    folder.mkdir(parents=True, exist_ok=True)
    whole: list[np.ndarray] = []
    least = LEAST_EVIDENCE[SWITCHED]
    for scene, radiance in pairs:
        trial = tried(scene, radiance)
        name = f"{scene.seed}-{scene.kind}-{scene.metal}"
        if len(whole) < 24:
            whole.append(_frame(trial, least))
        if scene.hole is not None and (trial.right is None or trial.right.evidence < least):
            about = trial.camera.pixel(trial.truth, trial.frames[0].pan, trial.frames[0].tilt)
            cv2.imwrite(str(folder / f"miss-{name}-{scene.hole.inside}.png"), _detail(trial, about))
        for n, hole in enumerate(h for h in trial.wrong if h.evidence >= least):
            about = trial.camera.pixel(hole.place, trial.frames[0].pan, trial.frames[0].tilt)
            which = "hole" if scene.hole is not None else "none"
            detail = _detail(trial, about, hole)
            cv2.imwrite(str(folder / f"false-{name}-{which}-{n}-{hole.kind}.png"), detail)
    for n in range(0, len(whole), 8):
        rows = [np.hstack(whole[k : k + 4]) for k in range(n, min(n + 8, len(whole)), 4)]
        rows = [row for row in rows if row.shape == rows[0].shape]
        cv2.imwrite(str(folder / f"whole-{n}.png"), np.vstack(rows))


def _frame(trial: Trial, least: float) -> np.ndarray:
    image = cv2.cvtColor(trial.frames[-1].image, cv2.COLOR_GRAY2BGR)
    for hole in trial.holes:
        if hole.evidence >= least:
            rim = trial.camera.pixel(hole.rim, trial.frames[0].pan, trial.frames[0].tilt)
            good = trial.scene.hole is not None and trial.off(hole) < 0.3e-3
            colour = _GREEN if good else _RED
            cv2.polylines(image, [np.rint(rim).astype(np.int32)], True, colour, 1)
    return image


def _detail(trial: Trial, about: np.ndarray, hole: Hole | None = None) -> np.ndarray:
    """Return the frames about a pixel, side by side, the last one with the outline."""
    height, width = trial.frames[0].image.shape
    x = int(np.clip(about[0], _HALF, width - _HALF))
    y = int(np.clip(about[1], _HALF, height - _HALF))
    parts = []
    for frame in trial.frames:
        part = frame.image[y - _HALF : y + _HALF, x - _HALF : x + _HALF].astype(np.float64)
        # The logarithm shows dark and bright parts alike.
        part = 255 * np.log((part + 4) / 4) / np.log(259 / 4)
        part = cv2.resize(part.astype(np.uint8), None, fx=_SCALE, fy=_SCALE)
        parts.append(cv2.cvtColor(part, cv2.COLOR_GRAY2BGR))
    shown = hole or trial.right
    if shown is not None:
        rim = trial.camera.pixel(shown.rim, trial.frames[0].pan, trial.frames[0].tilt)
        rim = _SCALE * (rim - [x - _HALF, y - _HALF])
        colour = _RED if hole is not None else _GREEN
        cv2.polylines(parts[-1], [np.rint(rim).astype(np.int32)], True, colour, 1)
        words = f"{shown.kind} {shown.evidence:+.1f} {1e3 * shown.diameter:.2f} mm"
        cv2.putText(parts[-1], words, (5, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour)
    return np.hstack(parts)
