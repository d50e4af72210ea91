"""Compiled loop of linear systems: takes and returns arrays only."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def march(phi, at_begin, at_end, which, begin, end, x, states):
    """Compute the states after each of K time steps.

    The steps have M different lengths; ``which`` (K,) is the index of the length of each.
    ``phi`` (M, n, n), ``at_begin`` and ``at_end`` (M, n) are the factors of the state and of the
    input at both ends of a step; ``begin`` and ``end`` (K,) are these inputs. ``x`` (n,) is
    changed in place, ``states`` (K, n) is filled.
    """
    order = x.size
    new = np.empty(order)
    for k in range(which.size):
        m = which[k]
        for i in range(order):
            total = at_begin[m, i] * begin[k] + at_end[m, i] * end[k]
            for j in range(order):
                total += phi[m, i, j] * x[j]
            new[i] = total
        for i in range(order):
            x[i] = new[i]
            states[k, i] = new[i]
