"""Newton system of the weights as a sparse system in Everett values and predictions.

The normal equations of the weights are dense. They are sparse in the Everett values on the nodes of
the plane together with the predicted outputs at reversals. A sample links at most six nodes to the
prediction at its last reversal, which is also a sample, and a weight is the mixed difference of
four nodes. Predictions of other samples are eliminated first. The links between reversals are
equations, each with a multiplier.

The sparse matrix is quasi-definite (Vanderbei, SIAM J. Optim. 5, 1995): its unknowns have signs,
and it is positive definite on those of one sign and negative definite on the others. So any order
of elimination is possible. Columns with nearly the same rows are eliminated together (Ng and
Peyton, SIAM J. Sci. Comput. 14, 1993).
"""

from __future__ import annotations

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification import _sparse_kernels as _kernels
from minorloop.identification.design_matrix import DesignMatrix, corners
from minorloop.identification.elimination_order import Elimination, permuted, quick_elimination
from minorloop.identification.linear_algebra import conjugate_gradients
from minorloop.identification.prior import FieldPrecision, Mesh

_SOFT = 1e-8
"""Negative diagonal of the multipliers, over the mean weight of a sample."""
_TINY = 1e-14
"""Diagonal of unknowns that no sample determines, over the mean weight of a sample."""
_TOGETHER = 64
"""Number of outputs whose variances are computed at once."""
_ROUNDING = 1e-15
"""Size of a pivot, over that of its column before elimination, that counts as zero: a few times the
precision of float64."""
_FIRST_PART, _SEGMENTS = 2000, 10
"""Samples of the first part of a record whose multiplications are counted, and number of contiguous
segments in a part."""
_REVERSALS = 2
"""Most reversals for each cell; with more, the sparse system is not considered."""


def quick_system(
    matrix: DesignMatrix,
    weight: FloatArray,
    scale: FloatArray,
    most: float,
    mesh: Mesh | None = None,
) -> EverettSystem | None:
    """Return the system if a factorisation takes at most ``most`` multiplications, else None.

    Parameters are as of `EverettSystem`. The order of elimination of a system with much fill takes
    seconds, so parts of the record are counted first, each twice as large as the previous one. The
    multiplications grow with the samples at least as fast as from one part to the next, and at most
    with the square of the samples.
    """
    if matrix.reversals > _REVERSALS * matrix.spec.cells:
        return None
    samples, before, known = _FIRST_PART, 0.0, matrix.elimination
    while known.order is None and known.operations <= most and samples < matrix.samples:
        place = np.arange(matrix.samples) * _SEGMENTS % matrix.samples
        kept = place < samples
        counted = EverettSystem(matrix.part(kept), weight[kept], scale).operations
        growth, ratio = counted - before, matrix.samples / samples
        if counted + 4 / 3 * growth * (ratio**2 - 1) <= most:
            break
        known.operations = counted + (2 * growth * (ratio - 1) if before else 0.0)
        samples, before = 2 * samples, counted
    if known.operations > most:
        return None
    system = EverettSystem(matrix, weight, scale, mesh, known.order)
    if known.order is None:
        known.order, known.operations = system.order, system.operations
    return system if system.operations <= most else None


