"""A mark is set beside a hole with the micro-tool, and compared with the truth.

Before that the tool sets a test mark on the other side of the hole, and its calibration is
corrected by where the picture shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import Mount, wall_distance, wrapped
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.mark import TOUCHED, Marking
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.steps import bring_in_reach
from minorloop_head.procedures.values import Request
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.pipe import Bore, Pipe
from minorloop_head.twins.rig import Rig, SimulatedTip
from papers.catheter import scoring
from papers.catheter.inspection_servo import within_stroke

WITHIN = 0.3e-3
"""Distance in metres from where it was wanted within which a touch counts, as the issue bounds it:
less than a third of the hole that is marked."""
TOUCHES = 3
BESIDE = 1.2e-3
"""Distance in metres of a mark from the middle of the hole, in which there is no wall to mark."""
OFF_PLACE = 0.1e-3
"""Standard deviation of the place of the hole as it is known before, in metres."""
AWAY = (19.0, 26.0)
"""Deflection at which the tool meets the place, in degrees."""
_DARKER = 0.8
"""Share of the grey level around it below which a mark is seen: four times the noise."""
_TICK = 0.04


@dataclass(frozen=True, eq=False)
class Touch:
    """One touch."""

    verdict: str
    """Of the procedure."""
    off: float
    """Distance of the mark from where it was wanted, in metres; infinite without a mark."""
    said: float
    """Distance between the mark and where the procedure says that it touched, in metres."""
    before: npt.NDArray[np.uint8]
    after: npt.NDArray[np.uint8]
    """Shape (height, width). Pictures before and after the touch."""
    pixel: FloatArray
    """Shape (2,). True pixel of the mark in the picture after it."""
    seen: float
    """Grey level of the mark over that of the wall around it; NaN if it is not in view."""


def run_touch(seed: int, number: int, control: HeadControl) -> Touch:
    """Set a mark beside a hole.

    Parameters
    ----------
    seed : int
        Of the head, which ``control`` was identified from.
    number : int
        Of the touch; it draws pipe, hole and place of the mark.
    control : HeadControl
    """
    rng = np.random.default_rng([seed, 62, number])
    x, y = rng.uniform(-0.2e-3, 0.2e-3, 2).tolist()
    mount = Mount(offset=(x, y), roll=float(rng.uniform(-np.pi, np.pi)))
    aim, _ = within_stroke(control, rng, AWAY)
    tip = SimulatedTip(Pipe.draw(seed), mount=mount, specimen=seed, seed=seed + number)
    pan, tilt = aim.tolist()
    phi, z, _ = scoring.true_tool(tip).meet(mount, pan, tilt, tip.pipe.radius)
    way, radius = float(rng.uniform(0, 2 * np.pi)), tip.pipe.radius
    beside = BESIDE * np.array([math.cos(way), math.sin(way)])
    hole = Bore(float(phi - beside[0] / radius), float(z - beside[1]), 1e-3)
    pipe = replace(tip.pipe, bores=(hole,))
    tip.pipe = tip.tool.pipe = pipe
    tip.camera.repaint(pipe)
    plant = Rig(Head(seed, 0.05, seed, delay=_TICK), Catheter(seed))
    known = (x + float(rng.normal(0, 0.05e-3)), y + float(rng.normal(0, 0.05e-3)))
    calibration = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=known,
        roll=mount.roll,
        tool=tip.tool.calibration,
    )
    rig = InspectionRig(plant, tip, control, calibration)
    place = np.array([hole.phi, hole.z]) + OFF_PLACE * rng.standard_normal(2) / (radius, 1.0)
    test = Marking(calibration=calibration)
    metres = np.array([radius, 1.0])
    bring_in_reach(rig, test, place - beside / metres)
    tried = rig.run(test, test.begin(place, rig.gain, -beside))
    tip.tool.marks.clear()
    marking = Marking(calibration=replace(calibration, tool=tried.tool or calibration.tool))
    bring_in_reach(rig, marking, place + beside / metres)
    pictures: list[npt.NDArray[np.uint8]] = []

    def watch(state: Any) -> None:
        if state.stage == "near" and not pictures:
            pictures.append(tip.frame().image)

    state = rig.run(marking, marking.begin(place, rig.gain, beside), watch)
    after = rig.reading(Request(frame=True)).image
    assert after is not None
    return _scored(rig, tip, hole, beside, state, [*pictures, after])


def _scored(
    rig: InspectionRig,
    tip: SimulatedTip,
    hole: Bore,
    beside: FloatArray,
    state: Any,
    pictures: Sequence[npt.NDArray[np.uint8]],
) -> Touch:
    """Compare with the truth."""
    radius = tip.pipe.radius
    metres = np.array([radius, 1.0])
    wanted = np.array([hole.phi, hole.z]) + beside / metres
    off = said = math.inf
    pixel, seen = np.full(2, np.nan), math.nan
    if tip.tool.marks:
        mark = np.array(tip.tool.marks[-1])
        off = float(wall_distance(mark, wanted, radius))
        pixel = scoring.true_pixel(tip.camera, *mark)
        seen = _contrast(pictures[-1], pixel)
        if state.touch is not None:
            told = (state.touch - state.place) * metres
            true = np.array([radius * float(wrapped(mark[0] - hole.phi)), mark[1] - hole.z])
            said = float(np.hypot(*(told - true)))
    return Touch(state.verdict, off, said, pictures[0], pictures[-1], pixel, seen)


def _contrast(image: npt.NDArray[np.uint8], pixel: FloatArray) -> float:
    """Return the grey level at a pixel over that of the wall around it."""
    u, v = (round(float(each)) for each in pixel)
    if not (20 <= u < image.shape[1] - 20 and 20 <= v < image.shape[0] - 20):
        return math.nan
    part = image[v - 16 : v + 17, u - 16 : u + 17].astype(np.float64)
    ring = np.median(np.concatenate([part[:2].ravel(), part[-2:].ravel()]))
    return float(part[15:18, 15:18].mean() / max(ring, 1.0))


def touch_figures(touches: Sequence[Touch]) -> dict[str, Any]:
    """Return the figures of touches; one that did not come to pass is not within the bound."""
    off = np.array([touch.off for touch in touches])
    said = [touch.said for touch in touches]
    made = off[np.isfinite(off)]
    return {
        "touch_mm_p90": 1e3 * float(np.quantile(off, 0.9, method="higher")),
        "touch_mm_median": 1e3 * float(np.median(made)) if made.size else math.nan,
        "within_bound": float(np.mean(off <= WITHIN)),
        "refused": sum(touch.verdict != TOUCHED for touch in touches),
        "mark_seen": float(np.mean([touch.seen < _DARKER for touch in touches])),
        "said_mm_p90": 1e3 * float(np.quantile(said, 0.9, method="higher")),
    }
