"""Constrained least squares on exact areas, with a choice of smoothness.

The cost, with the outputs scaled to a range of one and w the cell weights on that scale:

    mean over samples of (y - model)^2
    + smoothness * L^2 * sum over neighbouring cells of (w_k / a_k - w_m / a_m)^2

a is 1 for a square cell and 1/2 for a triangle of the diagonal, at any spacing of the levels: by
this measure, the plane is smooth if the levels are dense where relays switch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.errors import ParameterError, counted
from minorloop.identification import active_set, dense_solver
from minorloop.identification.dense_solver import GramRows, Quadratic, Rows
from minorloop.identification.design_matrix import (
    MOST_DENSE,
    DesignMatrix,
    PlaneSpec,
    pack,
)
from minorloop.identification.everett_system import quick_system
from minorloop.identification.linear_algebra import scale_symmetric
from minorloop.operators.plane import cell_areas
from minorloop.threads import one_thread

if TYPE_CHECKING:
    from scipy.sparse import csr_array

CANDIDATES = (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Strengths that ``smoothness="auto"`` tries, weakest first."""

_SEGMENTS = 25
_HELD_OUT_EVERY = 5
"""Contiguous segments for ``smoothness="auto"``; the middle one of every five is held out."""
_PATIENCE = 2
"""Number of stronger smoothnesses without improvement after which the search ends."""
_ROUNDING = 1e-11
_FLOOR = 1e-300
_MANY = 50_000
"""Samples from which the iteration uses the normal equations only: passes over all samples take
longer than the solution, and do not make it more accurate."""
_LEAST_SPARSE = 800
"""Cells from which the sparse system is used."""
_FILL, _LARGEST_FILL = 900.0, 20.0
"""Most multiplications of its factorisation: over the cells to the power of 3/2, at which it is
quicker than dense matrices; and over the squared cells, if dense matrices are too large."""
_ENOUGH, _NOISELESS = 1e-10, 1e-7
"""Largest violation and least residual with which the sparse system is accurate enough."""
_LARGE, _LARGE_OF_MANY = 2500, 1000
"""Cells from which a problem is first solved on every other threshold; and cells from which the
strength for many samples is chosen there."""


@dataclass(frozen=True, eq=False)
class FittedUnknowns:
    """Fitted unknowns, the violation of the optimality conditions, and the smoothness used.

    ``converged`` is false where a longer search would fit better.
    """

    x: FloatArray
    kkt: float
    smoothness: float
    converged: bool = True


@dataclass(frozen=True, eq=False)
class Problem:
    """Least-squares problem: ``matrix`` of M samples, and outputs ``y`` (M,).

    ``signed`` allows negative weights and slope; ``say`` is called with the next step. If
    ``rough``, as to compare options, the iteration uses the normal equations only.
    """

    matrix: DesignMatrix
    y: FloatArray
    signed: bool = False
    say: Callable[[str], None] = lambda stage: None
    rough: bool = False

    def fit(self, smoothness: float | Literal["auto"]) -> FittedUnknowns:
        """Fit with a given smoothness, or with the best to predict held-out segments."""
        bands = self.matrix.spec.bands
        if bands > MOST_DENSE and (self.signed or smoothness != 0):
            raise ParameterError(
                f"levels are {bands} bands; weights of either sign or smoothness allow at most "
                f"{MOST_DENSE}; give fewer levels, or smoothness 0"
            )
        if smoothness == "auto":
            return self._fit_chosen()
        return _System(self, np.ones(self.y.size)).solve(_as_strength(smoothness))

    def fit_part(
        self,
        kept: BoolArray,
        strengths: Sequence[float],
        guess: FloatArray | None = None,
    ) -> FloatArray:
        """(n,) unknowns fitted to the samples ``kept`` (M,).

        The strength is chosen from ``strengths``, weakest first, by prediction of held-out segments
        of these samples. A fit with a single strength starts at ``guess`` (n,).
        """
        part = _System(self, kept.astype(np.float64))
        if len(strengths) == 1:
            return part.solve(strengths[0], guess).x
        best, guess = self._best_strength(part, strengths)
        return part.solve(best, guess if best else None).x

    @cached_property
    def differences(self) -> tuple[csr_array[Any], csr_array[Any]]:
        """D of `neighbour_differences`, and D'D."""
        apart = neighbour_differences(self.matrix.spec)
        return apart, (apart.T @ apart).tocsr()

    def coarser(self) -> Problem:
        """Problem of the same samples with every other threshold."""
        return replace(self, matrix=self.matrix.coarser())

    def _fit_chosen(self) -> FittedUnknowns:
        """Choose the strength on held-out segments, from weak to strong; then fit all samples.

        The search ends after two strengths in a row that predict worse than the best. Weak ones
        take little time, because most weights are then zero. If the samples determine a plane that
        reproduces them to rounding, they have no noise to smooth. The best strength hardly depends
        on the number of levels, so a coarser problem chooses it for a large one.
        """
        whole = _System(self, np.ones(self.y.size))
        plain = None if self._is_large else whole.solve(0.0)
        if plain is not None and reproduces(self.matrix, plain.x, self.y):
            return plain
        best, guess = self._best_strength(whole, CANDIDATES)
        return plain if plain is not None and not best else whole.solve(best, guess)

    @property
    def _is_large(self) -> bool:
        most = _LARGE if self.y.size <= _MANY else _LARGE_OF_MANY
        return self.matrix.spec.cells > most

    def _best_strength(
        self, whole: _System, strengths: Sequence[float]
    ) -> tuple[float, FloatArray | None]:
        """Strength that predicts held-out samples of a system best, and a guess of its unknowns."""
        if self._is_large:
            coarse = self.coarser()
            return coarse._best_strength(_System(coarse, whole.share), strengths)[0], None
        used = np.flatnonzero(whole.weight > 0)
        held = used[held_out_segments(used.size)]
        if not held.size:
            return 0.0, None
        share = whole.share.copy()
        share[held] = 0.0
        part = _System(self, share, whole)
        # No first guess: undetermined cells would keep its knowledge of the held-out segments.
        guess: FloatArray | None = None
        best, least, since = 0.0, np.inf, 0
        for strength in strengths:
            guess = part.solve(strength, guess).x
            off = (self.matrix.forward(guess) - self.y)[held]
            error = float(off**2 @ whole.weight[held])
            if error < least:
                best, least, since = strength, error, 0
            else:
                since += 1
            if since == _PATIENCE:
                break
        return best, guess


