"""How deep pits are by the console, beside the study's scans of the same scenes.

The console is there but for its processes: session, eyes, plant and tip in one loop, a scan that is
asked for as a page asks for it, and the fit of the worker. In the study a probe sways as the flow
of the water turns it; the console's plant has no such flow.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from benchmarks._timing import Row

FIRST, SCENES, CLOSE = 0, 20, 3.0
"""Seeds of the scenes, and how far in micrometres bias and deviation may be from the study's."""
_LONGEST = 4000  # ticks
_SMALL = 0.2  # of the picture, which nobody looks at


class Beside:
    """Eyes in the same process."""

    def __init__(self, eyes: Any) -> None:
        self.eyes, self._seen = eyes, []

    def look(self, look: Any) -> None:
        self._seen.append(self.eyes.tick(look))

    def seen(self) -> list[Any]:
        seen, self._seen = self._seen, []
        return seen


def rows(quick: bool = False) -> list[Row]:
    found = figures(range(FIRST, FIRST + (2 if quick else SCENES)))
    ours, theirs = found["console"], found["study"]
    off = [abs(ours[key] - theirs[key]) for key in ("bias_um", "sd_um")]
    words = "; ".join(
        f"{name}: bias {each['bias_um']:+.2f} um, deviation {each['sd_um']:.2f} um, "
        f"bands cover {each['coverage']:.0%}, {each['measured']} of {each['scans']} measured"
        for name, each in found.items()
    )
    return [
        Row(
            "depth of a pit by the console, the fit",
            ours["seconds"],
            required=f"bias and deviation within {CLOSE:g} um of the study's",
            met=max(off) <= CLOSE,
            accuracy=words,
        )
    ]


def figures(seeds: range) -> dict[str, dict[str, float]]:
    """Bias, deviation and coverage of the bands by console and study, on scenes by seed."""
    from minorloop.head.studies.scan_trials import band_figures, depth_figures, draw_sounding, sound

    scored = {
        "console": [console_depth(draw_sounding(seed), seed) for seed in seeds],
        "study": [sound(draw_sounding(seed)) for seed in seeds],
    }
    return {name: {**band_figures(runs), **depth_figures(runs)} for name, runs in scored.items()}


def console_depth(scene: Any, seed: int) -> Any:
    """A scan of one scene from a session, as the study scores it."""
    from minorloop.head.console import depth_work
    from minorloop.head.studies.scan_trials import ScoredScan
    from minorloop.head.ultrasound.pits import PitDepth

    job = scan_job(scene, seed)
    began = time.process_time()
    *_, last = depth_work.depth(**job)
    seconds = time.process_time() - began
    names = ("phi", "z", "diameter", "depth", "place_sd", "diameter_sd", "depth_sd")
    told = last["told"]
    values = {name: math.nan if told[name] is None else told[name] for name in names}
    pit = PitDepth(told["verdict"], **values, bursts=told["bursts"])
    return ScoredScan(scene.site, pit, seconds, None, "sonar")


def scan_job(scene: Any, seed: int) -> dict[str, Any]:
    """What a session hands to the worker after a scan of the scene."""
    from minorloop.head.console import messages
    from minorloop.head.console.perception import Perception
    from minorloop.head.console.plant import PlantView, head_of
    from minorloop.head.console.reports import camera_finding
    from minorloop.head.console.session import Session
    from minorloop.head.geometry import Mount
    from minorloop.head.twins.camera import LENS
    from minorloop.head.twins.catheter import Catheter
    from minorloop.head.twins.head import Head
    from minorloop.head.twins.rig import Rig, SimulatedTip

    tip = SimulatedTip(
        replace(scene.pipe, water=None),
        mount=Mount(offset=scene.mount.offset),
        specimen=seed,
        seed=seed,
        optics=LENS.scaled(_SMALL),
        flooded=scene.pipe,
        probe=scene.probe,
    )
    view = PlantView(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=scene.ear.mount.offset,
        thickness=scene.ear.thickness,
        temperature=scene.ear.temperature,
    )
    plant = Rig(Head(seed, 0.05, seed, delay=0.04), Catheter(seed, 0.02, seed))
    sight = Beside(Perception(tip, view))
    session = Session(plant, view, head_of("twin:pipe", seed), sight)
    # The study's mount is known badly, and what its camera saw is off by as much.
    place = [seen - off for seen, off in zip(scene.centre, scene.strayed, strict=True)]
    hole = {"phi": place[0], "z": place[1], "diameter": scene.diameter, "evidence": 1.0}
    session.findings.append(camera_finding(1, 0.0, hole, view.radius))
    for k in range(_LONGEST):
        now, order = 0.04 * k, {"seq": k, "t": 0.04 * k, "grant": 1}
        still = {"pose": (0.0, 0.0, 0.0, 1.0), "age": 0.0, "stick": (0.0, 0.0), "clutch": False}
        session.hear(messages.Drive(**still, **order), now)
        if k == 1:
            session.hear(messages.Mode(mode="HEAD", **order), now)
        if k == 50:
            session.hear(messages.Scan(finding=1, **order), now)
        session.tick(now)
        if sight.eyes.jobs:
            return sight.eyes.jobs[0]
    raise TimeoutError(f"the scan of scene {seed} did not end; its stage is {session.scan}")
