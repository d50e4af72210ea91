import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.head.control.adaptive import AdaptiveControl
from minorloop.head.control.heating import HeatedWire
from minorloop.head.control.observer import ObserverControl
from minorloop.operators.preisach import Preisach
from wires import made_up


def adaptive(**options):
    return AdaptiveControl(control=ObserverControl(wire=made_up()), **options)


def aged(share=0.85):
    """The made-up wire with a shorter stroke."""
    wire = made_up()
    operator = wire.operator
    weights = operator.weights * share
    return HeatedWire(Preisach(operator.levels, weights, relay="unipolar"), wire.lag, wire.latent)


def work(law, plant_wire, targets, *, hold=12.0, state=None, plant=None):
    """Go through targets; gives the last state and plant, and all models that were believed."""
    state = law.begin() if state is None else state
    plant, seen = plant_wire.begin() if plant is None else plant, 0.0
    rng, models = np.random.default_rng(0), [law.control.wire.operator]
    for target in targets:
        for _ in range(round(hold / law.interval)):
            current, state = law.step(state, target, seen)
            seen = plant.angle + 0.02 * rng.normal()
            plant = plant_wire.step(plant, current**2, law.interval)
            model = state.belief.control.wire.operator
            if model is not models[-1]:
                models.append(model)
    return state, plant, models


TARGETS = np.random.default_rng(3).uniform(8.0, 45.0, 24)


def test_a_shorter_stroke_is_learnt():
    state, _, models = work(adaptive(), aged(), TARGETS)
    assert state.belief.updates >= 10
    truth = aged().operator
    u = np.random.default_rng(1).uniform(0.06, 0.16, 100)
    errors = [np.abs(model.simulate(u) - truth.simulate(u)).mean() for model in models]
    assert errors[-1] < 0.6 * errors[0]


def test_every_update_is_bounded_and_leaves_a_model_that_can_be_inverted():
    law = adaptive(largest_update=0.01)
    _, _, models = work(law, aged(), TARGETS[:10])
    low, high = law.control.wire.operator.range
    for before, after in pairwise(models):
        change = np.abs(after.weights - before.weights).sum() + abs(after.offset - before.offset)
        assert change <= 0.01 * (high - low) + 1e-9
        assert after.weights.min() >= 0
        assert after.monotone


def test_nothing_is_learnt_while_the_wire_moves_or_nothing_is_read():
    law = adaptive()
    state = law.begin()
    for k in range(500):
        _, state = law.step(state, 25.0 + 10.0 * math.sin(0.05 * k), math.nan)
    assert state.belief.updates == 0


def test_what_makes_predictions_worse_is_given_up():
    law = adaptive(tolerance=0.3)
    state, plant, _ = work(law, made_up(), TARGETS[:4])
    spoiled = replace(state.belief, score=5.0)
    state, _, _ = work(
        law, made_up(), TARGETS[4:6], state=replace(state, belief=spoiled), plant=plant
    )
    assert state.belief.rollbacks >= 1


def test_the_current_that_was_applied_goes_into_the_observer():
    law = adaptive()
    _, state = law.step(law.begin(), 40.0, 0.0)
    cut = law.step(replace(state, applied=0.0), 40.0, 0.0)[1]
    assert cut.estimate.wire.power < law.step(state, 40.0, 0.0)[1].estimate.wire.power


@pytest.mark.parametrize(
    "option",
    [{"settling": 0.0}, {"forgetting": 0.0}, {"prior": 0.0}, {"largest_update": 2.0}],
)
def test_bad_options_are_refused(option):
    with pytest.raises(ParameterError):
        adaptive(**option)
