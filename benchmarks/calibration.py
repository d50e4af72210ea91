"""Errors of `minorloop head calibrate` on pictures of a target from the camera twin, seeds 0 to 19.

The time is that of one calibration, pictures in files to results. The largest error over the seeds
is printed, and in brackets the share of errors that are within two of the standard deviations that
the calibration states.
"""

from __future__ import annotations

import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

from benchmarks._timing import Row

FIRST, COUNT = 0, 20
FOCAL, CENTRE, MOUNT, LEVER, LED = 0.3, 1.0, 0.3, 0.2, 0.3
"""Largest errors: per cent, pixels, degrees, mm, mm."""


def rows(quick: bool = False) -> list[Row]:
    errors: dict[str, list[float]] = defaultdict(list)
    within: dict[str, list[bool]] = defaultdict(list)
    times = [
        _calibrate(seed, errors, within) for seed in range(FIRST, FIRST + (2 if quick else COUNT))
    ]
    middle, found = float(np.median(times)), []
    for what, most, unit in (
        ("focal length", FOCAL, "%"),
        ("principal point", CENTRE, "px"),
        ("mount", MOUNT, "degrees"),
        ("lever", LEVER, "mm"),
        ("LEDs, across", LED, "mm"),
    ):
        worst, honest = max(errors[what]), float(np.mean(within[what]))
        found.append(
            Row(
                f"calibration of a head: {what}",
                middle,
                required=f"<= {most:g} {unit}",
                met=worst <= most,
                accuracy=f"{worst:.2g} {unit} ({honest:.0%})",
            )
        )
    return found


def _calibrate(seed: int, errors: dict[str, list[float]], within: dict[str, list[bool]]) -> float:
    """Calibrate one head; return the processor time, and add to errors and uncertainties."""
    from benchmarks.target_pictures import CalibrationScene
    from minorloop_head.procedures import calibrate as steps
    from minorloop_head.procedures.target_pictures import led_folders, look_through
    from minorloop_head.vision.targets import Target

    target = Target("charuco", 9, 7, 3e-3)
    scene = CalibrationScene(target, seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene.lens(folder / "lens")
        scene.mount(folder / "mount")
        scene.leds(folder / "leds")
        began = time.process_time()
        lens = steps.calibrate_lens(look_through(folder / "lens", target))
        sd = lens.rms / 2**0.5
        mount = steps.calibrate_mount(
            look_through(folder / "mount", target), lens.lens, None,
            corner_sd=sd, on_axis=True, centre_sd=steps.centre_sd_of(lens.measured),
        )  # fmt: skip
        lights = [look_through(each, target) for each in led_folders(folder / "leds")]
        _, leds = steps.calibrate_leds(lights, lens.lens, sd)
        took = time.process_time() - began
    found = {each.name: each for each in (*lens.measured, *mount.measured, *leds)}
    for what, name, true, scale in _truth(scene.truth):
        each = found[name]
        errors[what].append(scale * abs(each.value - true))
        within[what].append(abs(each.value - true) <= 2 * each.sd)
    return took


def _truth(truth):  # type: ignore[no-untyped-def]
    """Yield what an error counts for, the name of the result, its true value, and a scale."""
    for axis, true in zip("xy", truth.lens.focals, strict=True):
        yield "focal length", f"focal length f{axis}", true, 100 / true
    for axis, true in zip("uv", truth.lens.centre, strict=True):
        yield "principal point", f"principal point {axis}", true, 1.0
    yield "mount", "pan where straight", truth.straight[0], 1.0
    yield "mount", "tilt where level", truth.straight[1], 1.0
    yield "mount", "camera roll", truth.camera_roll, 1.0
    yield "mount", "roll of the base", np.degrees(truth.mount.roll), 1.0
    yield "mount", "squint", 0.0, 1.0
    yield "mount", "lean of the base", 0.0, 1.0
    yield "lever", "lever", 1e3 * truth.mount.lever, 1.0
    for number, led in enumerate(truth.leds, 1):
        for axis, true in zip("xy", led, strict=False):
            yield "LEDs, across", f"LED {number} {axis}", 1e3 * true, 1.0
