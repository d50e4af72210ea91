"""Find holes in the wall of a pipe under any light.

An acquisition is five frames: each LED alone, none, and all. On the map of the wall, the edge of
a hole is fixed under every light, while reflections and shadows move; light from behind also
shows without LEDs::

    findings = find_holes(frames, camera)
    print(findings)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from minorloop.arrays import FloatArray, check_option
from minorloop.errors import ParameterError
from minorloop.head.geometry import wall_distance
from minorloop.head.vision import frame_checks
from minorloop.head.vision._evidence import THRESHOLDS, WEIGHTS
from minorloop.head.vision.calibrated_camera import CalibratedCamera
from minorloop.head.vision.candidates import FEATURES, Candidate, candidates
from minorloop.head.vision.reflectance_map import LitFrame, ReflectanceMap, check_frames, lay_flat

SWITCHED, SINGLE, DITHER = "switched", "single", "dither"
MODES = (SWITCHED, SINGLE, DITHER)
"""Acquisition modes: LEDs one by one and a dark frame; a single frame; several frames with all LEDs
and small turns of the head between them."""

SEQUENCE = (
    (True, False, False),
    (False, True, False),
    (False, False, True),
    (False, False, False),
    (True, True, True),
)
"""Lights of the frames of an acquisition."""

LEAST_EVIDENCE = dict(THRESHOLDS)
"""Least evidence of a hole for each mode; ``_evidence`` has the false findings at these values."""

ALONE = 1.5
"""Exposure of a frame with one light or none, relative to one with all."""

NOT_IN_VIEW = "no wall in view"
_APART = 0.8e-3
"""Least distance of two holes in metres: a hole of 0.85 mm overlaps with any nearer."""


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole or round pit in an image.

    Parameters
    ----------
    place : (2,) array
        Phi in radians and z in metres of its centre, by the calibrated pose of the camera.
    diameter : float
        In metres.
    evidence : float
        Logarithm of the odds that it is a hole, among round objects on the wall.
    kind : str
        How it was found: ``dark``, ``bright``, ``either`` or ``lit`` from behind.
    rim : (N, 2) array
        Phi and z of points of its outline.
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
    """The result of an acquisition.

    Parameters
    ----------
    holes : tuple of Hole
        Strongest first.
    verdict : str
        ``good``, ``no wall in view``, or what is wrong with a frame: ``black``, ``saturated``,
        ``no picture``, ``frozen``, ``torn``, ``wrong size``, ``angle unknown``. An acquisition is
        ``torn`` too if some rows of a frame repeat another one that had other lights, and
        ``frozen`` if all do.
    wall : ReflectanceMap, optional
        The map of the wall; None if the verdict is not ``good``.
    """

    holes: tuple[Hole, ...]
    verdict: str
    wall: ReflectanceMap | None = None

    def __repr__(self) -> str:
        count = len(self.holes)
        head = f"{count or 'no'} hole{'' if count == 1 else 's'}; frames {self.verdict}"
        return "\n".join([head, *(f"  {hole}" for hole in self.holes)])


def find_holes(
    frames: Sequence[LitFrame],
    camera: CalibratedCamera,
    *,
    mode: str = SWITCHED,
    least: float | None = None,
) -> Findings:
    """Find round holes of 0.85 to 1.15 mm; bad frames give a verdict, not an error.

    Parameters
    ----------
    frames : sequence of LitFrame
        An acquisition, such as the one of `minorloop.head.procedures.extract`.
    camera : CalibratedCamera
        The camera.
    mode : {"switched", "single", "dither"}
        Acquisition mode, on which the weights of the evidence depend.
    least : float, optional
        Least evidence; without it, ``LEAST_EVIDENCE`` of the mode.

    Raises
    ------
    ParameterError
        If the mode is unknown, there are no frames, the least evidence is NaN, or a frame does not
        have one flag for each light.
    """
    check_option("mode", mode, MODES)
    if not frames:
        raise ParameterError("there are no frames; give at least one")
    threshold = LEAST_EVIDENCE[mode] if least is None else least
    if math.isnan(threshold):
        raise ParameterError("the least evidence is nan; give a number, or leave it out")
    verdict = check_frames(frames, camera)
    if verdict != frame_checks.GOOD:
        return Findings((), verdict)
    wall = lay_flat(frames, camera)
    if wall is None:
        return Findings((), NOT_IN_VIEW)
    holes = [_hole(candidate, wall, camera, mode) for candidate in candidates(wall)]
    return Findings(strongest(holes, camera.radius, threshold), verdict, wall)


def evidence(candidate: Candidate, mode: str = SWITCHED) -> float:
    """Return the logarithm of the odds that a candidate is a hole, linear in its features."""
    constant, weights = WEIGHTS[mode][candidate.kind]
    values = dict(zip(FEATURES, candidate.features.tolist(), strict=True))
    return float(constant + sum(weight * values[name] for name, weight in weights.items()))


def strongest(holes: Sequence[Hole], radius: float, least: float) -> tuple[Hole, ...]:
    """Return holes with enough evidence and not beside a stronger one, strongest first."""
    kept: list[Hole] = []
    for hole in sorted(holes, key=lambda hole: -hole.evidence):
        off = [float(wall_distance(hole.place, other.place, radius)) for other in kept]
        if hole.evidence >= least and all(apart > _APART for apart in off):
            kept.append(hole)
    return tuple(kept)


def _hole(candidate: Candidate, wall: ReflectanceMap, camera: CalibratedCamera, mode: str) -> Hole:
    place = wall.window.place(candidate.x, candidate.y, camera.radius)
    x, y = candidate.outline(wall.window.step).T
    rim = wall.window.place(x, y, camera.radius)
    return Hole(place, float(candidate.diameter), evidence(candidate, mode), candidate.kind, rim)