class EverettSystem:
    """The system (G + S + diag(ridge)) z = r, with G the weighted Gram matrix of scaled columns.

    Samples have a weight (M,), columns a factor ``scale`` (n,). S is the scaled precision of a
    prior, if there is one, as `condition` gives it. The values of the field on its ``mesh`` are
    further unknowns of the sparse system, and are eliminated last; the others in this ``order``, if
    it is known.
    """

    def __init__(
        self,
        matrix: DesignMatrix,
        weight: FloatArray,
        scale: FloatArray,
        mesh: Mesh | None = None,
        order: IntArray | None = None,
    ) -> None:
        spec = matrix.spec
        self.matrix, self.weight, self.scale = matrix, weight, scale
        self.precision: FieldPrecision | None = None
        self.owner: object = None
        """Owner of the present factor, which may use it again."""
        self.cells = spec.cells
        self.centre = np.zeros(spec.unknowns)
        """Means of the columns, if an offset is fitted and there is no prior; they are subtracted
        from the columns."""
        if spec.offset and mesh is None:
            self.centre = matrix.adjoint(weight) / weight.sum()
            self.centre[spec.cells] = 0.0
        inner = np.zeros(matrix.parent.size, dtype=np.bool_)
        inner[matrix.parent[matrix.parent >= 0]] = True
        # Unknowns: nodes, predictions at reversals, their multipliers, the root (the prediction at
        # saturation) and its multiplier, the slope, and the values of the field
        prediction = spec.cells + np.arange(np.count_nonzero(inner))
        multiplier = prediction + prediction.size
        self._root = spec.cells + 2 * prediction.size
        self._steep = self._root + 2
        self._values_of_field = 0 if mesh is None else mesh.unknowns
        self._size = self._steep + spec.slope + self._values_of_field
        entries = _Entries(float(weight.mean()))
        self._add_samples(entries, inner, prediction, multiplier)
        if spec.offset:  # the root is free; its equation contains the offset
            entries.add(self._root + 1, self._root + 1, -1.0)
        else:
            equation = np.array([[self._root, self._total]])
            entries.equations(np.array([self._root + 1]), equation, np.array([[1.0, matrix.shift]]))
        sign = np.ones(self._size)
        sign[multiplier], sign[self._root + 1] = -1.0, -1.0
        entries.add(np.flatnonzero(sign > 0), np.flatnonzero(sign > 0), _TINY * weight.mean())
        rows, columns, self._values = entries.all()
        added = self._added_places(mesh)
        places = np.zeros((self._size - self._values_of_field, 2))
        places[: spec.cells] = np.column_stack(np.tril_indices(spec.bands))
        corner = matrix.index[inner, :4].max(axis=1, initial=0)
        places[spec.cells : self._root] = np.tile(places[corner], (2, 1))
        self._factor = _SparseFactor(
            np.append(rows, added[0]),
            np.append(columns, added[1]),
            sign,
            self._values_of_field,
            places,
            order,
        )
        self._ridge = np.zeros(spec.unknowns)

    def _add_samples(
        self, entries: _Entries, inner: BoolArray, prediction: IntArray, multiplier: IntArray
    ) -> None:
        """Add the squares of all samples, and the equations of the reversals, ``inner`` (T,)."""
        matrix, weight = self.matrix, self.matrix.spread(self.weight)
        number = np.full(inner.size + 1, self._root)  # the last is the number of parent -1
        number[:-1][inner] = prediction
        before, own = number[matrix.parent][:, None], number[:-1][:, None]
        index, coefficient = matrix.index, matrix.swing * matrix.coefficient
        ones = np.ones((inner.size, 1))
        slope = [np.full((inner.size, 1), self._steep)] * matrix.spec.slope
        input_ = [matrix.spread(matrix.u)[:, None]] * matrix.spec.slope
        outer = ~inner & (weight > 0)
        links = np.hstack([index, before, *slope])
        factors = np.hstack([coefficient, ones, *input_])
        entries.squares(links[outer], factors[outer], weight[outer])
        links, factors = np.hstack([own, *slope]), np.hstack([ones, *input_])
        entries.squares(links[inner], factors[inner], weight[inner])
        links, factors = np.hstack([index, before, own]), np.hstack([coefficient, ones, -ones])
        entries.equations(multiplier, links[inner], factors[inner])

    def _added_places(self, mesh: Mesh | None) -> IntArray:
        """Rows and columns of the entries that `factorise` adds: ridges and the prior."""
        spec, root, total = self.matrix.spec, self._root, self._total
        *weights, self._ridge_cells, self._ridge_signs = _ridges(spec.bands)
        self._ridge_factors = np.where(weights[0] == weights[1], 1.0, 2.0) * self._ridge_signs
        self._level_factors = np.array([1.0, self.matrix.shift**2, self.matrix.shift])
        level = np.array([[root, total, root], [root, total, total]])[:, : 3 * spec.offset]
        slope = np.full((2, int(spec.slope)), self._steep)
        parts = [np.vstack(weights), level, slope]
        if mesh is not None:
            first = self._size - self._values_of_field
            at_node = mesh.places < spec.cells
            parts.append(np.where(at_node, mesh.places, mesh.places - spec.cells + first))
        return np.hstack(parts)

    @property
    def _total(self) -> int:
        """Node with the sum of all weights."""
        return self.cells - self.matrix.spec.bands

    @property
    def order(self) -> IntArray:
        """Order of elimination of the unknowns that are not of the field."""
        return self._factor.elimination.order[: self._size - self._values_of_field]

    @property
    def operations(self) -> float:
        """Multiplications of a factorisation."""
        return self._factor.elimination.operations

    def condition(self, scale: FloatArray, precision: FieldPrecision | None = None) -> None:
        """Set the factor of each column and the precision of the prior."""
        self.scale, self.precision, self.owner = scale, precision, None

    def product(self, z: FloatArray) -> FloatArray:
        """(n,) product with G + S."""
        return self.gradient(self.scale * z, 0.0)

    def gradient(self, x: FloatArray, y: FloatArray | float) -> FloatArray:
        """(n,) scaled gradient of the cost at unknowns ``x`` (n,), for outputs ``y`` (M,)."""
        downhill = self._adjoint(self.matrix.forward(x) - self.centre @ x - y)
        if self.precision is not None:
            downhill += self.precision.product(x)
        return np.asarray(self.scale * downhill)

    def unknowns(self, z: FloatArray) -> FloatArray:
        """(n,) unknowns of the original columns from those of the system."""
        x = self.scale * z
        if self.matrix.spec.offset:
            x[self.cells] -= self.centre @ x
        return np.asarray(x)

    def _adjoint(self, left: FloatArray) -> FloatArray:
        """(n,) products of the weighted columns with a residual (M,)."""
        left = self.weight * left
        return np.asarray(self.matrix.adjoint(left) - self.centre * left.sum())

    def factorise(self, ridge: FloatArray | float, owner: object = None) -> None:
        """Factorise the system with this (n,) ridge, for this owner."""
        spec, precision, self.owner = self.matrix.spec, self.precision, owner
        self._ridge = np.broadcast_to(ridge, self.scale.shape)
        steep = self._ridge / self.scale**2
        if precision is not None:
            steep = steep + precision.own
        parts = [
            self._values,
            self._ridge_signs * steep[self._ridge_cells],
            np.outer(steep[self.cells : self.cells + spec.offset], self._level_factors).ravel(),
            steep[steep.size - spec.slope :],
        ]
        if precision is not None:
            parts += [precision.links, precision.field[np.tril_indices(self._values_of_field)]]
        self._factor.factorise(np.concatenate(parts))

    def solve(
        self, r: FloatArray, free: BoolArray | bool = True, tolerance: float = 1.0, most: int = 1
    ) -> FloatArray:
        """(n,) solution by conjugate gradients on G, with the factor as the preconditioner.

        Unknowns that are not ``free`` are zero; their ridge must be high. The iteration ends after
        ``most`` steps, or at a residual of ``tolerance`` relative to ``r`` (n,).
        """
        left = np.where(free, r, 0.0)
        return conjugate_gradients(
            lambda z: np.where(free, self.product(z) + self._ridge * z, 0.0),
            lambda z: np.where(free, self.rough(z), 0.0),
            left,
            tolerance * float(np.linalg.norm(left)),
            most,
        )

    def rough(self, r: FloatArray) -> FloatArray:
        """(n,) solution, to the accuracy of the factor."""
        spec, cells, out = self.matrix.spec, self.cells, np.empty_like(r)
        r = r / self.scale
        if spec.offset:
            r += r[cells] * self.centre
        x = self._factor.solve(self._right(r))
        _kernels.weights_of_nodes(spec.bands, x[:cells], out[:cells])
        if spec.slope:
            out[-1] = x[self._steep]
        if spec.offset:
            out[cells] = x[self._root] + self.matrix.shift * x[self._total]
            out[cells] += self.centre @ out
        return out / self.scale

    def _right(self, r: FloatArray) -> FloatArray:
        """Right-hand side of the sparse system from that of the unknowns (n,)."""
        spec, cells, b = self.matrix.spec, self.cells, np.zeros(self._size)
        _kernels.weights_to_nodes(spec.bands, r[:cells], b[:cells])
        if spec.offset:
            b[self._root] = r[cells]
            b[self._total] += self.matrix.shift * r[cells]
        if spec.slope:
            b[self._steep] = r[-1]
        return b

    def inverse(self, directions: FloatArray | None = None) -> FloatArray:
        """(k, k) inverse of the factorised system along directions (k, n), for unscaled columns.

        Without directions, it is the whole inverse (n, n).
        """
        each = np.eye(self.scale.size) if directions is None else directions
        rows = np.stack([self._right(one) for one in each], axis=1)
        return self._factor.products(rows)

    def variances_apart(self, link_cells: IntArray) -> FloatArray:
        """(K,) variances of the weights without the part that the field of the prior explains.

        The variance is the derivative of the logarithm of the determinant by the precision of the
        weight. ``link_cells`` are the cells of the links of the prior.
        """
        assert self.precision is not None
        spec, precision = self.matrix.spec, self.precision
        levels = self._values.size + self._ridge_cells.size
        first = levels + 3 * spec.offset + spec.slope
        last = first + link_cells.size
        inverse = self._factor.inverse()
        own = self._ridge_factors * inverse[self._values.size : levels]
        links = 2 * precision.links / precision.own[link_cells] * inverse[first:last]
        field = np.zeros((self._values_of_field, self._values_of_field))
        field[np.tril_indices(len(field))] = inverse[last:]
        field += np.tril(field, -1).T
        given = precision.factors
        return np.asarray(
            np.bincount(self._ridge_cells, own, spec.cells)
            + np.bincount(link_cells, links, spec.cells)
            + given.multiply(given @ field).sum(axis=1)
        )

    def logarithm(self) -> float:
        """Logarithm of the determinant of the factorised system, up to a constant."""
        return self._factor.logarithm()

    def variances(self, future: DesignMatrix) -> FloatArray:
        """(T,) variances of the outputs of other samples, if the system is a precision."""
        times = np.flatnonzero(future.measured)
        out = np.empty(times.size)
        for begin in range(0, times.size, _TOGETHER):
            some = times[begin : begin + _TOGETHER]
            rows = np.zeros((self._size, some.size))
            _kernels.add_paths(future.index, future.coefficient, future.parent, some, rows)
            rows[: self.cells] *= future.swing
            rows[self._root] = 1.0
            if self.matrix.spec.slope:
                rows[self._steep] = future.u[begin : begin + _TOGETHER]
            out[begin : begin + _TOGETHER] = self._factor.squares(rows)
        return out


