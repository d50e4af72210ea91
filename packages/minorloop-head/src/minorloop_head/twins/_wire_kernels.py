"""Compiled physics of heated wires: arrays in, arrays out.

``axis`` (19,) are the parameters of a wire per metre, in the order of ``wire.wire_numbers``:
heat capacity, latent heat, resistance as martensite and as austenite, circumference, length,
cross-section, recoverable strain, moduli of austenite and martensite, stress influence,
austenite start and finish, martensite start and finish, preload, spring, pulley, strain at rest.
``state`` (axes, 7) is temperature, martensite fraction, effective temperature, compression of the
spring, hottest temperature and highest stress so far, and the temperature of the body of the head,
the same for every wire. ``cooling`` (6,) are the parameters of `surroundings.Cooling`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from minorloop_head.twins._kernels import course, recall, remember

ITERATIONS = 200
NEAR = 1e-11
"""Tolerance of the effective temperature, in K."""
LEAST_RISE = 1.0
"""Rise in K below which convection no longer falls: the air conducts the heat."""


@njit(cache=True, nogil=True)
def martensite(z, z0, xi0, axis):
    """Return the fraction after a monotone change of effective temperature, z0 to z, and its slope.

    The differential form of the cosine laws of Liang and Rogers (1990), integrated exactly: one
    long step and many short ones give the same fraction.
    """
    start, finish, begin, end = axis[11], axis[12], axis[13], axis[14]
    if z > z0:
        if z <= start:
            return xi0, 0.0
        if z >= finish:
            return 0.0, 0.0
        half = 0.5 * math.pi / (finish - start)
        was = math.cos(half * (max(z0, start) - start))
        now = math.cos(half * (z - start))
        scale = xi0 / (was * was)
        return scale * now * now, -2.0 * half * scale * now * math.sin(half * (z - start))
    if z >= begin or z == z0:
        return xi0, 0.0
    if z <= end:
        return 1.0, 0.0
    half = 0.5 * math.pi / (begin - end)
    was = math.sin(half * (min(z0, begin) - end))
    now = math.sin(half * (z - end))
    scale = (1.0 - xi0) / (was * was)
    return 1.0 - scale * now * now, -2.0 * half * scale * now * math.cos(half * (z - end))


@njit(cache=True, nogil=True)
def _wire_stress(xi, axis, recoverable, force):
    """Return the stress of a wire with its spring and a force, and its slope over the fraction."""
    length, area, austenite, soft = axis[5], axis[6], axis[8], axis[9]
    spring = axis[16]
    modulus = austenite + xi * (soft - austenite)
    slack = recoverable + axis[18]
    up = axis[15] + force + spring * length * (slack - recoverable * xi)
    down = area + spring * length / modulus
    steep = -spring * length / (modulus * modulus) * (soft - austenite)
    stress = up / down
    return stress, (-spring * length * recoverable - stress * steep) / down


@njit(cache=True, nogil=True)
def _heat_left(z, start, axis, around, h):
    """Return the error of the heat balance of a step that ends at effective temperature z.

    Returns (error, its slope, temperature, fraction, stress). ``start`` is the state before;
    ``around`` is current, ambient, film coefficient, force and age at the end of the step.
    """
    current, ambient, film, force, age = around
    power, loss = current * current, film * axis[4]
    xi, dxi = martensite(z, start[2], start[1], axis)
    stress, steep = _wire_stress(xi, axis, axis[7] * (1.0 - 0.1 * age), force)
    t = z + stress / axis[10] + 5.0 * age
    gained = h * (power * (axis[3] + xi * (axis[2] - axis[3])) - loss * (t - ambient))
    error = axis[0] * (t - start[0]) - gained - axis[1] * (xi - start[1])
    slope = (axis[0] + h * loss) * (1.0 + steep * dxi / axis[10])
    slope -= (h * power * (axis[2] - axis[3]) + axis[1]) * dxi
    return error, slope, t, xi, stress


@njit(cache=True, nogil=True)
def _wire_step(state, axis, around, h):
    """Integrate one wire over a step, in place, by implicit Euler and safeguarded Newton.

    The unknown is the effective temperature
    T - stress / C - shift, which gives fraction, stress and temperature. The heat balance rises
    with it, at least as steeply as the heat capacity, which brackets the root.
    """
    z = state[2]
    error, slope, t, xi, stress = _heat_left(z, state, axis, around, h)
    far = z - error / (axis[0] + h * around[2] * axis[4])
    low, high = min(z, far), max(z, far)
    for _ in range(ITERATIONS):
        better = z - error / slope
        if not low <= better <= high:
            better = 0.5 * (low + high)
        if abs(better - z) <= NEAR:
            break
        z = better
        error, slope, t, xi, stress = _heat_left(z, state, axis, around, h)
        if error > 0.0:
            high = z
        else:
            low = z
    age = around[4]
    modulus = axis[8] + xi * (axis[9] - axis[8])
    slack = axis[7] * (1.0 - 0.1 * age) * (1.0 - xi) + axis[18]
    state[0], state[1], state[2] = t, xi, z
    state[3] = axis[5] * (slack - stress / modulus)
    state[4], state[5] = max(state[4], t), max(state[5], stress)


@njit(cache=True, nogil=True)
def heads_at_rest(axes, cross, around, loads, age):
    """Return the state (axes, 7) of wires that have been cold for long, at time 0."""
    count = axes.shape[0]
    state = np.empty((count, 7))
    ambient = course(around[0], 0.0)
    for a in range(count):
        axis = axes[a]
        force = course(loads[a], 0.0) / axis[17]
        if count == 2:
            force -= cross[3] * cross[4]
        stress, _ = _wire_stress(1.0, axis, axis[7] * (1.0 - 0.1 * age), force)
        state[a, 0] = state[a, 4] = state[a, 6] = ambient
        state[a, 1] = 1.0
        state[a, 2] = ambient - stress / axis[10] - 5.0 * age
        state[a, 3] = axis[5] * (axis[18] - stress / axis[9])
        state[a, 5] = stress
    return state


@njit(cache=True, nogil=True)
def head_angles(state, axes, cross, out):
    """Fill out with the angles at the sensors in degrees, with the cross-coupling of two axes."""
    for a in range(axes.shape[0]):
        out[a] = state[a, 3] / axes[a, 17]
    if axes.shape[0] == 2:
        pan, tilt = out[0], out[1]
        out[0] = pan + cross[0] * (1.0 + cross[2] * pan) * tilt
        out[1] = tilt + cross[1] * (1.0 + cross[2] * tilt) * pan
    for a in range(axes.shape[0]):
        out[a] *= 180.0 / math.pi


@njit(cache=True, nogil=True)
def _film_share(rise, angle, cooling):
    """Return the film coefficient over that of a straight wire at the rise where it is given.

    ``rise`` is the temperature over that around the wire, in K; ``angle`` in radians.
    """
    warm = max(abs(rise), LEAST_RISE) / cooling[0]
    return math.pow(warm, cooling[1]) * (1.0 + cooling[2] * max(angle, 0.0))


@njit(cache=True, nogil=True)
def head_run(
    state,
    axes,
    cross,
    around,
    loads,
    cooling,
    ageing,
    clock,
    ends,
    first,
    u,
    pace,
    delay,
    past,
    mark,
):
    """Integrate one wire, or two coupled ones, under currents linear between samples.

    ``u`` (T, axes) are the currents at ``ends`` (T,) after ``clock``, ``first`` (axes,) those
    now; each gap is cut into equal steps of at most ``pace[0]``, and each of those into
    ``pace[1]``. Returns the angles (T, axes) as they were ``delay`` before each end. ``cross`` is
    the two couplings of angles, their growth with the angle, the push in N/m, and the
    compression of the other spring at which it vanishes.
    """
    count = axes.shape[0]
    out = np.empty((ends.size, count))
    seen = np.empty(count)
    length = np.empty(count)
    began = 0.0
    for n in range(ends.size):
        gap = ends[n] - began
        steps = int(max(math.ceil(gap / pace[0] - 1e-9), 1) * pace[1])
        h = gap / steps
        for k in range(1, steps + 1):
            now = clock + began + k * h
            ambient, film = course(around[0], now), course(around[1], now)
            age = min(ageing[0] + ageing[1] * now, 1.0)
            for a in range(count):
                length[a] = state[a, 3]
            body, flow = state[0, 6], 0.0
            near = ambient + cooling[3] * (body - ambient)
            for a in range(count):
                before = first[a] if n == 0 else u[n - 1, a]
                current = before + (u[n, a] - before) * k / steps
                force = course(loads[a], now) / axes[a, 17]
                if count == 2:
                    force += cross[3] * (length[1 - a] - cross[4])
                own = film * _film_share(state[a, 0] - near, length[a] / axes[a, 17], cooling)
                _wire_step(state[a], axes[a], (current, near, own, force, age), h)
                flow += cooling[3] * own * axes[a, 4] * axes[a, 5] * (state[a, 0] - body)
            flow += cooling[5] * ambient
            state[:, 6] = (cooling[4] * body + h * flow) / (cooling[4] + h * cooling[5])
            if delay > 0.0:
                head_angles(state, axes, cross, seen)
                remember(past, mark, now, seen, 0.25 * pace[0] / pace[1])
        began = ends[n]
        if delay > 0.0:
            recall(past, mark, clock + began - delay, out[n])
        else:
            head_angles(state, axes, cross, out[n])
    return out
