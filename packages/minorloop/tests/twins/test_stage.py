import numpy as np
import pytest
from scipy.integrate import solve_ivp

from minorloop.twins._kernels import creeping_resonance
from minorloop.twins.stage import RATE, TRAVEL, Stage


def test_the_platform_moves_as_a_general_integrator_says():
    omega, damping, shares, times = 2 * np.pi * 300, 0.05, np.array([0.1]), np.array([0.02])
    w = np.array([1.0] * 60 + [0.3] * 60)

    def rates(t, state):
        push = w[min(int(t * RATE), w.size - 1)]
        x, v, creep = state
        force = omega**2 * (push + shares[0] * creep - x)
        return [v, force - 2 * damping * omega * v, (push - creep) / times[0]]

    at = np.arange(1, w.size + 1) / RATE
    wanted = solve_ivp(
        rates, (0, at[-1]), np.zeros(3), t_eval=at, max_step=2e-6, rtol=1e-8, atol=1e-10
    ).y[0]
    found = creeping_resonance(w, 1 / RATE, 64, omega, damping, times, shares)
    np.testing.assert_allclose(found, wanted, atol=3e-5)


def test_it_has_its_travel_its_creep_and_its_noise():
    stage = Stage(1000)
    quick = stage.positions(np.concatenate([np.linspace(0, 100, 500), np.full(500, 100.0)]), 0.0)
    assert quick[499:].mean() == pytest.approx(1.01 * TRAVEL, rel=0.02)
    held = stage.positions(np.full(20_000, 100.0), 0.0)
    assert 0.01 * TRAVEL < held[-1] - held[2000:3000].mean() < 0.06 * TRAVEL
    read = stage.positions(np.zeros(5000)), stage.positions(np.zeros(5000), experiment=1)
    assert np.std(read[0]) == pytest.approx(0.01, rel=0.05)
    assert not np.array_equal(*read)
    np.testing.assert_array_equal(read[0], Stage(1000).positions(np.zeros(5000)))
    assert 285 <= stage.resonance <= 315
