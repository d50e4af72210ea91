from itertools import pairwise

import numpy as np
import pytest

from minorloop.dynamics import state_space
from minorloop.dynamics.state_space import propagate, transitions
from minorloop.errors import ParameterError

A = np.array([[-0.5, -1.0], [1.0, 0.0]])
B = np.array([1.0, 0.3])


@pytest.mark.parametrize("delay", [0.0, 0.13, 0.5, 40.0])
@pytest.mark.parametrize("between", ["held", "straight"])
def test_dead_time_need_not_be_whole_samples(delay, between):
    """Compared with the same system on a fine grid that contains every jump."""
    system = (A, B, np.array([0.2, 1.0]), 0.7)
    coarse = np.array([0.0, 0.3, 0.7, 1.1, 2.0, 2.6, 3.5])
    u = np.array([1.0, 1.0, -2.0, 0.5, 0.5, 3.0, 3.0])
    fine = 0.01 * np.arange(-30, 351)

    def at(s):
        if between == "straight":
            return np.where(s < 0, 0.4, np.interp(s, coarse, u))
        first = np.minimum(np.searchsorted(coarse, s), u.size - 1)
        return np.where(s < -0.3, 0.4, u[first])

    phi, at_begin, at_end, _ = transitions(A, B, np.array([0.01]))
    x = np.linalg.solve(A, -B * 0.4)
    rest, y = x.copy(), [np.nan]
    for begin, end in pairwise(fine):
        left, right = at(begin - delay + 1e-9), at(end - delay - 1e-9)
        x = phi[0] @ x + at_begin[0] * left + at_end[0] * right
        y.append(system[2] @ x + 0.7 * right)
    wanted = np.interp(coarse, fine, y)
    got = propagate(system, rest, coarse, u, delay=delay, before=0.4, between=between)
    first = 1 if between == "straight" else 0
    np.testing.assert_allclose(got[first:], wanted[first:], atol=1e-6)


@pytest.mark.parametrize("pole", [0.0, -0.3, -1e-12])
def test_refuses_poles_that_no_continuous_system_has(pole):
    with pytest.raises(ParameterError, match="identify with a lower order or sample faster"):
        state_space.continuous(np.array([0.0, 1.0]), np.array([1.0, -pole]), 1.0)
    state_space.refuse_alternating(np.array([0.5, -0.3 + 0.1j, -0.3 - 0.1j]))
