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
from papers.claims import Claim

TITLE = "The integral of Eq. (10)"
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

CLAIMS = (
    Claim(
        "point held by the camera, sway: rms with the integral over without",
        "integral.sway_ratio",
        "attenuates errors (Eq 10)",
        most=0.8,
    ),
    Claim(
        "the same, base at rest: mean offset with the integral [px of 320]",
        "integral.offset_px",
        "attenuates errors (Eq 10)",
        most=0.3,
    ),
    Claim("the same without [px of 320]", "integral.without_offset_px", "-"),
    Claim("the same, rms with the integral [px of 320]", "integral.still_px", "-"),
    Claim("the same, rms without [px of 320]", "integral.without_still_px", "-"),
    Claim("base turns slowly, with the integral: rms [px of 320]", "integral.drift_px", "-"),
    Claim("the same without [px of 320]", "integral.without_drift_px", "-"),
    Claim(
        "integral with the printed sign: rms after 8 s [px of 320]",
        "integral.printed_px",
        "printed",
    ),
)


@dataclass(frozen=True, eq=False)
class IntegralStudy:
    """Runs of one specimen by name: each case with the integral and without, and the printed sign.

    Parameters
    ----------
    runs : mapping of str to ServoRun
    """

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
