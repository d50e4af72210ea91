"""Compiled physics of the fast stage: arrays in, arrays out."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def hysteretic(u, radii, weights, strength, rate):
    """Plays at rest at the first input, less pinning potentials: (T,) for inputs u (T,)."""
    play = u[0] + radii
    chi = np.zeros(strength.size)
    out = np.empty(u.size)
    for k in range(u.size):
        total = 0.0
        for i in range(radii.size):
            play[i] = min(max(play[i], u[k] - radii[i]), u[k] + radii[i])
            total += weights[i] * play[i]
        change = u[k] - u[k - 1] if k > 0 else 0.0
        way = 1.0 if change >= 0 else -1.0
        for i in range(chi.size):
            # Armstrong and Frederick's law, which is that of Bouc and Wen with delta = 0, exactly.
            limit = strength[i] * way
            chi[i] = limit + (chi[i] - limit) * math.exp(-rate[i] * abs(change))
            total -= chi[i]
        out[k] = total
    return out


@njit(cache=True, nogil=True)
def creeping_resonance(w, interval, substeps, omega, damping, times, shares):
    """Positions (T,) of a platform pushed to w (T,) plus its creep, at rest at 0 before.

    The push is constant over a substep, so that each is exact.
    """
    h = interval / substeps
    swing = omega * math.sqrt(1.0 - damping * damping)
    left = math.exp(-damping * omega * h)
    cosine, sine = math.cos(swing * h), math.sin(swing * h)
    lean = damping * omega / swing
    keep = np.exp(-h / times)
    creep = np.zeros(times.size)
    x, v = 0.0, 0.0
    out = np.empty(w.size)
    for k in range(w.size):
        for _ in range(substeps):
            push = w[k]
            for i in range(times.size):
                creep[i] = w[k] + (creep[i] - w[k]) * keep[i]
                push += shares[i] * creep[i]
            off = x - push
            x = push + left * (off * (cosine + lean * sine) + v * sine / swing)
            v = left * (v * (cosine - lean * sine) - off * omega * omega / swing * sine)
        out[k] = x
    return out
