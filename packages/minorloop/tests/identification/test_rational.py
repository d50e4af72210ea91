import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop.dynamics.linear import Linear
from minorloop.identification.rational import fit_response

HERTZ = np.geomspace(0.005, 2, 12)
CORNERS = st.floats(np.log(0.008), np.log(1.2)).map(lambda x: -2 * np.pi * float(np.exp(x)))


def relative(model, gains):
    return float(np.sqrt(np.mean(np.abs(model.response(HERTZ) / gains - 1) ** 2)))


@given(st.lists(CORNERS, min_size=1, max_size=3), st.lists(CORNERS, max_size=3))
@settings(max_examples=10)
def test_the_response_of_a_rational_function_is_found(poles, zeros):
    truth = Linear.from_poles(poles, zeros[: len(poles) - 1])
    fit = fit_response(HERTZ, truth.response(HERTZ), order=len(poles))
    assert fit.error < 1e-5
    assert abs(fit.model.dc_gain - 1) <= 1e-12
    assert fit.model.stable


def test_a_fit_of_noisy_gains_has_no_greater_error_than_the_true_function():
    truth, rng = Linear.from_poles([-0.1, -3.0], [-0.07]), np.random.default_rng(0)
    clean = np.tile(truth.response(HERTZ), (3, 1))
    gains = clean * (1 + 0.02 * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape)))
    fit = fit_response(HERTZ, gains)
    assert fit.error <= relative(truth, gains)
    np.testing.assert_allclose(fit.model.response(HERTZ), clean[0], rtol=0.05)


def test_the_fit_of_gains_of_an_unstable_plant_is_stable():
    fit = fit_response(HERTZ, np.conj(Linear.lags(1.0).response(HERTZ)))
    assert fit.model.stable
    assert abs(fit.model.dc_gain - 1) <= 1e-12


def test_the_lowest_sufficient_order_is_chosen():
    fit = fit_response(HERTZ, Linear.lags(2.0).response(HERTZ))
    assert fit.model.order == 1
    few = fit_response([0.1, 1.0], Linear.lags(2.0).response([0.1, 1.0]))
    assert list(few.errors) == [1]
