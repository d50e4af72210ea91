"""The Bouc-Wen benchmark: an oscillator with hysteresis, identified from its vibrations.

Four models are fitted to the noisy training record by the error of their simulation, and scored on
two records without noise. What is known grows from row to row: that the plant is linear, which is
wrong; that its hysteresis is one of plays, which is wrong too; that there is a hysteretic force,
but not its law; and the law of Bouc and Wen, but not its parameters, from a start that is 50 % off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.oscillator import Oscillator
from minorloop.identification.oscillator import identify_oscillator
from minorloop.identification.oscillator_result import OscillatorIdentification
from minorloop.operators.differential import BoucWen
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.report import Table
from minorloop.twins import bouc_wen as plant
from papers.drawing import new_figure
from papers.harness import Study, rms

SUBSTEPS = 5
"""Steps of the integration in an interval: 3,750 a second, a fourth of those of the twin."""
OFF = 0.5
"""Share by which the start of the grey box is off, up or down for each parameter."""
PLAYS, SPRINGS = 6, 3
"""Plays, and degree of the restoring force beside them. By trial: twelve plays are hardly better,
and unstable for some forces."""
MODELS = {
    "linear": "linear",
    "plays": "plays in feedback, cubic spring",
    "unknown": "unknown law: free slopes",
    "grey": "law of Bouc and Wen",
}
PUBLISHED = (
    ("linear", "1.6e-4", "-", "Noel and others, 2017"),
    ("dynoNet, a network of linear filters", "4.5e-5", "-", "Forgione and Piga, 2021"),
    ("polynomial state space, decoupled", "1.87e-5", "-", "Fakhrizadeh Esfahani and others, 2018"),
    ("polynomial state space", "1.21e-5", "217", "Noel and others, 2017"),
    ("best black box", "7.5e-6", "-", "table of the benchmark"),
)
"""Model, error on the multisine in m, parameters, and who published it."""
_COLOURS = {"linear": "C3", "plays": "C1", "unknown": "C0", "grey": "C2"}


@dataclass(frozen=True, eq=False)
class Scored:
    """A model with its errors on both tests."""

    found: OscillatorIdentification
    """The model and its fit."""
    multisine: FloatArray
    sweep: FloatArray
    """Shape (T,). Simulated less true displacements in m."""
    seconds: float
    """Seconds of the identification."""

    def figures(self) -> dict[str, float]:
        """Errors, and the number of parameters."""
        return {
            "multisine": rms(self.multisine),
            "sweep": rms(self.sweep),
            "training": self.found.error,
            "parameters": int(self.found.free.sum()),
            "seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class BenchmarkStudy:
    """The models of one training record."""

    seed: int
    """Seed of the records."""
    test: plant.BenchmarkRecord
    sweep: plant.BenchmarkRecord
    """The two tests."""
    models: dict[str, Scored]
    """By the names in `MODELS`."""
    held: float
    """Error of the grey box in m on the multisine if its force is held between samples."""

    def figures(self) -> dict[str, Any]:
        """Every number by the name under which it is printed."""
        grey = self.models["grey"].found
        truth = true_parameters()
        found = {name: one.figures() for name, one in self.models.items()}
        worst = float(np.abs(grey.parameters / truth - 1).max())
        return {
            **found,
            "grey": {**found["grey"], "worst_parameter": worst},
            "held": {"multisine": self.held},
            "output": {"multisine": rms(self.test.y), "sweep": rms(self.sweep.y)},
        }


def run_study(seed: int) -> BenchmarkStudy:
    """Fit and score all models.

    Parameters
    ----------
    seed : int
        Draws both multisines, the noise, and which parameters of the start are too large.
    """
    training, test = plant.training_record(seed), plant.multisine_test(seed)
    sweep = plant.sweep_test()
    # The filters are a data sheet of the converter. The first two pass what the third one passes.
    stages = tuple(plant.filters()[-1:])

    def identified(start: Any, fixed: tuple[str, ...] = ()) -> OscillatorIdentification:
        return identify_oscillator(
            training.t,
            training.u,
            training.y,
            start,
            period=training.period,
            substeps=SUBSTEPS,
            stages=stages,
            fixed=fixed,
        )

    def error(
        model: Oscillator, record: plant.BenchmarkRecord, between: Any = "band"
    ) -> FloatArray:
        # A converter holds a sample until the next one; `held` is over the interval before it.
        force = np.roll(record.u, 1) if between == "held" else record.u
        y = model.simulate(
            record.t,
            force,
            between=between,
            substeps=SUBSTEPS,
            periodic=record.period is not None,
            stages=stages,
        )
        return np.asarray(y - record.y)

    def scored(fit: Callable[[], OscillatorIdentification]) -> Scored:
        began = perf_counter()
        found = fit()
        seconds = perf_counter() - began
        return Scored(found, error(found.model, test), error(found.model, sweep), seconds)

    models = {"unknown": scored(lambda: identified("unknown"))}
    known = models["unknown"].found.model
    nothing = ("alpha", "gamma", "delta", "exponent")
    spring = known.stiffness[0]
    still = Oscillator(known.mass, known.damping, 2 * spring, BoucWen(_NO_SLOPE, 0.0, 0.0))
    models["linear"] = scored(lambda: identified(still, nothing))
    models["plays"] = scored(lambda: identified(_plays(models["linear"].found.model, training.y)))
    models["grey"] = scored(lambda: identified(rough_start(seed)))
    held = rms(error(models["grey"].found.model, test, "held"))
    return BenchmarkStudy(seed, test, sweep, {name: models[name] for name in MODELS}, held)


_NO_SLOPE = 1e-3
"""Slope in N/m of a hysteretic force that is none: a hundred millionth of the stiffness."""


def true_parameters() -> FloatArray:
    """Return the parameters of the plant as they can be seen: with the products of beta."""
    law = plant.PARAMETERS
    first = [law["mass"], law["damping"], law["stiffness"], law["alpha"]]
    return np.array(
        [*first, law["beta"] * law["gamma"], law["beta"] * law["delta"], law["exponent"]]
    )


def rough_start(seed: int) -> Oscillator:
    """Return the plant with every parameter 50 % too large or too small."""
    signs = np.random.default_rng([seed, 2]).choice([1 - OFF, 1 + OFF], 7)
    mass, damping, stiffness, *law = true_parameters() * signs
    return Oscillator(mass, damping, stiffness, BoucWen(*law))


def _plays(linear: Oscillator, y: FloatArray) -> Oscillator:
    """Return an oscillator whose hysteretic force is one of plays, all of weight zero."""
    radii = np.abs(y).max() * np.arange(1, PLAYS + 1) / (PLAYS + 1)
    springs = np.concatenate([linear.stiffness, np.zeros(SPRINGS - 1)])
    return replace(linear, stiffness=springs, operator=PrandtlIshlinskii(radii, np.zeros(PLAYS)))


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
        middle = (np.arange(len(rows)) + 0.5) * 32 * plant.RATE / signal.size
        axes.semilogy(middle, np.sqrt(np.mean(rows**2, axis=1)), color=colour, lw=1.2, label=words)
    axes.set(xlabel="frequency [Hz]", ylabel="amplitude [m]", xlim=(0, plant.RATE / 2))
    axes.legend(frameon=False, fontsize=9)
    return figure


def draw_sweep(study: BenchmarkStudy) -> Any:
    """Draw the largest errors of each model against the frequency of the sweep."""
    figure, axes = new_figure(1, 1, height=3.6)
    first, last, _, _ = plant.SWEEP
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


def parameter_table(study: BenchmarkStudy) -> Table:
    """Return the parameters that were found beside the true ones."""
    found = study.models["grey"].found
    rows = [
        (name, f"{value:.6g}", f"{sd:.2g}", f"{true:g}")
        for name, value, sd, true in zip(
            found.names, found.parameters, found.sd, true_parameters(), strict=True
        )
    ]
    return Table(("parameter", "found", "standard deviation", "plant"), rows)


STUDY = Study(
    "benchmark",
    "The Bouc-Wen benchmark: hysteresis inside a vibrating structure",
    run_study,
    page=__name__,
)
