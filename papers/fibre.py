"""The polyaniline fibre paper, reproduced on the twin.

Sohn and colleagues (Modeling hysteresis and step response of a carbon-nanotube-reinforced
electroactive actuator) identify a Preisach model by first-order reversal curves and the transition
between settled lengths by an ARX model of a single step, and combine the two. They explain their
error on downward steps by the single step. So this study also measures a downward step.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from minorloop.arrays import FloatArray, Levels, uniform_levels
from minorloop.connect import connect
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.trajectory import Trajectory
from minorloop.identification import Identification, excitation
from minorloop.identification.arx import arx, step_response
from minorloop.identification.baseline import nrmse
from minorloop.identification.linear_fit import StepResponse
from minorloop.lab.actuator import Actuator
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import FURTHER, hold_each, settled_value
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel
from minorloop.twins.fibre import Fibre
from papers.facts import ProbeInputs, identify_settled, twin_facts
from papers.harness import Results, rms

LOW, HIGH, BANDS, HOLD = 0.20, 0.65, 9, 300.0
VALIDATION = (0.45, 0.28, 0.34, 0.20, 0.60, 0.36, 0.54)
"""The seven voltages of the paper, in V."""
NOISE = 1.0
"""Standard deviation of the measured length, in um: that of a good laser extensometer."""
_DEGREE, _TARGETS = 3, 14
"""Degree of the polynomial, a cubic, and number of targets, as of the ionic polymer."""
_MARGIN = 0.1
"""Share of the range at each end without targets, by trial."""


def run_steady(seed: int) -> Results:
    """Identify one specimen twice, predict the seven voltages, and drive it to targets.

    ``curves`` is the identification from reversal curves; ``validation`` (7,) the settled lengths
    in um after `VALIDATION`; ``predictions`` (7,) by model; ``targets`` (n,) and ``achieved`` (n,)
    by inverse. Figures are errors as fractions of full scale, the range of the settled length over
    the reversal curves, and rms errors of the inverses in um.
    """
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
    predictions = {name: model.simulate(VALIDATION) for name, model in models.items()}
    steady, span = {}, float(np.ptp(curves.y))
    for name, predicted in predictions.items():
        error = (predicted - validation) / span
        steady[f"{name}_nrmse"], steady[f"{name}_max"] = rms(error), float(np.abs(error).max())
    inverse = {f"rms_{name}": rms(y - targets) for name, y in achieved.items()}
    inverse["rms_ratio"] = inverse["rms_polynomial"] / inverse["rms_curves"]
    return Results(
        {"steady": steady, "inverse": inverse}, curves=curves, validation=validation,
        predictions=predictions, targets=targets, achieved=achieved,
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


def _identified(seed: int, experiment: int, grid: Levels, voltages: FloatArray) -> Identification:
    _, lengths = hold_each(new_fibre(seed, experiment), voltages, HOLD)
    # Part of the doping responds to the smallest reversal at once.
    return identify_settled(voltages, lengths, levels=grid)


PROBES = ProbeInputs(low=LOW, high=HIGH, bands=9, hold=HOLD, loop=(0.35, 0.45), excursion=0.35)
STEPS = (0.40, 0.45, 0.50, 0.45)
"""Voltages of the step experiment in V: the paper's step, one to score it on, and one down."""
REST, INTERVAL = 600.0, 1.0
STEP_REPEATS = 4
"""Times that the steps are measured and averaged: the sensor's noise is 3 % of one step."""
MARKER = ("u4", "u6", "u2", "u4")
MARKER_LEVELS = 6
KNOWN_LAGS = (27.0, 6.0)
"""Time constants in seconds of the linear plant that must be recovered."""
KNOWN_NOISE = 5e-4
"""Standard deviation of its noise, over its step; by trial."""


