"""The report of the ionic polymer study: every figure of the paper, drawn for the twin."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import uniform_levels
from minorloop.identification.frequency import decibels
from minorloop.operators.relays import RelayModel
from minorloop.report import Table
from papers.drawing import ABOVE, HOUR, draw, panel
from papers.harness import Results, Study, rms
from papers.ipmc import HALF_HERTZ, run_study

MODELS = {
    "uniform": "Preisach, uniform cells, L = 10 (the paper's)",
    "ours": "Preisach, reversible diagonal, L = 10 (ours)",
    "plays": "plays and dead zones",
    "quadratic": "quadratic (the paper's)",
}
FIG_10 = ("wanted", "inverse of the operator", "voltage", "strip", "curvature")
FIG_15 = ("voltage u", "operator", "w", "linear dynamics G(s)", "curvature y")

_DISCRETE = 4
"""Bands of Fig 6."""


def names(study: Results, *_: Any) -> dict[str, Any]:
    """Return spreads of gains of the specimen that is drawn."""
    responses = study.responses
    return {
        "spread": {name: one.gain_spread(high=HALF_HERTZ) for name, one in responses.items()},
        "phases_apart": responses["uniform"].phase_spread(high=HALF_HERTZ),
    }


def drives_table(study: Results) -> Table:
    """Return the errors of the inverses at the targets, in 1/m."""
    found = study.drives
    rows = [
        (text, f"{found[name].rms:.3f}", f"{found[name].worst:.3f}")
        for name, text in MODELS.items()
    ]
    return Table(("inverse of", "rms error, 1/m", "largest, 1/m"), rows)


def unavoidable(repetition: Results) -> float:
    """Return the share of the squared error that every Preisach model has."""
    return float(repetition.found.floor / repetition.nrmse["preisach"]) ** 2


def draw_short_holds(found: Results) -> Any:
    """Draw the errors at the end of short holds."""
    looks = {
        "settled": ("settled values", "C3 s 6"),
        "early": ("values after 10 s", "0.6 ^ 6"),
        "creep": ("with creep", "C0 o 6"),
    }
    number = np.arange(1, found.targets.size + 1)
    lines = [(number, found.errors[name], look, words) for name, (words, look) in looks.items()]
    return draw(panel("target", "error at the end of 10 s [1/m]", *lines, legend=ABOVE), height=3.6)


def draw_major(study: Results) -> Any:
    """Draw Fig 4: the inputs in time, and the loop."""
    record = study.major
    settled = np.append(np.flatnonzero(np.diff(record.u)), len(record) - 1)
    loop = (record.u[settled], record.y[settled], "C1 o-")
    return draw(
        panel("time [h]", "voltage [V]", (record.t / HOUR, record.u, "C0 - 0.9"), title="(a)"),
        panel("voltage [V]", "settled curvature [1/m]", loop, title="(b)"),
        columns=2,
    )


def draw_plane() -> Any:
    """Draw Fig 5, a relay, and Fig 6, cells with the relays that are on after some inputs."""
    up = np.linspace(-1.2, 1.2, 241)
    loop = np.concatenate([up, up[::-1]])
    relay = RelayModel(np.array((-0.5, 0.5)), np.array([[0.0, 0.0], [1.0, 0.0]]))
    fine = RelayModel(up, np.zeros((up.size, up.size)))
    edges, on = uniform_levels(-1.2, 1.2, _DISCRETE), fine.states((-1.2, 0.8, -0.4, 0.3))
    middle = (edges[1:] + edges[:-1]) / 2

    def cells(axes: Any) -> None:
        there = np.tri(up.size, dtype=bool)
        shown = np.where(there, 0.25 + 0.5 * on, np.nan)
        axes.pcolormesh(up, up, shown, cmap="Blues", vmin=0, vmax=1.2, rasterized=True)
        for number, (i, j) in enumerate(zip(*np.tril_indices(_DISCRETE), strict=True), start=1):
            place = (middle[j] - 0.1, middle[i] + 0.1) if i == j else (middle[j], middle[i])
            axes.text(*place, f"{number}", ha="center", va="center")
        for edge in edges:
            axes.plot([-1.2, edge, edge], [edge, edge, 1.2], color="0.3", lw=0.7)
        axes.plot(up[[0, -1]], up[[0, -1]], color="0.3", lw=0.7)

    return draw(
        panel(
            "input u [V]", "output of a relay", (loop, relay.simulate(loop), "C0"),
            title="Fig 5: beta = -0.5 V, alpha = 0.5 V", yticks=(-1, 1),
        ),
        panel(
            "threshold down, beta [V]", "threshold up, alpha [V]", cells, aspect="equal",
            title="Fig 6: cells for L = 4; dark: on",
        ),
        columns=2, height=3.8,
    )  # fmt: skip


def draw_blocks(words: Any) -> Any:
    """Draw two blocks with their signals: (signal, block, signal, block, signal)."""

    def blocks(axes: Any) -> None:
        axes.set_axis_off()
        axes.set(xlim=(0, 5), ylim=(0, 1))
        for number, text in enumerate(words):
            frame = {"boxstyle": "square,pad=0.8", "fc": "white"} if number % 2 else None
            axes.text(number + 0.5, 0.5 if number % 2 else 0.62, text, ha="center", bbox=frame,
                      va="center" if number % 2 else "bottom")  # fmt: skip
            if not number % 2:
                look = {"arrowstyle": "->"}
                axes.annotate("", (number + 0.92, 0.5), (number + 0.08, 0.5), arrowprops=look)

    return draw(blocks, height=1.2)


def draw_response(study: Results) -> Any:
    """Draw Fig 16: gains before (a) and after the operator (b), and behind ours with the fit."""
    dynamics, panels = study.dynamics.model, []
    paper, ours = study.responses["uniform"], study.responses["ours"]
    fine = np.geomspace(paper.frequencies[0], paper.frequencies[-1], 200)
    fit = (fine, decibels(dynamics.response(fine)), "0.3 --", f"G(s), order {dynamics.order}")
    for title, unit, gains, more in (
        ("(a) voltage to curvature", "dB re 1/(m V)", paper.plant, ()),
        ("(b) operator to curvature", "dB", paper.after, ()),
        ("ours: (b) and G(s)", "dB", ours.after, (fit,)),
    ):
        lines = [
            (paper.frequencies, decibels(row), f"C{number} o- 0.9", f"{amplitude:g} V")
            for number, (amplitude, row) in enumerate(zip(paper.amplitudes, gains, strict=True))
        ]
        frame: dict[str, Any] = {"title": title, "xscale": "log"}
        panels.append(panel("frequency [Hz]", f"gain [{unit}]", *lines, *more, **frame))
    return draw(*panels, columns=3, height=3.4)


def draw_sweep(study: Results) -> Any:
    """Draw the sine of growing amplitude: target, and result of both inverses."""
    sweep = study.sweep
    t, targets = sweep.inversion.t, sweep.inversion.targets
    alone, both = sweep.alone.y, sweep.cascade.y
    return draw(
        panel(
            "", "curvature [1/m]", (t, targets, "0.2 -- 1.4", "target"),
            (t, alone, "C3", "inverse of the operator alone"),
            (t, both, "C0", "inverse of the cascade"), legend=ABOVE,
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
    return draw(panel("hold", "predicted minus measured [1/m]", *lines, legend=ABOVE), height=3.6)


STUDY = Study(
    "ipmc", "Quasi-static positioning of an ionic polymer strip", run_study, page=__name__
)
