"""How well holes are found, on scenes that the weights of the evidence were not fitted on.

Each seed gives a scene with a hole and one without, beside saturated glints. A finding within
0.3 mm of the hole is it; one farther than 0.8 mm off, or where there is no hole, is false. Places
are compared on the map of the eye, which knows the pivot to 0.2 mm and the angles to 0.05
degrees, so that the pose is not scored again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.geometry import wrapped
from minorloop.twins.view import View, draw_view
from minorloop.vision.defects import ALONE, DITHER, SEQUENCE, SINGLE, SWITCHED, find_holes
from minorloop.vision.eye import Eye
from minorloop.vision.wallmap import Look

PIVOT, ANGLE, TURN = 0.2e-3, math.radians(0.05), math.radians(2.0)
NEAR, FAR, RADIUS = 0.3e-3, 0.8e-3, 10e-3
SIZE = 0.15


@dataclass(frozen=True)
class Outcome:
    """What was found in one scene by one way to acquire.

    ``hole`` whether there was one; ``found`` whether it was found, ``off`` how far off in m and
    ``size`` its relative error of diameter; ``false`` how many findings were none.
    """

    mode: str
    hole: bool
    found: bool
    off: float
    size: float
    false: int


def score_scene(
    seed: int, hole: bool, modes: Sequence[str] = (SWITCHED, SINGLE, DITHER)
) -> list[Outcome]:
    """Photograph and search one scene by every mode."""
    view, rng = draw_view(seed, hole=hole), np.random.default_rng([seed, int(hole), 7])
    way = rng.uniform(0, 2 * np.pi)
    off = np.array(view.mount.offset) + PIVOT * np.array([np.cos(way), np.sin(way)])
    mount = replace(view.mount, offset=(float(off[0]), float(off[1])))
    eye = Eye(view.camera.calibration, mount, view.camera.leds)
    truth = eye.place(view.camera._pixel(*view.place), view.pan, view.tilt)
    outcomes = []
    for mode in modes:
        near, false = None, 0
        for found in find_holes(_shots(view, rng, mode), eye, mode=mode).holes:
            apart = _apart(found.place, truth)
            if view.hole is not None and apart < NEAR:
                near = near or (apart, found.diameter / view.hole.diameter - 1)
            elif view.hole is None or apart > FAR:
                false += 1
        right = near or (math.nan, math.nan)
        outcomes.append(Outcome(mode, hole, near is not None, *right, false))
    return outcomes


def detection_figures(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Recall, false findings an acquisition, and how exact what was found is."""
    found: dict[str, Any] = {}
    for mode in (SWITCHED, SINGLE, DITHER):
        own = [each for each in outcomes if each.mode == mode]
        holes = [each for each in own if each.hole]
        if not holes:
            continue
        hits = [each for each in holes if each.found]
        false = sum(each.false for each in own) / len(own)
        recall = len(hits) / len(holes)
        if mode != SWITCHED:
            found[f"{mode}_recall"], found[f"{mode}_false_per_acquisition"] = recall, false
            continue
        found |= {
            "recall": recall,
            "recall_interval": wilson(len(hits), len(holes)),
            "false_per_acquisition": false,
            "scenes": len(holes),
            "centre_mm_p90": 1e3 * float(np.quantile([h.off for h in hits], 0.9)) if hits else 1e9,
            "size_within_15pct": float(np.mean([abs(h.size) < SIZE for h in hits]))
            if hits
            else 0.0,
        }
    return found


def wilson(hits: int, count: int) -> tuple[float, float]:
    """95 % interval of a share (Wilson, JASA 22, 1927)."""
    z, p = 1.959964, hits / count
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(p * (1 - p) / count + z * z / (4 * count**2))
    return middle - half, middle + half


def _shots(view: View, rng: np.random.Generator, mode: str) -> list[Look]:
    """An acquisition of a view."""
    turns: FloatArray = np.zeros((len(SEQUENCE), 2))
    lights: Sequence[tuple[bool, ...]] = SEQUENCE
    if mode == SINGLE:
        lights, turns = SEQUENCE[-1:], turns[:1]
    elif mode == DITHER:
        lights = (SEQUENCE[-1],) * 5
        turns = TURN * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)], dtype=np.float64)
    looks = []
    for on, turn in zip(lights, turns, strict=True):
        pan, tilt = view.pan + float(turn[0]), view.tilt + float(turn[1])
        view.camera.look(pan, tilt)
        view.camera.switch(on)
        view.camera.expose(0.01 if all(on) else 0.01 * ALONE, view.gain)
        seen = np.array([pan, tilt]) + ANGLE * rng.standard_normal(2)
        looks.append(Look(view.camera.frame().image, float(seen[0]), float(seen[1]), tuple(on)))
    return looks


def _apart(place: FloatArray, truth: FloatArray) -> float:
    around = RADIUS * float(wrapped(place[0] - truth[0]))
    return float(np.hypot(around, place[1] - truth[1]))
