"""The part of the head report on the integral of the paper's Eq. (10)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minorloop.report import Picture, Report, Table
from papers.catheter.inspection_servo import STEADY
from papers.catheter.servo_integral import BEGUN, PRINTED, WITHOUT, IntegralStudy
from papers.claims import cell
from papers.drawing import new_figure


def add_integral(
    report: Report, study: IntegralStudy, found: Mapping[str, float], seed: int
) -> None:
    """Add a section.

    Parameters
    ----------
    report : Report
    study : IntegralStudy
        Of the specimen that is drawn.
    found : mapping of str to float
        Figures over all specimens.
    seed : int
        Of the specimen that is drawn, for the caption.
    """
    columns = ("by the camera alone, medians over specimens", "with the integral", "without")
    rows = [
        (words, cell(found[key], ".2f"), cell(found[f"without_{key}"], ".2f"))
        for words, key in (
            ("off target: to 2 px of 320 from 43, s", "settle_s"),
            (f"on target, last {STEADY:.0f} s: mean offset, px of 320", "offset_px"),
            (f"on target, last {STEADY:.0f} s: rms, px of 320", "still_px"),
            (f"base turns by 2 degrees, {BEGUN:.0f} to 25 s: rms, px of 320", "drift_px"),
            ("sway of 1 degree at 0.3 and 0.23 Hz: rms, px of 320", "sway_px"),
        )
    ]
    report.add(
        "Eq. (10): its integral",
        text="The paper adds an integral to attenuate tracking errors. The angles that centre a "
        "point do not depend on the angles at which the head is, so that without an integral "
        "nothing corrects what the wires leave. It stops while the point is lost or far, at the "
        "edge of the cone, and for a joint that does not follow. By the camera alone "
        f"{found['sway_ratio']:.2f} of the sway remains that remains without it. With the sign as "
        "printed the loop is unstable: after 8 s the point is "
        f"{found['printed_px']:.0f} pixels of 320 from the middle, rms.",
        table=Table(columns, rows),
        pictures=[
            Picture(
                draw_integral(study),
                f"By the camera alone, with the integral and without; seed {seed}.",
            )
        ],
    )


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
