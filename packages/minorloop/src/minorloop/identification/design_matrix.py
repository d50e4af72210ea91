"""The design matrix of identification: exact areas of cells, stored as a tree.

An output is a sum of the cell weights, each times the fraction of its cell that is switched on. The
dense matrix has one number for each sample and cell. The tree of Everett differences (see
`_kernels`) is equivalent, and has at most six numbers for each sample.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray, Levels, frozen
from minorloop.errors import ParameterError
from minorloop.identification import _kernels
from minorloop.identification.elimination_order import KnownElimination
from minorloop.operators.memory import Start
from minorloop.operators.plane import Relay, off_output, swing
from minorloop.operators.preisach import Diagonal, Preisach

Packed = FloatArray
"""(K,) numbers, one for each cell, K = L (L + 1) / 2, row after row of the lower triangle."""

_Indices = npt.NDArray[np.int32]

MOST_BANDS = 500
"""Largest number of bands."""
MOST_DENSE = 250
"""Largest number of bands with dense normal equations; a finer plane needs more than 8 GB."""
_TOGETHER = 32
"""Rows of the Gram matrix that are finished at once."""
_NEVER = 1e-14
"""Share of the samples on which a cell is on, up to which it counts as never on."""


@dataclass(frozen=True)
class PlaneSpec:
    """Structure of the model to be fitted, without its numbers.

    ``levels`` (L + 1,); ``relay`` and ``diagonal`` as in `Preisach`; ``offset``, ``slope``:
    whether to fit them.

    Raises a `ParameterError` if there are more than `MOST_BANDS` bands.
    """

    levels: Levels
    relay: Relay = "bipolar"
    diagonal: Diagonal = "uniform"
    offset: bool = True
    slope: bool = False

    def __post_init__(self) -> None:
        check_bands(self.bands)

    @cached_property
    def bands(self) -> int:
        """L."""
        return int(self.levels.size - 1)

    @cached_property
    def cells(self) -> int:
        """K = L (L + 1) / 2."""
        return self.bands * (self.bands + 1) // 2

    @cached_property
    def unknowns(self) -> int:
        """Number of weights, offset and slope that are fitted."""
        return self.cells + self.offset + self.slope

    def model(self, x: FloatArray) -> Preisach:
        """Return the operator for a vector of unknowns: packed weights, offset, slope."""
        return Preisach(
            self.levels,
            unpack(x[: self.cells]),
            offset=float(x[self.cells]) if self.offset else 0.0,
            relay=self.relay,
            diagonal=self.diagonal,
            slope=float(x[-1]) if self.slope else 0.0,
        )

    def coarse(self, bands: int) -> PlaneSpec:
        """Return the structure on a subset of the levels, with at most ``bands`` bands."""
        count = min(bands, self.bands)
        places = np.round(np.linspace(0, self.bands, count + 1)).astype(np.int64)
        return replace(self, levels=self.levels[places])

    def sums(self, coarse: PlaneSpec) -> IntArray:
        """(n,) unknown of a coarser plane to which each unknown belongs."""
        within = np.searchsorted(coarse.levels, self.levels[:-1], side="right") - 1
        rows, columns = np.tril_indices(self.bands)
        i, j = within[rows], within[columns]
        levels = np.arange(coarse.cells, coarse.unknowns)
        return np.concatenate([i * (i + 1) // 2 + j, levels]).astype(np.int64)

    def bounded(self, signed: bool) -> BoolArray:
        """(n,) unknowns that must not be negative."""
        bounded = np.full(self.unknowns, not signed)
        bounded[self.cells : self.cells + self.offset] = False
        return bounded

    def unknowns_of(self, model: Preisach) -> FloatArray:
        """(n,) unknowns of an operator of this structure."""
        levels = [model.offset] * self.offset + [model.slope] * self.slope
        return np.append(pack(model.weights), levels)


class DesignMatrix:
    """Linear map from the unknowns of a `PlaneSpec` to the outputs at the measured samples.

    Parameters
    ----------
    spec : PlaneSpec
        Structure of the model.
    u : (T,) array
        Inputs applied, in order.
    measured : (T,) array of bool
        Whether the output was measured after each input; M are true.
    start : {"negative", "positive", "demagnetised"} or Memory
        Memory before the first input.
    counts : (M,) array, optional
        Number of samples that each measured one replaces; one by default.
    """

    def __init__(
        self,
        spec: PlaneSpec,
        u: FloatArray,
        measured: BoolArray,
        start: Start,
        counts: FloatArray | None = None,
    ) -> None:
        self.counts = counts
        self.elimination = KnownElimination()
        """That of its sparse system, which `quick_system` finds."""
        self.spec, self.u, self.start = spec, u[measured], start
        self.inputs, self.sampled = u, measured
        """Inputs applied (T,), and (T,) whether the output was measured."""
        blank = Preisach(spec.levels, np.zeros((spec.bands, spec.bands)), diagonal=spec.diagonal)
        past = np.array(blank.memory(start).extrema[1:])
        inputs = np.concatenate([past, u])
        tree = everett_tree(spec.levels, spec.diagonal == "uniform", inputs)
        self.index, self.coefficient, self.parent, corner = tree
        self.measured = np.concatenate([np.zeros(past.size, dtype=np.bool_), measured])
        self.swing, self.shift = swing(spec.relay), -off_output(spec.relay)
        self.corner = corner[self.measured]
        self._keep(_kernels.lead_to(self.measured.copy(), self.parent))

    def _keep(self, used: BoolArray) -> None:
        """Remove unused inputs from the tree."""
        if used.all():
            return
        number = np.append(np.cumsum(used, dtype=np.int32) - 1, np.int32(_kernels.ROOT))
        self.parent = number[self.parent[used]]
        self.index, self.coefficient = self.index[used], self.coefficient[used]
        self.measured = self.measured[used]

    @property
    def samples(self) -> int:
        """M, the number of rows."""
        return int(self.u.size)

    @property
    def measurements(self) -> int:
        """Number of measured samples, greater than M if they were condensed."""
        return self.samples if self.counts is None else round(float(self.counts.sum()))

    @cached_property
    def excited(self) -> BoolArray:
        """(L, L) cells in which a measured sample evaluates the Everett function."""
        packed = np.zeros(self.spec.cells)
        packed[self.corner[self.corner >= 0]] = 1.0
        touched: BoolArray = unpack(packed) > 0
        return touched

    def forward(self, x: FloatArray) -> FloatArray:
        """(M,) outputs for a vector of unknowns."""
        spec = self.spec
        nodes = x[: spec.cells].copy()
        total = nodes.sum()
        _kernels.cells_to_nodes(spec.bands, nodes)
        on = np.empty(self.parent.size)
        _kernels.forward(self.index, self.coefficient, self.parent, nodes, on)
        y: FloatArray = self.swing * on[self.measured] - self.shift * total
        if spec.offset:
            y += x[spec.cells]
        if spec.slope:
            y += x[-1] * self.u
        return y

    def adjoint(self, r: FloatArray) -> FloatArray:
        """Transpose of `forward`: (n,) from (M,)."""
        spec = self.spec
        out = np.empty(spec.unknowns)
        total = r.sum()
        out[: spec.cells] = self.swing * self._fraction_sums(r) - self.shift * total
        if spec.offset:
            out[spec.cells] = total
        if spec.slope:
            out[-1] = r @ self.u
        return out

    def gram(self, weight: FloatArray | None = None) -> FloatArray:
        """Gram matrix of the columns, in the lower triangle.

        Raises a `ParameterError` if there are more than `MOST_DENSE` bands.

        ``weight`` (M,): weight of each sample, one by default.
        """
        if self.spec.bands > MOST_DENSE:
            raise ParameterError(
                f"the normal equations of {self.spec.bands} bands need more than 8 GB; give at "
                f"most {MOST_DENSE}"
            )
        spec, cells = self.spec, self.spec.cells
        counts = np.ones(self.samples) if weight is None else weight
        gram = np.zeros((spec.unknowns, spec.unknowns))
        tree = self.index, self.coefficient, self.parent
        _kernels.gram(spec.bands, *tree, self.spread(counts), gram)
        touched, total = self._fraction_sums(counts), counts.sum()
        for first in range(0, cells, _TOGETHER):
            last = min(first + _TOGETHER, cells)
            rows = gram[first:last, :last]
            rows += gram[:last, first:last].T
            rows *= self.swing**2
            rows -= self.shift * self.swing * (touched[first:last, None] + touched[:last])
            rows += self.shift**2 * total
        gram[cells:] = self._level_rows(counts)
        return gram

    def gram_rows(
        self, weight: FloatArray, scale: FloatArray, which: IntArray, columns: IntArray
    ) -> FloatArray:
        """(k, m) entries of the Gram matrix of the columns times ``scale``.

        ``which`` (k,) and ``columns`` (m,): rows and columns; ``weight`` (M,): of each sample.
        """
        cells, inside, total = self.spec.cells, which[which < self.spec.cells], weight.sum()
        rows, levels = np.zeros((inside.size, self.spec.unknowns)), self._level_rows(weight)
        tree = self.index, self.coefficient, self.parent
        _kernels.gram_rows(self.spec.bands, *tree, self.spread(weight), inside, rows)
        rows = self.swing**2 * rows[:, columns]
        if self.shift:
            own = self.shift * (self.swing * self._fraction_sums(weight) - 0.5 * self.shift * total)
            rows -= own[inside][:, None] + np.append(own, np.zeros(len(levels)))[columns]
        level = np.flatnonzero(columns >= cells)
        rows[:, level] = levels[columns[level] - cells][:, inside].T
        rows = np.concatenate([rows, levels[which[inside.size :] - cells][:, columns]])
        return np.asarray(rows * (scale[which][:, None] * scale[columns]))

    def _level_rows(self, weight: FloatArray) -> FloatArray:
        """(0 to 2, n) rows of the Gram matrix of offset and slope."""
        columns = [np.ones(self.samples)] if self.spec.offset else []
        columns += [self.u] if self.spec.slope else []
        rows = [self.adjoint(column * weight) for column in columns]
        return np.reshape(rows, (len(rows), self.spec.unknowns))

    @property
    def reversals(self) -> int:
        """Number of samples from which other samples branch off."""
        return int(np.count_nonzero(np.bincount(self.parent[self.parent >= 0])))

    def column_squares(self, weight: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Squared length of each column with cells either on or off, and whether it varies.

        A cell that never switches between weighted samples has a constant column, which an offset
        replaces.
        """
        spec, total = self.spec, float(weight.sum())
        on = self._fraction_sums(weight)
        squares, varies = np.full(spec.unknowns, total), np.ones(spec.unknowns, dtype=np.bool_)
        squares[: spec.cells] = on * (self.swing - self.shift) ** 2 + (total - on) * self.shift**2
        if spec.offset:
            varies[: spec.cells] = (on > _NEVER * total) & (on < (1 - _NEVER) * total)
        else:
            varies[: spec.cells] = squares[: spec.cells] > 0
        if spec.slope:
            squares[-1] = weight @ self.u**2
            varies[-1] = squares[-1] > 0
        return squares, varies

    def coarser(self) -> DesignMatrix:
        """Design matrix of the same samples on a plane with every other threshold."""
        kept = np.union1d(np.arange(0, self.spec.levels.size, 2), [self.spec.bands])
        spec = replace(self.spec, levels=frozen(self.spec.levels[kept]))
        coarse = DesignMatrix(spec, self.inputs, self.sampled, self.start, self.counts)
        # Ratio for nested dissection of a plane; samples do not link fewer of its unknowns
        coarse.elimination.operations = self.elimination.operations / 8
        return coarse

    def part(self, kept: BoolArray) -> DesignMatrix:
        """Design matrix of some of the samples (M,)."""
        part = copy(self)
        part.__dict__.pop("excited", None)
        part.elimination = KnownElimination()
        part.u, part.corner = self.u[kept], self.corner[kept]
        part.counts = None if self.counts is None else self.counts[kept]
        part.measured, part.sampled = self.measured.copy(), self.sampled.copy()
        part.measured[self.measured] = kept
        part.sampled[self.sampled] = kept
        part._keep(_kernels.lead_to(part.measured.copy(), self.parent))
        return part

    def at_most(self, bands: int) -> DesignMatrix:
        """Design matrix of the same samples on a plane of at most ``bands`` bands."""
        matrix = self
        while matrix.spec.bands > bands:
            matrix = matrix.coarser()
        return matrix

    def dense(self) -> FloatArray:
        """(M, n) dense matrix; for small problems only."""
        identity = np.eye(self.spec.unknowns)
        return np.stack([self.forward(column) for column in identity], axis=1)

    def spread(self, r: FloatArray) -> FloatArray:
        """(T,) numbers of all inputs, zero where the output was not measured, from (M,)."""
        everywhere = np.zeros(self.parent.size)
        everywhere[self.measured] = r
        return everywhere

    def _fraction_sums(self, r: FloatArray) -> Packed:
        """Transpose of the map from weights to switched-on weight."""
        sums = np.zeros(self.spec.cells)
        _kernels.adjoint(self.index, self.coefficient, self.parent, self.spread(r), sums)
        _kernels.nodes_to_cells(self.spec.bands, sums)
        return sums


