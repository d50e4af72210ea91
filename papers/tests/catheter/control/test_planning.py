from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.errors import ParameterError, SignalError
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


@given(wanted=targets, effort=st.sampled_from([0.0, 1.0]))
@settings(max_examples=25)
def test_a_plan_is_never_worse_than_inverse_feedforward(wanted, effort):
    planner = Planner(wire=made_up(), effort=effort, horizon=6, sweeps=2)
    plan = planner.plan(wanted)
    assert plan.cost <= planner.feedforward(wanted).cost + 1e-9
    assert plan.feedforward_cost == planner.feedforward(wanted).cost
    assert plan.power.min() >= 0.0
    assert plan.power.max() <= 0.16 + 1e-15
    np.testing.assert_allclose(plan.y, planner._angles(plan.power[None], planner.wire.begin())[0])


@pytest.mark.parametrize(
    "wanted",
    [
        np.repeat([40.0, 10.0], [10, 20]),
        np.repeat([40.0, 25.0, 40.0, 20.0, 45.0, 10.0], 8),
    ],
)
def test_where_cooling_is_the_bottleneck_a_plan_begins_it_early(wanted):
    wire = identified().model
    warm = wire.found(wire.begin().tracker.aim(40.0), 40.0)
    planner = Planner(wire=wire)
    plan = planner.plan(wanted, warm)
    assert plan.gain < 0.9
    first = int(np.argmax(wanted < 40.0))
    early = plan.power[first - 2 : first].mean()
    assert early < 0.5 * planner.feedforward(wanted, warm).power[first - 2 : first].mean()


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


def test_effort_reduces_changes_of_the_power():
    wanted = np.repeat([30.0, 15.0, 30.0, 5.0], 8)
    rough, calm = (Planner(wire=made_up(), effort=each).plan(wanted) for each in (0.0, 300.0))
    assert np.abs(np.diff(calm.power)).sum() < np.abs(np.diff(rough.power)).sum()


def test_a_plan_describes_and_draws_itself():
    plan = Planner(wire=made_up(), horizon=4, sweeps=1).plan([10.0, 20.0, 10.0])
    assert "inverse feedforward" in str(plan)
    assert len(plan.plot().axes) == 2
    np.testing.assert_allclose(plan.current**2, plan.power)


def test_bad_input_is_refused():
    for option in (
        {"interval": 0.0},
        {"horizon": 0},
        {"sweeps": 1.5},
        {"highest": 1.0},
        {"effort": -1},
        {"horizon": np.nan},
        {"horizon": np.inf},
        {"horizon": "a"},
        {"horizon": None},
        {"horizon": True},
        {"interval": "a"},
        {"wire": None},
    ):
        with pytest.raises(ParameterError, match=next(iter(option))):
            Planner(**({"wire": made_up()} | option))
    with pytest.raises(SignalError, match="targets"):
        Planner(wire=made_up()).plan([1.0, np.nan])
    with pytest.raises(SignalError, match="targets have shape"):
        Planner(wire=made_up()).plan(np.zeros((2, 2)))
    with pytest.raises(SignalError, match="the targets reach 1e\\+308 degrees"):
        Planner(wire=made_up()).plan([1e308] * 5)


def test_an_invalid_start_or_look_ahead_is_refused():
    planner = Planner(wire=made_up(), horizon=4, sweeps=1)
    for attempt in (
        lambda: planner.plan([10.0], 3),
        lambda: planner.feedforward([10.0], 3),
    ):
        with pytest.raises(ParameterError, match="start is 3; give a HeatedState"):
            attempt()
    for ahead in (-1, -100, 1.5, None):
        with pytest.raises(ParameterError, match="ahead is"):
            planner.feedforward([10.0, 20.0], ahead=ahead)
