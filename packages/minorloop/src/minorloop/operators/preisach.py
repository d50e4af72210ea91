"""The Preisach operator with piecewise uniform density, and its exact right inverse."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Levels,
    Samples,
    as_finite,
    as_levels,
    as_triangle,
    check_option,
    frozen,
)
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.figures import Drawn
from minorloop.operators import _kernels, plane
from minorloop.operators._parallel import filled
from minorloop.operators.inversion import Inversion, Unreachable, as_targets
from minorloop.operators.memory import Memory, Start
from minorloop.operators.plane import RELAYS, Relay
from minorloop.operators.tracker import Tracker

Diagonal: TypeAlias = Literal["uniform", "reversible"]

_LARGEST = 1e300
"""Largest sum of the terms of an output: sums and differences of outputs do not overflow (1.8e308).
"""


@dataclass(frozen=True, eq=False)
class Preisach(ByValue, Drawn):
    """A weighted continuum of relays; the output depends on remembered extrema of the input.

    Raises a `ParameterError` if levels do not increase, shapes disagree, or a number is not finite.

    References
    ----------
    Mayergoyz, Mathematical Models of Hysteresis, 1991, chapter 1: geometry, Everett values.
    Tan, Venkataraman and Krishnaprasad, Proc. IEEE CDC 2001: inverse for a piecewise uniform
    density.

    Examples
    --------
    >>> model = ml.Preisach([-1.0, 0.0, 1.0], [[1.0, 0.0], [0.5, 1.0]])
    >>> model.simulate([1.0, 0.5, -1.0])
    array([ 2.5,  2. , -2.5])
    >>> model.invert([0.0, 1.0]).u
    array([0.30901699, 0.65138782])
    """

    levels: Levels
    """Shape (L + 1,). Thresholds in the unit of the input, strictly increasing, not necessarily
    even."""
    weights: FloatArray
    """Shape (L, L). ``weights[i, j]``, j <= i: integral of the density over the cell alpha in
    [levels[i], levels[i + 1]], beta in [levels[j], levels[j + 1]], in the unit of the output. Zero
    above the diagonal. Negative weights are legal."""
    offset: float = 0.0
    """Offset of the output."""
    relay: Relay = "bipolar"
    """Whether the output of a relay is -1 or +1, bipolar, or 0 or 1, unipolar."""
    diagonal: Diagonal = "uniform"
    """Whether the weight of a diagonal cell is spread evenly over its triangle, uniform, or lies on
    the line alpha = beta, reversible."""
    slope: float = 0.0
    """Slope of a memoryless linear part, output per input. Inputs beyond the levels are clamped for
    the relays, but not for this part."""

    def __post_init__(self) -> None:
        store = object.__setattr__
        store(self, "levels", as_levels(self.levels))
        store(self, "weights", as_triangle(self.weights, self.bands, name="weights"))
        for name in ("offset", "slope"):
            store(self, name, as_finite(name, getattr(self, name)))
        check_option("relay", self.relay, RELAYS)
        check_option("diagonal", self.diagonal, ("uniform", "reversible"))
        self._check_size()

    @classmethod
    def from_density(
        cls, levels: npt.ArrayLike, density: npt.ArrayLike | plane.Density, **options: Any
    ) -> Preisach:
        """Return the operator with a density instead of cell weights.

        Parameters
        ----------
        levels : (L + 1,) array_like
            Thresholds.
        density : (L, L) array_like or callable
            The value in each cell, or a vectorised function ``density(alpha, beta)``, which is
            integrated over each cell; unit of the output per squared unit of the input.
        **options
            ``offset``, ``relay``, ``diagonal``, ``slope`` of `Preisach`.
        """
        levels = as_levels(levels)
        if callable(density):
            return cls(levels, plane.integrate_density(levels, density), **options)
        values = as_triangle(density, levels.size - 1, name="density")
        return cls(levels, values * plane.cell_areas(levels), **options)

    def __repr__(self) -> str:
        low, high = self.levels[0], self.levels[-1]
        return (
            f"Preisach({self.bands} bands over [{low:g}, {high:g}], offset={self.offset:g}, "
            f"relay={self.relay!r}, diagonal={self.diagonal!r}, slope={self.slope:g})"
        )

    @property
    def bands(self) -> int:
        """L, the number of bands between the thresholds."""
        return int(self.levels.size - 1)

    @property
    def swing(self) -> float:
        """Output change of a relay of unit weight that switches."""
        return plane.swing(self.relay)

    @cached_property
    def range(self) -> tuple[float, float]:
        """Least and greatest output over the grid, with the slope."""
        if self.monotone:
            low, high = self.simulate(self.levels[[0, -1]])
            return float(low), float(high)
        swing = self.swing
        low, high = plane.extremes(self.levels, self.weights, self.slope, swing)
        return self.all_off + low, self.all_off + high

    @cached_property
    def monotone(self) -> bool:
        """Whether no branch of any history has a negative slope."""
        size = max(float(np.abs(self.weights).max()), abs(self.slope)) or 1.0  # avoids overflow
        weights, slope = self.weights / size, self.slope / size
        bow = self.diagonal == "uniform"
        rate = plane.slack(self.levels, weights, slope, self.swing, bow)
        steepest = np.abs(weights).sum() / np.diff(self.levels).min() + abs(slope)
        # A slope may be negative by this share of the steepest slope: rounding of sums of weights
        return bool(rate >= -1e-13 * steepest)

    def everett(self, alpha: npt.ArrayLike, beta: npt.ArrayLike) -> FloatArray:
        """Return the integral of the density over the triangle between beta and alpha.

        Raises a `ParameterError` if an alpha is below its beta.

        Parameters
        ----------
        alpha, beta : array_like
            Corners, broadcast against each other; inputs beyond the levels are clamped.

        Returns
        -------
        array
            In the unit of the output. After a reversal at beta, rising to alpha changes the output
            by this value for unipolar relays and by twice this value for bipolar relays.
        """
        pair = np.broadcast_arrays(
            np.asarray(alpha, dtype=np.float64), np.asarray(beta, dtype=np.float64)
        )
        high, low = (np.clip(x, self.levels[0], self.levels[-1]).ravel() for x in pair)
        if not (pair[0] >= pair[1]).all():
            raise ParameterError("alpha is below beta, or not a number; give alpha >= beta")
        out = np.empty(high.size)
        _kernels.everett(self.tables, high, low, out)
        return out.reshape(pair[0].shape) / self.swing

    def simulate(self, u: npt.ArrayLike, start: Start = "negative") -> Samples:
        """Return the outputs for input signals, as `Operator.simulate`."""
        memory = self.memory(start)

        def run(u: FloatArray, y: FloatArray) -> None:
            stack, rows = self.stack(memory, u.size)
            _kernels.simulate(self.tables, stack, rows, u, y)

        return filled(u, run)

    def invert(
        self, targets: npt.ArrayLike, start: Start = "negative", unreachable: Unreachable = "raise"
    ) -> Inversion:
        """Return inputs that bring the output to each target in turn, by the exact right inverse.

        Each input is the possible input inside the grid that is nearest to the previous input. For
        a target equal to the present output, the input does not change. Parameters, result and
        errors are those of `Operator.invert`.
        """
        self.require_monotone()
        wanted, reachable = as_targets(targets, *self.range, unreachable)
        stack, rows = self.stack(start, wanted.size)
        u, y = np.empty_like(wanted), np.empty_like(wanted)
        _kernels.invert(self.tables, stack, rows, wanted, u, y)
        return Inversion(u=u, y=y, residual=y - wanted, reachable=reachable)

    def step(self, memory: Start, u: float) -> tuple[float, Memory]:
        """Return output and memory after one input, as `Operator.step`."""
        tracker = self.track(memory)
        return tracker.push(u), tracker.memory

    def track(self, start: Start = "negative") -> Tracker:
        """Return a tracker that follows a live input sample by sample."""
        return Tracker(self, start)

    def memory(self, start: Start) -> Memory:
        """Return the memory of a start state as of `simulate`, within the levels of the plane."""
        low, high = float(self.levels[0]), float(self.levels[-1])
        if isinstance(start, Memory):
            if start.extrema[0] == low and max(start.extrema) <= high:
                return start
            return Memory.after(start.extrema, low=low, high=high)
        check_option("start", start, ("negative", "positive", "demagnetised"))
        if start == "negative":
            return Memory.negative(low)
        return Memory.positive(low, high) if start == "positive" else Memory.demagnetised(low, high)

    @property
    def all_off(self) -> float:
        """Output with every relay off, without the linear part."""
        return self.offset + plane.off_output(self.relay) * float(self.weights.sum())

    @cached_property
    def tables(self) -> _kernels.PlaneTables:
        """Tables for compiled loops and exports: thresholds, nodes, and the search for a band."""
        buckets, per_unit = plane.buckets(self.levels)
        nodes = self.swing * plane.nodes_from_weights(self.weights)
        diagonal = nodes.diagonal(-1).copy()
        bow = diagonal if self.diagonal == "uniform" else np.zeros(self.bands)
        return _kernels.PlaneTables(
            levels=self.levels,
            per_band=frozen(1 / np.diff(self.levels)),
            buckets=buckets,
            per_unit=per_unit,
            nodes=frozen(nodes),
            bow=frozen(bow),
            saturation=self.all_off,
            slope=self.slope,
        )

    def stack(self, start: Start, room: int) -> tuple[FloatArray, int]:
        """Return the state of the compiled loops for a start state as of `simulate`.

        Parameters
        ----------
        room : int
            Number of further reversals for which the state has room.

        Returns
        -------
        stack : (rows, 4) array
            As `minorloop.operators._kernels` describes it.
        rows : int
            Number of rows in use.
        """
        extrema = np.array(self.memory(start).extrema)
        stack = np.empty((extrema.size + room + 2, 4))
        stack[0] = self.levels[0], self.all_off, 0.0, 0.0
        return stack, _kernels.simulate(self.tables, stack, 1, extrema, np.empty_like(extrema))

    def _check_size(self) -> None:
        """Refuse outputs so large that their differences overflow."""
        steepest = abs(self.slope) / _LARGEST * float(np.abs(self.levels).max())
        share = np.abs(self.weights / _LARGEST).sum() + abs(self.offset) / _LARGEST + steepest
        if share > 1:
            raise ParameterError(f"outputs reach beyond {_LARGEST:g}; give them in a larger unit")

    def require_monotone(self) -> None:
        """Refuse a model that cannot be inverted.

        Raises a `NotInvertibleError` if it is not monotone.
        """
        if not self.monotone:
            raise NotInvertibleError(
                f"the model is not monotone (least weight {self.weights.min():g}, slope "
                f"{self.slope:g}), so some outputs belong to several inputs; identify with "
                "signed=False to get a model that can be inverted"
            )
