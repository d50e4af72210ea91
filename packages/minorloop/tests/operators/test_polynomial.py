import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop import NotInvertibleError, Polynomial

QUADRATIC = Polynomial([0.34, 8.2, -0.35], -1.2, 1.2)
inputs = st.lists(st.floats(-1.2, 1.2), min_size=1, max_size=40).map(np.array)


@given(inputs)
def test_inverse_of_the_quadratic_is_the_minus_branch(u):
    y = QUADRATIC.simulate(u)
    closed = (8.2 - np.sqrt(8.2**2 - 1.4 * (y - 0.34))) / 0.7
    result = QUADRATIC.invert(y)
    np.testing.assert_allclose(result.u, closed, atol=1e-13)
    np.testing.assert_allclose(result.u, u, atol=1e-13)
    assert result.worst <= 1e-12 * 19.68


@given(inputs, st.integers(1, 4), st.sampled_from([-1.0, 1.0]), st.floats(-2, 2))
def test_inverts_monotone_curves_of_any_degree(u, degree, sign, shift):
    odd = np.polynomial.polynomial.polypow([-shift, 1.0], 2 * degree - 1)
    model = Polynomial(sign * (odd + np.eye(odd.size)[1]), -1.2, 1.2)
    result = model.invert(model.simulate(u))
    low, high = model.range
    assert result.worst <= 1e-12 * (high - low)


@pytest.mark.parametrize(
    ("coefficients", "ends", "stretch"),
    [
        ([0.0, 0.0, 1.0], (-1.0, 2.0), (0.0, 2.0)),
        ([0.0, 0.0, -1.0], (-2.0, 1.0), (-2.0, 0.0)),
        ([0.0, -3.0, 0.0, 1.0], (-1.5, 1.5), (-1.0, 1.0)),
        ([0.0, 3.0, 0.0, -1.0], (-1.5, 2.5), (1.0, 2.5)),
    ],
)
def test_the_message_names_the_widest_monotone_interval(coefficients, ends, stretch):
    model = Polynomial(coefficients, *ends)
    assert not model.invertible
    assert model.monotone_stretch == pytest.approx(stretch)
    with pytest.raises(NotInvertibleError, match="monotone_stretch"):
        model.invert([0.0])
    cut = Polynomial(coefficients, *model.monotone_stretch)
    assert cut.invert([sum(cut.range) / 2]).worst < 1e-14


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=5), st.floats(-100, 100), st.floats(0.1, 10))
def test_fit_follows_a_polynomial(coefficients, low, width):
    u = np.linspace(low, low + width, 50)
    y = np.polynomial.polynomial.polyval((u - low) / width, coefficients)
    model = Polynomial.fit(u, y, len(coefficients) - 1)
    assert (model.low, model.high) == (u[0], u[-1])
    # Powers of an input far from zero cancel, by the ratio of its size to its range.
    lost = (1 + abs(low) / width) ** (len(coefficients) - 1)
    np.testing.assert_allclose(model.simulate(u), y, atol=1e-12 * lost + 1e-11)


def test_fit_leaves_out_gaps_and_accepts_a_wider_range():
    u = np.linspace(-1, 1, 21)
    y = QUADRATIC.simulate(u)
    y[::4] = np.nan
    model = Polynomial.fit(u, y, low=-1.2, high=1.2)
    np.testing.assert_allclose(model.coefficients, QUADRATIC.coefficients)
    assert (model.low, model.high) == (-1.2, 1.2)
