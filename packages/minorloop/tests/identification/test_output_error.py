import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from later import Later
from minorloop.identification.output_error import (
    Coefficients,
    Stretch,
    Structure,
    covariance,
    equation_error,
    output_error,
)

signal = Later("scipy.signal")

RNG = np.random.default_rng(4)
A, B = np.poly([0.9, 0.6])[1:], np.array([0.3, -0.1])
TRUTH = Coefficients(A, B, 2)
FORM = Structure(2, 2, 2)


def stretch(noise=0.0, seed=0, samples=300, u=None):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=samples) if u is None else u
    return Stretch(u, TRUTH.simulate(u) + rng.normal(0, noise, u.size))


def test_simulation_is_the_difference_equation():
    u = RNG.normal(size=20)
    y = np.zeros(20)
    for k in range(20):
        y[k] -= sum(A[i] * y[k - 1 - i] for i in range(2) if k - 1 - i >= 0)
        y[k] += sum(B[i] * u[k - 2 - i] for i in range(2) if k - 2 - i >= 0)
    np.testing.assert_allclose(TRUTH.simulate(u), y, atol=1e-12)
    np.testing.assert_allclose(TRUTH.dc_gain, 0.2 / 0.04)


@given(st.integers(0, 2**32 - 1))
def test_sensitivities_are_the_derivatives(seed):
    u, h = np.random.default_rng(seed).normal(size=40), 1e-6
    columns = TRUTH.sensitivities(u)
    for k in range(4):
        bump = np.where(np.arange(4) == k, h, 0.0)
        up, down = (
            Coefficients(A + way * bump[:2], B + way * bump[2:], 2).simulate(u) for way in (1, -1)
        )
        np.testing.assert_allclose(columns[:, k], (up - down) / (2 * h), atol=1e-5)


def test_output_error_has_no_bias_where_equation_error_has():
    """Noise on the output: least squares on the equation pulls the poles inwards."""
    errors = {equation_error: [], output_error: []}
    for seed in range(12):
        record = [stretch(0.2, seed, 1000)]
        for fit, kept in errors.items():
            kept.append(fit(record, FORM).a - A)
    biased, unbiased = (np.abs(np.mean(kept, axis=0)).max() for kept in errors.values())
    assert biased > 0.2
    assert unbiased < 0.02


@pytest.mark.parametrize(("colour", "least", "most"), [(0.0, 0.8, 1.25), (0.9, 0.9, 3.0)])
def test_covariance_is_the_spread_over_many_records(colour, least, most):
    """And rather more than it where errors resemble each other; counted as white, half of it."""
    u = np.repeat(np.random.default_rng(0).normal(size=40), 20)
    y, found, told = TRUTH.simulate(u), [], []
    for seed in range(80):
        white = np.random.default_rng(seed).normal(0, 0.02, u.size)
        record = [Stretch(u, y + signal.lfilter([1.0], [1.0, -colour], white))]
        one = output_error(record, FORM)
        found.append(np.append(one.a, one.b))
        told.append(np.sqrt(np.diag(covariance(record, one))))
    ratio = np.mean(told, axis=0) / np.std(found, axis=0)
    assert least <= ratio.min() <= ratio.max() <= most
