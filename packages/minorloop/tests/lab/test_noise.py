import numpy as np
import pytest

from minorloop.lab.noise import noise_of


@pytest.mark.parametrize("order", [1, 2, 4])
def test_the_noise_of_a_slow_signal_is_found_from_differences_of_any_order(order):
    rng = np.random.default_rng(1000)
    signal = np.sin(np.linspace(0.0, 6.0, 20_000)) + rng.normal(0.0, 0.01, 20_000)
    signal[::500] += 1.0
    assert noise_of(np.diff(signal, order), order) == pytest.approx(0.01, rel=0.05)
