"""Fig 8: ramps in open loop by the paper's inverse, and a hypothesis on their growing errors.

Boudjabi, Ferreira and Krupa drive the head by the inverse of a linear transfer function of the
heating and by the stepping inverse of the operator, without feedback. The head follows the first
rising ramp, but not later ones; they explain it by the variable dynamics of the heating. The same
chain drives the twin of all other runs here, whose latent heat and resistance vary. By hypothesis
its convection varies too, and its heat warms a body of the head, of assumed size.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.cascade import filtered_inverse
from minorloop.dynamics.linear import Linear
from minorloop.operators.preisach import Preisach
from minorloop_head.twins.head import Head
from minorloop_head.twins.surroundings import Cooling, Surroundings
from papers.catheter.head_loop import NOISE, TICK
from papers.catheter.head_static import COMMAND, CURRENT, heating_lag, identify_mesh
from papers.catheter.scoring import body_temperature
from papers.harness import Results, rms

LOW, HIGH, RAMPS, PERIOD, BEFORE = 5.0, 40.0, 10, 120.0, 30.0
"""Ends of the ramps in degrees, the upper one within the stroke of the weakest wire; their number;
seconds for one up and down, 15 lags of a wire each way, since the paper's inputs are slow; and
seconds before them at the lower end, in which the wire warms up."""
CASES = {"as it is": (None, PERIOD), "faster": (None, 30.0), "body": (Cooling(), PERIOD)}
"""The body of the head in which the model is identified and the ramps are driven, and the period of
the last ramp in seconds, from `PERIOD` to that of the faster circle. The first is the head of all
other runs, the last the hypothesis."""


def run_ramps(seed: int) -> dict[str, Results]:
    """Identify the paper's model in each kind of head, and drive the ramps by its inverse.

    ``t`` (T,) in seconds, ``wanted``, measured ``angle`` and ``error`` (T,) in degrees; ``rms``
    (n, 2) is the error of each ramp up and down. ``body_K`` is the warming of the body in kelvin.
    """
    models: dict[Cooling | None, tuple[Preisach, float]] = {}
    for cooling, _ in CASES.values():
        if cooling not in models:
            around = Surroundings(cooling=cooling)
            model = identify_mesh(seed, around).model
            models[cooling] = model, heating_lag(seed, model, around)
    return {name: _driven(seed, *case, *models[case[0]]) for name, case in CASES.items()}


def stepping_inverse(model: Preisach, wanted: FloatArray, step: float) -> FloatArray:
    """Return the inputs (T,) of Fig 6: steps until the model has passed each wanted output.

    A rising target only raises the input, a falling one only lowers it, as in the text of section
    4.1; the chart compares with the output of the model, and then the input goes up and down at
    every sample. It stops at the ends of the levels.
    """
    tracker, low = model.track(), float(model.levels[0])
    last = round(float(np.ptp(model.levels)) / step)
    level, y, before, inputs = 0, tracker.push(low), model.range[0], np.empty_like(wanted)
    for k, target in enumerate(wanted.tolist()):
        way = 1 if target > before else -1
        while target != before and way * (target - y) > 0 and 0 <= level + way <= last:
            level += way
            y = tracker.push(low + step * level)
        inputs[k], before = low + step * level, target
    return np.asarray(np.minimum(inputs, model.levels[-1]))


def _driven(
    seed: int, cooling: Cooling | None, fastest: float, model: Preisach, lag: float
) -> Results:
    periods = np.geomspace(PERIOD, fastest, RAMPS)
    ends = BEFORE + np.concatenate([[0.0], np.cumsum(periods)])
    t = TICK * np.arange(round(ends[-1] / TICK) + 1)
    # A phase of 1 for each ramp; 0.5 is its top.
    phase = np.interp(t, np.concatenate([[0.0], ends]), [0.0, *range(RAMPS + 1)]) % 1.0
    wanted = LOW + (HIGH - LOW) * (1.0 - np.abs(2.0 * phase - 1.0))
    # A step is 0.1 V across the 20 ohm of the paper: 5 mA, or 0.015 V of the command.
    steps = stepping_inverse(model, wanted, 0.015)
    # The filter of 0.5 s makes the inverse of the heating proper. It turns each step into a pulse
    # that is higher by the lag over it, 0.12 V.
    inverse, _ = filtered_inverse(Linear.lags(lag), 0.5)
    command = np.clip(inverse.simulate(t, steps), 0.0, COMMAND)
    around = Surroundings(cooling=cooling)
    head = Head(seed, NOISE, seed, surroundings=around, log_truth=True)
    angle, cuts = np.zeros_like(t), np.searchsorted(t, np.concatenate([[0.0], ends]))
    for a, b in zip(cuts[:-1], np.append(cuts[1:-1], t.size - 1), strict=True):
        currents = np.array([command[a : b + 1] * CURRENT / COMMAND, np.zeros(b + 1 - a)])
        angle[a : b + 1] = head.drive(t[a : b + 1], currents).y[0]
    error, middles = angle - wanted, 0.5 * (ends[:-1] + ends[1:])
    halves = np.searchsorted(t, np.sort(np.concatenate([ends, middles])))
    each = np.array([rms(error[a:b]) for a, b in pairwise(halves)]).reshape(-1, 2)
    whole = np.sqrt(np.mean(each**2, axis=1))
    figures = {
        "error_first_ramp_deg": float(whole[0]),
        "error_last_ramp_deg": float(whole[-1]),
        "ratio": float(whole[-1] / whole[0]),
        "first_rise_deg": float(each[0, 0]),
        "body_K": float(body_temperature(head)[-1] - 20.0),
    }
    return Results(figures, t=t, wanted=wanted, angle=angle, error=error, rms=each)
