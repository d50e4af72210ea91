import pytest

from papers.catheter.control.internal_model import InternalModel
from papers.catheter.control.laws import slow_pole
from wires import made_up


def test_the_lag_of_the_model_is_that_of_the_wire_with_its_latent_heat():
    wire = made_up(latent=2e-3, lag=4.0)
    assert InternalModel(wire=wire).model_lag == pytest.approx(4.0 + 2e-3 * 60.0 / 0.16)
    assert InternalModel(wire=wire, lag=3.0).model_lag == 3.0


def test_the_slow_pole_leaves_the_inverse_alone_before_the_wire():
    wire = made_up(latent=0.0)
    law = slow_pole(wire)
    assert law.response == InternalModel(wire=wire).model_lag
    state = law.begin()
    for _ in range(200):
        current, state = law.step(state, 30.0, state.lag)
        assert wire.operator.track().peek(current**2) == pytest.approx(30.0, abs=0.1)