def reproduces(matrix: DesignMatrix, x: FloatArray, y: FloatArray) -> bool:
    """Whether the samples determine the unknowns, which reproduce the samples to rounding."""
    left = np.abs(matrix.forward(x) - y).max()
    return bool(y.size >= matrix.spec.unknowns and left <= _ROUNDING * (float(np.ptp(y)) or 1.0))


def held_out_segments(samples: int) -> BoolArray:
    """(M,) the middle one of every five of 25 contiguous segments."""
    segment = np.arange(samples) * _SEGMENTS // max(samples, 1)
    return np.asarray(segment % _HELD_OUT_EVERY == _HELD_OUT_EVERY // 2)


class _System:
    """Scaled normal equations of a problem with weighted samples."""

    def __init__(self, problem: Problem, weight: FloatArray, whole: _System | None = None) -> None:
        counts = problem.matrix.counts
        self.problem, self.share, self._whole = problem, weight, whole
        self.weight = weight if counts is None else weight * counts
        spec, used = problem.matrix.spec, problem.y[self.weight > 0]
        self.shift = float(used.mean()) if spec.offset else 0.0
        self.unit = float(np.ptp(used)) or float(np.abs(used).max(initial=0.0)) or 1.0
        self.y = (problem.y - self.shift) / self.unit
        self.bounded = spec.bounded(problem.signed)

    @property
    def gram(self) -> GramRows:
        """Gram matrix of the scaled columns."""
        return self._normal[0]

    @property
    def scale(self) -> FloatArray:
        """(n,) factors that scale the columns to about unit length."""
        return self._normal[1]

    @cached_property
    def _normal(self) -> tuple[GramRows, FloatArray]:
        matrix, weight = self.problem.matrix, self.weight
        if matrix.spec.cells > _LARGE and self.y.size <= _MANY:
            squares = matrix.column_squares(weight)[0]
            scale = _unit(squares)
            compute = partial(matrix.gram_rows, weight, scale)
            whole = partial(_scaled, self._unscaled_gram, scale)
            return GramRows(squares * scale**2, compute, whole), scale
        gram = self._unscaled_gram()
        scale = _unit(gram.diagonal())
        scale_symmetric(gram, scale)
        return GramRows.of(gram), scale

    def _unscaled_gram(self) -> FloatArray:
        """Gram matrix; for many samples, the whole matrix less that of the few left-out samples."""
        matrix, whole = self.problem.matrix, self._whole
        self.problem.say(f"summing {counted(self.y.size, 'sample')} over pairs of weights")
        if whole is None or self.weight.size <= _MANY:
            return matrix.gram(self.weight)
        gram = _scaled(whole.gram.all.copy, 1.0 / whole.scale)
        return np.asarray(gram - matrix.gram(whole.weight - self.weight))

    def solve(self, strength: float, guess: FloatArray | None = None) -> FittedUnknowns:
        """Fit with a smoothness, starting from a guess of the unknowns if there is one."""
        spec = self.problem.matrix.spec
        self.problem.say(f"solving for {counted(spec.cells, 'weight')}, smoothness {strength:g}")
        if strength == 0:
            found = self._solve_sparse()
            if found.kkt <= _ENOUGH or spec.bands > MOST_DENSE:
                return found
            guess = found.x if np.isfinite(found.kkt) else guess
        if guess is None and spec.cells > _LARGE:
            guess = self._coarse_guess(strength)
        apart = penalty = None
        if strength:
            factor = np.sqrt(strength * self.weight.sum()) * spec.bands
            differences, products = self.problem.differences
            apart, penalty = factor * differences, products.copy()
            along = np.repeat(self.scale, np.diff(penalty.indptr))
            penalty.data *= factor**2 * along * self.scale[penalty.indices]
        rows = self._rows(apart)
        rough = self.problem.rough and spec.cells <= _LARGE
        if self.y.size > _MANY or rough:
            slope = self.scale * self.problem.matrix.adjoint(self.y * self.weight)
            cost, refined = Quadratic(self.gram, slope, penalty), None
        else:
            cost, refined = _OnSamples(self, penalty), rows
        size = float(np.linalg.norm(rows.target)) or 1.0
        solution = dense_solver.solve(
            cost,
            self.bounded,
            size,
            guess=None if guess is None else self._scaled(guess),
            rows=refined,
            say=self.problem.say,
        )
        # Computed from the rows alone, without the rounding of the normal equations.
        z = solution.z
        kkt = active_set.optimality(z, -rows.transpose(rows.residual(z)), self.bounded, size)
        converged = solution.settled and kkt <= active_set.ACCEPTABLE
        return FittedUnknowns(self._of_record(self.scale * z), kkt, strength, converged)

    def _solve_sparse(self) -> FittedUnknowns:
        """Fit without smoothness on the sparse system, if that is quicker and accurate enough.

        Otherwise the violation is infinite. Outputs without noise determine the weights to more
        digits than the sparse system resolves.
        """
        matrix, spec, share = self.problem.matrix, self.problem.matrix.spec, np.sqrt(self.weight)
        unused = FittedUnknowns(np.zeros(spec.unknowns), np.inf, 0.0)
        if self.problem.signed or spec.cells < _LEAST_SPARSE:
            return unused
        squares, varying = matrix.column_squares(self.weight)
        scale, most = _unit(squares), _FILL * spec.cells**1.5
        if spec.bands > MOST_DENSE:
            most = _LARGEST_FILL * float(spec.cells) ** 2
        system = quick_system(matrix, self.weight, scale, most)
        if system is None:
            if spec.bands > MOST_DENSE:
                raise ParameterError(
                    f"levels are {spec.bands} bands and the input reverses every few samples: the "
                    f"fit needs more than 8 GB; give at most {MOST_DENSE} levels"
                )
            return unused
        apart = np.maximum(squares - self.weight.sum() * system.centre**2, _ROUNDING * squares)
        fine = _unit(np.where(varying, apart, squares))
        size = float(np.linalg.norm(share * self.y)) or 1.0
        with one_thread():
            found = active_set.solve_sparse(system, self.y, self.bounded, varying, size, fine)
        x = system.unknowns(found.z)
        left = float(np.linalg.norm(share * (matrix.forward(x) - self.y)))
        x = self._of_record(x)
        determined = matrix.samples >= spec.unknowns
        if left <= _NOISELESS * size and determined and spec.bands <= MOST_DENSE:
            return replace(unused, x=x)
        return FittedUnknowns(x, found.kkt, 0.0, found.kkt <= active_set.ACCEPTABLE)

    def gradient(self, z: FloatArray, y: FloatArray | float | None = None) -> FloatArray:
        """(n,) gradient of the cost without a penalty, for outputs ``y`` or those of the system."""
        matrix, target = self.problem.matrix, self.y if y is None else y
        residual = (matrix.forward(self.scale * z) - target) * self.weight
        return np.asarray(self.scale * matrix.adjoint(residual))

    def _rows(self, apart: csr_array[Any] | None) -> Rows:
        """Rows of the problem: samples, then penalised differences of neighbours, if any."""
        matrix, scale, share = self.problem.matrix, self.scale, np.sqrt(self.weight)
        if apart is None:
            return Rows(
                lambda z: share * matrix.forward(scale * z),
                lambda r: scale * matrix.adjoint(share * r),
                share * self.y,
            )
        samples = self.y.size

        def apply(z: FloatArray) -> FloatArray:
            return np.append(share * matrix.forward(scale * z), apart @ (scale * z))

        def transpose(r: FloatArray) -> FloatArray:
            return np.asarray(scale * (matrix.adjoint(share * r[:samples]) + apart.T @ r[samples:]))

        return Rows(apply, transpose, np.append(share * self.y, np.zeros(apart.shape[0])))

    def _coarse_guess(self, strength: float) -> FloatArray:
        """Solve on every other threshold, and divide each weight among the cells that it covers.

        Without smoothness, only the cells with a gradient below the mean get a share.
        """
        problem = self.problem.coarser()
        coarse = _System(problem, self.weight).solve(strength)
        spec, wide = self.problem.matrix.spec, problem.matrix.spec
        within = spec.sums(wide)[: spec.cells]

        def divide(share: FloatArray) -> FloatArray:
            sums = np.bincount(within, share, wide.cells)
            fine = (coarse.x[: wide.cells] / sums)[within] * share
            return np.concatenate([fine, coarse.x[wide.cells :]])

        area = pack(cell_areas(spec.levels))
        if strength:
            return divide(area)
        slope = self.gradient(self._scaled(divide(area)))[: spec.cells]
        mean = np.bincount(within, slope) / np.bincount(within)
        return divide(area * (slope - mean[within] <= _ROUNDING * np.abs(slope)))

    def _of_record(self, x: FloatArray) -> FloatArray:
        """(n,) unknowns in the unit of the output."""
        spec = self.problem.matrix.spec
        x = x * self.unit
        if spec.offset:
            x[spec.cells] += self.shift
        return x

    def _scaled(self, x: FloatArray) -> FloatArray:
        spec = self.problem.matrix.spec
        z = x.copy()
        if spec.offset:
            z[spec.cells] -= self.shift
        return z / (self.scale * self.unit)


class _OnSamples(Quadratic):
    """Cost of a system, with gradients from the samples instead of their normal equations."""

    def __init__(self, system: _System, penalty: csr_array[Any] | None) -> None:
        super().__init__(system.gram, np.empty(0), penalty)
        self.system = system

    def gradient(self, z: FloatArray) -> FloatArray:
        """As of `Quadratic`."""
        return self._penalised(self.system.gradient(z), z)

    def product(self, z: FloatArray) -> FloatArray:
        """As of `Quadratic`."""
        return self._penalised(self.system.gradient(z, 0.0), z)


def _unit(squares: FloatArray) -> FloatArray:
    """Factors that scale columns of these squared lengths to unit length."""
    return np.asarray(1.0 / np.sqrt(np.where(squares > _FLOOR, squares, 1.0)))


def _scaled(compute: Callable[[], FloatArray], scale: FloatArray) -> FloatArray:
    """Scaled rows and columns of a matrix."""
    matrix = compute()
    scale_symmetric(matrix, scale)
    return matrix


def neighbour_differences(spec: PlaneSpec) -> csr_array[Any]:
    """(P, n) sparse differences of the unknowns of neighbouring cells, over the area of each."""
    from scipy.sparse import csr_array

    i, j = np.tril_indices(spec.bands)
    cell, area = np.arange(i.size), np.where(i == j, 0.5, 1.0)
    up, right = i + 1 < spec.bands, j < i
    # The cell above is one row further; the one to the right is the next.
    first = np.append((cell + i + 1)[up], cell[right] + 1)
    second = np.append(cell[up], cell[right])
    values = np.append(1 / area[first], -1 / area[second])
    pair = np.tile(np.arange(first.size), 2)
    shape = first.size, spec.unknowns
    return csr_array((values, (pair, np.append(first, second))), shape=shape)


def _as_strength(smoothness: float) -> float:
    number = isinstance(smoothness, float | int | np.floating | np.integer)
    if not number or isinstance(smoothness, bool) or not 0 <= smoothness < np.inf:
        raise ParameterError(
            f'smoothness is {smoothness!r}; give "auto", 0.0 for none, or a positive strength'
        )
    return float(smoothness)
