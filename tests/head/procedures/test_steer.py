import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.head.control.head import head_control
from minorloop.head.procedures.steer import steer
from minorloop.head.twins.head import Head
from minorloop.head.twins.sensor import Fault
from wires import made_up

CONTROL = head_control("observer", (made_up(), made_up()))


def test_a_head_reaches_its_targets_and_is_left_safe():
    head = Head(noise=0.05, seed=3)
    result = steer(head, CONTROL, [[30.0, 30.0], [40.0, 20.0]], 8.0)
    np.testing.assert_allclose(result.reached, result.targets, atol=1.0)
    assert result.current.max() <= 0.4
    assert result.t[-1] == pytest.approx(16.0)
    assert head._input.tolist() == [0.0, 0.0]


def test_a_target_without_a_reading_has_no_result():
    head = Head(noise=0.05, faults=[Fault("pan", "lost", 0.0)])
    result = steer(head, CONTROL, [[10.0, 10.0]], 1.0)
    assert np.isnan(result.reached[0, 0])
    assert np.isfinite(result.reached[0, 1])


@pytest.mark.parametrize(
    ("targets", "hold"), [([[1.0]], 1.0), ([[1.0, np.nan]], 1.0), ([[1.0, 1.0]], 0.0)]
)
def test_targets_that_cannot_be_held_are_refused(targets, hold):
    with pytest.raises(ParameterError, match="give"):
        steer(Head(), CONTROL, targets, hold)