def everett_tree(
    levels: Levels, spread: bool, u: FloatArray
) -> tuple[_Indices, FloatArray, _Indices, _Indices]:
    """Tree of Everett differences of inputs that begin at negative saturation.

    Parameters
    ----------
    levels : (L + 1,) array
        Thresholds.
    spread : bool
        Whether the density of a diagonal cell is spread over its triangle.
    u : (T,) array
        Inputs.

    Returns
    -------
    index : (T, 6) array of int32
        Nodes of the plane, as `_kernels` describes them.
    coefficient : (T, 6) array
        Coefficients of the nodes.
    parent : (T,) array of int32
        Sample at which the branch began; -1 for negative saturation.
    corner : (T,) array of int32
        Cell in which the branch ends: the sample evaluates the Everett function there; -1 at
        negative saturation.
    """
    x, root = np.clip(u, levels[0], levels[-1]), np.int32(_kernels.ROOT)
    parent = _kernels.trace(float(levels[0]), x)
    x, begin, own = np.append(x, levels[0]), np.append(parent, root), np.arange(u.size + 1)
    band = np.clip(np.searchsorted(levels, x, side="right") - 1, 0, levels.size - 2)
    fraction = (x - levels[band]) * (1 / np.diff(levels))[band]
    rises, moves = x > x[begin], x != x[begin]
    high, low = np.where(rises, own, begin), np.where(rises, begin, own)
    i, s, j, f = band[high], fraction[high], band[low], fraction[low]
    node, same = i * (i + 1) // 2 + j, i == j
    # The corners of the rectangle below and left of (i, j), and the curved parts within the bands.
    nodes = [np.where(same, node, node - i), node, node - i + 1, node + 1]
    nodes += [i * (i + 3) // 2, j * (j + 3) // 2]
    index = np.stack(nodes, axis=1, dtype=np.int32)
    a, b = 1.0 - s, 1.0 - f
    coefficient = np.stack([a * b, s * b, a * f, s * f, -s * a, -f * b], axis=1)
    coefficient[j + 1 >= i, 2] = 0.0
    coefficient[:, 4:] *= spread
    coefficient[same] = 0.0
    coefficient[same, 0] = ((s - f) ** (1 + spread))[same]
    coefficient *= np.where(rises, 1.0, -1.0)[:, None]
    index[coefficient == 0.0] = 0
    ends = np.where(s == 0.0, node - i, node)
    ends = np.where(moves, ends, np.where(moves, ends, root)[begin]).astype(np.int32)
    return index[:-1], coefficient[:-1], parent, ends[:-1]


def check_bands(bands: int) -> None:
    """Raise an error if a plane is too fine to be identified.

    Raises a `ParameterError` if there are more than `MOST_BANDS` bands.
    """
    if bands > MOST_BANDS:
        raise ParameterError(
            f"levels are {bands} bands, too many to be identified; give at most {MOST_BANDS}"
        )


def corners(bands: int) -> tuple[tuple[IntArray, float, BoolArray], ...]:
    """Everett nodes whose values, with these signs, sum to the weight of each cell.

    Returns
    -------
    tuple
        Four corners: (K,) nodes, their sign, and the (K,) cells that have this corner.
    """
    i, j = np.tril_indices(bands)
    cell = np.arange(i.size)
    above = cell - i  # the node (i - 1, j)
    return (
        (cell, 1.0, j <= i), (above, -1.0, j < i), (cell + 1, -1.0, j < i),
        (above + 1, 1.0, j + 1 < i),
    )  # fmt: skip


def unpack(x: Packed) -> FloatArray:
    """(L, L) lower triangle from (K,) packed cells."""
    bands = int((np.sqrt(8 * x.size + 1) - 1) // 2)
    square = np.zeros((bands, bands))
    square[np.tril_indices(bands)] = x
    return square


def pack(x: npt.NDArray[np.float64]) -> Packed:
    """(K,) packed cells from an (L, L) lower triangle."""
    return np.asarray(x[np.tril_indices(len(x))], dtype=np.float64)
