"""The polyaniline fibre paper, reproduced on the twin.

Sohn and colleagues (Modeling hysteresis and step response of a carbon-nanotube-reinforced
electroactive actuator) identify a Preisach model by first-order reversal curves and the transition
between settled lengths by an ARX model of a single step, and combine the two. They explain their
error on downward steps by the single step. So this study also measures a downward step.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.trajectory import Trajectory
from minorloop.identification.arx import arx, step_response
from minorloop.identification.baseline import nrmse
from minorloop.identification.linear_fit import LinearFit, StepResponse
from minorloop.lab.records import Record
from minorloop.lab.settled_holds import hold_each, settled_value
from minorloop.operators.relays import RelayModel
from minorloop.twins.fibre import Fibre
from papers.facts import ProbeInputs, twin_facts
from papers.fibre_steady import (
    HIGH,
    HOLD,
    LOW,
    VALIDATION,
    Steady,
    fibre_at_rest,
    new_fibre,
    run_steady,
)

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


@dataclass(frozen=True, eq=False)
class FibreStudy:
    """Everything that one specimen gave.

    ``steps`` are the holds at `STEPS`; ``fit`` the ARX model of the first, ``responses`` the
    unit steps up and down; ``validation`` the record of the seven voltages; ``single`` and
    ``updown`` (T,) what the joined models give at its times, in um.
    """

    seed: int
    facts: dict[str, Any]
    steady: Steady
    major: Record
    steps: tuple[Record, ...]
    fit: LinearFit
    responses: StepResponse
    free_run: FloatArray
    known: dict[str, float]
    validation: Record
    single: FloatArray
    updown: FloatArray
    seconds: float

    def figures(self) -> dict[str, Any]:
        """Every number by the name under which it is printed."""
        y = self.validation.y
        single, updown = (nrmse(joined - y, y) for joined in (self.single, self.updown))
        measured = _averaged(unit_step(self.steps[1], self.steps[2]))
        return {
            "twin": self.facts,
            **self.steady.figures(),
            "trajectory": {
                "single_nrmse": single,
                "updown_nrmse": updown,
                "updown_over_single": updown / single,
            },
            "arx": {
                "dc_gain_error": max(abs(self.fit.model.dc_gain - 1), self.known["dc_gain_error"]),
                "linear_pole_error": self.known["pole_error"],
                "free_run_nrmse": nrmse(_averaged(self.free_run) - measured, measured),
                "order": self.fit.model.order,
            },
            "seconds": self.seconds,
        }


def run_study(seed: int) -> FibreStudy:
    """Carry the whole study out on one specimen.

    Parameters
    ----------
    seed : int
        Draws specimen and targets.
    """
    began = time.perf_counter()
    steady = run_steady(seed)
    steps = _steps(seed)
    fit = arx(*_joined(steps[0], steps[1]))
    down = step_response(*_joined(steps[2], steps[3])).falling
    assert down is not None
    up = step_response(*_joined(steps[0], steps[1])).rising
    assert up is not None
    after = steps[2].t - steps[1].t[-1]
    validation, _ = hold_each(fibre_at_rest(seed, 6), VALIDATION, HOLD, INTERVAL)
    model = steady.curves.model
    joined = [
        Trajectory(model, up.model, falling).simulate(validation.t, validation.u, before=LOW)
        for falling in (None, down.model)
    ]
    grid = np.linspace(LOW, HIGH, 37)
    return FibreStudy(
        seed=seed,
        facts={**twin_facts(Fibre, PROBES), **_times(Fibre())},
        steady=steady,
        major=hold_each(new_fibre(seed, 8), np.concatenate([grid, grid[::-1]]), HOLD, HOLD)[0],
        steps=steps,
        fit=fit,
        responses=StepResponse(up, down),
        free_run=fit.model.step_response(after),
        known=_known_plant(seed),
        validation=validation,
        single=joined[0],
        updown=joined[1],
        seconds=time.perf_counter() - began,
    )


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
