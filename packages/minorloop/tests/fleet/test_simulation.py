from dataclasses import replace

import numpy as np
import pytest

from minorloop import Memory, ParameterError, PrandtlIshlinskii, Preisach, SignalError
from minorloop.export.python_control import bounded
from minorloop.fleet.simulation import FleetState, simulate_fleet

RNG = np.random.default_rng(0)


def operator(signed=False, **options):
    weights = np.tril(RNG.uniform(size=(10, 10)) - 0.3 * signed)
    return Preisach(np.sort(RNG.uniform(-1, 1, 11)), weights, 0.2, **options)


@pytest.mark.parametrize(
    "options", [{}, {"slope": 0.3, "relay": "unipolar", "diagonal": "reversible"}]
)
@pytest.mark.parametrize("start", ["negative", "positive"])
def test_each_operator_equals_a_single_one(options, start):
    model, u = operator(**options), RNG.uniform(-1.1, 1.1, (300, 20))
    state = FleetState.begin(model, 300, start=start, room=30)
    y, after = simulate_fleet(model, u, state)
    np.testing.assert_allclose(y, model.simulate(u, start), atol=1e-12 * np.ptp(model.range))
    assert not after.lost.any()


def test_step_by_step_gives_the_same_and_changes_nothing_in_place():
    model, u = operator(), RNG.uniform(-1, 1, (50, 12))
    whole, _ = simulate_fleet(model, u)
    state = FleetState.begin(model, 50)
    for t in range(12):
        kept = state.copy()
        y, following = simulate_fleet(model, u[:, t], state)
        np.testing.assert_array_equal(y, whole[:, t])
        np.testing.assert_array_equal(state.rows, kept.rows)
        state = following


@pytest.mark.parametrize("signed", [False, True])
def test_a_full_memory_loses_its_smallest_loop(signed):
    model, room = operator(signed), 8
    low, high = model.levels[[0, -1]]
    shrink = np.linspace(1, 0.2, 40) * np.where(np.arange(40) % 2, 1, -1)
    u = (low + high) / 2 + (high - low) / 2 * shrink * RNG.uniform(0.9, 1, (5, 40))
    y, after = simulate_fleet(model, u, FleetState.begin(model, 5, room=room))
    for k in range(5):
        memory = Memory.negative(low)
        for t in range(40):
            memory = Memory.after([*memory.extrema, u[k, t]], low=low, high=high)
            expected = model.simulate([memory.u], memory)[0]
            assert y[k, t] == pytest.approx(expected, abs=1e-10)
            memory = bounded(model, memory, room - 1)
        assert after.memory(k) == memory
    error = np.abs(y - model.simulate(u)).max(axis=1)
    assert (after.lost > 0).all()
    assert (error <= after.lost + 1e-9).all()


def test_refusals():
    model = operator()
    for operators in (0, None, 1.5):
        with pytest.raises(ParameterError, match="operators is"):
            FleetState.begin(model, operators)
    for room in (5, np.nan, "a"):
        with pytest.raises(ParameterError, match="room is"):
            FleetState.begin(model, 3, room=room)
    with pytest.raises(ParameterError, match="give room for more"):
        FleetState.begin(model, 3, start="demagnetised", room=16)
    with pytest.raises(SignalError, match="4 rows and the state 3 operators"):
        simulate_fleet(model, np.zeros(4), FleetState.begin(model, 3))
    with pytest.raises(SignalError, match="finite"):
        simulate_fleet(model, [np.nan])
    with pytest.raises(ParameterError, match=r"model is .* give a Preisach"):
        simulate_fleet(PrandtlIshlinskii([0.0, 1.0], [1.0, 1.0]), [0.1])


@pytest.mark.parametrize(
    "damage",
    [
        {"rows": np.array([500, 1])},
        {"rows": np.array([0, 1])},
        {"rows": np.array([1.0, 1.0])},
        {"lost": np.zeros(3)},
        {"within": np.zeros(2)},
        {"stacks": np.zeros((2, 32))},
        {"stacks": np.zeros((2, 32, 3))},
    ],
)
def test_a_damaged_state_is_refused(damage):
    model = operator()
    state = replace(FleetState.begin(model, 2), **damage)
    with pytest.raises(ParameterError, match="do not fit together"):
        simulate_fleet(model, [0.1, 0.2], state)
