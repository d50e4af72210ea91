"""Depths of pits by the console and by the study, on the same scenes.

The console runs in one process: session, perception, plant and tip in one loop, a scan ordered as
by a page, and the fit of the worker. In the study the flow of the water moves the probe; the plant
of the console has no flow.
"""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

from benchmarks._timing import Row

FIRST, SCENES, CLOSE = 0, 20, 3.0
"""First seed and number of scenes; largest difference of bias and deviation in micrometres."""
_LONGEST = 4000  # ticks
_SMALL = 0.5  # scale of the pictures, which give the pose of each burst


class DirectCamera:
    """A camera in the same process."""

    def __init__(self, perception: Any) -> None:
        self.perception, self._reports, self.problem = perception, [], ""

    def send(self, request: Any) -> None:
        self._reports.append(self.perception.tick(request))

    def reports(self) -> list[Any]:
        reports, self._reports = self._reports, []
        return reports


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
    from papers.catheter.scan_trials import band_figures, depth_figures, draw_trial, run_trial

    scored = {
        "console": [console_depth(draw_trial(seed), seed) for seed in seeds],
        "study": [run_trial(draw_trial(seed)) for seed in seeds],
    }
    return {name: {**band_figures(runs), **depth_figures(runs)} for name, runs in scored.items()}


def console_depth(scene: Any, seed: int) -> Any:
    """Scan one scene with a session; return what the study scores."""
    from minorloop_head.console import depth_work
    from minorloop_head.ultrasound.pits import PitDepth
    from papers.catheter.scan_trials import ScoredScan

    job = scan_job(scene, seed)
    began = time.process_time()
    *_, last = depth_work.depth(**job)
    seconds = time.process_time() - began
    names = ("phi", "z", "diameter", "depth", "place_sd", "diameter_sd", "depth_sd")
    result = last["result"]
    values = {name: math.nan if result[name] is None else result[name] for name in names}
    pit = PitDepth(result["verdict"], **values, bursts=result["bursts"])
    return ScoredScan(scene.site, pit, seconds, None, "ultrasound")


def scan_job(scene: Any, seed: int) -> dict[str, Any]:
    """Scan one scene with a session; return its job for the worker."""
    from minorloop_head.console import messages
    from minorloop_head.console.identified_head import head_of
    from minorloop_head.console.perception import Perception
    from minorloop_head.console.reports import camera_finding
    from minorloop_head.console.session import Session
    from minorloop_head.geometry import Mount
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.twins.camera import LENS
    from minorloop_head.twins.catheter import Catheter
    from minorloop_head.twins.head import Head
    from minorloop_head.twins.pipe import Pipe
    from minorloop_head.twins.rig import Rig, SimulatedTip
    from minorloop_head.twins.surroundings import Filling, Sway

    water = Filling(level=scene.pipe.water, temperature=scene.temperature, sway=Sway())
    # The camera tracks texture. There are no dents, as in the scene for the echoes.
    wall = replace(scene.pipe, water=None, finish=Pipe.draw(seed).finish)
    plant = Rig(Head(seed, 0.05, seed, delay=0.04), Catheter(seed, 0.02, seed), flooded=water)
    tip = SimulatedTip(
        wall,
        mount=Mount(offset=scene.mount.offset),
        specimen=seed,
        seed=seed,
        optics=LENS.scaled(_SMALL),
        flooded=water,
        flow=plant.flood,
    )
    view = HeadCalibration(
        lens=tip.camera.calibration,
        leds=tip.camera.leds,
        offset=scene.probe.mount.offset,
        thickness=scene.probe.thickness,
        temperature=scene.probe.temperature,
    )
    camera = DirectCamera(Perception(tip, view))
    session = Session(plant, view, head_of("twin:pipe", seed), camera)
    # In the study the calibration of the mount has an error, which shifts the place by the camera.
    place = [seen - off for seen, off in zip(scene.centre, scene.site.strayed, strict=True)]
    hole = {"phi": place[0], "z": place[1], "diameter": scene.diameter, "evidence": 1.0}
    session.findings.append(camera_finding(1, 0.0, hole, view.radius))
    for k in range(_LONGEST):
        now, order = 0.04 * k, {"seq": k, "t": 0.04 * k, "grant": 1}
        still = {"pose": (0.0, 0.0, 0.0, 1.0), "age": 0.0, "stick": (0.0, 0.0), "clutch": False}
        session.receive(messages.Drive(**still, **order), now)
        if k == 1:
            session.receive(messages.SetMode(mode="HEAD", **order), now)
        if k == 50:
            session.receive(messages.Scan(finding=1, **order), now)
        session.tick(now)
        if camera.perception.jobs:
            return camera.perception.jobs[0]
    raise TimeoutError(f"the scan of scene {seed} did not end; its stage is {session.scan}")
