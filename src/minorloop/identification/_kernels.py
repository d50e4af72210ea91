"""Compiled loops of identification: arrays in, arrays out.

Cells and nodes of the plane are packed row by row: cell (i, j), j <= i, and the node
(alpha, beta) = (levels[i + 1], levels[j]) share the index i (i + 1) / 2 + j, K = L (L + 1) / 2
of them.

The design is a tree. The switched-on weight at a sample is that at the last reversal (its
parent, itself a sample) plus one Everett difference, which reads at most six nodes:

    row(t) = row(parent[t]) + sum over c of coefficient[t, c] * node[index[t, c]]

A whole number that a helper gets is an ``np.int64``: for a literal, numba compiles it once more.

Parent -1 is negative saturation, where nothing is on. Reversals with the same parent at the same
input have the same memory, and the first of them is the parent of what follows any of them: curves
that all begin demagnetised share the reversals of the demagnetisation.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop.operators._kernels import band_of
from minorloop.operators._memory_kernels import INSIDE, wipes_out

ROOT = -1
_SEARCHED = 64
"""Reversals with the same parent, the newest ones, that are compared."""


@njit(**INSIDE)
def packed(i, j):
    """Index of cell (i, j), and of the node at its upper left corner."""
    return i * (i + 1) // 2 + j


@njit(**INSIDE)
def put(index, coefficient, slot, i, j, value):
    """Write one term of a row unless it is zero; gives the next slot."""
    if value != 0.0:
        index[slot] = i * (i + 1) // 2 + j
        coefficient[slot] = value
        slot += 1
    return slot


@njit(**INSIDE)
def everett_terms(index, coefficient, i, s, j, f, sign, spread):
    """Terms of the Everett value at fraction s of band i over fraction f of band j <= i."""
    slot = np.int64(0)
    if i == j:
        x = s - f
        put(index, coefficient, slot, i, i, sign * (x * x if spread else x))
        return
    slot = put(index, coefficient, slot, i - 1, j, sign * (1.0 - s) * (1.0 - f))
    slot = put(index, coefficient, slot, i, j, sign * s * (1.0 - f))
    if j + 1 < i:
        slot = put(index, coefficient, slot, i - 1, j + 1, sign * (1.0 - s) * f)
    slot = put(index, coefficient, slot, i, j + 1, sign * s * f)
    if spread:
        slot = put(index, coefficient, slot, i, i, -sign * s * (1.0 - s))
        put(index, coefficient, slot, j, j, -sign * f * (1.0 - f))


@njit(**INSIDE)
def shared(newest, older, at, parent, sample, value):
    """Earlier reversal with the same memory; this one, which is then compared too, if none is."""
    if sample == ROOT:
        return ROOT
    above = parent[sample] + 1
    node = newest[above]
    for _ in range(_SEARCHED):
        if node == ROOT:
            break
        if at[node] == value:
            return node
        node = older[node]
    at[sample], older[sample], newest[above] = value, newest[above], sample
    return sample


@njit(cache=True, nogil=True)
def trace(levels, per_band, buckets, per_unit, spread, u, index, coefficient, parent, corner):
    """Fill the tree for an input that begins at negative saturation.

    ``corner`` becomes the cell in which the present branch ends: where this sample looks at the
    Everett surface; -1 where it does not.
    """
    newest, older = np.empty(u.size + 1, np.int32), np.empty(u.size, np.int32)
    newest[:] = ROOT
    at = np.empty(u.size)
    values, bands = np.empty(u.size + 2), np.empty(u.size + 2, np.int64)
    fractions, samples = np.empty(u.size + 2), np.empty(u.size + 2, np.int64)
    top, value, band, fraction, sample = 0, levels[0], 0, 0.0, np.int64(ROOT)
    for t in range(u.size):
        x = min(max(u[t], levels[0]), levels[-1])
        parent[t] = sample
        corner[t] = corner[t - 1] if t > 0 else ROOT
        if x == value:
            continue
        rising = x > value
        if rising == (top & 1 == 0):
            sample = shared(newest, older, at, parent, sample, value)
            values[top], bands[top], fractions[top], samples[top] = value, band, fraction, sample
            top += 1
        while top >= 2 and wipes_out(x, top, values[top - 2], rising):
            top -= 2
        value, band = x, band_of(levels, buckets, per_unit, x)
        fraction = (x - levels[band]) * per_band[band]
        if top == 0:
            parent[t], sample, corner[t] = ROOT, np.int64(ROOT), ROOT
            continue
        parent[t], sample = samples[top - 1], t
        i, s, j, f, sign = band, fraction, bands[top - 1], fractions[top - 1], 1.0
        if not rising:
            i, s, j, f, sign = j, f, i, s, -1.0
        everett_terms(index[t], coefficient[t], i, s, j, f, sign, spread)
        corner[t] = packed(i - 1 if s == 0.0 else i, j)


@njit(cache=True, nogil=True)
def lead_to(used, parent):
    """Add the parents of samples in use to them, in place: the others have no use."""
    for t in range(parent.size - 1, -1, -1):
        if used[t] and parent[t] != ROOT:
            used[parent[t]] = True
    return used


@njit(cache=True, nogil=True)
def forward(index, coefficient, parent, nodes, out):
    """Switched-on weight at every sample, from Everett values at the nodes."""
    for t in range(parent.size):
        total = 0.0 if parent[t] == ROOT else out[parent[t]]
        for c in range(index.shape[1]):
            total += coefficient[t, c] * nodes[index[t, c]]
        out[t] = total


@njit(cache=True, nogil=True)
def adjoint(index, coefficient, parent, samples, out):
    """Transpose of `forward`: one number a sample to one a node. Consumes ``samples``."""
    out[:] = 0.0
    for t in range(parent.size - 1, -1, -1):
        if samples[t] == 0.0:
            continue
        if parent[t] != ROOT:
            samples[parent[t]] += samples[t]
        for c in range(index.shape[1]):
            out[index[t, c]] += coefficient[t, c] * samples[t]


@njit(cache=True, nogil=True)
def cells_to_nodes(bands, x):
    """In place: Everett values from cell weights, F(a, b) = sum over i < a, j >= b."""
    for i in range(1, bands):
        for j in range(i):
            x[packed(i, j)] += x[packed(i - 1, j)]
    for i in range(bands):
        for j in range(i - 1, -1, -1):
            x[packed(i, j)] += x[packed(i, j + 1)]


@njit(cache=True, nogil=True)
def nodes_to_cells(bands, x):
    """In place along the first axis of a two-dimensional x: transpose of `cells_to_nodes`."""
    columns = x.shape[1]
    for i in range(bands):
        for j in range(1, i + 1):
            p = packed(i, j)
            for k in range(columns):
                x[p, k] += x[p - 1, k]
    for i in range(bands - 2, -1, -1):
        for j in range(i + 1):
            p, q = packed(i, j), packed(i + 1, j)
            for k in range(columns):
                x[p, k] += x[q, k]


@njit(cache=True, nogil=True)
def gram(index, coefficient, parent, weight, out):
    """Half of the weighted Gram matrix of the rows: out + out' is all of it.

    Expanding a sum over tree rows by ancestry, every sample counts with the weight of all that
    descends from it, against its own terms (half) and those of each of its ancestors (whole).
    Samples of one parent share their ancestors, so that their terms are added first. The tree is
    walked depth first, so that the sum over the ancestors changes by one row at each step. The cost
    grows with the number of reversals and the nodes of the plane that a memory touches. Consumes
    ``weight``.
    """
    child, sibling = np.empty(parent.size + 1, np.int64), np.empty(parent.size, np.int64)
    child[:], sibling[:] = ROOT, ROOT
    for t in range(parent.size - 1, -1, -1):
        n = weight[t]
        if n == 0.0:
            continue
        for c in range(index.shape[1]):
            row, a = out[index[t, c]], 0.5 * n * coefficient[t, c]
            for d in range(index.shape[1]):
                row[index[t, d]] += a * coefficient[t, d]
        if parent[t] != ROOT:
            weight[parent[t]] += n
        sibling[t], child[parent[t]] = child[parent[t]], t  # the last child is that of the root
    terms, others = np.empty(out.shape[0]), np.empty(out.shape[0])
    terms[:], others[:] = 0.0, 0.0
    nodes, far = np.empty(out.shape[0], np.int64), np.empty(out.shape[0], np.int64)
    listed, far_listed = np.empty(out.shape[0], np.bool_), np.empty(out.shape[0], np.bool_)
    listed[:], far_listed[:] = False, False
    before = np.empty(index.size).reshape(index.shape)
    remote_before = np.empty(parent.size, np.int64)
    remote, p = np.int64(0), child[ROOT]
    while p != ROOT:
        if child[p] != ROOT:
            remote_before[p] = remote
            for c in range(index.shape[1]):
                before[p, c] = others[index[p, c]]
            remote = add_terms(index[p], coefficient[p], 1.0, others, far, far_listed, remote)
            count, t = np.int64(0), child[p]
            while t != ROOT:
                count = add_terms(index[t], coefficient[t], weight[t], terms, nodes, listed, count)
                t = sibling[t]
            for c in range(count):
                row, a = out[nodes[c]], terms[nodes[c]]
                for d in range(remote):
                    row[far[d]] += a * others[far[d]]
                terms[nodes[c]], listed[nodes[c]] = 0.0, False
            p = child[p]
            continue
        while p != ROOT and sibling[p] == ROOT:
            p = parent[p]
            if p == ROOT:
                break
            for c in range(index.shape[1]):
                others[index[p, c]] = before[p, c]
            for d in range(remote_before[p], remote):
                far_listed[far[d]] = False
            remote = remote_before[p]
        if p != ROOT:
            p = sibling[p]


@njit(cache=True, nogil=True)
def gram_rows(bands, index, coefficient, parent, weight, cells, out):
    """Rows of the weighted Gram matrix of switched-on fractions, for cells (k,).

    The Everett value of a single cell is one at the nodes above and left of it.
    """
    nodes, on = np.empty(bands * (bands + 1) // 2), np.empty(parent.size)
    for k in range(cells.size):
        i = np.int64((np.sqrt(8.0 * cells[k] + 1.0) - 1.0) / 2.0)
        last = cells[k] - packed(i, np.int64(0)) + 1
        nodes[:] = 0.0
        for a in range(i, bands):
            first = packed(a, np.int64(0))
            nodes[first : first + last] = 1.0
        forward(index, coefficient, parent, nodes, on)
        for t in range(parent.size):
            on[t] *= weight[t]
        adjoint(index, coefficient, parent, on, out[k])
    columns_to_cells(bands, out)


@njit(**INSIDE)
def add_terms(index, coefficient, factor, sums, nodes, listed, count):
    """Add terms of a row to sums; ``nodes`` lists where, each once. Gives their number."""
    for c in range(index.size):
        if coefficient[c] == 0.0:
            continue
        if not listed[index[c]]:
            nodes[count], listed[index[c]] = index[c], True
            count += 1
        sums[index[c]] += factor * coefficient[c]
    return count


@njit(cache=True, nogil=True)
def columns_to_cells(bands, x):
    """In place along the last axis of a two-dimensional x: transpose of `cells_to_nodes`."""
    for k in range(x.shape[0]):
        row = x[k]
        for i in range(bands):
            for j in range(1, i + 1):
                row[packed(i, j)] += row[packed(i, j) - 1]
        for i in range(bands - 2, -1, -1):
            first, above = packed(i, i) - i, packed(i, i) + 1
            for j in range(i + 1):
                row[first + j] += row[above + j]


@njit(cache=True, nogil=True)
def finish_gram(x, cells, swing, shift, touched, count):
    """In place, lower triangle: Gram matrix of relay columns from half the one of fractions.

    A column is ``swing`` times the switched-on fraction less ``shift``; ``touched`` holds the
    sums of the fractions over the samples, ``count`` the number of samples.
    """
    block = 32  # reading across rows costs a cache line a number unless done block by block
    for first in range(0, cells, block):
        for k in range(first, cells):
            for m in range(first, min(first + block, k + 1)):
                both = x[k, m] + x[m, k]
                cross = shift * swing * (touched[k] + touched[m])
                x[k, m] = swing * swing * both - cross + shift * shift * count


@njit(cache=True, nogil=True)
def scale_lower(x, scale):
    """In place, lower triangle: rows and columns times a scale."""
    for k in range(x.shape[0]):
        for m in range(k + 1):
            x[k, m] *= scale[k] * scale[m]


@njit(cache=True, nogil=True)
def take_lower(x, place, picked, ridge, out):
    """Rows and columns ``picked``, ascending, of a symmetric matrix, plus a ridge.

    Row k of the matrix is row ``place[k]`` of x, of which the part up to column k is read.
    """
    for k in range(picked.size):
        row = x[place[picked[k]]]
        for m in range(k + 1):
            out[k, m] = row[picked[m]]
        out[k, k] += ridge


@njit(cache=True, nogil=True)
def add_lower(rows, columns, values, place, out):
    """Add sparse entries, where both ends are picked, to a lower triangle."""
    for e in range(values.size):
        k, m = place[rows[e]], place[columns[e]]
        if k >= m >= 0:
            out[k, m] += values[e]


@njit(cache=True, nogil=True)
def add_columns(rows, columns, values, place, out):
    """Add sparse entries of a symmetric matrix, its lower triangle, to the columns picked."""
    for e in range(values.size):
        k, m = rows[e], columns[e]
        if place[m] >= 0:
            out[k, place[m]] += values[e]
        if k != m and place[k] >= 0:
            out[m, place[k]] += values[e]


@njit(cache=True, nogil=True)
def descend(x, gradient, z, bounded, sweeps):
    """Coordinate descent on 1/2 z'Xz, X symmetric with unit diagonal: a first guess."""
    size = z.size
    for _ in range(sweeps):
        for k in range(size):
            new = z[k] - gradient[k]
            if bounded[k] and new < 0.0:
                new = 0.0
            step = new - z[k]
            if step == 0.0:
                continue
            z[k] = new
            row = x[k]
            for m in range(size):
                gradient[m] += step * row[m]


@njit(cache=True, nogil=True)
def multiply_symmetric(rows, columns, values, z, out):
    """Add Q z to out, Q given by the entries of its lower triangle."""
    for e in range(values.size):
        k, m = rows[e], columns[e]
        out[k] += values[e] * z[m]
        if k != m:
            out[m] += values[e] * z[k]
