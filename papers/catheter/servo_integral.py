"""The integral of the paper's Eq. (10): a point held by the camera alone, with it and without.

Off and on target, on a base that stands still, turns slowly or sways, and with the sign as printed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from minorloop.arrays import FloatArray
from minorloop_head.procedures.centre import Centring
from minorloop_head.procedures.values import Reading
from minorloop_head.twins.surroundings import Sway
from minorloop_head.vision.hold import PointHold
from papers.catheter.inspection_servo import (
    SERVO,
    STEADY,
    SWAY_SECONDS,
    SWAY_WAIT,
    TICK,
    Scene,
    ServoRun,
    run_servo,
    watched,
)
from papers.drawing import new_figure
from papers.harness import Study

CASES: Mapping[str, tuple[Sway | None, float]] = {
    "still": (None, SERVO),
    "drift": (Sway(amplitude=math.radians(2.0), pan=0.01, tilt=0.008), SERVO),
    "sway": (Sway(), SWAY_SECONDS),
}
"""Motion of the base, and seconds of a run. The slow turn is up to 0.13 degrees a second."""
WITHOUT, PRINTED = ", no integral", "printed"
BEGUN = 8.0
"""Seconds after which a point on a turning base is scored: it has long been centred by then."""
PRINTED_SECONDS, PRINTED_END = 12.0, 4.0
"""Duration of the run with the printed sign, and its end that is scored, in seconds."""


@dataclass(frozen=True, eq=False)
class IntegralStudy:
    """Runs of one specimen by name: cases with the integral and without, and the printed sign."""

    runs: Mapping[str, ServoRun]

    def figures(self) -> dict[str, Any]:
        """Return what the integral changes, in pixels of 320 and seconds."""
        found = {
            "sway_ratio": self._rms("sway", SWAY_WAIT) / self._rms(f"sway{WITHOUT}", SWAY_WAIT),
            "printed_px": self._rms(PRINTED, PRINTED_SECONDS - PRINTED_END),
        }
        for key, words in (("", ""), ("without_", WITHOUT)):
            found |= {
                f"{key}settle_s": self.runs[f"still{words}"].settle,
                f"{key}offset_px": self.runs[f"still{words}"].offset(SERVO - STEADY),
                f"{key}still_px": self._rms(f"still{words}", SERVO - STEADY),
                f"{key}drift_px": self._rms(f"drift{words}", BEGUN),
                f"{key}sway_px": self._rms(f"sway{words}", SWAY_WAIT),
            }
        return {"integral": found}

    def _rms(self, name: str, after: float) -> float:
        return self.runs[name].rms(after)


def run_study(seed: int, told: Callable[[str], None] = lambda part: None) -> IntegralStudy:
    """Hold a point in all cases with one specimen.

    Parameters
    ----------
    seed : int
        Draws head, pipe and noise.
    told : callable
        Is given the name of each case that is done.
    """
    scene = Scene(seed)
    runs: dict[str, ServoRun] = {}
    for case, (sway, seconds) in CASES.items():
        for words in ("", WITHOUT):
            runs[f"{case}{words}"] = run_servo(
                scene, sensor=False, sway=sway, seconds=seconds, integral=not words
            )
        told(case)
    return IntegralStudy({**runs, PRINTED: run_printed(scene)})


class _PrintedHold(PointHold):
    """A hold with the integral of Eq. (10) as it is printed: with a plus."""

    def correction(self, integral: FloatArray, error: FloatArray | None) -> FloatArray:
        return -super().correction(integral, error)


class _PrintedCentring(Centring):
    def _hold(self, reading: Reading) -> PointHold:
        hold = super()._hold(reading)
        return _PrintedHold(servo=hold.servo, near=math.pi, slip=math.pi)


def run_printed(scene: Scene) -> ServoRun:
    """Centre the hole by the camera alone with the printed sign of the integral."""
    rig = scene.rig(sensor=False)
    centring = _PrintedCentring(
        calibration=rig.calibration,
        still=math.inf,
        patience=PRINTED_SECONDS + TICK,
        by_image=True,
    )
    return watched(scene, rig, centring).run("printed sign")


def draw_integral(study: IntegralStudy) -> Any:
    """Draw distances against time by the camera alone: still, drifting and swayed base."""
    figure, axes = new_figure(1, 3, height=3.6, sharey=True)
    cases = {"still": "still base", "drift": "base turns slowly", "sway": "sway of 1 degree"}
    for one, (case, title) in zip(axes, cases.items(), strict=True):
        for suffix, words, colour in (
            (WITHOUT, "without", "C3"),
            ("", "with the integral", "C0"),
        ):
            run = study.runs[f"{case}{suffix}"]
            one.plot(run.t, run.off, color=colour, lw=0.9, label=words)
        one.set(xlabel="time [s]", title=title, yscale="log")
    printed = study.runs[PRINTED]
    axes[0].plot(printed.t, printed.off, color="C7", lw=0.9, label="printed sign")
    axes[0].set_ylabel("off the middle [px of 320]")
    axes[0].legend(frameon=False)
    return figure


STUDY = Study("integral", "The integral of Eq. (10)", run_study)
