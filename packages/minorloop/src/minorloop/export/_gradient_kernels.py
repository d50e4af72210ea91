"""Compiled loops of gradients in the input; they take and return only arrays.

A plane is a `PlaneTables` of `minorloop.operators._kernels`.

The tree is that of `minorloop.identification._kernels`: the output at a sample is the output at its
parent plus one Everett difference between the two.
"""

from __future__ import annotations

from numba import njit

from minorloop.operators._kernels import band_of

ROOT = -1


@njit(cache=True, nogil=True)
def _everett_rates(nodes, bow, i, s, j, f):
    """Return the derivatives of `everett_inside` in the two fractions."""
    if i == j:
        rate = nodes[i + 1, i] - bow[i] * (1.0 - 2.0 * (s - f))
        return rate, -rate
    a, b, c, d = nodes[i, j], nodes[i, j + 1], nodes[i + 1, j], nodes[i + 1, j + 1]
    in_s = (c - a) + f * ((d - c) - (b - a)) - bow[i] * (1.0 - 2.0 * s)
    in_f = (b - a) + s * ((d - c) - (b - a)) - bow[j] * (1.0 - 2.0 * f)
    return in_s, in_f


@njit(cache=True, nogil=True)
def pull_inputs(plane, u, parent, samples, out):
    """Add the gradient in the inputs to ``out``.

    ``samples[t]`` is the sum of the cotangents of sample t and its descendants, which the transpose
    of the tree computes.
    """
    levels, per_band, buckets, per_unit, nodes, bow, _, _ = plane
    lowest, highest = levels[0], levels[-1]
    for t in range(u.size):
        p = parent[t]
        before = lowest if p == ROOT else min(max(u[p], lowest), highest)
        x = min(max(u[t], lowest), highest)
        if samples[t] == 0.0 or x == before:
            continue
        high, low = max(x, before), min(x, before)
        i = band_of(levels, buckets, per_unit, high)
        j = band_of(levels, buckets, per_unit, low)
        s, f = (high - levels[i]) * per_band[i], (low - levels[j]) * per_band[j]
        in_high, in_low = _everett_rates(nodes, bow, i, s, j, f)
        in_high, in_low = in_high * per_band[i] * samples[t], in_low * per_band[j] * samples[t]
        here, there = (in_high, in_low) if x > before else (-in_low, -in_high)
        if lowest <= u[t] <= highest:
            out[t] += here
        if p != ROOT and lowest <= u[p] <= highest:
            out[p] += there


@njit(cache=True, nogil=True)
def pull_plays(u, radii, weights, positions, cotangents, for_weights, for_inputs, movers):
    """Add the gradients of weighted plays in weights and inputs to the two arrays.

    ``movers`` (n,) holds the last sample that moved each play, -1 for none. A play follows the
    input while the input moves it; otherwise it keeps its position.
    """
    for t in range(u.size):
        for k in range(radii.size):
            place = min(max(positions[k], u[t] - radii[k]), u[t] + radii[k])
            if place != positions[k]:
                positions[k] = place
                movers[k] = t
            for_weights[k] += cotangents[t] * place
            if movers[k] >= 0:
                for_inputs[movers[k]] += cotangents[t] * weights[k]
