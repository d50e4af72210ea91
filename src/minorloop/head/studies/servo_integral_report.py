"""The part of the head report on the integral of the paper's Eq. (10)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minorloop.head.studies.servo_integral import PRINTED, WITHOUT, IntegralStudy
from minorloop.report import Picture, Report, Table
from minorloop.studies.claims import cell
from minorloop.studies.drawing import new_figure


def add_integral(report: Report, study: IntegralStudy, found: Mapping[str, float]) -> None:
    """Add a section.

    Parameters
    ----------
    report : Report
    study : IntegralStudy
        Of the specimen that is drawn.
    found : mapping of str to float
        Figures over all specimens.
    """
    columns = ("by the camera alone, medians over specimens", "with the integral", "without")
    rows = [
        (words, cell(found[key], ".2f"), cell(found[f"without_{key}"], ".2f"))
        for words, key in (
            ("off target: to 2 px from 43 px, s", "settle_s"),
            ("on target: mean offset, px", "offset_px"),
            ("base turns by 2 degrees in 25 s: rms, px", "drift_px"),
            ("sway of 1 degree at 0.3 and 0.23 Hz: rms, px", "sway_px"),
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
        f"{found['printed_px']:.0f} pixels from the middle, rms. Pixels are those of a picture "
        "320 wide.",
        table=Table(columns, rows),
        pictures=[
            Picture(draw_integral(study), "By the camera alone, with the integral and without.")
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
    axes[0].set_ylabel("off the middle [px]")
    axes[0].legend(frameon=False)
    return figure
