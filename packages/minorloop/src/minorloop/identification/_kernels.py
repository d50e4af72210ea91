"""Compiled loops of identification: arrays in, arrays out.

The K = L (L + 1) / 2 cells and nodes of the plane are packed row by row: cell (i, j), j <= i, and
the node (alpha, beta) = (levels[i + 1], levels[j]) share the index i (i + 1) / 2 + j.

The design is a tree. The switched-on weight at a sample is the weight at its parent, the sample of
the last reversal, plus one Everett difference, which reads at most six nodes:

    row(t) = row(parent[t]) + sum over c of coefficient[t, c] * node[index[t, c]]

Pass whole numbers to helpers as ``np.int64``: numba compiles a helper again for a literal.

Parent -1 is negative saturation, where all cells are off. Reversals with the same parent at the
same input have the same memory; the first of them is the parent of all samples that follow any of
them. So curves that all begin demagnetised share the reversals of the demagnetisation.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop.operators._memory_kernels import INSIDE, wipes_out

ROOT = -1
_SEARCHED = 64
"""Number of the newest reversals with the same parent that are compared."""


@njit(cache=True, nogil=True)
def trace(low, u):
    """(T,) parents of inputs within the levels that begin at negative saturation, ``low``."""
    parent, newest = np.empty(u.size, dtype=np.int32), np.full(u.size + 1, ROOT, dtype=np.int32)
    older, samples = np.empty((2, u.size), dtype=np.int32)
    at, values = np.empty((2, u.size))
    top, value, sample = 0, low, np.int64(ROOT)
    for t in range(u.size):
        x = u[t]
        parent[t] = sample
        if x == value:
            continue
        rising = x > value
        if rising == (top & 1 == 0):
            if sample != ROOT:  # an earlier reversal with the same memory replaces this one
                above, left = parent[sample] + 1, _SEARCHED
                node = newest[above]
                while left > 0 and node != ROOT and at[node] != value:
                    node, left = older[node], left - 1
                if left == 0 or node == ROOT:
                    at[sample], older[sample], newest[above] = value, newest[above], sample
                else:
                    sample = np.int64(node)
            values[top], samples[top] = value, sample
            top += 1
        while top >= 2 and wipes_out(x, top, values[top - 2], rising):
            top -= 2
        value = x
        if top == 0:
            parent[t], sample = ROOT, np.int64(ROOT)
            continue
        parent[t], sample = samples[top - 1], t
    return parent


@njit(cache=True, nogil=True)
def lead_to(used, parent):
    """Mark all ancestors of the samples in use as used too, in place."""
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
    """Transpose of `forward`: numbers per sample become numbers per node. Consumes ``samples``."""
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
    """Replace cell weights by Everett values in place: F(a, b) = sum over i < a, j >= b."""
    for i in range(1, bands):
        first = i * (i + 1) // 2
        for k in range(first, first + i):
            x[k] += x[k - i]
    for i in range(1, bands):
        first = i * (i + 1) // 2
        for k in range(first + i - 1, first - 1, -1):
            x[k] += x[k + 1]


@njit(cache=True, nogil=True)
def gram(bands, index, coefficient, parent, weight, out):
    """Half of the weighted Gram matrix of the cells: out + out' is all of it.

    A sample counts with the sum of the weights of its descendants and itself. Its terms are
    multiplied by themselves (half) and by the terms of each of its ancestors (whole). Samples of
    one parent share their ancestors, so their terms are added first. The tree is walked depth
    first, so that the sum over the ancestors changes by one row at each step. The cost grows with
    the number of reversals and of the nodes that a memory touches. Consumes ``weight``; ``out``
    (n, n), n >= K, begins at zero.
    """
    terms, cells = index.shape[1], bands * (bands + 1) // 2
    # First child, next child of the same parent, and number of nodes of the ancestors before
    links = np.full((3, parent.size + 1), ROOT)
    before = np.empty(index.shape)
    # For children and for ancestors: sums at the nodes, and the nodes at which they are not zero
    sums, listed = np.zeros((2, cells)), np.zeros((2, cells), dtype=np.bool_)
    nodes = np.empty((2, cells), dtype=np.int64)
    for t in range(parent.size - 1, -1, -1):
        n = weight[t]
        if n == 0.0:
            continue
        for c in range(terms):
            a = 0.5 * n * coefficient[t, c]
            for d in range(terms):
                out[index[t, c], index[t, d]] += a * coefficient[t, d]
        if parent[t] != ROOT:
            weight[parent[t]] += n
        # The last child is that of the root.
        links[1, t], links[0, parent[t]] = links[0, parent[t]], t
    children, ancestors = np.int64(0), np.int64(1)
    remote, p = np.int64(0), links[0, ROOT]
    while p != ROOT:
        if links[0, p] != ROOT:
            links[2, p] = remote
            for c in range(terms):
                before[p, c] = sums[1, index[p, c]]
            remote = _add_terms(index, coefficient, p, 1.0, sums, nodes, listed, ancestors, remote)
            count, t = np.int64(0), links[0, p]
            while t != ROOT:
                w = weight[t]
                count = _add_terms(index, coefficient, t, w, sums, nodes, listed, children, count)
                t = links[1, t]
            for c in range(count):
                node = nodes[0, c]
                for d in range(remote):
                    out[node, nodes[1, d]] += sums[0, node] * sums[1, nodes[1, d]]
                sums[0, node], listed[0, node] = 0.0, False
            p = links[0, p]
            continue
        while p != ROOT and links[1, p] == ROOT:
            p = parent[p]
            if p == ROOT:
                break
            for c in range(terms):
                sums[1, index[p, c]] = before[p, c]
            for d in range(links[2, p], remote):
                listed[1, nodes[1, d]] = False
            remote = links[2, p]
        if p != ROOT:
            p = links[1, p]
    _nodes_to_cells_both_ways(bands, out)


@njit(**INSIDE)
def _add_terms(index, coefficient, t, factor, sums, nodes, listed, which, count):
    """Add terms of a row to a line of sums; list each node once in ``nodes``; return the count."""
    for c in range(index.shape[1]):
        if coefficient[t, c] == 0.0:
            continue
        node = index[t, c]
        if not listed[which, node]:
            nodes[which, count], listed[which, node] = node, True
            count += 1
        sums[which, node] += factor * coefficient[t, c]
    return count


@njit(cache=True, nogil=True)
def gram_rows(bands, index, coefficient, parent, weight, cells, out):
    """Rows of the weighted Gram matrix of switched-on fractions, for cells (k,).

    The Everett function of a single cell is one at the nodes above and left of the cell.
    """
    nodes, on = np.empty(bands * (bands + 1) // 2), np.empty(parent.size)
    for k in range(cells.size):
        i = np.int64((np.sqrt(8.0 * cells[k] + 1.0) - 1.0) / 2.0)
        last = cells[k] - i * (i + 1) // 2 + 1
        nodes[:] = 0.0
        for a in range(i, bands):
            first = a * (a + 1) // 2
            nodes[first : first + last] = 1.0
        forward(index, coefficient, parent, nodes, on)
        for t in range(parent.size):
            on[t] *= weight[t]
        adjoint(index, coefficient, parent, on, out[k])
        nodes_to_cells(bands, out[k])


@njit(cache=True, nogil=True)
def nodes_to_cells(bands, x):
    """Apply the transpose of `cells_to_nodes` in place."""
    for i in range(1, bands):
        first = i * (i + 1) // 2
        for k in range(first + 1, first + i + 1):
            x[k] += x[k - 1]
    for i in range(bands - 2, -1, -1):
        first = i * (i + 1) // 2
        for k in range(first, first + i + 1):
            x[k] += x[k + i + 1]


@njit(**INSIDE)
def add_row(x, row, other):
    """Add another row of a matrix to a row."""
    for c in range(x.shape[1]):
        x[row, c] += x[other, c]


@njit(cache=True, nogil=True)
def _nodes_to_cells_both_ways(bands, x):
    """Apply `nodes_to_cells` in place along both axes of a matrix (n, n), n >= K."""
    for row in x:
        nodes_to_cells(bands, row)
    for i in range(1, bands):
        first = i * (i + 1) // 2
        for k in range(first + 1, first + i + 1):
            add_row(x, k, k - 1)
    for i in range(bands - 2, -1, -1):
        first = i * (i + 1) // 2
        for k in range(first, first + i + 1):
            add_row(x, k, k + i + 1)


@njit(cache=True, nogil=True)
def take_lower(entries, begin, places, ridge, out):
    """Lower triangle of rows and columns ``places`` of a symmetric matrix, plus a ridge.

    ``begin`` is where each row of its lower triangle begins in ``entries``.
    """
    for k in range(places.size):
        for m in range(k + 1):
            out[k, m] = entries[begin[max(places[k], places[m])] + min(places[k], places[m])]
        out[k, k] += ridge


@njit(cache=True, nogil=True)
def add_rows(first, columns, values, rows, place, out):
    """Add rows of a sparse matrix to ``out``; ``place`` maps its columns, -1 leaves one out."""
    for k in range(rows.size):
        for p in range(first[rows[k]], first[rows[k] + 1]):
            if place[columns[p]] >= 0:
                out[k, place[columns[p]]] += values[p]


@njit(cache=True, nogil=True)
def descend(x, gradient, z, bounded, sweeps):
    """Improve a first guess by coordinate descent on 1/2 z'Xz, X symmetric with unit diagonal."""
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
