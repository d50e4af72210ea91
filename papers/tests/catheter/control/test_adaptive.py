import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from minorloop_head.control.observer import ObserverControl
from minorloop_head.twins.wire import Wire
from papers.catheter.control.adaptive import AdaptiveControl
from wires import angle, identified, settled


def adaptive(**options):
    return AdaptiveControl(control=ObserverControl(wire=identified().model), **options)


def aged():
    """A twin that has lost 10 % of its stroke, and needs 5 K more."""
    return Wire(noise=0.02, seed=1, ageing=1.0)


def work(law, plant, targets, *, hold=12.0, state=None):
    """Go through targets; return the last state and all models."""
    state = law.begin() if state is None else state
    seen, models = angle(plant), [law.control.wire.operator]
    for target in targets:
        for _ in range(round(hold / law.interval)):
            current, state = law.step(state, target, seen)
            seen = plant.exchange(current)
            model = state.adapted.control.wire.operator
            if model is not models[-1]:
                models.append(model)
    return state, models


TARGETS = np.random.default_rng(3).uniform(8.0, 45.0, 24)


def test_a_shorter_stroke_is_learnt():
    state, models = work(adaptive(), aged(), TARGETS)
    assert state.adapted.updates >= 10
    holds = np.random.default_rng(1).uniform(0.25, 0.4, 30)
    truth = settled(Wire(ageing=1.0), holds)
    errors = [np.abs(model.simulate(holds**2) - truth) for model in (models[0], models[-1])]
    # A warmer ambient explains what all samples have in common, so that is not learnt.
    spread = [np.std(error) for error in errors]
    assert spread[1] < spread[0]


def test_every_update_is_bounded_and_leaves_a_model_that_can_be_inverted():
    law = adaptive(largest_update=0.01)
    _, models = work(law, aged(), TARGETS[:10])
    low, high = law.control.wire.operator.range
    for before, after in pairwise(models):
        change = np.abs(after.weights - before.weights).sum() + abs(after.offset - before.offset)
        assert change <= 0.01 * (high - low) + 1e-9
        assert after.weights.min() >= 0
        assert after.monotone


def test_nothing_is_learnt_in_motion_or_without_readings():
    law = adaptive()
    state = law.begin()
    for k in range(500):
        _, state = law.step(state, 25.0 + 10.0 * math.sin(0.05 * k), math.nan)
    assert state.adapted.updates == 0


def test_an_update_that_makes_predictions_worse_is_undone():
    law = adaptive(tolerance=0.3)
    plant = Wire(noise=0.02, seed=1)
    state, _ = work(law, plant, TARGETS[:4])
    spoiled = replace(state.adapted, score=5.0)
    state, _ = work(law, plant, TARGETS[4:6], state=replace(state, adapted=spoiled))
    assert state.adapted.rollbacks >= 1
