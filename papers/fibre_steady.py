"""Steady behaviour of the polyaniline fibre: identification, prediction and inverse on the twin.

Sohn et al. identify a fibre of polyaniline and carbon nanotubes by first-order reversal curves and
predict its length after seven voltages. This study does the same, and compares it with a decaying
staircase, and with a generalised Prandtl-Ishlinskii operator and a polynomial fitted to the same
points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.connect import connect
from minorloop.identification import Identification, excitation
from minorloop.lab.actuator import Actuator
from minorloop.lab.settled_holds import FURTHER, hold_each
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Preisach
from papers.facts import identify_settled
from papers.harness import rms

LOW, HIGH, BANDS, HOLD = 0.20, 0.65, 9, 300.0
VALIDATION = (0.45, 0.28, 0.34, 0.20, 0.60, 0.36, 0.54)
"""The seven voltages of the paper, in V."""
NOISE = 1.0
"""Standard deviation of the measured length, in um: that of a good laser extensometer."""
_DEGREE, _TARGETS = 3, 14
"""Degree of the polynomial, a cubic, and number of targets, as of the ionic polymer."""
_MARGIN = 0.1
"""Share of the range at each end without targets, by trial."""


@dataclass(frozen=True, eq=False)
class Steady:
    """Settled measurements and models fitted to them; lengths in um, voltages in V.

    ``curves`` is the identification from reversal curves; ``validation`` (7,) the settled lengths
    after `VALIDATION`; ``predictions`` (7,) by model; ``targets`` (n,) and ``achieved`` (n,) by
    inverse.
    """

    curves: Identification
    validation: FloatArray
    predictions: dict[str, FloatArray]
    targets: FloatArray
    achieved: dict[str, FloatArray]

    @property
    def span(self) -> float:
        """Range of the settled length over the reversal curves, in um: full scale."""
        return float(np.ptp(self.curves.y))

    def figures(self) -> dict[str, Any]:
        """Return errors as fractions of full scale, and rms errors of the inverses in um."""
        steady: dict[str, Any] = {}
        for name, predicted in self.predictions.items():
            error = (predicted - self.validation) / self.span
            steady[f"{name}_nrmse"] = rms(error)
            steady[f"{name}_max"] = float(np.abs(error).max())
        inverse = {f"rms_{name}": rms(y - self.targets) for name, y in self.achieved.items()}
        inverse["rms_ratio"] = inverse["rms_polynomial"] / inverse["rms_curves"]
        return {"steady": steady, "inverse": inverse}


def run_steady(seed: int) -> Steady:
    """Identify one specimen twice, predict the seven voltages, and drive it to targets."""
    grid = uniform_levels(LOW, HIGH, BANDS)
    curves = _identified(seed, 0, grid, excitation.reversal_curves(grid))
    models: dict[str, Preisach | GeneralisedPrandtlIshlinskii | Polynomial] = {
        "curves": curves.model,
        "staircase": _identified(seed, 1, grid, excitation.decaying_staircase(grid)).model,
        "plays": GeneralisedPrandtlIshlinskii.fit(curves.u, curves.y),
        "polynomial": Polynomial.fit(curves.u, curves.y, degree=_DEGREE, low=LOW, high=HIGH),
    }
    _, validation = hold_each(fibre_at_rest(seed, 2), VALIDATION, HOLD)
    low, high = curves.model.range
    edge = _MARGIN * (high - low)
    targets = np.random.default_rng(seed).uniform(low + edge, high - edge, _TARGETS)
    achieved = {}
    for experiment, name in enumerate(("curves", "plays", "polynomial"), start=3):
        wanted = models[name].invert(targets, unreachable="clip").u
        fibre = fibre_at_rest(seed, experiment)
        _, achieved[name] = hold_each(fibre, np.clip(wanted, LOW, HIGH), HOLD)
    return Steady(
        curves=curves,
        validation=validation,
        predictions={name: model.simulate(VALIDATION) for name, model in models.items()},
        targets=targets,
        achieved=achieved,
    )


def new_fibre(seed: int, experiment: int) -> Actuator:
    """Return a specimen with a noisy sensor; every experiment has noise of its own."""
    noise_seed = seed + FURTHER * experiment
    return connect("twin:fibre", specimen=seed, noise=NOISE, seed=noise_seed)


def fibre_at_rest(seed: int, experiment: int) -> Actuator:
    """Return the fibre settled at the lowest voltage: negative saturation."""
    fibre = new_fibre(seed, experiment)
    fibre.apply(LOW, HOLD, 1.0)
    return fibre


def _identified(seed: int, experiment: int, grid: Levels, voltages: FloatArray) -> Identification:
    _, lengths = hold_each(new_fibre(seed, experiment), voltages, HOLD)
    # Part of the doping responds to the smallest reversal at once.
    return identify_settled(voltages, lengths, levels=grid)