class _Entries:
    """Entries of a symmetric matrix, one triangle."""

    def __init__(self, unit: float) -> None:
        self.unit = unit
        self.parts: list[tuple[IntArray, IntArray, FloatArray]] = []

    def add(
        self, rows: IntArray | int, columns: IntArray | int, values: FloatArray | float
    ) -> None:
        row, column, value = np.broadcast_arrays(
            np.atleast_1d(rows), np.atleast_1d(columns), np.atleast_1d(values)
        )
        kept = value != 0
        self.parts.append((row[kept], column[kept], value[kept].astype(np.float64)))

    def squares(self, links: IntArray, factors: FloatArray, weight: FloatArray) -> None:
        """Add the squares of rows with these factors at these unknowns."""
        for a in range(links.shape[1]):
            for b in range(a + 1):
                one, other = links[:, a], links[:, b]
                twice = 2.0 if a != b else 1.0
                value = weight * factors[:, a] * factors[:, b]
                self.add(one, other, np.where(one == other, twice, 1.0) * value)

    def equations(self, multiplier: IntArray, links: IntArray, factors: FloatArray) -> None:
        """Add equations, one for each multiplier.

        Their squares change no solution, but keep the pivots away from zero.
        """
        self.squares(links, factors, np.full(len(links), self.unit))
        for a in range(links.shape[1]):
            self.add(multiplier, links[:, a], factors[:, a])
        self.add(multiplier, multiplier, -_SOFT * self.unit)

    def all(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Rows, columns and values, without duplicates."""
        from scipy.sparse import coo_array

        rows, columns, values = (np.concatenate(part) for part in zip(*self.parts, strict=True))
        places = np.maximum(rows, columns), np.minimum(rows, columns)
        merged = coo_array((values, places)).tocsc().tocoo()
        return merged.row.astype(np.int64), merged.col.astype(np.int64), merged.data


def _ridges(bands: int) -> tuple[IntArray, IntArray, IntArray, FloatArray]:
    """Entries of the nodes on which the ridge of each weight acts: rows, columns, cells, signs."""
    cell = np.arange(bands * (bands + 1) // 2)
    found, parts = corners(bands), []
    for a, (row, one, there) in enumerate(found):
        for column, other, too in found[: a + 1]:
            both = there & too
            parts.append((row[both], column[both], cell[both], np.full(both.sum(), one * other)))
    rows, columns, cells, signs = (np.concatenate(part) for part in zip(*parts, strict=True))
    return rows, columns, cells, signs


class _SparseFactor:
    """Factor of a sparse symmetric matrix whose pattern does not change.

    ``rows`` and ``columns`` (E,) are the places of its entries, in one triangle; entries in the
    same place are added. ``sign`` (n,) is 1 or -1 for each unknown. ``last`` unknowns are
    eliminated last, because they are linked to most others. ``places`` (n - last, 2) are the places
    of the other unknowns in the plane, and ``order`` (n - last,) is their order of elimination, if
    it is known.
    """

    def __init__(
        self,
        rows: IntArray,
        columns: IntArray,
        sign: FloatArray,
        last: int = 0,
        places: FloatArray | None = None,
        order: IntArray | None = None,
    ) -> None:
        from scipy.sparse import coo_array

        n = sign.size
        ends = np.concatenate([rows, columns, np.arange(n)])
        others = np.concatenate([columns, rows, np.arange(n)])
        self._entries, self._sign = (rows, columns), sign
        self._pattern = coo_array((np.ones(ends.size), (ends, others)), shape=(n, n)).tocsc()
        if order is None:
            self.elimination = quick_elimination(self._pattern, last, places)
        else:
            self.elimination = Elimination.of(
                self._pattern, np.append(order, np.arange(order.size, n))
            )
        self._data: FloatArray | None = None

    def _lay_out(self) -> FloatArray:
        """Find the panels and the places of the entries, which a system that only counts omits."""
        n = self._sign.size
        order, parent, _ = self.elimination
        self._order = order[_kernels.postorder(parent)]
        first, below = permuted(self._pattern, self._order)
        _, parent, counts = Elimination.of(self._pattern, self._order)
        start, height = _kernels.panels(parent, counts)
        width = np.diff(start)
        at, offset = np.append(0, np.cumsum(height)), np.append(0, np.cumsum(height * width))
        rows, self._panel_of = _kernels.panel_rows(first, below, start, at)
        # Sorted here, because numba takes longer to compile a sort than all these loops.
        key = np.sort(np.repeat(np.arange(height.size), height) * n + rows)
        self._panels = start, at, key % n, offset

        def places(row: IntArray, column: IntArray) -> IntArray:
            panel = self._panel_of[column]
            row = np.searchsorted(key, panel * n + row) - at[panel]
            return np.asarray(offset[panel] + row * width[panel] + column - start[panel])

        place, each = np.argsort(self._order), np.arange(n)
        one, other = (place[end] for end in self._entries)
        self._places = places(np.maximum(one, other), np.minimum(one, other))
        self._pivots = places(each, each)
        self._sign = self._sign[self._order]
        return np.empty(offset[-1])

    def factorise(self, values: FloatArray) -> None:
        """Factorise the matrix with these (E,) values of its entries."""
        if self._data is None:
            self._data = self._lay_out()
        known = self._panel_of, self._sign, self._places
        _kernels.factorise(*self._panels, *known, values, _ROUNDING, self._data)

    def solve(self, b: FloatArray) -> FloatArray:
        """(n,) solution of the system with the right-hand side ``b``."""
        x = b[self._order]
        _kernels.solve(*self._panels, self._sign, self._data, x)
        out = np.empty_like(b)
        out[self._order] = x
        return out

    def inverse(self) -> FloatArray:
        """(E,) inverse at the entries of the matrix."""
        out = np.empty_like(self._data)
        _kernels.invert(*self._panels, self._panel_of, self._sign, self._data, out)
        return np.asarray(out[self._places])

    def logarithm(self) -> float:
        """Logarithm of the magnitude of the determinant."""
        assert self._data is not None
        return 2 * float(np.log(self._data[self._pivots]).sum())

    def products(self, b: FloatArray) -> FloatArray:
        """(r, r) products b' M^-1 b with the inverse of the matrix, for columns ``b`` (n, r)."""
        x = self._half(b)
        return np.asarray((x.T * self._sign) @ x)

    def squares(self, b: FloatArray) -> FloatArray:
        """(r,) diagonal of `products`."""
        x = self._half(b)
        return np.asarray(np.einsum("n,nr,nr->r", self._sign, x, x))

    def _half(self, b: FloatArray) -> FloatArray:
        """Solution of half the system, L X = B."""
        x = np.ascontiguousarray(b[self._order])
        _kernels.solve_half(*self._panels, self._data, x)
        return x
