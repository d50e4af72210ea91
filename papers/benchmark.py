"""The Bouc-Wen benchmark: an oscillator with hysteresis, identified from its vibrations.

Four models are fitted to the noisy training record by the error of their simulation, and scored on
two records without noise. What is known grows from row to row: that the plant is linear, which is
wrong; that its hysteresis is one of plays, which is wrong too; that there is a hysteretic force,
but not its law; and the law of Bouc and Wen, but not its parameters, from a start that is 50 % off.
"""

from __future__ import annotations

from collections.abc import Callable
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
from minorloop.twins import bouc_wen as plant
from papers.claims import Claim

TITLE = "The Bouc-Wen benchmark: hysteresis inside a vibrating structure"
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

CLAIMS = (
    Claim("linear: multisine [m]", "linear.multisine", "1.6e-4 (linear)"),
    Claim("linear: sweep [m]", "linear.sweep", "-"),
    Claim("plays and cubic spring: multisine [m]", "plays.multisine", "4.5e-5 (dynoNet)"),
    Claim("plays and cubic spring: sweep [m]", "plays.sweep", "-"),
    Claim(
        "unknown law: multisine [m]",
        "unknown.multisine",
        "1.87e-5, 1.21e-5 (PNLSS), 7.5e-6 (best)",
        most=7e-6,
    ),
    Claim("unknown law: sweep [m]", "unknown.sweep", "-"),
    Claim("unknown law: parameters", "unknown.parameters", "217 (PNLSS, 1.21e-5)", most=60),
    Claim("unknown law: seconds", "unknown.seconds", "-"),
    Claim("law known: multisine [m]", "grey.multisine", "-", most=2e-7),
    Claim("law known: sweep [m]", "grey.sweep", "-", most=2.5e-6),
    Claim("law known: seconds", "grey.seconds", "-", most=10),
    Claim("law known: largest error of a parameter", "grey.worst_parameter", "-", percent=True),
    Claim("law known, force held between samples: multisine [m]", "held.multisine", "-"),
    Claim("output: multisine, rms [m]", "output.multisine", "6.7e-4"),
)


@dataclass(frozen=True, eq=False)
class Scored:
    """A model with its errors on both tests.

    Parameters
    ----------
    found : OscillatorIdentification
        The model and its fit.
    multisine, sweep : (T,) arrays
        Simulated less true displacements in m.
    seconds : float
        Seconds of the identification.
    """

    found: OscillatorIdentification
    multisine: FloatArray
    sweep: FloatArray
    seconds: float

    def figures(self) -> dict[str, float]:
        """Errors, and the number of parameters."""
        return {
            "multisine": _rms(self.multisine),
            "sweep": _rms(self.sweep),
            "training": self.found.error,
            "parameters": int(self.found.free.sum()),
            "seconds": self.seconds,
        }


@dataclass(frozen=True, eq=False)
class BenchmarkStudy:
    """The models of one training record.

    Parameters
    ----------
    seed : int
        Seed of the records.
    test, sweep : BenchmarkRecord
        The two tests.
    models : dict of Scored
        By the names in `MODELS`.
    held : float
        Error of the grey box in m on the multisine if its force is held between samples.
    """

    seed: int
    test: plant.BenchmarkRecord
    sweep: plant.BenchmarkRecord
    models: dict[str, Scored]
    held: float

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
            "output": {"multisine": _rms(self.test.y), "sweep": _rms(self.sweep.y)},
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
    held = _rms(error(models["grey"].found.model, test, "held"))
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


def _rms(error: FloatArray) -> float:
    return float(np.sqrt(np.mean(error**2)))
