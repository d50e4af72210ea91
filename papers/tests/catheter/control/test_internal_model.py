import pytest

from papers.catheter.control.internal_model import InternalModel
from papers.catheter.control.laws import slow_pole
from wires import made_up


def test_the_lag_of_the_model_is_that_of_the_wire_with_its_latent_heat():
    wire = made_up(latent=2e-3, lag=4.0)
    assert InternalModel(wire=wire).model_lag == pytest.approx(4.0 + 2e-3 * 60.0 / 0.16)
    assert InternalModel(wire=wire, lag=3.0).model_lag == 3.0


@pytest.mark.parametrize("seconds", [5.0, 120.0])
def test_the_model_uses_saturated_values_so_that_nothing_winds_up(seconds):
    wire = made_up()
    law = InternalModel(wire=wire)
    state = law.begin()
    top = wire.operator.range[1]
    for _ in range(round(seconds / law.interval)):
        current, state = law.step(state, 500.0, min(state.lag, top))
        assert current == law.highest
        assert -1e-9 <= state.lag <= top + 1e-9
    # A target below: the current leaves its limit at once, however long it was there.
    current, state = law.step(state, 5.0, min(state.lag, top))
    assert current < 0.5 * law.highest


def test_an_exact_model_leaves_nothing_to_feed_back():
    wire = made_up(latent=0.0)
    law = InternalModel(wire=wire)
    state, past = law.begin(), [0.0]
    for _ in range(600):
        _, state = law.step(state, 30.0, past[-1])
        past.append(state.lag)
        assert abs(state.missing) < 1e-9
    assert state.lag == pytest.approx(30.0, abs=0.1)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_as_many_angles_are_remembered_as_the_readings_are_late(delay):
    law = InternalModel(wire=made_up(), delay=delay)
    _, state = law.step(law.begin(), 20.0, 0.0)
    assert len(state.past) == delay


def test_the_slow_pole_leaves_the_inverse_alone_before_the_wire():
    wire = made_up(latent=0.0)
    law = slow_pole(wire)
    assert law.response == InternalModel(wire=wire).model_lag
    state = law.begin()
    for _ in range(200):
        current, state = law.step(state, 30.0, state.lag)
        assert wire.operator.track().peek(current**2) == pytest.approx(30.0, abs=0.1)
