"""The generalised Prandtl-Ishlinskii operator: plays and dead zones, for loops that saturate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import ByValue, FloatArray, Samples, as_finite, frozen
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.figures import Drawn
from minorloop.operators._play_fit import as_record, choose_knots, choose_radii, fit_bent_plays
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.prandtl_ishlinskii import PlayStart, PrandtlIshlinskii, as_paired
from minorloop.operators.tracker import StepTracker


@dataclass(frozen=True, eq=False)
class DeadZones(ByValue):
    """A weighted sum of one-sided dead zones: piecewise linear, monotone, through the origin.

    After symmetric plays, it makes their loops saturating and asymmetric.

    ``S(x) = sum of weights[k] * d_k(x)``, where ``d_k(x)`` is ``max(x - s, 0)`` for a threshold
    s > 0, ``min(x - s, 0)`` for s < 0, and ``x`` for s = 0.

    Raises a `ParameterError` if there is no threshold, they do not increase, lengths differ, or a
    number is not finite.

    References
    ----------
    Kuhnen, European Journal of Control 9 (2003) 407: superposition operators.
    """

    thresholds: FloatArray
    """Shape (K,). Strictly increasing, in the unit of x; threshold zero is the linear term."""
    weights: FloatArray
    """Shape (K,). Change of slope at each threshold, away from the origin; for threshold zero the
    slope at the origin."""

    def __post_init__(self) -> None:
        thresholds, weights = as_paired(self.thresholds, self.weights, name="thresholds")
        object.__setattr__(self, "thresholds", thresholds)
        object.__setattr__(self, "weights", weights)

    @classmethod
    def from_slopes(cls, knots: npt.ArrayLike, slopes: npt.ArrayLike) -> DeadZones:
        """Return dead zones from the slope of each piece.

        Raises a `ParameterError` if a knot is zero or the lengths differ.

        ``knots`` (K,): points where the slope changes, strictly increasing, not zero; may be empty;
        ``slopes`` (K + 1,): slope of each piece, from left to right.
        """
        knots, slopes = np.asarray(knots, dtype=np.float64), np.asarray(slopes, dtype=np.float64)
        if knots.ndim != 1 or slopes.shape != (knots.size + 1,):
            raise ParameterError(
                f"slopes have shape {slopes.shape}; {knots.size} knots need ({knots.size + 1},)"
            )
        if (knots == 0).any():
            raise ParameterError("a knot is zero; the piece through the origin must be straight")
        centre = int(np.count_nonzero(knots < 0))
        below = slopes[:centre] - slopes[1 : centre + 1]
        above = np.diff(slopes[centre:])
        thresholds = np.insert(knots, centre, 0.0)
        return cls(thresholds, np.concatenate([below, slopes[centre : centre + 1], above]))

    @cached_property
    def knots(self) -> FloatArray:
        """Points where the slope changes: the thresholds without zero."""
        return frozen(self.thresholds[self.thresholds != 0])

    @cached_property
    def slopes(self) -> FloatArray:
        """Slope of each piece; there is one piece more than knots."""
        negative, positive = self.thresholds < 0, self.thresholds > 0
        straight = self.weights[~(negative | positive)].sum()
        below = straight + np.cumsum(self.weights[negative][::-1])[::-1]
        above = straight + np.cumsum(self.weights[positive])
        return frozen(np.concatenate([below, [straight], above]))

    @property
    def invertible(self) -> bool:
        """Whether every piece rises."""
        return bool((self.slopes > 0).all())

    def __call__(self, x: npt.ArrayLike) -> FloatArray:
        """Return the values of the curve at x, of any shape."""
        return _follow(np.asarray(x, dtype=np.float64), self.knots, self.slopes, self.heights)

    def invert(self, y: npt.ArrayLike) -> FloatArray:
        """Return the x at which the curve has the values y, of any shape.

        Raises a `NotInvertibleError` if a piece does not rise.
        """
        if not self.invertible:
            piece = int(np.argmin(self.slopes))
            raise NotInvertibleError(
                f"piece {piece} of the dead zones has slope {self.slopes[piece]:g}; give weights "
                "whose cumulative sums from zero outwards are all positive"
            )
        return _follow(np.asarray(y, dtype=np.float64), self.heights, 1 / self.slopes, self.knots)

    @cached_property
    def heights(self) -> FloatArray:
        """Value of the curve at each knot."""
        centre = int(np.count_nonzero(self.knots < 0))
        corners = np.insert(self.knots, centre, 0.0)
        pieces = np.concatenate([self.slopes[1 : centre + 1], self.slopes[centre:-1]])
        rises = np.diff(corners) * pieces
        heights = np.concatenate(
            [-np.cumsum(rises[:centre][::-1])[::-1], np.cumsum(rises[centre:])]
        )
        return frozen(heights)


@dataclass(frozen=True, eq=False)
class GeneralisedPrandtlIshlinskii(ByValue, Drawn):
    """Plays followed by dead zones, ``y = offset + S(H[u])``, for asymmetric, saturating loops.

    H is a `PrandtlIshlinskii` operator and S a curve of `DeadZones`. Memory and start states are
    those of H.

    Raises a `ParameterError` if the offset is not finite, or plays or zones are of another class.

    References
    ----------
    Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a
    modified Prandtl-Ishlinskii approach, European Journal of Control 9 (2003) 407.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 12.0, 200))
    >>> found = ml.GeneralisedPrandtlIshlinskii.fit(u, np.tanh(2 * u))
    >>> found.invertible
    True
    """

    plays: PrandtlIshlinskii
    """The operator H; its offset shifts the loop along the curve S."""
    zones: DeadZones
    """The curve S."""
    offset: float = 0.0
    """Offset of the output."""

    def __post_init__(self) -> None:
        if not isinstance(self.plays, PrandtlIshlinskii):
            raise ParameterError(f"plays is {self.plays!r}; give a PrandtlIshlinskii")
        if not isinstance(self.zones, DeadZones):
            raise ParameterError(f"zones is {self.zones!r}; give DeadZones")
        object.__setattr__(self, "offset", as_finite("offset", self.offset))

    @classmethod
    def fit(
        cls,
        u: npt.ArrayLike,
        y: npt.ArrayLike,
        *,
        radii: npt.ArrayLike = 12,
        thresholds: npt.ArrayLike = 8,
        start: PlayStart = "negative",
    ) -> GeneralisedPrandtlIshlinskii:
        """Fit the operator to a record, by bounded least squares from plays without dead zones.

        S has slope 1 at its origin, so H is in the unit of the output. The result always has an
        inverse: the slope after a reversal is at least 1e-4 times the range of the output over that
        of the input.

        Raises a `SignalError` if the record is too short, its input or output constant, or its
        lengths differ; a `ParameterError` if radii or thresholds are out of range.

        Parameters
        ----------
        u : (T,) array_like
            Inputs.
        y : (T,) array_like
            Outputs; NaN if not measured.
        radii : int or (n,) array_like
            Radii, of which the first is zero, or their number: they are then evenly spaced from
            zero to just below half the range of the input.
        thresholds : int or (K,) array_like
            Outputs at which the slope of S changes, strictly increasing, or their number: they are
            then spread over the range of the outputs, denser towards its ends. With 0, S is
            straight, and ``plays`` alone describe the record.
        start : start state
            State before the first sample.
        """
        inputs, outputs = as_record(u, y)
        places = choose_radii(inputs, radii)
        knots = choose_knots(outputs, thresholds)
        positions = PrandtlIshlinskii(places, np.zeros(places.shape)).trace(inputs, start)
        bent = fit_bent_plays(inputs, outputs, positions, knots)
        plays = PrandtlIshlinskii(places, bent.weights, bent.shift)
        return cls(plays, DeadZones.from_slopes(bent.knots, bent.slopes), bent.centre)

    @property
    def invertible(self) -> bool:
        """Whether plays and dead zones both have an inverse."""
        return self.plays.invertible and self.zones.invertible

    @property
    def range(self) -> tuple[float, float]:
        """Infinite in both directions, because the outer pieces of the curve have no end."""
        return -np.inf, np.inf

    def positions(self, start: PlayStart) -> FloatArray:
        """Return the (n,) play positions of a start state, as of `PrandtlIshlinskii.positions`."""
        return self.plays.positions(start)

    def simulate(self, u: npt.ArrayLike, start: PlayStart = "negative") -> Samples:
        """Return the outputs for input signals, as `Operator.simulate`."""
        return self.offset + self.zones(self.plays.simulate(u, start))

    def invert(
        self,
        targets: npt.ArrayLike,
        start: PlayStart = "negative",
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Return inputs that bring the output to each target in turn, by the analytic inverses.

        There is none if plays or dead zones have no inverse.
        """
        wanted = as_signal(targets, name="targets")
        inner = self.plays.invert(self.zones.invert(wanted - self.offset), start, unreachable)
        y = self.simulate(inner.u, start)
        return Inversion(inner.u, y, y - wanted, inner.reachable)

    def step(self, memory: PlayStart, u: float) -> tuple[float, FloatArray]:
        """Return output and play positions after one input, as `Operator.step`."""
        inner, after = self.plays.step(memory, u)
        return self.offset + float(self.zones(inner)), after

    def aim(self, memory: PlayStart, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y from a start state, as `Operator.aim`."""
        inner = self.zones.invert(as_finite("target", y) - self.offset)
        return self.plays.aim(memory, float(inner), unreachable)

    def track(self, start: PlayStart = "negative") -> StepTracker[PlayStart]:
        """Return a tracker that follows a live input sample by sample."""
        return StepTracker(self, self.positions(start))


def _follow(
    x: FloatArray, knots: FloatArray, slopes: FloatArray, heights: FloatArray
) -> FloatArray:
    """Return the values at x of the piecewise linear curve through the origin and the knots."""
    centre = int(np.count_nonzero(knots < 0))
    # Each piece begins at its corner nearer to the origin, where rounding errors are smallest.
    corner_x = np.insert(knots, centre, 0.0)
    corner_y = np.insert(heights, centre, 0.0)
    piece = np.searchsorted(knots, x)
    return np.asarray(corner_y[piece] + slopes[piece] * (x - corner_x[piece]))
