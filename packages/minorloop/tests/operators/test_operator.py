"""The laws of an operator, for each kind of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.operators.dead_zones import DeadZones
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.polynomial import Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach

PLANE = np.tril(np.random.default_rng(0).uniform(0.1, 1.0, (5, 5)))
LEVELS = np.array([-1.0, -0.75, -0.2, 0.0, 0.6, 1.0])


def operators(offset=0.3):
    """One operator of each kind, by its name."""
    plays = PrandtlIshlinskii([0.0, 0.2, 0.5], [1.0, 0.5, 0.25], offset)
    zones = DeadZones.from_slopes([-0.8, 0.4], [0.2, 1.0, 0.4])
    return {
        "plane": Preisach(LEVELS, PLANE, offset, "bipolar", "uniform", 0.5),
        "reversible": Preisach(LEVELS, PLANE, offset, "unipolar", "reversible"),
        "plays": plays,
        "plays and zones": GeneralisedPrandtlIshlinskii(plays, zones, offset=7.0),
        "polynomial": Polynomial([offset, 8.2, -0.35], -1.0, 1.0),
        "bouc-wen": BoucWen(5.0 + offset, 1.0, 0.3, 1.0),
        "duhem": Duhem([-1.0, 0.0, 1.0], [2.0, 1.5, 1.0 + offset], [1.0 + offset, 1.5, 2.0]),
    }


every = pytest.mark.parametrize("kind", operators())
signals = st.lists(st.floats(-1, 1), min_size=1, max_size=30).map(np.array)


@every
@given(u=signals)
def test_the_output_does_not_depend_on_the_rate(kind, u):
    model = operators()[kind]
    thrice = model.simulate(np.repeat(u, 3))[2::3]
    np.testing.assert_allclose(thrice, model.simulate(u), rtol=1e-12, atol=1e-12)


@every
@given(u=signals, cut=st.integers(0, 30))
def test_steps_trackers_and_parts_give_what_simulate_gives(kind, u, cut):
    model, whole = operators()[kind], operators()[kind].simulate(u)
    tracker, other, stepped = model.track(), model.track(), []
    memory = tracker.memory
    for k, sample in enumerate(u):
        if k == cut:
            rest = model.simulate(u[cut:], tracker.memory)
            np.testing.assert_allclose(rest, whole[cut:], rtol=1e-12, atol=1e-12)
            other = tracker.copy()
        foreseen = tracker.peek(sample)
        y, memory = model.step(memory, sample)
        assert tracker.push(sample) == foreseen == pytest.approx(y, rel=1e-12, abs=1e-12)
        stepped.append(y)
    np.testing.assert_allclose(stepped, whole, rtol=1e-12, atol=1e-12)
    if cut < u.size:  # a copy stays where it was
        assert other.push(u[cut]) == pytest.approx(whole[cut], rel=1e-12, abs=1e-12)


@every
@given(past=signals, u=signals)
def test_the_inverse_brings_the_output_back_from_any_past(kind, past, u):
    model = operators()[kind]
    tracker = model.track()
    for sample in past:
        tracker.push(sample)
    wanted = model.simulate(u, tracker.memory)
    found = model.invert(wanted, tracker.memory, "clip")
    again = model.simulate(found.u, tracker.memory)
    np.testing.assert_allclose(again, wanted, atol=1e-9)
    np.testing.assert_allclose(found.y, again, atol=1e-12)
    before = tracker.peek(0.0)
    aimed = tracker.aim(wanted[0], "clip")
    assert tracker.peek(aimed) == pytest.approx(wanted[0], abs=1e-9)
    assert tracker.peek(0.0) == before


@every
def test_signals_in_rows_are_independent(kind):
    model, u = operators()[kind], np.random.default_rng(2).uniform(-1, 1, (7, 50))
    np.testing.assert_array_equal(model.simulate(u), [model.simulate(row) for row in u])
    assert model.simulate(np.empty((0, 5))).shape == (0, 5)


@every
def test_equality_is_of_values(kind):
    model = operators()[kind]
    assert model == operators()[kind]
    assert model != operators(0.4)[kind]
    assert model != 1.0
