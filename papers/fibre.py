"""The polyaniline fibre paper, reproduced on the twin.

Sohn and colleagues (Modeling hysteresis and step response of a carbon-nanotube-reinforced
electroactive actuator) identify the weights of relays, dots, by first-order reversal curves and the
transition between settled lengths by an ARX model of a single step, and combine the two. They
explain their error on downward steps by the single step. So this study also measures a downward
step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, uniform_levels
from minorloop.connect import connect
from minorloop.dynamics.trajectory import Trajectory
from minorloop.identification import excitation
from minorloop.identification.arx import arx, step_response
from minorloop.identification.baseline import nrmse
from minorloop.identification.linear_fit import StepResponse
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each, settled_value
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.relays import RelayModel
from minorloop.twins.fibre import Fibre
from papers.facts import ProbeInputs, identify_settled, twin_facts
from papers.harness import Results, rms

LOW, HIGH, BANDS, HOLD = 0.20, 0.65, 9, 300.0
VALIDATION = (0.45, 0.28, 0.34, 0.20, 0.60, 0.36, 0.54)
"""The seven voltages of the paper, in V."""
LEVELS = np.array([0.20, 0.28, 0.34, 0.36, 0.40, 0.45, 0.50, 0.54, 0.60, 0.65])
"""Levels of the dots: those of the seven voltages and of the step, as many as of every 0.05 V. The
paper does not give its levels; a dot is switched by inputs on levels only."""
NOISE = 1.0
"""Standard deviation of the measured length, in um: that of a good laser extensometer."""


def run_steady(seed: int) -> Results:
    """Identify one specimen, predict the seven voltages, and drive it to targets.

    ``models`` are those identified: relays, ``square`` by the paper's system and ``dots`` by
    constrained least squares, cells that are ``uniform``, and ``curves`` with a reversible
    diagonal, all from reversal curves, and rivals. ``record`` and ``validation`` (7,) are the
    lengths in um along `VALIDATION`; ``predictions`` (7,) by model, with ``square_even`` and
    ``dots_even`` of relays on every 0.05 V, moved to the nearest level; ``targets`` (n,) and
    ``achieved`` (n,) by inverse. Figures are errors as fractions of full scale, the range of the
    settled length over the reversal curves, and rms errors of the inverses in um.
    """
    even = uniform_levels(LOW, HIGH, BANDS)
    settled = _settled(seed, 0, excitation.reversal_curves(even))
    on_levels = _settled(seed, 9, excitation.reversal_curves(LEVELS))
    models: dict[str, Any] = {
        "square": RelayModel.fit(*on_levels, LEVELS, signed=True),
        "dots": RelayModel.fit(*on_levels, LEVELS),
        "uniform": identify_settled(*settled, levels=even, diagonal="uniform").model,
        # Part of the doping responds to the smallest reversal at once.
        "curves": identify_settled(*settled, levels=even).model,
        "plays": GeneralisedPrandtlIshlinskii.fit(*settled),
        "polynomial": Polynomial.fit(*settled, degree=3, low=LOW, high=HIGH),
    }
    record, validation = hold_each(fibre_at_rest(seed, 2), VALIDATION, HOLD)
    predictions = {name: model.simulate(VALIDATION) for name, model in models.items()}
    for name in ("square", "dots"):
        relays = RelayModel.fit(*settled, even, signed=name == "square")
        nearest = np.abs(even - np.array(VALIDATION)[:, None]).argmin(axis=1)
        predictions[f"{name}_even"] = relays.simulate(even[nearest])
    low, high = models["curves"].range
    edge = 0.1 * (high - low)  # by trial
    targets = np.random.default_rng(seed).uniform(low + edge, high - edge, 14)
    achieved = {}
    for experiment, name in enumerate(("curves", "plays", "polynomial"), start=3):
        wanted = models[name].invert(targets, unreachable="clip").u
        fibre = fibre_at_rest(seed, experiment)
        _, achieved[name] = hold_each(fibre, np.clip(wanted, LOW, HIGH), HOLD)
    steady, span = {}, float(np.ptp(settled[1]))
    for name, predicted in predictions.items():
        error = (predicted - validation) / span
        steady[f"{name}_nrmse"], steady[f"{name}_max"] = rms(error), float(np.abs(error).max())
    inverse = {f"rms_{name}": rms(y - targets) for name, y in achieved.items()}
    inverse["rms_ratio"] = inverse["rms_polynomial"] / inverse["rms_curves"]
    return Results(
        {"steady": steady, "inverse": inverse}, models=models, record=record,
        validation=validation, predictions=predictions, targets=targets, achieved=achieved,
    )  # fmt: skip


def new_fibre(seed: int, experiment: int) -> Actuator:
    """Return a specimen with a noisy sensor; every experiment has noise of its own."""
    noise_seed = seed + FURTHER * experiment
    return connect("twin:fibre", specimen=seed, noise=NOISE, seed=noise_seed)


def fibre_at_rest(seed: int, experiment: int) -> Actuator:
    """Return the fibre settled at the lowest voltage: negative saturation."""
    fibre = new_fibre(seed, experiment)
    fibre.apply(LOW, HOLD, 1.0)
    return fibre


def _settled(seed: int, experiment: int, voltages: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return voltages and the settled lengths that they give."""
    return voltages, hold_each(new_fibre(seed, experiment), voltages, HOLD)[1]


