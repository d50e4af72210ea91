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
from papers.facts import identify_settled
from papers.harness import Results, rms

BANDS, STAIRS = 20, 10
"""Bands of the models with the prior, and of the staircase."""
HOLDS = (8, 12, 16, 20, 28)
ALL_HOLDS = (*HOLDS, 56)
FIRST = 4
"""First holds of the adaptive sequence, which come from the design without data."""
UNSEEN, TARGETS = 40, 14
MARGIN = 0.05
"""Share of full scale at each end without targets."""
PROBABILITY = 0.9
METHODS = ("staircase", "random", "design", "adaptive")

Hold = Callable[[float], float]
"""Applies an input, waits, and returns the settled output."""


@dataclass(frozen=True)
class DesignSetup:
    """A kind of twin to measure."""

    name: str
    low: float
    high: float
    """Range of the input, in V."""
    seconds: float
    """Duration of a hold."""
    noise: float
    """Standard deviation of a measurement, known as that of a sensor is: half a percent of full
    scale, in 1/m or um."""

    def begin(self, seed: int, noise: float) -> Hold:
        """Return what holds inputs at the specimen of a seed, from rest."""
        twin = connect(f"twin:{self.name}", specimen=seed, noise=noise, seed=seed)
        return lambda u: float(hold_each(twin, [u], self.seconds, self.seconds)[1][0])


TWINS = (
    DesignSetup("ipmc", -1.2, 1.2, 200.0, 0.1),
    DesignSetup("fibre", 0.20, 0.65, 300.0, 1.0),
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


def score_at(scores: Sequence[Score], holds: int) -> Score:
    """Return the score at a number of holds."""
    return next(score for score in scores if score.holds == holds)


def compare(plant: DesignSetup, seed: int) -> Results:
    """Measure a plant with four methods, and score every model on the same unseen inputs.

    ``curves`` are the scores of each method; ``inputs`` (28,) what the adaptive sequence
    applied; ``shown`` its prediction of the unseen inputs after 12 holds, ``truth`` (40,) what
    they gave.
    """
    trial = _Trial(plant, seed)
    grid = uniform_levels(plant.low, plant.high, BANDS)
    stairs = excitation.decaying_staircase(uniform_levels(plant.low, plant.high, STAIRS))
    rng = np.random.default_rng([seed, 2])
    random = np.concatenate([[plant.low], rng.uniform(plant.low, plant.high, ALL_HOLDS[-1] - 1)])
    designed = design(grid, HOLDS[-1])
    models = trial.adaptive(grid, designed[:FIRST])
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
        self.unseen = rng.uniform(plant.low, plant.high, UNSEEN)
        ends = np.array([plant.low, plant.high])
        self.scale = float(np.ptp(self.settled(ends, noise=0.0)))
        self.unseen_outputs = self.settled(np.append(plant.low, self.unseen), noise=0.0)[1:]
        low, high = self.settled(ends)
        edge = MARGIN * (high - low)
        self.targets = rng.uniform(low + edge, high - edge, TARGETS)

    def settled(self, u: FloatArray, noise: float | None = None) -> FloatArray:
        """Return settled outputs for inputs, from rest."""
        hold = self.plant.begin(self.seed, self.plant.noise if noise is None else noise)
        return np.array([hold(float(value)) for value in u])

    def plain(self, u: FloatArray) -> Identification:
        """Return a fit to a staircase as in the papers: a uniform density in every cell."""
        grid = uniform_levels(self.plant.low, self.plant.high, STAIRS)
        return identify_settled(u, self.settled(u), levels=grid, prior="none", diagonal="uniform")

    def with_prior(self, grid: Levels, u: FloatArray) -> Identification:
        """Return a fit with the prior to inputs that were chosen beforehand."""
        return self._fit(grid, u, self.settled(u))

    def adaptive(self, grid: Levels, first: FloatArray) -> dict[int, Identification]:
        """Return models after `HOLDS` chosen inputs."""
        hold = self.plant.begin(self.seed, self.plant.noise)
        u, y = list(first), [hold(float(value)) for value in first]
        found = {}
        while True:
            fit = self._fit(grid, np.array(u), np.array(y))
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
        """Return predictions of the true outputs for the unseen inputs, with bands."""
        whole = fit.predict(np.append(self.plant.low, self.unseen), bands=PROBABILITY)
        return replace(whole, u=whole.u[1:], y=whole.y[1:], sd=whole.sd[1:]).without_noise()

    def _fit(self, grid: Levels, u: FloatArray, y: FloatArray) -> Identification:
        law = Plane(grid, diagonal="reversible", slope=False, lag=0)
        return identify(Record(u, y, sd=self.plant.noise), law, prior=Gaussian())


def _figures(curves: Mapping[str, Sequence[Score]]) -> dict[str, Any]:
    at_12, baseline = score_at(curves["adaptive"], 12), score_at(curves["staircase"], 56)
    late = [score for score in curves["adaptive"] if score.holds >= 16]
    names = ("holds", "holdout", "positioning")
    return {
        "positioning_12": at_12.positioning,
        "holdout_12": at_12.holdout,
        "baseline_56": baseline.positioning,
        "baseline_56_holdout": baseline.holdout,
        "beats_baseline_at_12_mean": at_12.positioning < baseline.positioning,
        "coverage_16_28": float(np.mean([score.coverage for score in late])),
        "width_ratio": float(np.mean([score.width_ratio for score in late])),
        "curves": {
            method: {name: [getattr(score, name) for score in scores] for name in names}
            for method, scores in curves.items()
        },
    }
