"""The interface of all simulated axes."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop import LimitError, ParameterError, SignalError
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.surroundings import Course, Surroundings
from minorloop_head.twins.wire import Wire

KINDS = (Wire, Head, Catheter)
every_kind = pytest.mark.parametrize("kind", KINDS)


def inputs(kind, shares):
    """Shares (..., ) of the range of each input, in 0 to 1, as one input."""
    low, high = (np.array([getattr(c, end) for c in kind.inputs]) for end in ("low", "high"))
    values = low + (high - low) * np.asarray(shares)[: len(low)]
    return float(values[0]) if len(low) == 1 else values


def wave(kind, count, seed=0):
    """A sequence of inputs (count) that moves every axis."""
    phases = np.arange(count)[:, None] * [0.05, 0.035] + seed
    return [inputs(kind, 0.6 + 0.39 * np.sin(phase)) for phase in phases]


@every_kind
def test_exchange_is_a_hold_of_one_tick(kind):
    loop, bench = kind(tick=0.5), kind(tick=0.5)
    for u in wave(kind, 40):
        record = bench.apply(u, 0.5, 0.5)
        np.testing.assert_array_equal(loop.exchange(u), record.y[..., -1])
        np.testing.assert_array_equal(record.u[..., -1], u)
    assert loop.clock == pytest.approx(20.0)
    assert [str(q) for q in record.inputs] == [str(c) for c in kind.inputs]
    assert [str(q) for q in record.outputs] == [str(c) for c in kind.outputs]


@every_kind
def test_a_hold_does_not_depend_on_how_it_is_sampled(kind):
    u = inputs(kind, [0.95, 0.9])
    whole, fine, pieces = kind(), kind(), kind()
    expected = whole.apply(u, 20.0, 20.0).y[..., -1]
    np.testing.assert_allclose(fine.apply(u, 20.0, 0.04).y[..., -1], expected, rtol=1e-6)
    for _ in range(500):
        last = pieces.exchange(u)
    np.testing.assert_allclose(last, expected, rtol=1e-6)


@every_kind
@pytest.mark.parametrize("delay", [0.1, 0.053])
def test_a_delayed_reading_is_the_reading_of_then(kind, delay):
    now, late = kind(tick=0.01), kind(tick=0.04, delay=delay)
    sequence = wave(kind, 500)
    late_y = np.array([late.exchange(u) for u in sequence])
    now_y = np.array([now.exchange(u) for u in sequence for _ in range(4)])
    t = 0.04 * np.arange(1, 501) - delay
    for a in range(len(kind.outputs)):
        seen, true = (y.reshape(len(y), -1)[:, a] for y in (late_y, now_y))
        grid = 0.01 * np.arange(2001)
        np.testing.assert_allclose(
            seen, np.interp(t, grid, np.concatenate([[0.0], true])), atol=1e-6
        )


@every_kind
@given(st.integers(0, 30), st.integers(1, 30), st.integers(0, 5))
@settings(max_examples=15)
def test_a_restored_twin_repeats_exactly(kind, before, after, seed):
    name = kind.outputs[0].name
    options = {
        "specimen": 2,
        "noise": 0.1,
        "seed": seed,
        "delay": 0.1,
        "tick": 0.4,
        "faults": [SimulatedFault(name, "stuck", 4.0, 6.0), SimulatedFault(name, "lost", 8.0, 9.0)],
    }
    twin = kind(**options)
    for u in wave(kind, before):
        twin.exchange(u)
    kept = json.loads(json.dumps(twin.checkpoint(), allow_nan=False))
    first = [twin.exchange(u) for u in wave(kind, after, seed=1)]
    for again in (twin, kind(**options)):
        again.restore(kept)
        np.testing.assert_array_equal([again.exchange(u) for u in wave(kind, after, 1)], first)


@every_kind
def test_reset_goes_back_to_the_start(kind):
    twin = kind(noise=0.1, delay=0.08, log_truth=True)
    first = [twin.exchange(u) for u in wave(kind, 50)]
    twin.reset()
    assert twin.clock == 0.0
    np.testing.assert_array_equal([twin.exchange(u) for u in wave(kind, 50)], first)
    assert twin._truth()["t"].shape == (50,)


@every_kind
def test_safe_is_the_resting_input_and_takes_no_time(kind):
    twin = kind()
    for u in wave(kind, 50):
        twin.exchange(u)
    before = twin.clock
    twin.safe()
    assert twin.clock == before
    assert twin.checkpoint()["input"] == [0.0] * len(kind.inputs)


@every_kind
def test_specimens_differ_by_up_to_a_tenth_and_repeat(kind):
    nominal = kind()._parameters
    for specimen in range(10):
        drawn = kind(specimen)._parameters
        ratios = np.array([drawn[name] / nominal[name] for name in nominal])
        assert np.all(np.abs(ratios - 1) <= 0.1)
        assert np.unique(ratios).size == len(nominal)
        assert drawn == kind(specimen)._parameters


@every_kind
@pytest.mark.parametrize("wrong", [1e3, -1e3, np.nan, np.inf])
def test_refuses_an_input_beyond_its_limits_and_stays_where_it_is(kind, wrong):
    twin = kind()
    twin.exchange(inputs(kind, [0.8, 0.8]))
    before = twin.checkpoint()
    u = np.multiply(inputs(kind, [0.5, 0.5]), 1.0)
    u = wrong if len(kind.inputs) == 1 else np.array([u[0], wrong])
    for attempt in (lambda: twin.apply(u, 1.0, 1.0), lambda: twin.exchange(u)):
        with pytest.raises(LimitError, match="beyond the limits"):
            attempt()
    with pytest.raises((LimitError, SignalError)):
        twin.drive([0.0, 1.0], np.stack([np.zeros_like(u), u], axis=-1))
    assert twin.checkpoint() == before


@every_kind
@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"twin": "fibre"}, "has twin 'fibre'"),
        ({"state": [0.0]}, "damaged"),
        ({"past": [[np.nan]]}, "damaged"),
        ({"mark": 1000}, "damaged"),
        ({"last": []}, "damaged"),
        ({"input": [1e3, 1e3]}, "damaged"),
        ({"samples": -1}, "damaged: samples is -1"),
        ({"clock": 1e300}, r"damaged: clock is 1e\+300"),
        ({"tick": 0.5}, r"has tick 0\.5 and this twin 0\.04"),
    ],
)
def test_refuses_a_checkpoint_of_another_or_a_damaged_one(kind, change, complaint):
    twin = kind()
    with pytest.raises(ParameterError, match=complaint):
        twin.restore(twin.checkpoint() | change)
    with pytest.raises(ParameterError, match="twin None"):
        twin.restore({})
    kept = twin.checkpoint()
    del kept["state"]
    with pytest.raises(ParameterError, match="it has no state"):
        twin.restore(kept)


@pytest.mark.parametrize("kind", [Wire, Head])
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12), st.integers(0, 20))
@settings(max_examples=15)
def test_whatever_the_surroundings_do_to_a_wire_is_restored(kind, shares, specimen):
    hard = Surroundings(
        Course(-40.0, 90.0, at=3.0, duration=4.0, amplitude=5.0, period=2.0),
        Course(75.0, 2000.0, at=10.0),
        Course(-3e-3, 3e-3, at=2.0, amplitude=1e-3, period=0.5),
    )
    twin = kind(specimen, delay=0.1, surroundings=hard, ageing=0.5, drift=1.0)
    for share in shares:
        twin.apply(inputs(kind, [share, 1 - share]), 2.0, 0.5)
        kept = json.loads(json.dumps(twin.checkpoint()))
        twin.restore(kept)
        assert twin.checkpoint() == kept
