from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from papers.catheter.control.planning import Planner
from wires import identified, made_up

targets = st.lists(st.floats(-5, 70), min_size=1, max_size=16)


@given(
    power=st.lists(st.floats(0.0, 0.16), min_size=1, max_size=20), latent=st.sampled_from([0, 2e-3])
)
def test_plans_and_steps_of_the_wire_agree(power, latent):
    planner = Planner(wire=made_up(latent=latent), interval=0.4, parts=3)
    state = planner.wire.begin(0.05)
    found = planner._angles(np.array([power, power[::-1]]), state)
    for row, order in zip(found, (power, power[::-1]), strict=True):
        own = state
        for k, each in enumerate(order):
            for _ in range(3):
                own = planner.wire.step(own, each, 0.4 / 3)
            assert row[k] == pytest.approx(own.angle, abs=1e-9)


@given(wanted=targets)
@settings(max_examples=25)
def test_a_plan_is_never_worse_than_inverse_feedforward(wanted):
    planner = Planner(wire=made_up(), horizon=6, sweeps=2)
    plan = planner.plan(wanted)
    assert plan.cost <= planner.feedforward(wanted).cost + 1e-9
    assert plan.power.min() >= 0.0
    assert plan.power.max() <= 0.16 + 1e-15
    np.testing.assert_allclose(plan.y, planner._angles(plan.power[None], planner.wire.begin())[0])


@pytest.mark.parametrize(
    "wanted",
    [np.repeat([40.0, 10.0], [10, 20]), np.repeat([40.0, 25.0, 40.0, 20.0, 45.0, 10.0], 8)],
)
def test_where_cooling_is_the_bottleneck_a_plan_begins_it_early(wanted):
    wire = identified().model
    warm = wire.found(wire.begin().tracker.aim(40.0), 40.0)
    planner = Planner(wire=wire)
    plan = planner.plan(wanted, warm)
    inverse = planner.feedforward(wanted, warm)
    assert plan.cost < 0.9 * inverse.cost
    first = int(np.argmax(wanted < 40.0))
    early = plan.power[first - 2 : first].mean()
    assert early < 0.5 * inverse.power[first - 2 : first].mean()


def test_reachable_targets_are_followed():
    planner = Planner(wire=made_up())
    warm = planner.wire.begin(0.1)
    wanted = warm.angle + np.linspace(0.2, 5.0, 24)
    assert planner.feedforward(wanted, warm).rms < 0.5
    assert planner.plan(wanted, warm).rms < 0.02


@pytest.mark.parametrize("wanted", [[30.0, 10.0, 45.0, 5.0, 20.0], [40.0, 20.0, 40.0, 20.0, 40.0]])
def test_a_plan_is_no_worse_than_the_best_of_all_sequences_on_the_levels(wanted):
    wire, interval = made_up(bands=4, latent=0.0), 3.0
    paths = np.array(list(product(wire.operator.levels, repeat=len(wanted))))
    before = np.column_stack([np.zeros(len(paths)), paths[:, :-1]])
    power = before + (wire.lag + interval) * (paths - before) / interval
    allowed = ((power >= 0) & (power <= 0.16)).all(axis=1)
    errors = wire.operator.simulate(paths[allowed]) - wanted
    plan = Planner(wire=wire, interval=interval, parts=1).plan(wanted)
    assert plan.cost <= (errors**2).sum(axis=1).min()
