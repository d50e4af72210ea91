"""Cost of a camera frame, of finding holes in an acquisition, and of tracking a patch.

Median processor time of one core over frames and acquisitions, without that of other programs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks._timing import Row, within

FIRST = 80_000
FRAME, FINDING, TRACKING = 8e-3, 0.1, 8e-3


def rows(quick: bool = False) -> list[Row]:
    from minorloop_head.vision.defects import LEAST_EVIDENCE, find_holes
    from minorloop_head.vision.tracking import TRACKED, PatchTracker
    from papers.catheter.detection import NEAR, search_scene

    rounds, frames, finding, tracking, found = 2 if quick else 8, [], [], [], 0
    searches = [search_scene(FIRST + n, True)[0] for n in range(rounds)]
    followed = []
    for search in searches:
        camera, calibrated = search.view.camera, search.camera
        aim = (search.view.pan, search.view.tilt)
        camera.look(*aim)
        frames += [_processor(camera.frame) for _ in range(4 * rounds)]
        find = partial(find_holes, search.frames, search.camera)
        finding.append(min(_processor(find) for _ in "123"))
        best = search.holes[0]
        found += best.evidence >= LEAST_EVIDENCE["switched"] and search.off(best) < NEAR
        tracker = PatchTracker(replace(calibrated))
        _, state = tracker.begin(camera.frame().image, calibrated.pixel(search.place, *aim), *aim)
        for _ in range(2 * rounds):
            image = camera.frame().image
            began = time.thread_time()
            track, state = tracker.step(state, image, *aim)
            tracking.append(time.thread_time() - began)
            followed.append(track.verdict == TRACKED)
    share = float(np.mean(followed))
    return [
        within("a frame of 640 by 480 pixels, three lights on", _middle(frames), FRAME, "", True),
        within(
            "finding holes in an acquisition of five frames",
            _middle(finding),
            FINDING,
            f"{found} of {rounds} holes found",
            found >= 0.9 * rounds,
        ),
        within(
            "following a piece of the wall through one frame",
            _middle(tracking),
            TRACKING,
            f"{share:.0%} of the frames tracked",
            share >= 0.99,
        ),
    ]


def _middle(times: list[float]) -> float:
    return float(np.median(times))


def _processor(work: Callable[[], object]) -> float:
    began = time.thread_time()
    work()
    return time.thread_time() - began
