"""The report of the Bouc-Wen benchmark."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.operators.differential import BoucWen
from minorloop.report import Picture, Report, Table
from minorloop.twins.bouc_wen import RATE, SWEEP
from papers.benchmark import CLAIMS, MODELS, TITLE, true_parameters
from papers.claims import claim_table, specimens
from papers.drawing import draw_specimens, new_figure

if TYPE_CHECKING:
    from papers.benchmark import BenchmarkStudy

PUBLISHED = (
    ("linear", "1.6e-4", "-", "Noel and others, 2017"),
    ("dynoNet, a network of linear filters", "4.5e-5", "-", "Forgione and Piga, 2021"),
    ("polynomial state space, decoupled", "1.87e-5", "-", "Fakhrizadeh Esfahani and others, 2018"),
    ("polynomial state space", "1.21e-5", "217", "Noel and others, 2017"),
    ("best black box", "7.5e-6", "-", "table of the benchmark"),
)
"""Model, error on the multisine in m, parameters, and who published it."""
_COLOURS = {"linear": "C3", "plays": "C1", "unknown": "C0", "grey": "C2"}


def study_report(
    study: BenchmarkStudy, figures: Mapping[str, Any], runs: Sequence[Mapping[str, Any]]
) -> Report:
    """Return the page; see the other studies for the parameters."""
    report = Report(
        TITLE,
        f"A model that is not told the law of the hysteresis predicts the multisine within "
        f"{figures['unknown']['multisine']:.2g} m rms, of {figures['output']['multisine']:.2g} m, "
        f"and one that is told it within {figures['grey']['multisine']:.2g} m; {specimens(runs)}.",
    )
    report.add(
        "What was found",
        text=(
            "The records are generated anew from the description of the benchmark, at 15 kHz by "
            "the method of Newmark, and decimated to 750 Hz. Every model is fitted to five noisy "
            "periods of one multisine by the error of its simulation, and scored on another "
            "multisine and on a sweep from rest, both without noise. Models are integrated by "
            "Runge and Kutta at 3,750 Hz, with a force that has no content above 375 Hz between "
            "its samples, and a displacement that passes the last filter of the converter. "
            "Published figures are of other draws of the same signals.",
            "What the unknown law is told: one mass, and a force of which the slope depends on the "
            "force itself and on the direction of the motion. What it is not told: the slopes. "
            "Their levels lie where the force of the record lies, and none is at zero on purpose.",
        ),
        table=claim_table(CLAIMS, figures),
    )
    report.add("Beside the published", table=published_table(figures))
    report.add(
        "Where the errors are",
        pictures=[
            Picture(draw_spectra(study), "Displacement of the multisine, and what models miss."),
            Picture(draw_sweep(study), "Largest errors along the sweep, in each of 200 parts."),
        ],
    )
    report.add(
        "The law that was found",
        text="The slope of the hysteretic force against the force, for both directions.",
        pictures=[Picture(draw_law(study), "Free slopes with twice their standard deviation.")],
    )
    report.add("Parameters of the known law", table=_parameters(study))
    if len(runs) > 1:
        report.add(
            "Every specimen",
            pictures=[Picture(draw_specimens(CLAIMS, runs, study.seed), "Points, and the median.")],
        )
    return report


def published_table(figures: Mapping[str, Any]) -> Table:
    """Return our errors on the multisine and those of others, the largest first."""
    ours = [
        (words, f"{figures[name]['multisine']:.2g}", f"{figures[name]['parameters']:.0f}", "ours")
        for name, words in MODELS.items()
    ]
    rows = sorted([*ours, *PUBLISHED], key=lambda row: -float(row[1]))
    return Table(("model", "multisine, rms error [m]", "parameters", "source"), rows)


def draw_spectra(study: BenchmarkStudy) -> Any:
    """Draw the spectrum of the multisine response, and of the error of each model."""
    figure, axes = new_figure(1, 1, height=4.0)
    signals = {"displacement": study.test.y} | {
        MODELS[name]: one.multisine for name, one in study.models.items()
    }
    colours = ["0.3", *(_COLOURS[name] for name in study.models)]
    for (words, signal), colour in zip(signals.items(), colours, strict=True):
        size = 2 * np.abs(np.fft.rfft(signal)) / signal.size
        # Means over 32 lines: single lines of a random-phase multisine scatter.
        rows = size[1:].reshape(-1, 32)
        middle = (np.arange(len(rows)) + 0.5) * 32 * RATE / signal.size
        axes.semilogy(middle, np.sqrt(np.mean(rows**2, axis=1)), color=colour, lw=1.2, label=words)
    axes.set(xlabel="frequency [Hz]", ylabel="amplitude [m]", xlim=(0, RATE / 2))
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_sweep(study: BenchmarkStudy) -> Any:
    """Draw the largest errors of each model against the frequency of the sweep."""
    figure, axes = new_figure(1, 1, height=3.6)
    first, last, _, _ = SWEEP
    signals = [("displacement", study.sweep.y, "0.3")]
    signals += [(MODELS[name], one.sweep, _COLOURS[name]) for name, one in study.models.items()]
    for words, signal, colour in signals:
        parts = np.array_split(np.abs(signal), 200)
        frequency = np.linspace(first, last, len(parts))
        axes.semilogy(frequency, [part.max() for part in parts], color=colour, lw=1.2, label=words)
    axes.set(xlabel="frequency of the sweep [Hz]", ylabel="largest, absolute [m]")
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_law(study: BenchmarkStudy) -> Any:
    """Draw the free slopes with their uncertainty, and those of the plant."""
    figure, axes = new_figure(1, 2, height=3.6, sharey=True)
    found = study.models["unknown"].found
    law = found.model.operator
    first = found.parameters.size - 2 * law.levels.size
    sd = np.split(found.sd[first:], 2)
    _, _, _, alpha, gamma, delta, exponent = true_parameters()
    z = np.linspace(law.levels[0], law.levels[-1], 400)
    true = BoucWen(alpha, gamma, delta, exponent).slopes(z)
    sides = (("rising", law.rising), ("falling", law.falling))
    for axis, (name, values), one, both in zip(axes, sides, sd, true, strict=True):
        axis.plot(z, both / 1e3, color="0.3", lw=1, label="plant")
        axis.errorbar(
            law.levels, values / 1e3, 2 * one / 1e3, fmt="o-", ms=3, lw=1, color="C0", label="found"
        )
        axis.set(title=f"displacement {name}", xlabel="hysteretic force [N]")
        axis.legend(frameon=False, fontsize=9)
    axes[0].set_ylabel("slope [N/mm]")
    axes[0].set_ylim(0, 1.2 * max(float(both.max()) for both in true) / 1e3)
    return figure


def _parameters(study: BenchmarkStudy) -> Table:
    found = study.models["grey"].found
    rows = [
        (name, f"{value:.6g}", f"{sd:.2g}", f"{true:g}")
        for name, value, sd, true in zip(
            found.names, found.parameters, found.sd, true_parameters(), strict=True
        )
    ]
    return Table(("parameter", "found", "standard deviation", "plant"), rows)
