import numpy as np
import pytest

from minorloop.errors import NotInvertibleError, ParameterError, UnreachableError
from minorloop.operators.preisach import Preisach

MODEL = Preisach(np.linspace(-1, 1, 9), np.tril(np.random.default_rng(0).uniform(size=(8, 8))))


def test_aim_equals_the_inverse():
    targets = np.random.default_rng(2).uniform(*MODEL.range, 200)
    tracker, aimed = MODEL.track(), []
    for target in targets:
        aimed.append(tracker.aim(target))
        tracker.push(aimed[-1])
    np.testing.assert_array_equal(aimed, MODEL.invert(targets).u)


def test_aim_beyond_the_range_is_refused_or_the_nearest_end():
    tracker = MODEL.track("demagnetised")
    low, high = MODEL.range
    for target in (low - 1, high + 1):
        with pytest.raises(UnreachableError, match='pass unreachable="clip"'):
            tracker.aim(target)
    assert MODEL.simulate([tracker.aim(high + 1e-14)])[0] == pytest.approx(high)
    assert (tracker.aim(low - 1, "clip"), tracker.aim(high + 1, "clip")) == (-1.0, 1.0)


def test_the_memory_grows_with_the_number_of_extrema():
    swing = np.linspace(1, 0, 2000) * np.where(np.arange(2000) % 2, -1, 1)
    tracker = MODEL.track()
    followed = [tracker.push(value) for value in swing]
    np.testing.assert_array_equal(followed, MODEL.simulate(swing))
    assert len(tracker.memory) > 1900


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_refused_inputs_do_not_change_the_memory(value):
    tracker = MODEL.track()
    tracker.push(0.3)
    before = tracker.memory
    with pytest.raises(ParameterError, match="finite"):
        tracker.push(value)
    with pytest.raises(ParameterError, match="finite"):
        tracker.aim(value)
    assert tracker.memory == before


def test_aiming_needs_a_monotone_model():
    butterfly = Preisach([-1, 0, 1], [[-1.0, 0.0], [0.0, 1.0]])
    with pytest.raises(NotInvertibleError):
        butterfly.track().aim(0.0)
