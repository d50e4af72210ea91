import numpy as np

from minorloop.identification.baseline import polynomial_nrmse
from minorloop.identification.curves import Curves


def test_a_delayed_polynomial_is_found():
    u = np.sin(np.arange(300) / 9) + 0.3 * np.sin(np.arange(300) / 31)
    late = Curves.whole("negative").delayed(u, 4)
    y = late**3 - late
    train = scored = np.ones(300, dtype=bool)
    assert polynomial_nrmse(u, y, train, scored) < 1e-12
    curves = Curves(np.array([0, 150]), "negative")
    assert polynomial_nrmse(u, curves.delayed(u, 4) ** 3, train, scored, curves) < 1e-12


def test_a_long_periodic_record_is_not_seen_at_one_phase():
    k = np.arange(1_000_000)
    u = np.round(np.sin(2 * np.pi * k / 500), 3)
    every = np.ones(k.size, dtype=bool)
    assert polynomial_nrmse(u, u**2, every, every) < 1e-6
