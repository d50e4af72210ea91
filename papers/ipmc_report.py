"""The report of the ionic polymer study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.identification.frequency import decibels
from papers.drawing import COLOURS, HOUR, new_figure
from papers.harness import Study
from papers.ipmc import HALF_HERTZ, IpmcStudy, Repetition, run_study
from papers.short_holds import SHORT, ShortHolds

_ORDER = ("Preisach", "plays", "quadratic")


def names(study: IpmcStudy, *_: Any) -> dict[str, Any]:
    """Return spreads of gains and phases of the specimen that is drawn."""
    return {
        "spread": study.response.gain_spread(high=HALF_HERTZ),
        "phases_apart": study.response.phase_spread(high=HALF_HERTZ),
    }


def errors_of(study: IpmcStudy) -> str:
    """Return in words the rms errors of the inverses."""
    return ", ".join(f"{name} {drive.rms:.2f}" for name, drive in _drives(study).items())


def unavoidable(repetition: Repetition) -> float:
    """Return the share of the squared error that every Preisach model has."""
    return (repetition.found.floor / repetition.nrmse["preisach"]) ** 2


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


STUDY = Study(
    "ipmc",
    "Quasi-static positioning of an ionic polymer strip",
    run_study,
    page=__name__,
)
