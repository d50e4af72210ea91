"""The oscillator of the Bouc-Wen benchmark, integrated by the method of Newmark."""

import numpy as np
from numba import njit

_ITERATIONS = 200
"""Largest number of iterations of Newton's method."""
_ROUNDING = 1e-13
"""Relative change of the rates at which it ends."""


@njit(cache=True, nogil=True)
def newmark(force, h, mass, damping, stiffness, alpha, beta, gamma, delta, exponent):
    """Return the displacement (T,) for a force (T,), from rest.

    Acceleration and rate of the hysteretic force z are the unknowns of each step. Displacement and
    velocity follow by the constants (1/2, 1/4), z by the trapezoidal rule.
    """
    half, quarter = h / 2, h * h / 4
    y, v, z, rate = 0.0, 0.0, 0.0, 0.0
    a = force[0] / mass
    out = np.empty_like(force)
    out[0] = y
    for t in range(1, force.size):
        y_free, v_free, z_free = y + h * v + quarter * a, v + half * a, z + half * rate
        for _ in range(_ITERATIONS):
            y, v, z = y_free + quarter * a, v_free + half * a, z_free + half * rate
            size, up = abs(z), 1.0 if v > 0 else -1.0
            sign = 1.0 if z > 0 else -1.0
            power = size**exponent
            steep = exponent * size ** (exponent - 1) if size > 0 else 0.0
            pull = beta * (gamma * up * sign + delta)
            rest_force = mass * a + damping * v + stiffness * y + z - force[t]
            rest_rate = rate - v * (alpha - pull * power)
            # Both equations, linear in the changes of the two rates.
            by_a = mass + damping * half + stiffness * quarter
            rate_by_a = -half * (alpha - pull * power)
            rate_by_rate = 1.0 + half * v * pull * steep * sign
            det = by_a * rate_by_rate - half * rate_by_a
            da = (rest_force * rate_by_rate - half * rest_rate) / det
            dr = (by_a * rest_rate - rate_by_a * rest_force) / det
            a -= da
            rate -= dr
            if abs(da) <= _ROUNDING * (1 + abs(a)) and abs(dr) <= _ROUNDING * (1 + abs(rate)):
                break
        y, v, z = y_free + quarter * a, v_free + half * a, z_free + half * rate
        out[t] = y
    return out
