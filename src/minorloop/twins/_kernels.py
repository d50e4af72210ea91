"""Compiled physics of the twins: arrays in, arrays out.

Each ``*_run`` integrates a plant over steps of lengths ``h`` (N,) with inputs ``u`` (N,) at their
ends and coupling gains ``gain`` (N,). It changes ``state`` and returns the outputs (N,). The method
is implicit Euler: an explicit update of the pinning terms is unstable, because one step of the
input is many times their memory.
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
def ipmc_charge(q0, chi, u, pace, vs, strength, rate):
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
        new = ipmc_charge(q, chi, u[n], h[n] / tau1, vs, strength, rate)
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
def fibre_doping(q0, chi, u, pace_up, pace_down, e0, width, strength, rate):
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
        new = fibre_doping(q, chi, u[n], base / tau_up, base / tau_down, e0, width, strength, rate)
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
def course(c, t):
    """Value at time t of a quantity that steps or ramps once, and oscillates from then on."""
    start, end, at, duration, amplitude, period = c
    if t < at:
        return start
    value = end if t >= at + duration else start + (end - start) * (t - at) / duration
    if amplitude != 0.0:
        value += amplitude * math.sin(2.0 * math.pi * (t - at) / period)
    return value


@njit(cache=True, nogil=True)
def remember(past, mark, t, y, spacing):
    """Add outputs y at time t to the ring ``past``; the newest row is at ``mark[0]``.

    Row ``mark[0]`` always has the latest time. A new row begins ``spacing`` after the one before,
    so that many short steps do not overwrite rows that are still needed.
    """
    rows = past.shape[0]
    before = (mark[0] - 1) % rows
    if past[mark[0], 0] - past[before, 0] >= spacing:
        mark[0] = (mark[0] + 1) % rows
    past[mark[0], 0] = t
    past[mark[0], 1:] = y


@njit(cache=True, nogil=True)
def recall(past, mark, t, out):
    """Outputs at time t from the ring, linear between its rows; the oldest for earlier times."""
    rows = past.shape[0]
    newer = mark[0]
    for back in range(1, rows):
        older = (mark[0] - back) % rows
        if past[older, 0] <= t or back == rows - 1:
            gap = past[newer, 0] - past[older, 0]
            share = (t - past[older, 0]) / gap if gap > 0.0 else 1.0
            share = min(max(share, 0.0), 1.0)
            out[:] = past[older, 1:] + share * (past[newer, 1:] - past[older, 1:])
            return
        newer = older


@njit(cache=True, nogil=True)
def catheter_step(axis, drive, stretch, rate, h):
    """Integrate one axis of the catheter over a step.

    ``axis`` is the motor's rate, its position, the tip's position, and the direction of sliding
    (-1, 0 where it sticks, 1). ``drive`` is acceleration, breakaway, sliding, relaxation, and the
    two ends of the travel. Breakaway and sliding are the lags at which static friction ends and
    begins; ``stretch`` multiplies them.
    """
    most = drive[0] * h
    before = axis[0]
    axis[0] += min(max(rate - before, -most), most)
    axis[1] += 0.5 * h * (before + axis[0])
    if axis[1] <= drive[4] or axis[1] >= drive[5]:
        axis[1] = min(max(axis[1], drive[4]), drive[5])
        axis[0] = 0.0
    lag = axis[1] - axis[2]
    if axis[3] == 0.0 and abs(lag) > stretch * drive[1]:
        axis[3] = 1.0 if lag > 0.0 else -1.0
    if axis[3] != 0.0:
        pace = h / drive[3]
        goal = axis[1] - axis[3] * stretch * drive[2]
        moved = pace * (goal - axis[2]) / (1.0 + pace)
        if moved * axis[3] > 0.0:
            axis[2] += moved
        else:
            axis[3] = 0.0


@njit(cache=True, nogil=True)
def catheter_run(state, drives, growth, clock, ends, first, u, pace, delay, past, mark):
    """Advance and roll of the catheter under rates that are linear between samples.

    As ``head_run``; ``drives`` (2, 6) are those of ``catheter_step``, and ``growth`` is how
    much friction grows per millimetre of catheter in the pipe.
    """
    out = np.empty((ends.size, 2))
    began = 0.0
    for n in range(ends.size):
        gap = ends[n] - began
        steps = int(max(math.ceil(gap / pace[0] - 1e-9), 1) * pace[1])
        h = gap / steps
        for k in range(1, steps + 1):
            stretch = 1.0 + growth * state[0, 2]
            for a in range(2):
                before = first[a] if n == 0 else u[n - 1, a]
                rate = before + (u[n, a] - before) * k / steps
                catheter_step(state[a], drives[a], stretch, rate, h)
            if delay > 0.0:
                now = clock + began + k * h
                remember(past, mark, now, state[:, 2], 0.25 * pace[0] / pace[1])
        began = ends[n]
        if delay > 0.0:
            recall(past, mark, clock + began - delay, out[n])
        else:
            out[n] = state[:, 2]
    return out
