"""Compiled physics of the twins: arrays in, arrays out.

Each ``*_run`` integrates a strip or a fibre over steps of lengths ``h`` (N,) with inputs ``u`` (N,)
at their ends and coupling gains ``gain`` (N,). It changes ``state`` and returns the outputs (N,).
The method is implicit Euler: an explicit update of the pinning terms is unstable, because one step
of the input is many times their memory.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

ITERATIONS = 200
"""Most iterations of the guarded Newton method, so that it always ends."""
TOLERANCE = 1e-15
"""Of a root, as a share of its range: rounding."""


@njit(cache=True, nogil=True)
def pinned(chi, start, q, strength, rate):
    """Pinning potentials after a monotone change from start to q: (sum, slope of the sum)."""
    way = 1.0 if q >= start else -1.0
    total, slope = 0.0, 0.0
    for i in range(chi.size):
        left = (chi[i] - strength[i] * way) * math.exp(-rate[i] * abs(q - start))
        total += strength[i] * way + left
        slope -= way * rate[i] * left
    return total, slope


@njit(cache=True, nogil=True)
def pin(chi, start, q, strength, rate):
    """Update the pinning potentials exactly (Armstrong and Frederick's law)."""
    way = 1.0 if q >= start else -1.0
    for i in range(chi.size):
        limit = strength[i] * way
        chi[i] = limit + (chi[i] - limit) * math.exp(-rate[i] * abs(q - start))


@njit(cache=True, nogil=True)
def _ipmc_charge(q0, chi, u, pace, vs, strength, rate):
    """Root q of q - q0 = pace (u - pinning(q) - vs atanh(q / vs)), by guarded Newton."""
    pull = u - np.sum(chi) - vs * math.atanh(q0 / vs)
    low, high = (q0, vs) if pull >= 0 else (-vs, q0)
    q = q0
    for _ in range(ITERATIONS):
        pinning, slope = pinned(chi, q0, q, strength, rate)
        error = q - q0 - pace * (u - pinning - vs * math.atanh(q / vs))
        if error > 0:
            high = q
        else:
            low = q
        steep = 1.0 + pace * (slope + 1.0 / (1.0 - (q / vs) ** 2))
        better = q - error / steep
        if not low < better < high:
            better = 0.5 * (low + high)
        if abs(better - q) <= TOLERANCE * vs:
            break
        q = better
    return q


@njit(cache=True, nogil=True)
def ipmc_run(state, parameters, strength, rate, u, h, gain):
    """IPMC strip: state (charge, water, creep, pinning...); curvature after each step."""
    tau1, vs, tau2, drag, k0, a2, m0, tau_c, cc = parameters
    q, water, creep = state[0], state[1], state[2]
    chi = state[3:]
    out = np.empty(h.size)
    for n in range(h.size):
        new = _ipmc_charge(q, chi, u[n], h[n] / tau1, vs, strength, rate)
        pin(chi, q, new, strength, rate)
        q = new
        water = (water + h[n] / tau2 * drag * q) / (1.0 + h[n] / tau2)
        z = q - water
        bend = gain[n] * (k0 * z - 2.0 * a2 * z * z) + m0
        creep = (creep + h[n] / tau_c * cc * bend) / (1.0 + h[n] / tau_c)
        out[n] = bend + creep
    state[0], state[1], state[2] = q, water, creep
    return out


@njit(cache=True, nogil=True)
def _fibre_doping(q0, chi, u, pace_up, pace_down, e0, width, strength, rate):
    """Root q of q - q0 = pace (u - e0 - width ln(q / (1 - q)) - pinning(q)), guarded Newton."""
    pull = u - np.sum(chi) - e0 - width * math.log(q0 / (1.0 - q0))
    low, high = (q0, 1.0) if pull >= 0 else (0.0, q0)
    pace = pace_up if pull >= 0 else pace_down
    q = q0
    for _ in range(ITERATIONS):
        pinning, slope = pinned(chi, q0, q, strength, rate)
        error = q - q0 - pace * (u - e0 - width * math.log(q / (1.0 - q)) - pinning)
        if error > 0:
            high = q
        else:
            low = q
        steep = 1.0 + pace * (slope + width / (q * (1.0 - q)))
        better = q - error / steep
        if not low < better < high:
            better = 0.5 * (low + high)
        if abs(better - q) <= TOLERANCE:
            break
        q = better
    return q


@njit(cache=True, nogil=True)
def fibre_run(state, parameters, strength, rate, u, h, gain):
    """Fibre: state (doping, diffused doping, creep, pinning...); length change after each step."""
    e0, width, tau_up, tau_down, tau_dif, tau_c, cc, span = parameters
    q, diffused, creep = state[0], state[1], state[2]
    chi = state[3:]
    out = np.empty(h.size)
    for n in range(h.size):
        base = h[n] / (4.0 * width)
        new = _fibre_doping(q, chi, u[n], base / tau_up, base / tau_down, e0, width, strength, rate)
        pin(chi, q, new, strength, rate)
        q = new
        diffused = (diffused + h[n] / tau_dif * q) / (1.0 + h[n] / tau_dif)
        creep = (creep + h[n] / tau_c * cc * diffused) / (1.0 + h[n] / tau_c)
        out[n] = gain[n] * span * (diffused + creep)
    state[0], state[1], state[2] = q, diffused, creep
    return out


@njit(cache=True, nogil=True)
def relaxing(gaps, x, gain, tau):
    """Response (T,) of a first-order high-pass with a gain to x (T,), linear between samples."""
    out = np.zeros(x.size)
    for n in range(1, x.size):
        keep = math.exp(-gaps[n - 1] / tau)
        out[n] = keep * out[n - 1] + gain * (x[n] - x[n - 1]) * tau / gaps[n - 1] * (1.0 - keep)
    return out


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
