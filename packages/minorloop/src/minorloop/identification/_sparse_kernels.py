"""Compiled loops of the sparse factorisation L S L' of a symmetric matrix, S of signs.

Columns of the factor with nearly the same rows form a panel, a dense block. ``start`` (P + 1,) are
the first columns of the panels. The rows of a panel, its own columns first, begin at ``at`` (P +
1,) in ``rows``. Its numbers begin at ``offset`` (P + 1,) in ``data``, row after row.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from minorloop.operators._memory_kernels import INSIDE

_WIDEST = 96
_PADDING, _FEW = 0.3, 32
"""Zeros that a panel may store: this share of its numbers, or this number."""
_SMALL = 30_000
"""Number of multiplications above which the library multiplies two blocks."""
_INFINITE = 1e64
"""Replaces a pivot that is zero to rounding: its unknown becomes zero."""


@njit(cache=True, nogil=True)
def elimination_tree(first, rows, parent, seen, count):
    """Parent of each column in the elimination tree, -1 for a root, and the size of each column.

    ``first`` and ``rows`` are the columns of the matrix, both triangles. ``parent`` and ``seen``
    begin at -1, ``count`` at 1. Liu, SIAM J. Matrix Anal. Appl. 11, 1990.
    """
    for k in range(count.size):
        seen[k] = k
        for p in range(first[k], first[k + 1]):
            i = rows[p]
            while i < k and seen[i] != k:
                if parent[i] == -1:
                    parent[i] = k
                count[i] += 1
                seen[i] = k
                i = parent[i]


@njit(cache=True, nogil=True)
def postorder(parent):
    """Order of the columns in which each follows its whole subtree."""
    n = parent.size
    child, sibling = np.full(n + 1, -1), np.full(n, -1)
    for k in range(n - 1, -1, -1):
        above = parent[k] if parent[k] >= 0 else n
        sibling[k], child[above] = child[above], k
    order, stack, top, count = np.empty(n, np.int64), np.empty(n + 1, np.int64), 1, 0
    stack[0] = n
    while top > 0:
        k = stack[top - 1]
        if child[k] >= 0:
            stack[top] = child[k]
            child[k] = sibling[child[k]]
            top += 1
            continue
        top -= 1
        if k < n:
            order[count] = k
            count += 1
    return order


@njit(cache=True, nogil=True)
def panels(parent, count):
    """First column of each panel, and its number of rows."""
    n = parent.size
    start, height, zeros = np.empty(n + 1, np.int64), np.empty(n, np.int64), np.zeros(n, np.int64)
    top = 0
    for k in range(n):
        start[top], height[top], zeros[top] = k, count[k], 0
        top += 1
        if top < 2 or parent[k - 1] != k:
            continue
        width = k - start[top - 2]
        tall = width + count[k]
        padding = zeros[top - 2] + width * (tall - height[top - 2])
        if width < _WIDEST and padding <= max(_PADDING * (width + 1) * tall, _FEW):
            top -= 1
            height[top - 1], zeros[top - 1] = tall, padding
    start[top] = n
    return start[: top + 1].copy(), height[:top].copy()


@njit(cache=True, nogil=True)
def panel_rows(first, rows, start, at):
    """Rows of each panel, its own columns first, and the panel of each column."""
    n, count = first.size - 1, start.size - 1
    out, seen, panel_of = np.empty(at[-1], np.int64), np.full(n, -1), np.empty(n, np.int64)
    child, sibling = np.full(count, -1), np.full(count, -1)
    for s in range(count):
        panel_of[start[s] : start[s + 1]] = s
    for s in range(count):
        width, last = start[s + 1] - start[s], start[s + 1]
        for k in range(width):
            out[at[s] + k] = start[s] + k
        end = at[s] + width
        for p in range(first[start[s]], first[last]):
            if rows[p] >= last and seen[rows[p]] != s:
                seen[rows[p]] = s
                out[end] = rows[p]
                end += 1
        below = child[s]
        while below >= 0:
            for p in range(at[below] + start[below + 1] - start[below], at[below + 1]):
                if out[p] >= last and seen[out[p]] != s:
                    seen[out[p]] = s
                    out[end] = out[p]
                    end += 1
            below = sibling[below]
        if at[s] + width < end:
            above = n
            for p in range(at[s] + width, end):
                above = min(above, out[p])
            above = panel_of[above]
            sibling[s], child[above] = child[above], s
    return out, panel_of


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def factorise(start, at, rows, offset, panel_of, sign, place, values, least, data):
    """Fill ``data`` with the factor of the matrix of entries ``values`` at ``place``.

    A pivot counts as zero below ``least`` times the size of its column before elimination.
    """
    data[:] = 0.0
    for e in range(place.size):
        data[place[e]] += values[e]
    size = np.empty(sign.size)
    for s in range(start.size - 1):
        width = start[s + 1] - start[s]
        for k in range(width):
            size[start[s] + k] = abs(data[offset[s] + k * width + k])
    where = np.empty(sign.size, np.int64)
    for s in range(start.size - 1):
        width, height = start[s + 1] - start[s], at[s + 1] - at[s]
        panel = data[offset[s] : offset[s + 1]].reshape(height, width)
        signs = sign[start[s] : start[s + 1]]
        _eliminate_panel(panel, signs, least * size[start[s] : start[s + 1]])
        below, signed = panel[width:], panel[width:] * signs
        small = below.shape[0] ** 2 * width < _SMALL
        product = products(below, signed) if small else below
        mine = rows[at[s] + width : at[s + 1]]
        i = 0
        while i < mine.size:
            t, end = _find_panel(mine, i, start, at, rows, panel_of, where)
            target = data[offset[t] : offset[t + 1]].reshape(-1, start[t + 1] - start[t])
            block = product[i:, i:end] if small else np.dot(below[i:], signed[i:end].T)
            for r in range(i, mine.size):
                line = target[where[mine[r]]]
                for c in range(i, min(r + 1, end)):
                    line[mine[c] - start[t]] -= block[r - i, c - i]
            i = end


@njit(**INSIDE)
def _find_panel(mine, i, start, at, rows, panel_of, where):
    """Return the panel of row ``mine[i]`` and the end of its rows in ``mine``; fill ``where``."""
    t, end = panel_of[mine[i]], i
    while end < mine.size and mine[end] < start[t + 1]:
        end += 1
    for k in range(at[t], at[t + 1]):
        where[rows[k]] = k - at[t]
    return t, end


@njit(cache=True, nogil=True)
def products(one, other):
    """Lower triangle of the products of the rows of two small arrays."""
    across = other.T.copy()
    out = np.zeros((one.shape[0], one.shape[0]))
    for r in range(one.shape[0]):
        line = out[r]
        for k in range(one.shape[1]):
            x = one[r, k]
            for c in range(r + 1):
                line[c] += x * across[k, c]
    return out


@njit(cache=True, nogil=True)
def _eliminate_panel(panel, sign, least):
    """Factor the own columns of a panel, and divide the rows below by them."""
    height, width = panel.shape
    across, inverse = np.zeros((width, width)), np.empty(width)
    for i in range(width):
        line = panel[i]
        for k in range(i):
            x = line[k] * inverse[k]
            line[k] = x * sign[k]
            across[k, i] = line[k]
            for j in range(k + 1, i + 1):
                line[j] -= x * across[k, j]
        pivot = line[i] * sign[i]
        line[i] = np.sqrt(pivot if pivot > least[i] else _INFINITE)
        inverse[i] = 1.0 / line[i]
    if (height - width) * width**2 > _SMALL:
        divisor = np.zeros((width, width))
        for i in range(width):
            divisor[i, i] = inverse[i]
            for j in range(i + 1, width):
                total = 0.0
                for k in range(i, j):
                    total += divisor[i, k] * across[k, j]
                divisor[i, j] = -total * inverse[j]
        # Numba takes seconds to compile an assignment of slices.
        divided = np.dot(panel[width:], divisor * sign)
        for i in range(width, height):
            for k in range(width):
                panel[i, k] = divided[i - width, k]
        return
    for i in range(width, height):
        line = panel[i]
        for k in range(width):
            x = line[k] * inverse[k]
            line[k] = x * sign[k]
            for j in range(k + 1, width):
                line[j] -= x * across[k, j]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def solve(start, at, rows, offset, sign, data, x):
    """Solve L S L' x = b in place."""
    for s in range(start.size - 1):
        width, p = start[s + 1] - start[s], offset[s]
        own = x[start[s] : start[s + 1]]
        for i in range(at[s + 1] - at[s]):
            total = 0.0
            for k in range(min(i, width)):
                total += data[p + k] * own[k]
            if i < width:
                own[i] = (own[i] - total) / data[p + i]
            else:
                x[rows[at[s] + i]] -= total
            p += width
    for s in range(start.size - 2, -1, -1):
        width, p = start[s + 1] - start[s], offset[s + 1]
        own = x[start[s] : start[s + 1]]
        for k in range(width):
            own[k] *= sign[start[s] + k]
        for i in range(at[s + 1] - at[s] - 1, -1, -1):
            p -= width
            if i < width:
                own[i] /= data[p + i]
            value = own[i] if i < width else x[rows[at[s] + i]]
            for k in range(min(i, width)):
                own[k] -= data[p + k] * value


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def invert(start, at, rows, offset, panel_of, sign, data, out):
    """Fill ``out`` with the inverse at the entries of the factor, panel after panel.

    Takahashi, Fagan and Chin, Proc. 8th PICA Conference, 1973: from the last panel to the first,
    Z_rj = -Z_rr Y and Z_jj = (L_jj S L_jj')^-1 - Y' Z_rj with Y = L_rj L_jj^-1.
    """
    where = np.empty(sign.size, np.int64)
    for s in range(start.size - 2, -1, -1):
        width, height = start[s + 1] - start[s], at[s + 1] - at[s]
        panel = data[offset[s] : offset[s + 1]].reshape(height, width)
        mine = rows[at[s] + width : at[s + 1]]
        inverse = np.zeros((width, width))
        for i in range(width):
            inverse[i, i] = 1.0 / panel[i, i]
            for j in range(i):
                total = 0.0
                for k in range(j, i):
                    total += panel[i, k] * inverse[k, j]
                inverse[i, j] = -total / panel[i, i]
        later = np.empty((mine.size, mine.size))
        i = 0
        while i < mine.size:
            t, end = _find_panel(mine, i, start, at, rows, panel_of, where)
            source = out[offset[t] : offset[t + 1]].reshape(-1, start[t + 1] - start[t])
            for r in range(i, mine.size):
                line = source[where[mine[r]]]
                for c in range(i, min(r + 1, end)):
                    later[r, c] = line[mine[c] - start[t]]
                    later[c, r] = later[r, c]
            i = end
        divided = np.dot(panel[width:], inverse)
        below = np.dot(later, divided)
        own = np.dot((inverse.T * sign[start[s] : start[s + 1]]).copy(), inverse)
        own += np.dot(divided.T.copy(), below)
        target = out[offset[s] : offset[s + 1]].reshape(height, width)
        for k in range(width):
            for i in range(width):
                target[i, k] = own[i, k]
            for i in range(width, height):
                target[i, k] = -below[i - width, k]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def solve_half(start, at, rows, offset, data, x):
    """Solve L X = B in place, for several columns at once; rows of zeros cost nothing."""
    filled = np.zeros(start[-1], dtype=np.bool_)
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            if x[i, c] != 0.0:
                filled[i] = True
                break
    for s in range(start.size - 1):
        if not filled[start[s] : start[s + 1]].any():
            continue
        width, height = start[s + 1] - start[s], at[s + 1] - at[s]
        panel = data[offset[s] : offset[s + 1]].reshape(height, width)
        own = x[start[s] : start[s + 1]]
        for i in range(width):
            line = own[i]
            for k in range(i):
                factor = panel[i, k]
                for c in range(line.size):
                    line[c] -= factor * own[k, c]
            line /= panel[i, i]
        product = np.dot(panel[width:], own)
        for i in range(width, height):
            row = rows[at[s] + i]
            filled[row] = True
            for c in range(x.shape[1]):
                x[row, c] -= product[i - width, c]