PROBES = ProbeInputs(low=LOW, high=HIGH, bands=9, hold=HOLD, loop=(0.35, 0.45), excursion=0.35)
STEPS = (0.40, 0.45, 0.50, 0.45)
"""Voltages of the step experiment in V: the paper's step, one to score it on, and one down."""
REST, INTERVAL = 600.0, 1.0
MARKER = ("u4", "u6", "u2", "u4")
MARKER_LEVELS = 6


def run_study(seed: int) -> Results:
    """Carry the whole study out on the specimen of a seed.

    ``steps`` are the holds at `STEPS`; ``fit`` is the ARX model of the first, ``responses`` the
    unit steps up and down; ``single``, ``updown`` and ``ours`` (T,) what the joined models give at
    the times of the record of the seven voltages, in um: the first two with the paper's relays.
    """
    steady, fibre = run_steady(seed), fibre_at_rest(seed, 7)
    steps = [fibre.apply(u, HOLD if k else REST, INTERVAL) for k, u in enumerate(STEPS)]
    fit = arx(*_joined(steps[0], steps[1]))
    down = step_response(*_joined(steps[2], steps[3])).falling
    up = step_response(*_joined(steps[0], steps[1])).rising
    assert down is not None
    assert up is not None
    t, u, y = steady.record.t, steady.record.u, steady.record.y
    single, updown, ours = (
        Trajectory(steady.models[name], up.model, falling).simulate(t, u, before=LOW)
        for name, falling in (("square", None), ("square", down.model), ("curves", down.model))
    )
    facts = {**twin_facts(Fibre, PROBES), **_times(Fibre())}
    free_run = _averaged(fit.model.step_response(steps[2].t - steps[1].t[-1]))
    measured = _averaged(unit_step(steps[1], steps[2]))
    one_way, both_ways, with_ours = (nrmse(joined - y, y) for joined in (single, updown, ours))
    figures = {
        "twin": facts,
        **steady.figures(),
        "trajectory": {
            "single_nrmse": one_way,
            "updown_nrmse": both_ways,
            "ours_nrmse": with_ours,
            "updown_over_single": both_ways / one_way,
        },
        "arx": {"free_run_nrmse": nrmse(free_run - measured, measured), "order": fit.model.order},
    }
    return Results(
        figures, seed=seed, facts=facts, steady=steady, steps=steps, fit=fit,
        responses=StepResponse(up, down), single=single, updown=updown, ours=ours,
    )  # fmt: skip


def marker_diagrams() -> list[tuple[str, FloatArray]]:
    """Fig 2: which relays are on after each input of the paper's example.

    Returns
    -------
    list of tuple
        The input, and (N, N) relays ``[alpha, beta]``: 1 on, -1 off, NaN where there is none.
    """
    levels = np.arange(1.0, MARKER_LEVELS + 1)
    there = np.tri(MARKER_LEVELS)
    model = RelayModel(levels, there, relay="unipolar")
    inputs = [float(name[1:]) for name in MARKER]
    states = [2 * model.states(inputs[: count + 1]) - 1 for count in range(len(MARKER))]
    return [
        (name, np.where(there > 0, on, np.nan)) for name, on in zip(MARKER, states, strict=True)
    ]


def unit_step(before: Record, after: Record) -> FloatArray:
    """(T,) the hold ``after``, from 0 where ``before`` settled to 1 where it settled itself."""
    span = float(np.ptp(np.concatenate([before.y, after.y])))
    rest, end = settled_value(before, span), settled_value(after, span)
    return np.asarray((after.y - rest) / (end - rest))


def _averaged(y: FloatArray) -> FloatArray:
    """Means over ten samples: the noise of a sample is 3 % of a step, that of the mean 1 %."""
    return np.asarray(y[: y.size // 10 * 10].reshape(-1, 10).mean(axis=1))


def _joined(before: Record, after: Record) -> tuple[FloatArray, FloatArray, FloatArray]:
    record = Record.joined([before, after])
    return record.t, record.u, record.y


def _times(fibre: Fibre) -> dict[str, float]:
    """Seconds in which steps have come 63 % and 95 % of their way, up and down to 0.45 V."""
    found = {}
    for name, begin in (("up", 0.40), ("down", 0.50)):
        fibre.reset()
        held = fibre.apply(begin, REST, INTERVAL)
        share = unit_step(held, fibre.apply(0.45, REST, INTERVAL))
        for percent in (63, 95):
            found[f"{name}_t{percent}_s"] = float(np.argmax(share >= percent / 100) + 1) * INTERVAL
    return found
