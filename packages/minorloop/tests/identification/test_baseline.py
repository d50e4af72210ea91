import numpy as np
import pytest

from minorloop.identification.baseline import delayed, percent, polynomial_nrmse
from minorloop.identification.curves import Curves


def test_a_delayed_polynomial_is_found():
    u = np.sin(np.arange(300) / 9) + 0.3 * np.sin(np.arange(300) / 31)
    y = delayed(u, 4) ** 3 - delayed(u, 4)
    train = scored = np.ones(300, dtype=bool)
    assert polynomial_nrmse(u, y, train, scored) < 1e-12
    curves = Curves(np.array([0, 150]), "negative")
    assert polynomial_nrmse(u, curves.delayed(u, 4) ** 3, train, scored, curves) < 1e-12


def test_a_long_periodic_record_is_not_seen_at_one_phase():
    k = np.arange(1_000_000)
    u = np.round(np.sin(2 * np.pi * k / 500), 3)
    every = np.ones(k.size, dtype=bool)
    assert polynomial_nrmse(u, u**2, every, every) < 1e-6


def test_few_distinct_inputs_do_not_give_a_high_degree():
    u = np.resize([0.0, 1.0, 2.0], 60)
    y = np.random.default_rng(0).normal(size=60)
    every = np.ones(60, dtype=bool)
    best = min(np.std(y - mean_by(u, y, k)) for k in range(21)) / np.ptp(y)
    assert polynomial_nrmse(u, y, every, every) == pytest.approx(best, rel=1e-6)


def mean_by(u, y, delay):
    """Mean output for each delayed input: the best function of it."""
    late = delayed(u, delay)
    return np.array([y[late == value].mean() for value in late])


def test_no_percentage_has_dozens_of_digits():
    assert [percent(share) for share in (0.15504, 1e36)] == ["15.504%", "1e+38%"]
