"""Constrained least squares on exact areas, with a choice of smoothness.

What is minimised, with the outputs scaled to a range of one and w the cell weights on that
scale:

    mean over samples of (y - model)^2
    + smoothness * L^2 * sum over neighbouring cells of (w_k / a_k - w_m / a_m)^2

a is 1 for a square cell and 1/2 for a triangle of the diagonal, whatever the spacing of the
levels: levels that are dense where switching happens make the plane smooth in these terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.errors import ParameterError
from minorloop.identification import _kernels, active_set
from minorloop.identification.areas import Areas, Form, pack, unpack
from minorloop.operators.plane import cell_areas

CANDIDATES = (0.0, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
"""Strengths that ``smoothness="auto"`` tries, weakest first."""

_SEGMENTS = 25
_HELD_OUT_EVERY = 5
_PATIENCE = 2
_ROUNDING = 1e-11
_FLOOR = 1e-300
_LARGE = 2500


@dataclass(frozen=True, eq=False)
class Fit:
    """Unknowns of a fitted form, how optimal they are, and the smoothness that was used."""

    x: FloatArray
    kkt: float
    smoothness: float


@dataclass(frozen=True, eq=False)
class Problem:
    """Outputs to be fitted: ``areas`` of M samples, ``y`` (M,), and which signs are free.

    ``signed`` lets weights and slope be negative.
    """

    areas: Areas
    y: FloatArray
    signed: bool = False

    def fit(self, smoothness: float | Literal["auto"]) -> Fit:
        """Fit with a given smoothness, or with the one that predicts held-out segments best."""
        if smoothness == "auto":
            return self._fit_chosen()
        return _System(self, np.ones(self.y.size)).solve(_as_strength(smoothness))

    def coarser(self) -> Problem:
        """The same samples with every other threshold."""
        return Problem(self.areas.coarser(), self.y, self.signed)

    def _fit_chosen(self) -> Fit:
        """Hold out contiguous segments, try strengths from weak to strong, then fit it all.

        The search ends once two strengths in a row predict worse than the best: weak ones are
        cheap, as most weights are then at zero. Data that a determined plane reproduces to
        rounding have no noise to smooth away. What is best hardly depends on how finely the
        plane is cut, so that large problems take it from coarser ones.
        """
        whole = _System(self, np.ones(self.y.size))
        if self.areas.form.cells > _LARGE:
            return whole.solve(self.coarser().fit("auto").smoothness)
        plain = whole.solve(0.0)
        held = held_out_segments(self.y.size)
        if reproduces(self.areas, plain.x, self.y) or not held.any():
            return plain
        part = _System(self, np.where(held, 0.0, 1.0))
        best, least, since, guess = 0.0, np.inf, 0, plain.x
        for strength in CANDIDATES:
            guess = part.solve(strength, guess).x
            error = float(np.mean((self.areas.forward(guess) - self.y)[held] ** 2))
            if error < least:
                best, least, since = strength, error, 0
            else:
                since += 1
            if since == _PATIENCE:
                break
        return whole.solve(best, guess) if best else plain


def reproduces(areas: Areas, x: FloatArray, y: FloatArray) -> bool:
    """Whether samples determine the unknowns, and these give the samples back to rounding."""
    left = np.abs(areas.forward(x) - y).max()
    return bool(y.size >= areas.form.unknowns and left <= _ROUNDING * (float(np.ptp(y)) or 1.0))


def held_out_segments(samples: int) -> BoolArray:
    """(M,) the middle one of every five of 25 contiguous segments."""
    segment = np.arange(samples) * _SEGMENTS // max(samples, 1)
    return np.asarray(segment % _HELD_OUT_EVERY == _HELD_OUT_EVERY // 2)


class _System:
    """Scaled normal equations of a problem with weighted samples."""

    def __init__(self, problem: Problem, weight: FloatArray) -> None:
        self.problem, self.weight = problem, weight
        form = problem.areas.form
        used = problem.y[weight > 0]
        self.shift = float(used.mean()) if form.offset else 0.0
        self.unit = float(np.ptp(used)) or float(np.abs(used).max(initial=0.0)) or 1.0
        self.y = (problem.y - self.shift) / self.unit
        self.gram = problem.areas.gram(weight)
        squares = self.gram.diagonal().copy()
        self.scale = 1.0 / np.sqrt(np.where(squares > _FLOOR, squares, 1.0))
        _kernels.scale_lower(self.gram, self.scale)
        self.bounded = np.full(form.unknowns, not problem.signed)
        if form.offset:
            self.bounded[form.cells] = False

    def solve(self, strength: float, guess: FloatArray | None = None) -> Fit:
        """Fit with a smoothness, beginning at a guess of the unknowns where there is one."""
        areas, form = self.problem.areas, self.problem.areas.form
        if guess is None and form.cells > _LARGE:
            guess = self._coarse_guess(strength)
        rows, columns, values = neighbour_penalty(form)
        values = values * (strength * self.weight.sum() * form.bands**2)
        values = values * (self.scale[rows] * self.scale[columns])
        penalty = active_set.Sparse(rows, columns, values)

        def hessian(z: FloatArray) -> FloatArray:
            h = self.scale * areas.adjoint(areas.forward(self.scale * z) * self.weight)
            if strength:
                _kernels.multiply_symmetric(rows, columns, values, z, h)
            return h

        def gradient(z: FloatArray) -> FloatArray:
            residual = (areas.forward(self.scale * z) - self.y) * self.weight
            g = self.scale * areas.adjoint(residual)
            if strength:
                _kernels.multiply_symmetric(rows, columns, values, z, g)
            return g

        solution = active_set.solve(
            self.gram,
            gradient,
            hessian,
            self.bounded,
            float(np.linalg.norm(self.y * np.sqrt(self.weight))) or 1.0,
            penalty=penalty if strength else None,
            guess=None if guess is None else self._scaled(guess),
        )
        return Fit(self._unscaled(solution.z), solution.kkt, strength)

    def _coarse_guess(self, strength: float) -> FloatArray:
        """Solve on every other threshold, and share each weight among the cells it covers."""
        problem = self.problem.coarser()
        coarse = _System(problem, self.weight).solve(strength)
        form, wide = self.problem.areas.form, problem.areas.form
        within = np.searchsorted(wide.levels, form.levels[:-1], side="right") - 1
        inside = np.ix_(within, within)
        covering = np.tril(cell_areas(wide.levels)[inside])
        share = cell_areas(form.levels) / np.where(covering > 0, covering, 1.0)
        fine = unpack(coarse.x[: wide.cells])[inside] * share
        return np.concatenate([pack(fine), coarse.x[wide.cells :]])

    def _unscaled(self, z: FloatArray) -> FloatArray:
        form = self.problem.areas.form
        x = z * self.scale * self.unit
        if form.offset:
            x[form.cells] += self.shift
        return x

    def _scaled(self, x: FloatArray) -> FloatArray:
        form = self.problem.areas.form
        z = x.copy()
        if form.offset:
            z[form.cells] -= self.shift
        return z / (self.scale * self.unit)


def neighbour_penalty(form: Form) -> tuple[IntArray, IntArray, FloatArray]:
    """Lower triangle of the matrix of the roughness: rows, columns, values."""
    bands = form.bands
    i, j = np.tril_indices(bands)
    number = np.full((bands, bands), -1)
    number[i, j] = np.arange(i.size)
    area = np.where(i == j, 0.5, 1.0)
    up = number[i[i + 1 < bands] + 1, j[i + 1 < bands]], number[i, j][i + 1 < bands]
    right = number[i[j < i], j[j < i] + 1], number[i, j][j < i]
    first = np.concatenate([up[0], right[0]])
    second = np.concatenate([up[1], right[1]])
    low, high = np.minimum(first, second), np.maximum(first, second)
    rows = np.concatenate([low, high, high])
    columns = np.concatenate([low, high, low])
    values = np.concatenate(
        [1 / area[low] ** 2, 1 / area[high] ** 2, -1 / (area[low] * area[high])]
    )
    return rows, columns, values


def _as_strength(smoothness: float) -> float:
    number = isinstance(smoothness, float | int | np.floating | np.integer)
    if not number or isinstance(smoothness, bool) or not 0 <= smoothness < np.inf:
        raise ParameterError(
            f'smoothness is {smoothness!r}; give "auto", 0.0 for none, or a positive strength'
        )
    return float(smoothness)