def run_study(seed: int) -> Results:
    """Carry the whole study out on the specimen of a seed.

    ``steps`` are the holds at `STEPS`; ``fit`` is the ARX model of the first, ``responses`` the
    unit steps up and down; ``validation`` the record of the seven voltages; ``single`` and
    ``updown`` (T,) what the joined models give at its times, in um.
    """
    began = time.perf_counter()
    steady = run_steady(seed)
    steps = _steps(seed)
    fit = arx(*_joined(steps[0], steps[1]))
    down = step_response(*_joined(steps[2], steps[3])).falling
    up = step_response(*_joined(steps[0], steps[1])).rising
    assert down is not None
    assert up is not None
    validation, _ = hold_each(fibre_at_rest(seed, 6), VALIDATION, HOLD, INTERVAL)
    t, u, y = validation.t, validation.u, validation.y
    single, updown = (
        Trajectory(steady.curves.model, up.model, falling).simulate(t, u, before=LOW)
        for falling in (None, down.model)
    )
    facts = {**twin_facts(Fibre, PROBES), **_times(Fibre())}
    known = _known_plant(seed)
    free_run = _averaged(fit.model.step_response(steps[2].t - steps[1].t[-1]))
    measured = _averaged(unit_step(steps[1], steps[2]))
    one_way, both_ways = (nrmse(joined - y, y) for joined in (single, updown))
    figures = {
        "twin": facts,
        **steady.figures(),
        "trajectory": {
            "single_nrmse": one_way,
            "updown_nrmse": both_ways,
            "updown_over_single": both_ways / one_way,
        },
        "arx": {
            "dc_gain_error": max(abs(fit.model.dc_gain - 1), known["dc_gain_error"]),
            "linear_pole_error": known["pole_error"],
            "free_run_nrmse": nrmse(free_run - measured, measured),
            "order": fit.model.order,
        },
        "seconds": time.perf_counter() - began,
    }
    grid = np.linspace(LOW, HIGH, 37)
    major = hold_each(new_fibre(seed, 8), np.concatenate([grid, grid[::-1]]), HOLD, HOLD)[0]
    return Results(
        figures, seed=seed, facts=facts, steady=steady, major=major, steps=steps, fit=fit,
        responses=StepResponse(up, down), validation=validation, single=single, updown=updown,
    )  # fmt: skip


def marker_diagrams() -> list[tuple[str, FloatArray]]:
    """Fig 2: which relays are on after each input of the paper's example.

    Returns
    -------
    list of tuple
        The input, and (N, N) relays ``[alpha, beta]``: 1 on, -1 off, NaN where there is none.
    """
    levels = np.arange(1.0, MARKER_LEVELS + 1)
    model = RelayModel(levels, np.tril(np.ones((MARKER_LEVELS, MARKER_LEVELS))), relay="unipolar")
    inputs = [float(name[1:]) for name in MARKER]
    there = np.tril(np.ones((MARKER_LEVELS, MARKER_LEVELS), dtype=bool))
    diagrams = []
    for count, name in enumerate(MARKER, start=1):
        on = model.states(inputs[:count]) > 0
        diagrams.append((name, np.where(there, np.where(on, 1.0, -1.0), np.nan)))
    return diagrams


def unit_step(before: Record, after: Record) -> FloatArray:
    """(T,) the hold ``after``, from 0 where ``before`` settled to 1 where it settled itself."""
    span = float(np.ptp(np.concatenate([before.y, after.y])))
    rest, end = settled_value(before, span), settled_value(after, span)
    return np.asarray((after.y - rest) / (end - rest))


def _steps(seed: int) -> tuple[Record, ...]:
    """Measure the steps several times, each time from saturation, and return their mean."""
    fibre = new_fibre(seed, 7)
    turns = []
    for _ in range(STEP_REPEATS):
        fibre.apply(LOW, HOLD, INTERVAL)
        holds = [(voltage, HOLD if k else REST) for k, voltage in enumerate(STEPS)]
        turns.append([fibre.apply(voltage, hold, INTERVAL) for voltage, hold in holds])
    return tuple(
        replace(records[0], y=np.mean([record.y for record in records], axis=0))
        for records in zip(*turns, strict=True)
    )


def _averaged(y: FloatArray) -> FloatArray:
    """Means over ten samples: the noise of a sample is 3 % of a step, that of the mean 1 %."""
    return np.asarray(y[: y.size // 10 * 10].reshape(-1, 10).mean(axis=1))


def _joined(before: Record, after: Record) -> tuple[FloatArray, FloatArray, FloatArray]:
    record = Record.joined([before, after])
    return record.t, record.u, record.y


def _known_plant(seed: int) -> dict[str, float]:
    """How well the time constants of a linear plant are found from its noisy step."""
    plant = Linear.lags(*KNOWN_LAGS)
    t = np.arange(1.0, REST + HOLD + 1)
    u = np.where(t <= REST, 0.0, 1.0)
    noise = np.random.default_rng(seed).normal(0, KNOWN_NOISE, t.size)
    fit = arx(t, u, plant.simulate(t, u, before=0.0) + noise)
    found, wanted = fit.model.time_constants, np.array(KNOWN_LAGS)
    nearest = np.abs(found[:, None] / wanted - 1).min(axis=0)
    return {
        "pole_error": float(nearest.max()),
        "dc_gain_error": abs(fit.model.dc_gain - 1),
    }


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
