"""Order of elimination with little fill for the unknowns of a sparse symmetric system.

Least degree (Liu, ACM Trans. Math. Softw. 11, 1985) looks one step ahead. If the steps of the input
are independent, samples link unknowns all over the plane, and least degree leaves a large dense
rest. Nested dissection (George, SIAM J. Numer. Anal. 10, 1973) then takes a third of the
multiplications. It cuts the plane into halves, again and again, and eliminates the unknowns that
separate two halves after both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification import _sparse_kernels as _kernels

if TYPE_CHECKING:
    from scipy.sparse import csc_array

_COSTLY = 5e7
"""Multiplications by least degree from which dissection saves more time than it takes."""
_HUB = 50
"""Number of links from which an unknown is eliminated after all parts."""
_LEAF, _WIDE = 800, 0.4
"""Most unknowns of a part that stays whole; and largest share of a part in a separator."""


class Elimination(NamedTuple):
    """Order of elimination (n,), and its tree."""

    order: IntArray
    parent: IntArray
    """Shape (n,). Parent of each column in the elimination tree, -1 for a root."""
    counts: IntArray
    """Shape (n,). Size of each column of the factor."""

    @classmethod
    def of(cls, pattern: csc_array[Any], order: IntArray) -> Elimination:
        """Eliminate a matrix of this pattern in this order."""
        first, rows = permuted(pattern, order)
        parent, counts = np.full(order.size, -1), np.ones(order.size, dtype=np.int64)
        _kernels.elimination_tree(first, rows, parent, np.full(order.size, -1), counts)
        return cls(order, parent, counts)

    @property
    def operations(self) -> float:
        """Multiplications of a factorisation."""
        return float(np.sum(self.counts.astype(np.float64) ** 2))


@dataclass
class KnownElimination:
    """What is known about the elimination of a system."""

    order: IntArray | None = None
    """Shape (n,). Order of elimination."""
    operations: float = 0.0
    """Least number of multiplications of a factorisation."""


def quick_elimination(
    pattern: csc_array[Any], last: int = 0, places: FloatArray | None = None
) -> Elimination:
    """Elimination of a symmetric matrix (n, n) with few multiplications.

    ``last`` unknowns are eliminated last. ``places`` (n - last, 2) are coordinates of the other
    unknowns in the plane, for dissection.
    """
    inner = pattern.shape[0] - last
    end, others = np.arange(inner, inner + last), pattern[:inner, :inner]
    found = Elimination.of(pattern, np.append(_least_degree(others), end))
    if places is None or found.operations < _COSTLY:
        return found
    other = Elimination.of(pattern, np.append(_dissected(others, places), end))
    return min(found, other, key=lambda one: one.operations)


def permuted(pattern: csc_array[Any], order: IntArray) -> tuple[IntArray, IntArray]:
    """Columns of a permuted pattern: where each begins, and its rows."""
    moved = pattern[order][:, order]
    return moved.indptr.astype(np.int64), moved.indices.astype(np.int64)


def _least_degree(pattern: csc_array[Any]) -> IntArray:
    """Order of least degree."""
    from scipy.sparse import csc_array, diags_array
    from scipy.sparse.linalg import spilu

    count = pattern.shape[0]
    # The diagonal keeps pivots away from zero; only the order of elimination counts, so its size
    # does not matter
    dominant = csc_array(pattern + diags_array(np.full(count, 1e3)))
    incomplete = spilu(  # drops all entries, so it takes little longer than the order
        dominant,
        drop_tol=1.0,
        fill_factor=1,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    return np.argsort(incomplete.perm_c)


def _dissected(pattern: csc_array[Any], places: FloatArray) -> IntArray:
    """Order by nested dissection: uncut parts, then separators, then unknowns with many links."""
    degree = np.diff(pattern.indptr)
    near = np.flatnonzero(degree < _HUB)
    links = pattern[near][:, near]
    # Move each unknown between its neighbours, which shortens long links.
    places = (links @ places[near]) / (links @ np.ones(near.size))[:, None]
    parts, leaves, separators = [np.arange(near.size)], [], [np.flatnonzero(degree >= _HUB)]
    while parts:
        part = parts.pop()
        halves = _cut(links, places, part)
        if halves is None:
            leaves.append(part)
            continue
        parts += halves[:2]
        separators.append(near[halves[2]])
    leaf = np.sort(np.concatenate(leaves))
    first = near[leaf[_least_degree(links[leaf][:, leaf])]]
    return np.concatenate([first, *separators[::-1]])


def _cut(
    links: csc_array[Any], places: FloatArray, part: IntArray
) -> tuple[IntArray, IntArray, IntArray] | None:
    """Two halves of a part, and the unknowns between them; None if a cut does not help."""
    best = None
    for along in places[part].T if part.size > _LEAF else ():
        low = along < np.median(along)
        if not low.any():
            continue
        one, other = part[low], part[~low]
        mine, theirs = _least_cover(links[:, other][one])  # columns first: contiguous in memory
        between = np.append(one[mine], other[theirs])
        if between.size < (_WIDE * part.size if best is None else best[2].size):
            best = one[~mine], other[~theirs], between
    return best


def _least_cover(links: csc_array[Any]) -> tuple[BoolArray, BoolArray]:
    """Fewest rows and columns that contain all entries; König's theorem, from a matching."""
    from scipy.sparse.csgraph import maximum_bipartite_matching

    partner = maximum_bipartite_matching(links.tocsr(), perm_type="row")
    matched = np.flatnonzero(partner >= 0)
    reached = np.ones(links.shape[0], dtype=np.bool_)
    reached[partner[matched]] = False
    across = links.T
    while True:
        columns = across @ reached > 0
        more = reached.copy()
        more[partner[matched[columns[matched]]]] = True
        if np.array_equal(more, reached):
            return ~reached, columns
        reached = more
