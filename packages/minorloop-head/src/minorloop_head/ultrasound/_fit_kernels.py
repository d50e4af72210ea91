"""Compiled loops for the fit of a pit to traces: arrays in, arrays out.

Arrays (K, 2, F) hold spectra, their real parts before their imaginary ones.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop_head.ultrasound._field_kernels import phases

_STEPS = 4
"""Newton steps from the best trial: three give the rounding error, and one is spare."""


@njit(cache=True, nogil=True, fastmath=True)
def best_shifts(product, wavenumbers, trials, turns, slip, shift):
    """Fill shift (K,) with the most likely distances of traces from the plane.

    A distance s maximises Re(sum product exp(-2 i k s)) - s^2 / (2 slip^2); ``product`` (K, 2, F)
    is the expected spectrum, conjugate, times the received one over the square of the noise. The
    best of ``trials`` (T,), with exp(2 i k s) in ``turns`` (T, 2, F), is improved by Newton steps.
    """
    k0, dk, count = wavenumbers[0], wavenumbers[1] - wavenumbers[0], wavenumbers.size
    turn = np.empty((2, count))
    for n in range(shift.size):
        best, s = -np.inf, 0.0
        for t in range(trials.size):
            score = 0.0
            for f in range(count):
                score += product[n, 0, f] * turns[t, 0, f] + product[n, 1, f] * turns[t, 1, f]
            score -= 0.5 * (trials[t] / slip) ** 2
            if score > best:
                best, s = score, trials[t]
        for _ in range(_STEPS):
            phases(2.0 * k0 * s, 2.0 * dk * s, turn)
            slope, bend = -s / slip**2, 1.0 / slip**2
            for f in range(count):
                x, y, k = product[n, 0, f], product[n, 1, f], wavenumbers[f]
                slope += 2.0 * k * (y * turn[0, f] - x * turn[1, f])
                bend += 4.0 * k * k * (x * turn[0, f] + y * turn[1, f])
            if bend > 0.0:
                s += min(max(slope / bend, -0.5 * slip), 0.5 * slip)
        shift[n] = s


@njit(cache=True, nogil=True, fastmath=True)
def residual_power(received, expected, wavenumbers, shift, power):
    """Fill power (K,) with the mean of |received - expected exp(2 i k shift)|^2 over F."""
    k0, dk, count = wavenumbers[0], wavenumbers[1] - wavenumbers[0], wavenumbers.size
    turn = np.empty((2, count))
    for n in range(shift.size):
        phases(2.0 * k0 * shift[n], 2.0 * dk * shift[n], turn)
        total = 0.0
        for f in range(count):
            x, y = expected[n, 0, f], expected[n, 1, f]
            real = received[n, 0, f] - x * turn[0, f] + y * turn[1, f]
            imaginary = received[n, 1, f] - x * turn[1, f] - y * turn[0, f]
            total += real * real + imaginary * imaginary
        power[n] = total / count
