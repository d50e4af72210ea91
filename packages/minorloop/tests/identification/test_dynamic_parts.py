import numpy as np
import pytest

from minorloop import Preisach, Record
from minorloop.identification.dynamic_parts import DynamicParts, DynamicRecord

PLANE = Preisach(np.linspace(0, 1, 5), np.tril(np.ones((4, 4))))
STEP = 1 / 128  # exact, so that a dead time of whole samples is exact
T = STEP * np.arange(600)
U = 0.5 - 0.5 * np.cos(3 * T) * np.exp(-0.1 * T)
RECORD = DynamicRecord.of(Record(U, U, T), 0.0)


@pytest.mark.parametrize(
    ("ahead", "behind"), [((), ()), ((-3.0,), ()), ((), (-2.0, -5.0)), ((-3.0,), (-2.0, -5.0))]
)
def test_outputs_are_those_of_the_cascade(ahead, behind):
    dynamics = DynamicParts(STEP, 3.0, ahead, behind)
    expected = dynamics.cascade(PLANE).simulate(T, U)
    np.testing.assert_allclose(dynamics.outputs(RECORD, PLANE), expected, atol=1e-6)
    assert dynamics.structure == (len(ahead), len(behind), False)
    np.testing.assert_array_equal(dynamics.at(dynamics.vector).vector, dynamics.vector)


def test_dead_time_is_behind_the_operator_unless_all_poles_are_before_it():
    assert DynamicParts(STEP, 2.0, (-3.0,), ()).cascade(PLANE).linear.delay == pytest.approx(
        2 * STEP
    )
    both = DynamicParts(STEP, 2.0, (-3.0,), (-4.0,)).cascade(PLANE)
    assert (both.ahead.delay, both.linear.delay) == (0, pytest.approx(2 * STEP))


def test_a_start_up_ends_when_the_input_has_been_near_both_ends():
    assert RECORD.startup == np.argmax(U.min() + 0.9 * np.ptp(U) <= U)
    later = RECORD.with_pieces().without(RECORD.startup)
    assert not later.fitted[: RECORD.startup].any()
    assert (later.pieces[: RECORD.startup] == -1).all()
    slow = DynamicRecord.of(Record(T, T, T), 0.0)  # most rows would count as one
    assert slow.startup == 0
