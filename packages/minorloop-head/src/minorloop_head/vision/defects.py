"""Find holes in the wall of a pipe under any light.

An acquisition is five frames: each LED alone, none, and all. On the map of the wall, the edge of
a hole is fixed under every light, while reflections and shadows move; light from behind also
shows without LEDs::

    findings = find_holes(frames, camera)
    print(findings)
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from minorloop.arrays import FloatArray, check_option
from minorloop.errors import ParameterError
from minorloop_head.geometry import wall_distance
from minorloop_head.vision import frame_checks
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from minorloop_head.vision.candidates import DIAMETERS, FEATURES, Candidate, at_rim, candidates
from minorloop_head.vision.reflectance_map import (
    LitFrame,
    ReflectanceMap,
    aligned,
    check_frames,
    lay_flat,
)

SWITCHED, SINGLE, DITHER, SIZED = "switched", "single", "dither", "sizes"
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

_FITTED = json.loads(Path(__file__).with_name("hole_weights.json").read_text(encoding="utf-8"))
"""Weights as printed by ``python -m benchmarks.detector fit``; ``about`` describes their data."""
LEAST_EVIDENCE: dict[str, float] = _FITTED["least"]
"""Least evidence of a hole for each mode, and of several sizes."""
WEIGHTS: dict[str, dict[str, tuple[float, dict[str, float]]]] = _FITTED["weights"]
"""For each mode and kind of candidate a constant and the weights of its features."""

NOT_IN_VIEW = "no wall in view"
SIZES = (0.85e-3, 1.15e-3)
"""Default range of diameters, in metres: that of one map."""
LIMITS = (0.3, 4.0)
"""Range of diameters in millimetres: the smallest hole has 12 pixels only if the lens is nearer
than 13 mm; only a part of the views shows the largest hole whole."""
_OCTAVE = math.sqrt(2.0)
"""Largest ratio of the scales of neighbouring maps: the diameters of the next begin where those of
the first end, except for 4 %."""
_APART = 0.94
"""Least distance of two holes over the mean of their diameters: nearer ones overlap, allowing for
an error of 6 % of their sizes."""


@dataclass(frozen=True, eq=False)
class Hole:
    """A hole or round pit in an image."""

    place: FloatArray
    """Shape (2,). Phi in radians and z in metres of its centre, by the calibrated pose of the
    camera."""
    diameter: float
    """In metres."""
    evidence: float
    """Logarithm of the odds that it is a hole, among round objects on the wall."""
    kind: str
    """Kind of the candidate: ``dark``, ``bright``, ``either`` or ``lit`` from behind."""
    rim: FloatArray
    """Shape (N, 2). Phi and z of points of its outline."""

    def __repr__(self) -> str:
        phi, z = self.place
        return (
            f"hole at phi {math.degrees(phi):+.2f} deg, z {1e3 * z:.2f} mm, "
            f"diameter {1e3 * self.diameter:.2f} mm, evidence {self.evidence:+.1f} ({self.kind})"
        )


@dataclass(frozen=True, eq=False)
class Findings:
    """The result of an acquisition."""

    holes: tuple[Hole, ...]
    """Strongest first."""
    verdict: str
    """``good``, ``no wall in view``, or the fault of a frame: ``black``, ``saturated``, ``no
    picture``, ``frozen``, ``torn``, ``wrong size``, ``angle unknown``. An acquisition is ``torn``
    too if some rows of a frame repeat another one that had other lights, and ``frozen`` if all
    do."""
    wall: ReflectanceMap | None = None
    """The map of the wall; None if the verdict is not ``good``."""

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
    diameters: tuple[float, float] = SIZES,
) -> Findings:
    """Find round holes; bad frames give a verdict, not an error.

    Raises a `ParameterError` if the mode is unknown, there are no frames, the least evidence is
    NaN, the diameters are beyond the limits, or a frame does not have one flag for each light.

    Parameters
    ----------
    frames : sequence of LitFrame
        An acquisition, such as the one of `minorloop_head.procedures.meter`.
    camera : CalibratedCamera
        The camera.
    mode : {"switched", "single", "dither"}
        Acquisition mode, on which the weights of the evidence depend.
    least : float, optional
        Least evidence; without it, ``LEAST_EVIDENCE`` of the mode.
    diameters : (float, float)
        Least and largest diameter of the holes, in metres, from 0.3 to 4 mm. Each factor of 1.4
        takes as long as the search of one size.
    """
    check_option("mode", mode, MODES)
    if not frames:
        raise ParameterError("there are no frames; give at least one")
    steps = scales(diameters)
    if len(steps) > 1 and mode != SWITCHED:
        raise ParameterError(
            f"holes of several sizes cannot be searched in mode {mode!r}; give mode {SWITCHED!r}, "
            "or leave the diameters out"
        )
    mode = mode if len(steps) == 1 else SIZED
    threshold = LEAST_EVIDENCE[mode] if least is None else least
    if math.isnan(threshold):
        raise ParameterError("the least evidence is nan; give a number, or leave it out")
    verdict = check_frames(frames, camera)
    if verdict != frame_checks.GOOD:
        return Findings((), verdict)
    frames = aligned(frames, camera)
    walls = [wall for scale in steps if (wall := lay_flat(frames, camera, scale)) is not None]
    if not walls:
        return Findings((), NOT_IN_VIEW)
    seen = [(candidate, wall) for wall in walls for candidate in candidates(wall)]
    found = [_hole(candidate, wall, camera, mode) for candidate, wall in seen]
    best = strongest(found, camera.radius, threshold, diameters[0])
    source = {id(hole): pair for hole, pair in zip(found, seen, strict=True)}
    rims = [_hole(at_rim(*source[id(hole)]), source[id(hole)][1], camera, mode) for hole in best]
    # Two outlines may have one rim.
    return Findings(strongest(rims, camera.radius, threshold, diameters[0]), verdict, walls[0])


def scales(diameters: tuple[float, float]) -> list[float]:
    """Return the scales of the maps on which holes of a range of diameters, in metres, are found.

    Raises a `ParameterError` if the range is empty or beyond 0.3 to 4 mm.
    """
    low, high = (1e3 * float(value) for value in diameters)
    if not LIMITS[0] <= low <= high <= LIMITS[1]:
        raise ParameterError(
            f"holes of {low:g} to {high:g} mm cannot be searched; give diameters in metres, the "
            f"least first, from {LIMITS[0]:g}e-3 to {LIMITS[1]:g}e-3"
        )
    first, last = low / DIAMETERS[0], max(high / DIAMETERS[1], low / DIAMETERS[0])
    count = math.ceil(math.log(last / first) / math.log(_OCTAVE) - 1e-9) + 1
    return [first * (last / first) ** (n / max(count - 1, 1)) for n in range(count)]


def evidence(candidate: Candidate, mode: str = SWITCHED) -> float:
    """Return the logarithm of the odds that a candidate is a hole, linear in its features."""
    constant, weights = WEIGHTS[mode][candidate.kind]
    values = dict(zip(FEATURES, candidate.features.tolist(), strict=True))
    return float(constant + sum(weight * values[name] for name, weight in weights.items()))


def strongest(
    holes: Sequence[Hole], radius: float, least: float, smallest: float = SIZES[0]
) -> tuple[Hole, ...]:
    """Return holes with enough evidence and not beside a stronger one, strongest first.

    An outline smaller than ``smallest``, in metres, excludes neighbours like a hole of that size.
    """
    kept: list[Hole] = []
    for hole in sorted(holes, key=lambda hole: -hole.evidence):
        off = [float(wall_distance(hole.place, other.place, radius)) for other in kept]
        size = max(hole.diameter, smallest)
        clear = all(
            apart > _APART / 2 * (size + max(other.diameter, smallest))
            for apart, other in zip(off, kept, strict=True)
        )
        if hole.evidence >= least and clear:
            kept.append(hole)
    return tuple(kept)


def _hole(candidate: Candidate, wall: ReflectanceMap, camera: CalibratedCamera, mode: str) -> Hole:
    place = wall.window.place(candidate.x, candidate.y, camera.radius)
    x, y = candidate.outline(wall.window.step).T
    rim = wall.window.place(x, y, camera.radius)
    return Hole(place, float(candidate.diameter), evidence(candidate, mode), candidate.kind, rim)
