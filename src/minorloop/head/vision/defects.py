"""Find holes on the wall of a pipe whatever the light.

An acquisition is five frames: each LED alone, none, and all. On the map of the wall the edge of
a hole stays where it is under every light, reflections and shadows do not, and light from behind
is there without any::

    looks = acquire(camera, (pan, tilt), gain=2.0)
    findings = find_holes(looks, eye)
    print(findings)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray, check_option
from minorloop.errors import ParameterError
from minorloop.head.vision import frame_checks
from minorloop.head.vision._evidence import THRESHOLDS, WEIGHTS
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.candidates import FEATURES, Candidate, candidates
from minorloop.head.vision.reflectance_map import LitFrame, ReflectanceMap, judge_looks, lay_flat

SWITCHED, SINGLE, DITHER = "switched", "single", "dither"
MODES = (SWITCHED, SINGLE, DITHER)
"""Ways to acquire: LEDs one by one with one frame in the dark; one frame; several frames with all
LEDs and the head turned a little between them."""

SEQUENCE = (
    (True, False, False),
    (False, True, False),
    (False, False, True),
    (False, False, False),
    (True, True, True),
)
"""Lights of the frames of an acquisition."""

LEAST_EVIDENCE = dict(THRESHOLDS)
"""Evidence at which something counts as a hole, for each way to acquire."""

ALONE = 1.5
"""Exposure of a frame without all lights, relative to one with all."""

NOT_IN_VIEW = "no wall in view"
_APART = 0.8e-3


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole, or a round pit, as it looks from inside.

    Parameters
    ----------
    place : (2,) array
        phi in radians and z in metres of its middle, by the pose that the eye knows.
    diameter : float
        In metres.
    evidence : float
        Logarithm of the odds that it is one, among round things on the wall.
    kind : str
        How it was found: ``dark``, ``bright``, ``either`` or ``lit`` from behind.
    rim : (N, 2) array
        phi and z of points of its outline.
    """

    place: FloatArray
    diameter: float
    evidence: float
    kind: str
    rim: FloatArray

    def __repr__(self) -> str:
        phi, z = self.place
        return (
            f"hole at phi {math.degrees(phi):+.2f} deg, z {1e3 * z:.2f} mm, "
            f"diameter {1e3 * self.diameter:.2f} mm, evidence {self.evidence:+.1f} ({self.kind})"
        )


@dataclass(frozen=True, eq=False)
class Findings:
    """What was found in an acquisition.

    Parameters
    ----------
    holes : tuple of Hole
        Strongest first.
    verdict : str
        ``good``, ``no wall in view``, or what is wrong with a frame: ``black``, ``saturated``,
        ``no picture``, ``frozen``, ``torn``, ``wrong size``, ``angle unknown``. ``torn`` is also
        an acquisition in which rows of one frame are those of another, though another light was
        on; ``frozen`` one in which all are.
    wall : ReflectanceMap, optional
        The map on which they were found; None where the verdict is not ``good``.
    """

    holes: tuple[Hole, ...]
    verdict: str
    wall: ReflectanceMap | None = None

    def __repr__(self) -> str:
        count = len(self.holes)
        head = f"{count or 'no'} hole{'' if count == 1 else 's'}; frames {self.verdict}"
        return "\n".join([head, *(f"  {hole}" for hole in self.holes)])


def find_holes(
    looks: Sequence[LitFrame],
    eye: CalibratedCamera,
    *,
    mode: str = SWITCHED,
    least: float | None = None,
) -> Findings:
    """Find round holes of 0.85 to 1.15 mm; nothing is raised for frames that are bad.

    Parameters
    ----------
    looks : sequence of LitFrame
        An acquisition, such as `minorloop.head.procedures.extract.acquire` gives.
    eye : CalibratedCamera
        The camera.
    mode : {"switched", "single", "dither"}
        How the frames were taken; the weights of the evidence depend on it.
    least : float, optional
        Least evidence; without it, ``LEAST_EVIDENCE`` of the mode, which gave few false findings
        an acquisition on the scenes that the weights were fitted on.

    Raises
    ------
    ParameterError
        If the mode is unknown, there are no frames, the least evidence is no number, or a look
        does not say of each light whether it was on.
    """
    check_option("mode", mode, MODES)
    if not looks:
        raise ParameterError("there are no frames; give at least one")
    threshold = LEAST_EVIDENCE[mode] if least is None else least
    if math.isnan(threshold):
        raise ParameterError("the least evidence is nan; give a number, or none for the usual one")
    verdict = judge_looks(looks, eye)
    if verdict != frame_checks.GOOD:
        return Findings((), verdict)
    wall = lay_flat(looks, eye)
    if wall is None:
        return Findings((), NOT_IN_VIEW)
    holes = [_hole(candidate, wall, eye, mode) for candidate in candidates(wall)]
    return Findings(strongest(holes, eye.radius, threshold), verdict, wall)


def evidence(candidate: Candidate, mode: str = SWITCHED) -> float:
    """Logarithm of the odds that a candidate is a hole: weights times features, and a constant."""
    constant, weights = WEIGHTS[mode][candidate.kind]
    values = dict(zip(FEATURES, candidate.features.tolist(), strict=True))
    return float(constant + sum(weight * values[name] for name, weight in weights.items()))


def strongest(holes: Sequence[Hole], radius: float, least: float) -> tuple[Hole, ...]:
    """Those with enough evidence, without those beside a stronger one, strongest first."""
    kept: list[Hole] = []
    for hole in sorted(holes, key=lambda hole: -hole.evidence):
        off = [hole.place - other.place for other in kept]
        if hole.evidence >= least and all(np.hypot(radius * a, b) > _APART for a, b in off):
            kept.append(hole)
    return tuple(kept)


def _hole(candidate: Candidate, wall: ReflectanceMap, eye: CalibratedCamera, mode: str) -> Hole:
    place = wall.window.place(candidate.x, candidate.y, eye.radius)
    x, y = candidate.outline(wall.window.step).T
    rim = wall.window.place(x, y, eye.radius)
    return Hole(place, float(candidate.diameter), evidence(candidate, mode), candidate.kind, rim)
