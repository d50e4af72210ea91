"""The compiled loop under linear systems: arrays in, arrays out."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def march(phi, at_begin, at_end, which, begin, end, x, states):
    """States after each of K stretches of time.

    ``phi`` (M, n, n), ``at_begin`` and ``at_end`` (M, n) belong to M lengths of a stretch,
    ``which`` (K,) says which of them each stretch has; ``begin`` and ``end`` (K,) are the
    input at its two ends. ``x`` (n,) is changed in place, ``states`` (K, n) is filled.
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
