"""The report of the ionic polymer study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.identification.frequency import decibels
from papers.drawing import COLOURS, HOUR, bars, draw, panel
from papers.harness import Results, Study, rms
from papers.ipmc import HALF_HERTZ, run_study
from papers.short_holds import SHORT


def names(study: Results, *_: Any) -> dict[str, Any]:
    """Return spreads of gains and phases of the specimen that is drawn, and its drives."""
    found = study.positioning
    return {
        "spread": study.response.gain_spread(high=HALF_HERTZ),
        "phases_apart": study.response.phase_spread(high=HALF_HERTZ),
        "drives": {
            "Preisach": found.preisach,
            "plays": study.plays_drive,
            "quadratic": found.quadratic,
        },
    }


def errors_of(drives: dict[str, Any]) -> str:
    """Return in words the rms errors of the inverses."""
    return ", ".join(f"{name} {drive.rms:.2f}" for name, drive in drives.items())


def unavoidable(repetition: Results) -> float:
    """Return the share of the squared error that every Preisach model has."""
    return float(repetition.found.floor / repetition.nrmse["preisach"]) ** 2


def draw_short_holds(found: Results) -> Any:
    """Draw the errors at the end of short holds, and those of targets that are held on."""
    looks = {
        "settled": ("settled values", "C3", "s"),
        "early": ("values after 10 s", "0.6", "^"),
        "creep": ("with creep", "C0", "o"),
    }
    number, ends, on = np.arange(1, found.targets.size + 1), [], []
    for name, (words, colour, mark) in looks.items():
        ends.append((number, found.errors[name], f"{colour} {mark} 6", words))
        errors = found.delivered.get(name, np.empty((0, 0)))
        seconds = SHORT * np.arange(1, errors.shape[1] + 1)
        on += [(seconds, each, f"{colour} - 0.8") for each in errors]
    return draw(
        panel("target", "error [1/m]", *ends, title="at the end of a hold of 10 s"),
        panel("time since the step [s]", "", *on, title="held for a minute"),
        columns=2, height=3.6, sharey=True,
    )  # fmt: skip


def draw_major(study: Results) -> Any:
    """Draw Fig 4: the staircase in time, and the loop."""
    record = study.major
    settled = np.append(np.flatnonzero(np.diff(record.u)), len(record) - 1)
    t, u, y = record.t / HOUR, record.u[settled], record.y[settled]
    lines = ((t, record.y, "C0 - 0.9", "curvature"), (t[settled], y, "C1 o 3", "settled"))
    return draw(
        panel("time [h]", "curvature [1/m]", *lines),
        panel("voltage [V]", "settled curvature [1/m]", (u, y, "C1 o-")),
        columns=2,
    )


def draw_three(drives: dict[str, Any]) -> Any:
    """Draw the settled errors of the three inverses at each target."""
    groups = {
        f"{name}: {drive.rms:.2f} 1/m rms": (np.abs(drive.errors), COLOURS[name])
        for name, drive in drives.items()
    }
    return draw(bars("target", "size of the settled error [1/m]", groups), height=3.6)


def draw_response(study: Results) -> Any:
    """Draw Fig 16: gains before and after the operator with the fit, and the phases."""
    response, dynamics = study.response, study.dynamics.model
    fine = np.geomspace(response.frequencies[0], response.frequencies[-1], 200)
    curve, fit = dynamics.response(fine), f"G(s), order {dynamics.order}"
    upper, lower = [], []
    for title, unit, gains in (
        ("voltage to curvature", "dB re 1/(m V)", response.plant),
        ("operator to curvature", "dB", response.after),
    ):
        size, phase = [], []
        for number, (amplitude, row) in enumerate(zip(response.amplitudes, gains, strict=True)):
            look = f"C{number} o- 0.9"
            size.append((response.frequencies, decibels(row), look, f"{amplitude:g} V"))
            phase.append((response.frequencies, _phase(row), look))
        if unit == "dB":
            size.append((fine, decibels(curve), "0.3 --", fit))
            phase.append((fine, _phase(curve), "0.3 --"))
        upper.append(panel("", f"gain [{unit}]", *size, title=title, xscale="log"))
        lower.append(panel("frequency [Hz]", "phase [degrees]", *phase, xscale="log"))
    return draw(*upper, *lower, columns=2, height=5.6, sharex=True)


def _phase(gains: Any) -> Any:
    return np.degrees(np.unwrap(np.angle(gains)))


def draw_sweep(study: Results) -> Any:
    """Draw the sine of growing amplitude: target, and result of both inverses."""
    sweep = study.sweep
    t, targets = sweep.inversion.t, sweep.inversion.targets
    alone, both = sweep.alone.y, sweep.cascade.y
    return draw(
        panel(
            "", "curvature [1/m]", (t, targets, "0.2 -- 1.4", "target"),
            (t, alone, "C3", "inverse of the operator alone"),
            (t, both, "C0", "inverse of the cascade"), legend={"loc": "upper left"},
        ),
        panel("time [s]", "error [1/m]", (t, alone - targets, "C3"), (t, both - targets, "C0")),
        height=5.0, sharex=True,
    )  # fmt: skip


def draw_tracking(study: Results) -> Any:
    """Draw the errors of one-step predictions on the fading strip."""
    found, lines = study.tracking, []
    for words, name, colour in (
        ("identified once", "fixed", "C3"),
        ("batch on recent holds", "batch", "C2"),
        ("recursive", "recursive", "C0"),
    ):
        error = found.predicted[name] - found.measured
        hold = np.arange(error.size) + 1
        lines.append((hold, error, colour, f"{words}: {rms(error):.2f} 1/m rms"))
    return draw(panel("hold", "predicted minus measured [1/m]", *lines), height=3.6)


def draw_sensing(study: Results) -> Any:
    """Draw the imposed bending and the voltage."""
    record = study.sensing
    return draw(
        panel("", "imposed curvature [1/m]", (record.t, record.u, "0.25")),
        panel("time [s]", "voltage [mV]", (record.t, record.y, "C0")),
        height=4.2,
        sharex=True,
    )


STUDY = Study(
    "ipmc", "Quasi-static positioning of an ionic polymer strip", run_study, page=__name__
)
