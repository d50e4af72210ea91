"""Compiled loops of linear systems: they take and return only arrays."""

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


@njit(cache=True, nogil=True)
def lag(decay, x, before, lagged):
    """Compute the outputs of n first-order lags for a signal that is held between samples.

    ``decay`` (T, n) is the remaining share of each lag after the step to a sample, ``x`` (T,) the
    signal, ``before`` the earlier value at which all lags settled; ``lagged`` (T, n) is filled.
    """
    for i in range(lagged.shape[1]):
        now = before
        for k in range(x.size):
            now = x[k] + decay[k, i] * (now - x[k])
            lagged[k, i] = now


@njit(cache=True, nogil=True)
def compensate(decay, strengths, gain, targets, crept, x):
    """Compute the signal with which a prompt part and n lags together give the target outputs.

    ``decay`` (T, n) is as in `lag`; ``strengths`` (n,) and ``gain`` are the factors of the lags and
    of the prompt part. ``crept`` (n,), the last lags, is changed in place; ``x`` (T,) is filled.
    """
    for k in range(x.size):
        left, prompt = targets[k], gain
        for i in range(crept.size):
            left -= strengths[i] * decay[k, i] * crept[i]
            prompt += strengths[i] * (1 - decay[k, i])
        x[k] = left / prompt
        for i in range(crept.size):
            crept[i] = x[k] + decay[k, i] * (crept[i] - x[k])
