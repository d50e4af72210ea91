"""The Bouc-Wen benchmark: an oscillator with hysteresis, identified from its vibrations.

Four models are fitted to the noisy training record by the error of their simulation, and scored on
two records without noise. Their prior knowledge grows: a linear plant, which is wrong; hysteresis
of plays, which is wrong too; a hysteretic force with an unknown law; and the law of Bouc and Wen
with unknown parameters, starting from the linear model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.oscillator import Oscillator
from minorloop.identification.oscillator import Vibration
from minorloop.lab.records import Record
from minorloop.operators.differential import BoucWen
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.report import Table
from papers import bouc_wen as plant
from papers.drawing import draw, on_axes, panel
from papers.harness import Results, Study, rms

PLAYS = 6
"""Number by trial: twelve are hardly better, and unstable for some forces."""
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
"""Model, error on the multisine in m, number of parameters, and publication."""
_COLOURS = {"linear": "C3", "plays": "C1", "unknown": "C0", "grey": "C2"}


def run_study(seed: int) -> Results:
    """Fit and score all models.

    The seed draws both multisines and the noise. ``models`` has, by the names in `MODELS`, the
    result ``found``, and the errors (T,) in m of the simulated displacement in both tests,
    ``multisine`` and ``sweep``; ``test`` and ``sweep`` are the records.
    """
    training, test = plant.training_record(seed), plant.multisine_test(seed)
    sweep = plant.sweep_test()
    # The filters are a data sheet of the converter. The first two pass the band of the third.
    # The integration has 3,750 steps per second, a fourth of the number of the twin.
    options: dict[str, Any] = {"substeps": 5, "stages": tuple(plant.filters()[-1:])}

    def error(model: Oscillator, record: Record, between: Any = "band") -> FloatArray:
        # A converter holds a sample until the next one; `held` is over the interval before it.
        force = np.roll(record.u, 1) if between == "held" else record.u
        periodic = record is not sweep  # which begins at rest
        y = model.simulate(record.t, force, between=between, periodic=periodic, **options)
        return np.asarray(y - record.y)

    def scored(start: Any, fixed: tuple[str, ...] = ()) -> Results:
        began = perf_counter()
        law = Vibration(start, plant.PERIOD, fixed=fixed, **options)
        found = law.identify(training)
        seconds = perf_counter() - began
        errors = {"multisine": error(found.model, test), "sweep": error(found.model, sweep)}
        figures = {
            **{name: rms(each) for name, each in errors.items()},
            "parameters": int(found.free.sum()),
            "seconds": seconds,
        }
        return Results(figures, found=found, **errors)

    unknown = scored("unknown")
    known, widest = unknown.found.model, float(np.abs(training.y).max())
    # The slope of a hysteretic force that is none: a hundred millionth of the stiffness.
    none = BoucWen(1e-3, 0.0, 0.0)
    still = Oscillator(known.mass, known.damping, 2 * known.stiffness[0], none)
    linear = scored(still, ("alpha", "gamma", "delta", "exponent"))
    start = linear.found.model
    # A cubic restoring force, and plays of weight zero.
    radii = widest * np.arange(1, PLAYS + 1) / (PLAYS + 1)
    springs = np.concatenate([start.stiffness, np.zeros(2)])
    operator = PrandtlIshlinskii(radii, np.zeros(PLAYS))
    plays = scored(replace(start, stiffness=springs, operator=operator))
    # Half of the stiffness is hysteretic, and bends within the record.
    half, bend = start.stiffness / 2, 0.5 / widest
    law = BoucWen(float(half[0]), bend, -bend)
    grey = scored(replace(start, stiffness=half, operator=law))
    models = {"linear": linear, "plays": plays, "unknown": unknown, "grey": grey}
    worst = float(np.abs(grey.found.parameters / true_parameters() - 1).max())
    figures = {
        **{name: one.figures() for name, one in models.items()},
        "grey": {**grey.figures(), "worst_parameter": worst},
        "held": {"multisine": rms(error(grey.found.model, test, "held"))},
        "output": {"multisine": rms(test.y), "sweep": rms(sweep.y)},
    }
    return Results(figures, seed=seed, test=test, sweep=sweep, models=models)


def true_parameters() -> FloatArray:
    """Return the identifiable parameters of the plant: with the products of beta."""
    law = plant.PARAMETERS
    first = [law["mass"], law["damping"], law["stiffness"], law["alpha"]]
    return np.array(
        [*first, law["beta"] * law["gamma"], law["beta"] * law["delta"], law["exponent"]]
    )


def published_table(figures: Mapping[str, Any]) -> Table:
    """Return our errors on the multisine and published ones, the largest first."""
    ours = [
        (words, f"{figures[name]['multisine']:.2g}", f"{figures[name]['parameters']:.0f}", "ours")
        for name, words in MODELS.items()
    ]
    rows = sorted([*ours, *PUBLISHED], key=lambda row: -float(row[1]))
    return Table(("model", "multisine, rms error [m]", "parameters", "source"), rows)


def draw_spectra(study: Results) -> Any:
    """Draw the spectrum of the multisine response, and of the error of each model."""

    def spectrum(signal: FloatArray) -> tuple[FloatArray, FloatArray]:
        # Means over 32 lines: single lines of a random-phase multisine scatter.
        rows = (2 * np.abs(np.fft.rfft(signal)) / signal.size)[1:].reshape(-1, 32)
        middle = (np.arange(len(rows)) + 0.5) * 32 * plant.RATE / signal.size
        return middle, np.sqrt(np.mean(rows**2, axis=1))

    lines = _lines(study, "multisine", study.test.y, spectrum)
    limits = {"yscale": "log", "xlim": (0, plant.RATE / 2)}
    return draw(panel("frequency [Hz]", "amplitude [m]", *lines, **limits), height=4.0)


def draw_sweep(study: Results) -> Any:
    """Draw the largest errors of each model against the frequency of the sweep."""
    first, last, _, _ = plant.SWEEP

    def largest(signal: FloatArray) -> tuple[FloatArray, list[float]]:
        parts = np.array_split(np.abs(signal), 200)
        return np.linspace(first, last, len(parts)), [part.max() for part in parts]

    lines = _lines(study, "sweep", study.sweep.y, largest)
    words = "frequency of the sweep [Hz]", "largest, absolute [m]"
    return draw(panel(*words, *lines, yscale="log"), height=3.6)


def _lines(study: Results, test: str, y: FloatArray, curve: Callable[..., Any]) -> list[Any]:
    """Return curves of the displacement and of the errors of each model."""
    errors = [
        (*curve(getattr(one, test)), f"{_COLOURS[name]} - 1.2", MODELS[name])
        for name, one in study.models.items()
    ]
    return [(*curve(y), "0.3 - 1.2", "displacement"), *errors]


def draw_law(study: Results) -> Any:
    """Draw the free slopes with their uncertainty, and those of the plant."""
    found = study.models["unknown"].found
    law = found.model.operator
    sd = np.split(found.sd[found.parameters.size - 2 * law.levels.size :], 2)
    z = np.linspace(law.levels[0], law.levels[-1], 400)
    true = BoucWen(*true_parameters()[3:]).slopes(z)
    most = 1.2 * max(float(both.max()) for both in true) / 1e3

    style = {"fmt": "o-", "ms": 3, "lw": 1, "color": "C0", "label": "found"}
    sides = zip(("rising", "falling"), (law.rising, law.falling), sd, true, strict=True)
    panels = [
        panel(
            "hysteretic force [N]", "slope [N/mm]", (z, both / 1e3, "0.3", "plant"),
            on_axes("errorbar", law.levels, values / 1e3, 2 * one / 1e3, **style),
            title=f"displacement {name}", ylim=(0, most),
        )
        for name, values, one, both in sides
    ]  # fmt: skip
    return draw(*panels, columns=2, height=3.6, sharey=True)


def parameter_table(study: Results) -> Table:
    """Return the identified parameters beside the true ones."""
    found = study.models["grey"].found
    rows = [
        (name, f"{value:.6g}", f"{sd:.2g}", f"{true:g}")
        for name, value, sd, true in zip(
            found.names, found.parameters, found.sd, true_parameters(), strict=True
        )
    ]
    return Table(("parameter", "found", "standard deviation", "plant"), rows)


STUDY = Study(
    "benchmark", "The Bouc-Wen benchmark: hysteresis inside a vibrating structure", run_study,
    page=__name__,
)  # fmt: skip
