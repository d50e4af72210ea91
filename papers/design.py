"""Fewer holds: the error of a model against the number of its measurements.

Four methods have the same budget: a decaying staircase with constrained least squares and, with
the prior, random inputs, a sequence designed without data, and inputs chosen from the measurements
before them. All are scored on inputs and targets that were not fitted, on both twins.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.connect import connect
from minorloop.identification import Gaussian, Identification, Plane, excitation, identify
from minorloop.identification.bands import Prediction
from minorloop.identification.design import design, next_input
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import hold_each
from minorloop.operators.memory import Memory
from papers.drawing import draw, level, on_axes, panel
from papers.facts import identify_settled
from papers.harness import Results, Study, rms

STAIRS = 10
"""Bands of the model of the staircase; those with the prior have 20."""
HOLDS = (8, 12, 16, 20, 28)
ALL_HOLDS = (*HOLDS, 56)
METHODS = {
    "staircase": ("decaying staircase, no prior", "C3", "s"),
    "random": ("random inputs, prior", "0.6", "v"),
    "design": ("designed without data, prior", "C2", "^"),
    "adaptive": ("chosen one by one, prior", "C0", "o"),
}
"""Words, colour and mark of each."""


@dataclass(frozen=True)
class DesignSetup:
    """A kind of twin to measure."""

    title: str
    name: str
    low: float
    high: float
    """Range of the input, in V."""
    seconds: float
    """Duration of a hold."""
    noise: float
    """Known standard deviation of a measurement, half a percent of full scale, in 1/m or um."""

    def begin(self, seed: int, noise: float) -> Callable[[float], float]:
        """Return a function that holds an input at a new specimen, and reads the output."""
        twin = connect(f"twin:{self.name}", specimen=seed, noise=noise, seed=seed)
        return lambda u: float(hold_each(twin, [u], self.seconds, self.seconds)[1][0])


TWINS = (
    DesignSetup("ionic polymer strip", "ipmc", -1.2, 1.2, 200.0, 0.1),
    DesignSetup("polyaniline fibre", "fibre", 0.20, 0.65, 300.0, 1.0),
)


class Score(NamedTuple):
    """Errors of one model on data that were not fitted, over full scale."""

    holds: int
    holdout: float
    positioning: float
    coverage: float = math.nan
    width_ratio: float = math.nan


def run_study(seed: int) -> Results:
    """Measure a specimen of each twin with all four methods."""
    twins = {plant.name: compare(plant, seed) for plant in TWINS}
    figures = {name: one.figures() for name, one in twins.items()}
    return Results(figures, seed=seed, twins=twins)


def compare(plant: DesignSetup, seed: int) -> Results:
    """Measure a plant with four methods, and score every model on the same unseen inputs.

    ``curves`` are the scores of each method; ``inputs`` (28,) those of the adaptive sequence;
    ``shown`` its prediction for the unseen inputs after 12 holds, ``truth`` (40,) the true
    outputs.
    """
    trial = _Trial(plant, seed)
    grid = uniform_levels(plant.low, plant.high, 20)
    stairs = excitation.decaying_staircase(uniform_levels(plant.low, plant.high, STAIRS))
    rng = np.random.default_rng([seed, 2])
    random = np.concatenate([[plant.low], rng.uniform(plant.low, plant.high, ALL_HOLDS[-1] - 1)])
    designed = design(grid, HOLDS[-1])
    models = trial.adaptive(grid, designed[:4])
    curves = {
        "staircase": [trial.score(trial.plain(stairs[:n])) for n in ALL_HOLDS],
        "random": [trial.score(trial.with_prior(grid, random[:n])) for n in ALL_HOLDS],
        "design": [trial.score(trial.with_prior(grid, designed[:n])) for n in HOLDS],
        "adaptive": [trial.score(models[n]) for n in HOLDS],
    }
    return Results(
        _figures(curves), plant=plant, scale=trial.scale, curves=curves,
        inputs=models[HOLDS[-1]].u, shown=trial.predicted(models[12]), truth=trial.unseen_outputs,
    )  # fmt: skip


class _Trial:
    """A plant, and inputs and targets that are not fitted; errors are over its true full scale."""

    def __init__(self, plant: DesignSetup, seed: int) -> None:
        self.plant, self.seed = plant, seed
        rng = np.random.default_rng([seed, 1])
        self.unseen = rng.uniform(plant.low, plant.high, 40)
        ends = np.array([plant.low, plant.high])
        self.scale = float(np.ptp(self.settled(ends, noise=0.0)))
        self.unseen_outputs = self.settled(np.append(plant.low, self.unseen), noise=0.0)[1:]
        low, high = self.settled(ends)
        edge = 0.05 * (high - low)
        self.targets = rng.uniform(low + edge, high - edge, 14)

    def settled(self, u: FloatArray, noise: float | None = None) -> FloatArray:
        """Return settled outputs for inputs, from rest."""
        hold = self.plant.begin(self.seed, self.plant.noise if noise is None else noise)
        return np.array([hold(float(value)) for value in u])

    def plain(self, u: FloatArray) -> Identification:
        """Return a fit to a staircase as in the papers: a uniform density in every cell."""
        grid = uniform_levels(self.plant.low, self.plant.high, STAIRS)
        return identify_settled(u, self.settled(u), levels=grid, prior="none", diagonal="uniform")

    def with_prior(
        self, grid: Levels, u: FloatArray, y: FloatArray | None = None
    ) -> Identification:
        """Return a fit with the prior to inputs, which are applied if no outputs are given."""
        law = Plane(grid, diagonal="reversible", slope=False, lag=0)
        record = Record(u, self.settled(u) if y is None else y, sd=self.plant.noise)
        return identify(record, law, prior=Gaussian())

    def adaptive(self, grid: Levels, first: FloatArray) -> dict[int, Identification]:
        """Return models after `HOLDS` inputs; the models choose all inputs after the first ones."""
        hold = self.plant.begin(self.seed, self.plant.noise)
        u, y = list(first), [hold(float(value)) for value in first]
        found = {}
        while True:
            fit = self.with_prior(grid, np.array(u), np.array(y))
            if len(u) in HOLDS:
                found[len(u)] = fit
            if len(u) == HOLDS[-1]:
                return found
            memory = Memory.after(u, low=self.plant.low, high=self.plant.high)
            u.append(next_input(fit, memory).u)
            y.append(hold(u[-1]))

    def score(self, fit: Identification) -> Score:
        """Return the errors on unseen inputs and at the targets."""
        missed = fit.model.simulate(np.append(self.plant.low, self.unseen))[1:]
        holdout = rms(missed - self.unseen_outputs)
        inputs = fit.model.invert(self.targets, unreachable="clip").u
        achieved = self.settled(np.append(self.plant.low, inputs), noise=0.0)[1:]
        errors = holdout / self.scale, rms(achieved - self.targets) / self.scale
        if fit.posterior is None:
            return Score(fit.u.size, *errors)
        shown = self.predicted(fit)
        width = float(np.mean(shown.sd)) / holdout
        return Score(fit.u.size, *errors, shown.covers(self.unseen_outputs), width)

    def predicted(self, fit: Identification) -> Prediction:
        """Return predictions of the true outputs for the unseen inputs, with bands of 90 %."""
        whole = fit.predict(np.append(self.plant.low, self.unseen), bands=0.9)
        return replace(whole, u=whole.u[1:], y=whole.y[1:], sd=whole.sd[1:]).without_noise()


def _figures(curves: Mapping[str, Sequence[Score]]) -> dict[str, Any]:
    at_12, baseline = (
        next(score for score in curves[method] if score.holds == holds)
        for method, holds in (("adaptive", 12), ("staircase", 56))
    )
    late = [score for score in curves["adaptive"] if score.holds >= 16]
    return {
        "positioning_12": at_12.positioning,
        "holdout_12": at_12.holdout,
        "baseline_56": baseline.positioning,
        "beats_baseline_at_12_mean": at_12.positioning < baseline.positioning,
        "coverage_16_28": float(np.mean([score.coverage for score in late])),
        "width_ratio": float(np.mean([score.width_ratio for score in late])),
        "curves": {
            method: {
                name: [getattr(score, name) for score in scores]
                for name in ("holds", "holdout", "positioning")
            }
            for method, scores in curves.items()
        },
    }


def draw_curves(runs: Sequence[Mapping[str, Any]]) -> Any:
    """Draw the positioning error against the number of holds, median and middle half."""
    panels = []
    for twin in TWINS:
        lines: list[Any] = []
        for method, (words, colour, mark) in METHODS.items():
            curves = [run[twin.name]["curves"][method] for run in runs]
            holds = curves[0]["holds"]
            errors = 100 * np.array([curve["positioning"] for curve in curves])
            low, middle, high = np.quantile(errors, [0.25, 0.5, 0.75], axis=0)
            lines.append((holds, middle, f"{colour} {mark}- 1.2", words))
            lines.append(on_axes("fill_between", holds, low, high, color=colour, alpha=0.15, lw=0))
        y = "positioning error, rms [% of full scale]"
        frame: dict[str, Any] = {"title": twin.title, "xscale": "log", "yscale": "log"}
        panels.append(panel("settled holds", y, *lines, _ticks, legend={"fontsize": 9}, **frame))
    return draw(*panels, columns=2, height=4.2, sharey=True)


def _ticks(axes: Any) -> None:
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_ticks(ALL_HOLDS, [f"{each:g}" for each in ALL_HOLDS])
    percents = (0.5, 1, 2, 5, 10)
    axes.yaxis.set_ticks(percents, [f"{each:g}" for each in percents])
    axes.minorticks_off()


def draw_bands(one: Results) -> Any:
    """Draw predictions of unseen inputs with bands, and the chosen inputs."""
    half = np.vstack([one.shown.half_width, one.shown.half_width]) / one.scale * 100
    error = (one.shown.y - one.truth) / one.scale * 100
    style = {"fmt": "o", "ms": 3, "lw": 0.9, "color": "C0", "label": "90 % band"}
    y, hold = "predicted minus true [% of full scale]", np.arange(1, one.inputs.size + 1)
    return draw(
        panel(
            "unseen input", y, level(0.0),
            on_axes("errorbar", np.arange(one.truth.size), error, half, **style),
        ),
        panel(
            "hold", "input chosen [V]", (hold, one.inputs, "C0 o- 0.7"),
            on_axes("axvline", 12.5, color="0.5", lw=0.8, ls="--"),
        ),
        columns=2, width_ratios=[2, 1],
    )  # fmt: skip


STUDY = Study(
    "design", "Fewer holds: prior, bands and the next best input", run_study, page=__name__
)