@njit(cache=True, nogil=True)
def weights_of_nodes(bands, nodes, out):
    """Cell weights from Everett values: inverse of `cells_to_nodes` of `_kernels`."""
    for i in range(bands):
        here, above = i * (i + 1) // 2, (i - 1) * i // 2
        for j in range(i + 1):
            total = nodes[here + j]
            if j < i:
                total -= nodes[here + j + 1] + nodes[above + j]
            if j + 1 < i:
                total += nodes[above + j + 1]
            out[here + j] = total


@njit(cache=True, nogil=True)
def weights_to_nodes(bands, weights, out):
    """Transpose of `weights_of_nodes`."""
    out[:] = 0.0
    for i in range(bands):
        here, above = i * (i + 1) // 2, (i - 1) * i // 2
        for j in range(i + 1):
            x = weights[here + j]
            out[here + j] += x
            if j < i:
                out[here + j + 1] -= x
                out[above + j] -= x
            if j + 1 < i:
                out[above + j + 1] += x


@njit(cache=True, nogil=True)
def add_paths(index, coefficient, parent, times, out):
    """Add the row (factors of nodes) of each sample ``times`` (m,) to columns of ``out`` (n, m)."""
    for m in range(times.size):
        t = times[m]
        while t >= 0:
            for c in range(index.shape[1]):
                out[index[t, c], m] += coefficient[t, c]
            t = parent[t]
