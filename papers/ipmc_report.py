"""The report of the ionic polymer study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.identification.frequency import decibels
from minorloop.positioning_report import (
    draw_errors,
    draw_model,
    draw_quadratic,
    draw_sequences,
    draw_staircase,
    draw_trajectories,
)
from minorloop.report import Picture, Report
from papers.claims import claim_table, specimens
from papers.drawing import COLOURS, HOUR, every_specimen, new_figure
from papers.ipmc import CLAIMS, TITLE
from papers.short_holds import SHORT

if TYPE_CHECKING:
    from papers.ipmc import IpmcStudy
    from papers.short_holds import ShortHolds

_ORDER = ("Preisach", "plays", "quadratic")


def study_report(
    study: IpmcStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """The page.

    Parameters
    ----------
    study : IpmcStudy
        The first specimen, which is drawn.
    figures : mapping
        Over all specimens.
    runs : sequence of mapping
        The figures of each specimen.
    """
    ratio = figures["positioning"]["rms_ratio_median"]
    report = Report(
        TITLE,
        f"The experiments of Chen, Tan and Shahinpoor (2005) on {specimens(runs)}; figures are "
        f"drawn for that of seed {study.seed}. Positioning with the inverse of a Preisach model "
        f"has {ratio:.1f} times less error than with that of a quadratic. After the operator the "
        "gains "
        "of two amplitudes agree. Recursive identification follows a strip whose response fades.",
    )
    _add_overview(report, study, figures, runs)
    _add_hysteresis(report, study)
    _add_identification(report, study)
    _add_positioning(report, study)
    _add_short_holds(report, study)
    _add_dynamics(report, study)
    _add_open_ends(report, study)
    return report


def _add_overview(
    report: Report,
    study: IpmcStudy,
    figures: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
) -> None:
    facts = study.facts
    c2, c1, c0 = facts["quadratic_fit"]
    report.add(
        "Results",
        text=(
            "The strip is a twin, a simulation of ion pinning, water relaxation and creep without "
            "a "
            "Preisach operator. Its curves differ from those of the paper's strip, "
            "which are printed as plots only. Identification and inversion use only voltages and "
            "measured curvatures. Figures are medians over the specimens.",
            "The curvature formula printed in the paper gives the radius, its inverse. "
            "minorloop uses 2 (d0 - d) / ((d - d0)^2 + h0^2), which is 0 for a straight strip.",
        ),
        table=claim_table(CLAIMS, figures),
        pictures=every_specimen(CLAIMS, runs, study.seed),
    )
    report.add(
        "The twin",
        text=(
            f"At nominal parameters its settled points follow {c2:.2f} u^2 + {c1:.2f} u + "
            f"{c0:.2f} in 1/m (the paper's strip: -0.35 u^2 + 8.2 u + 0.34), and its major loop "
            f"is {facts['loop_gap']:.0%} of its range wide. It is not a Preisach operator: the "
            "height "
            f"of one minor loop differs by {facts['congruency']:.1%} between two histories, and "
            "an excursion that should be wiped out changes the output by "
            f"{facts['wiping_out']:.2%} "
            "of the range.",
        ),
    )


def _add_hysteresis(report: Report, study: IpmcStudy) -> None:
    report.add(
        "Fig 4: hysteresis under a staircase",
        text="The paper holds each voltage for 200 s, from -1.2 V to 1.2 V and back, and reports "
        "a significant gap between the two branches.",
        pictures=[
            Picture(draw_major(study), "Voltage and curvature of the twin, and the settled points.")
        ],
    )


def _add_identification(report: Report, study: IpmcStudy) -> None:
    report.add(
        "Figs 7 to 9: identification",
        text="The paper applies an oscillation of decreasing amplitude, observes the trend of "
        "minor loops in the settled points, and identifies a density on ten levels. A staircase "
        "with a settled point at every level determines all 55 cells and the offset from 56 "
        "points; "
        "reversal points alone would determine 11. The strip is measured by a simulated laser "
        "with a noise of 2.8 um; the settled points are found in its raw log. The model drawn "
        "here is the paper's, uniform in every cell.",
        pictures=[
            Picture(draw_staircase(study.positioning), "Figs 7, 8: the decaying staircase."),
            Picture(draw_model(study.positioning), "Figs 8, 9: settled points, model, density."),
        ],
    )
    report.add(
        "Fig 11: the single-valued model",
        text="The paper fits y = -0.35 u^2 + 8.2 u + 0.34 to the same points.",
        pictures=[Picture(draw_quadratic(study.positioning), "The quadratic of the twin.")],
    )


def _add_positioning(report: Report, study: IpmcStudy) -> None:
    drives = _drives(study)
    words = ", ".join(f"{name} {drive.rms:.2f}" for name, drive in drives.items())
    report.add(
        "Figs 12 to 14: fourteen targets",
        text=(
            "The paper applies the voltages of both inverses, 200 s each, and reports a much "
            "smaller error with the Preisach inverse. On this specimen, in 1/m rms: " + words + ".",
        ),
        pictures=[
            Picture(draw_sequences(study.positioning), "Fig 12: the voltages of both inverses."),
            Picture(draw_trajectories(study.positioning), "Fig 13: the curvature of the strip."),
            Picture(draw_errors(study.positioning), "Fig 14: settled errors."),
            Picture(draw_three(study), "Errors of three models fitted to the same points."),
        ],
    )


def _add_short_holds(report: Report, study: IpmcStudy) -> None:
    found = study.short_holds.figures()
    report.add(
        "Targets in 10 s instead of 200 s",
        text=f"With creep in the inverse, each target is met at the end of a hold of 10 s: "
        f"{found['rms_creep']:.2f} 1/m rms, {found['rms_settled']:.2f} with the inverse of settled "
        f"values, and {found['rms_early']:.2f} with that of values read after 10 s. Over 14 "
        f"targets it saves {found['minutes_saved']:.0f} minutes. Held for a minute by an input "
        f"that follows the creep, targets are missed by {found['rms_minute_creep']:.2f} 1/m rms, "
        f"and by {found['rms_minute_settled']:.2f} with a constant input.",
        pictures=[
            Picture(draw_short_holds(study.short_holds), "Errors after 10 s, and over a minute.")
        ],
    )


def draw_short_holds(found: ShortHolds) -> Any:
    """Draw the errors at the end of short holds, and those of targets that are held on."""
    figure, (left, right) = new_figure(1, 2, height=3.6, sharey=True)
    number = np.arange(1, found.targets.size + 1)
    marks = {"settled": ("C3", "s"), "early": ("0.6", "^"), "creep": ("C0", "o")}
    names = {"settled": "settled values", "early": "values after 10 s", "creep": "with creep"}
    for name, (colour, mark) in marks.items():
        left.plot(number, found.errors[name], mark, color=colour, label=names[name])
        if name in found.delivered:
            errors = found.delivered[name]
            seconds = SHORT * np.arange(1, errors.shape[1] + 1)
            right.plot(seconds, errors.T, "-", color=colour, lw=0.8)
    left.set(xlabel="target", ylabel="error [1/m]", title="at the end of a hold of 10 s")
    right.set(xlabel="time since the step [s]", title="held for a minute")
    left.legend(frameon=False, fontsize=9)
    return figure


def _add_dynamics(report: Report, study: IpmcStudy) -> None:
    spread = study.response.gain_spread(high=0.5)
    before, after = study.response.phase_spread(high=0.5)
    sweep = study.sweep.errors()
    report.add(
        "Figs 15, 16: the operator followed by linear dynamics",
        text=(
            "The paper finds that the gains at 0.7 V and 1 V differ from voltage to curvature and "
            "agree much better from the operator's output to curvature, with a remaining "
            "discrepancy, and that phases agree in both. On this specimen, up to 0.5 Hz, gains "
            "differ "
            f"by {spread.before:.2f} dB before and {spread.after:.2f} dB after; phases by "
            f"{before:.1f} and {after:.1f} degrees. Above 0.5 Hz the transition between settled "
            "values is nonlinear too, and the gains differ again.",
            f"A transfer function of order {study.dynamics.model.order} with DC gain 1 is fitted "
            f"to both amplitudes, with an error of {study.dynamics.error:.1%}. With it the cascade "
            "is "
            "inverted for a sine of growing amplitude: the error is "
            f"{sweep['rms_cascade']:.2f} 1/m rms, and {sweep['rms_operator']:.2f} with the inverse "
            "of the operator alone.",
        ),
        pictures=[
            Picture(draw_response(study), "Fig 16: gains before and after, and the phases."),
            Picture(
                draw_sweep(study),
                "A trajectory with both inverses.",
            ),
        ],
    )


def _add_open_ends(report: Report, study: IpmcStudy) -> None:
    repetition = study.repetition
    found, errors = repetition.found, repetition.nrmse
    report.add(
        "Section VI: following a strip that changes",
        text="The paper observes that the strip varies slightly over time and suggests recursive "
        "identification. Here its bending fades by 2 % an hour. The figure compares predictions of "
        "a recursion, of a batch fit to the most recent points, and of a model identified once.",
        pictures=[Picture(draw_tracking(study), "Errors of the predictions, one hold ahead.")],
    )
    report.add(
        "The least error of any Preisach model",
        text=(
            "A record that returns to the same memory or branch shows by how much it contradicts "
            "every Preisach model. Two decaying staircases and random levels: "
            f"{found}.",
            f"The error of the fitted Preisach model is {errors['preisach']:.2%} rms on this "
            "record, "
            f"so {(found.floor / errors['preisach']) ** 2:.0%} of its squared error is "
            "unavoidable. "
            f"The error of play operators is {errors['plays']:.2%}, that of the quadratic "
            f"{errors['quadratic']:.2%}. Positioning adds the error between the levels of the "
            "model.",
        ),
    )
    report.add(
        "Section I: the strip as a sensor",
        text="The paper mentions that bending gives millivolts. In the twin, bending makes a "
        "charge "
        f"that leaks away: here {np.ptp(study.sensing.y):.1f} mV peak to peak. This project chose "
        "gain and leakage.",
        pictures=[Picture(draw_sensing(study), "Imposed bending, and the voltage it gives.")],
    )


def _drives(study: IpmcStudy) -> dict[str, Any]:
    found = study.positioning
    every = {
        "Preisach": found.preisach,
        "plays": study.plays_drive,
        "quadratic": found.quadratic,
    }
    return {name: every[name] for name in _ORDER}


def draw_major(study: IpmcStudy) -> Any:
    """Draw Fig 4: the staircase in time, and the loop."""
    figure, (left, right) = new_figure(1, 2, height=3.8)
    record = study.major
    settled = np.append(np.flatnonzero(np.diff(record.u)), len(record) - 1)
    left.plot(record.t / HOUR, record.y, lw=0.9, color="C0", label="curvature", rasterized=True)
    left.plot(record.t[settled] / HOUR, record.y[settled], "o", ms=3, color="C1", label="settled")
    left.set(xlabel="time [h]", ylabel="curvature [1/m]")
    left.legend(frameon=False)
    right.plot(record.u[settled], record.y[settled], "o-", ms=4, color="C1")
    right.set(xlabel="voltage [V]", ylabel="settled curvature [1/m]")
    return figure


def draw_three(study: IpmcStudy) -> Any:
    """Draw the settled errors of the three inverses at each target."""
    figure, axes = new_figure()
    place = np.arange(study.positioning.targets.size) + 1
    for shift, (name, drive) in zip((-0.27, 0.0, 0.27), _drives(study).items(), strict=True):
        label = f"{name}: {drive.rms:.2f} 1/m rms"
        axes.bar(place + shift, np.abs(drive.errors), width=0.26, color=COLOURS[name], label=label)
    axes.set(xlabel="target", ylabel="size of the settled error [1/m]")
    axes.set_xticks(place)
    axes.legend(frameon=False)
    return figure


def draw_response(study: IpmcStudy) -> Any:
    """Draw Fig 16: gains before and after the operator with the fit, and the phases."""
    figure, grid = new_figure(2, 2, height=5.6, sharex=True)
    response, dynamics = study.response, study.dynamics.model
    assert response.after is not None
    kinds = (("voltage to curvature", response.plant), ("operator to curvature", response.after))
    for column, (title, gains) in enumerate(kinds):
        upper, lower = grid[:, column]
        for amplitude, row in zip(response.amplitudes, gains, strict=True):
            label = f"{amplitude:g} V"
            upper.semilogx(response.frequencies, decibels(row), "o-", ms=3.5, lw=0.9, label=label)
            phase = np.degrees(np.unwrap(np.angle(row)))
            lower.semilogx(response.frequencies, phase, "o-", ms=3.5, lw=0.9, label=label)
        upper.set(title=title, ylabel="gain [dB]" if column else "gain [dB re 1/(m V)]")
        lower.set(xlabel="frequency [Hz]", ylabel="phase [degrees]")
    fine = np.geomspace(response.frequencies[0], response.frequencies[-1], 200)
    curve = dynamics.response(fine)
    style = {"color": "0.3", "lw": 1.0, "ls": "--"}
    grid[0, 1].semilogx(fine, decibels(curve), label=f"G(s), order {dynamics.order}", **style)
    grid[1, 1].semilogx(fine, np.degrees(np.unwrap(np.angle(curve))), **style)
    for upper in grid[0]:
        upper.legend(frameon=False)
    return figure


def draw_sweep(study: IpmcStudy) -> Any:
    """Draw the sine of growing amplitude: target, and result of both inverses."""
    figure, (upper, lower) = new_figure(2, 1, height=5.0, sharex=True)
    sweep = study.sweep
    t, targets = sweep.inversion.t, sweep.inversion.targets
    upper.plot(t, targets, color="0.2", lw=1.4, ls="--", label="target")
    for name, record, colour in (
        ("operator alone", sweep.alone, "C3"),
        ("cascade", sweep.cascade, "C0"),
    ):
        upper.plot(t, record.y, lw=1.0, color=colour, label=f"inverse of the {name}")
        lower.plot(t, record.y - targets, lw=1.0, color=colour)
    upper.set(ylabel="curvature [1/m]")
    upper.legend(frameon=False, loc="upper left")
    lower.set(xlabel="time [s]", ylabel="error [1/m]")
    return figure


def draw_tracking(study: IpmcStudy) -> Any:
    """Draw the errors of one-step predictions on the fading strip."""
    figure, axes = new_figure()
    tracking = study.tracking
    hold = np.arange(tracking.measured.size) + 1
    for name, predicted, colour in (
        ("identified once", tracking.fixed, "C3"),
        ("batch on recent holds", tracking.batch, "C2"),
        ("recursive", tracking.recursive, "C0"),
    ):
        label = f"{name}: {tracking.rms(predicted):.2f} 1/m rms"
        axes.plot(hold, predicted - tracking.measured, lw=1.0, color=colour, label=label)
    axes.set(xlabel="hold", ylabel="predicted minus measured [1/m]")
    axes.legend(frameon=False)
    return figure


def draw_sensing(study: IpmcStudy) -> Any:
    """Draw the imposed bending and the voltage."""
    figure, (upper, lower) = new_figure(2, 1, height=4.2, sharex=True)
    upper.plot(study.sensing.t, study.sensing.u, color="0.25", lw=1.0)
    upper.set(ylabel="imposed curvature [1/m]")
    lower.plot(study.sensing.t, study.sensing.y, color="C0", lw=1.0)
    lower.set(xlabel="time [s]", ylabel="voltage [mV]")
    return figure
