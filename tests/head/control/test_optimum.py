from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.errors import ParameterError, SignalError
from minorloop.head.control.optimum import memory_curves, optimum_on_levels
from minorloop.head.control.planning import Planner
from minorloop.operators.memory import Memory
from wires import made_up


@pytest.mark.parametrize("bands", [1, 3, 6, 10])
def test_there_are_as_many_curves_as_numbers_and_no_two_are_the_same(bands):
    curves = memory_curves(bands)
    assert len(set(curves)) == 2**bands
    for number, curve in enumerate(curves):
        Memory(curve)  # nests, or this raises
        assert curve[-1] == number.bit_count()


@given(bands=st.integers(1, 8), moves=st.lists(st.integers(0, 8), max_size=12))
def test_moving_bits_is_wiping_out(bands, moves):
    curves, curve = memory_curves(bands), 0
    for level in (min(move, bands) for move in moves):
        while curve.bit_count() < level:
            curve |= curve + 1
        while curve.bit_count() > level:
            curve &= curve - 1
    history = [min(move, bands) for move in moves]
    assert curves[curve] == Memory.after(history, low=0, high=bands).extrema


def brute_force(wire, wanted, interval):
    """Least cost over every sequence of levels whose powers keep the limits."""
    levels, best = wire.operator.levels, np.inf
    for path in product(levels, repeat=len(wanted)):
        y = wire.operator.simulate(np.array(path))
        w = np.concatenate([levels[:1], path])
        moved = np.diff(y, prepend=wire.operator.simulate(levels[:1]))
        power = w[:-1] + ((wire.lag + interval) * np.diff(w) + wire.latent * moved) / interval
        if ((power >= 0) & (power <= 0.16)).all():
            best = min(best, float(((y - wanted) ** 2).sum()))
    return best


@given(wanted=st.lists(st.floats(0, 60), min_size=1, max_size=4), latent=st.sampled_from([0, 2e-3]))
@settings(max_examples=15)
def test_it_is_the_best_of_all_sequences(wanted, latent):
    wire = made_up(bands=4, latent=latent)
    plan = optimum_on_levels(wire, wanted, interval=3.0)
    assert plan.cost == pytest.approx(brute_force(wire, wanted, 3.0))
    assert plan.cost <= plan.feedforward_cost


def test_the_wire_goes_where_the_plan_says():
    wire = made_up(bands=10, latent=0.0)
    wanted = np.repeat([30.0, 10.0, 45.0, 0.0], 5)
    plan = optimum_on_levels(wire, wanted, interval=2.0)
    state = wire.begin()
    for power, y in zip(plan.power, plan.y, strict=True):
        state = wire.step(state, power, 2.0)
        assert state.angle == pytest.approx(y, abs=1e-6)


@pytest.mark.parametrize(
    "wanted", [np.repeat([30.0, 10.0, 45.0, 5.0], 5), np.tile([40.0, 20.0], 8)]
)
def test_the_planner_comes_up_to_the_optimum_from_elsewhere(wanted):
    wire = made_up(bands=10, latent=0.0)
    planner = Planner(wire=wire, interval=2.0, parts=1)
    optimum = optimum_on_levels(wire, wanted, interval=2.0)
    improved = planner._plan(optimum.power, wanted, wire.begin())
    for _ in range(30):
        improved = planner.improve(improved)
    # The plan may leave the levels, so it is no worse than the optimum on them; and where the
    # optimum ends when it may leave them too is about where the plan is.
    plan = planner.plan(wanted)
    assert plan.cost <= optimum.cost
    assert plan.cost <= 1.03 * improved.cost


def test_bad_input_is_refused():
    wire = made_up(bands=4)
    with pytest.raises(ParameterError, match="11 bands; give 1 to 10"):
        memory_curves(11)
    with pytest.raises(ParameterError, match="bands"):
        optimum_on_levels(made_up(bands=12), [1.0], interval=1.0)
    with pytest.raises(ParameterError, match="curve is 16"):
        optimum_on_levels(wire, [1.0], interval=1.0, curve=16)
    with pytest.raises(ParameterError, match="no sequence of levels"):
        optimum_on_levels(wire, [60.0], interval=0.1, curve=15, highest=0.1)
    with pytest.raises(SignalError, match="targets"):
        optimum_on_levels(wire, [np.nan], interval=1.0)
