"""The Prandtl-Ishlinskii operator: weighted plays, with an analytic inverse.

Its loops are symmetric and do not saturate; loops of `GeneralisedPrandtlIshlinskii` may be
asymmetric and saturate.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import ByValue, FloatArray, Samples, as_finite, check_option, frozen
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.figures import Drawn
from minorloop.operators import _play_kernels
from minorloop.operators._parallel import filled
from minorloop.operators.inversion import (
    Inversion,
    Unreachable,
    as_signal,
    check_unreachable_option,
)
from minorloop.operators.tracker import StepTracker

PlayStart: TypeAlias = "npt.ArrayLike | Literal['negative', 'positive', 'demagnetised']"
"""Positions of the plays before the first sample, or the name of a start state."""


@dataclass(frozen=True, eq=False)
class PrandtlIshlinskii(ByValue, Drawn):
    """A weighted sum of plays: ``y = offset + sum of weights[i] * play(radii[i])[u]``.

    A play of radius r follows its input with a slack of r on either side. A play of radius zero
    equals the input, so ``weights[0]`` with ``radii[0] == 0`` is the linear term.

    A start state is one of

    - an (n,) array of play positions in the unit of the input,
    - ``"negative"`` or ``"positive"``: the input came from far below, or from far above,
    - ``"demagnetised"`` or ``"relaxed"``: every play at zero.

    Raises a `ParameterError` if there is no play, radii do not increase or are negative, lengths
    differ, or a number is not finite.

    References
    ----------
    Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, chapter 2: plays.
    Krejci and Kuhnen, IEE Proc. Control Theory and Applications 148 (2001) 185: the inverse.

    Examples
    --------
    >>> plays = ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5])
    >>> plays.simulate([1.0, 0.5], "demagnetised").round(2).tolist()
    [1.4, 0.85]
    """

    radii: FloatArray
    """Shape (n,). Slack of each play in the unit of the input; >= 0, strictly increasing."""
    weights: FloatArray
    """Shape (n,). Weights of any sign, in the unit of the output over that of the input."""
    offset: float = 0.0
    """Offset of the output."""

    def __post_init__(self) -> None:
        radii, weights = as_paired(self.radii, self.weights, name="radii")
        if radii[0] < 0:
            raise ParameterError(f"radii[0] is {radii[0]:g}; a slack is zero or more")
        object.__setattr__(self, "radii", radii)
        object.__setattr__(self, "weights", weights)
        object.__setattr__(self, "offset", as_finite("offset", self.offset))

    def __repr__(self) -> str:
        return (
            f"PrandtlIshlinskii({self.radii.size} plays, radii up to {self.radii[-1]:g}, "
            f"slope {self.slopes[0]:g} to {self.slopes[-1]:g}, offset={self.offset:g})"
        )

    @cached_property
    def slopes(self) -> FloatArray:
        """(n,) cumulative sums of the weights: slopes while the plays up to play i move."""
        return frozen(np.cumsum(self.weights))

    @property
    def invertible(self) -> bool:
        """Whether there is a linear term and all cumulative sums of the weights are positive."""
        return bool(self.radii[0] == 0 and (self.slopes > 0).all())

    @property
    def range(self) -> tuple[float, float]:
        """Infinite in both directions, because plays do not saturate."""
        return -np.inf, np.inf

    def positions(self, start: PlayStart) -> FloatArray:
        """Return the (n,) play positions of a start state; infinite for both saturations.

        Raises a `ParameterError` if the name is unknown, or no input leads to these positions:
        neighbours differ by at most the difference of their radii.

        Parameters
        ----------
        start : {"negative", "positive", "demagnetised"} or (n,) array_like
            Positions of the plays before the first input, or a state by name.
        """
        if isinstance(start, str):
            names = ("negative", "positive", "demagnetised", "relaxed")
            check_option("start", start, names)
            value = {"negative": -np.inf, "positive": np.inf}.get(start, 0.0)
            return np.full(self.radii.size, value)
        try:
            positions = np.array(start, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ParameterError(f"start is not an array of numbers: {error}") from None
        if positions.shape != self.radii.shape:
            raise ParameterError(
                f"start has shape {positions.shape}; give {self.radii.size} play positions"
            )
        if not (np.isneginf(positions).all() or np.isposinf(positions).all()):
            self._check_consistent(positions)
        return positions

    def simulate(self, u: npt.ArrayLike, start: PlayStart = "negative") -> Samples:
        """Return the outputs for input signals, as `Operator.simulate`."""
        before = self.positions(start)

        def run(u: FloatArray, y: FloatArray) -> None:
            _play_kernels.simulate(u, self.radii, self.slopes, self.offset, before.copy(), y)

        return filled(u, run)

    def invert(
        self,
        targets: npt.ArrayLike,
        start: PlayStart = "negative",
        unreachable: Unreachable = "raise",
    ) -> Inversion:
        """Return inputs that bring the output to each target in turn, branch by branch.

        The inputs are those of the analytic inverse, which also consists of plays. Residuals are
        rounding errors even if the slopes of the operator differ by many orders of magnitude. Plays
        reach every target. There is no inverse without a linear term, or if a cumulative sum of the
        weights is not positive.
        """
        check_unreachable_option(unreachable)
        wanted = as_signal(targets, name="targets")
        self._require_invertible()
        u, positions = np.empty_like(wanted), self.positions(start)
        _play_kernels.invert(wanted, self.radii, self.slopes, self.offset, positions, u)
        y = self.simulate(u, start)
        return Inversion(u, y, y - wanted, np.ones(wanted.shape, dtype=np.bool_))

    def trace(self, u: npt.ArrayLike, start: PlayStart = "negative") -> FloatArray:
        """Return the positions (T, n) of the plays, in the unit of the input, along one signal.

        They do not depend on the weights. Parameters and errors are as of `simulate`.
        """
        inputs = as_signal(u, name="u")
        out = np.empty((inputs.size, self.radii.size))
        _play_kernels.trace(inputs, self.radii, self.positions(start), out)
        return out

    def step(self, memory: PlayStart, u: float) -> tuple[float, FloatArray]:
        """Return output and (n,) play positions after one input, as `Operator.step`."""
        sample, y = np.array([as_finite("u", u)]), np.empty(1)
        after = self.positions(memory)
        _play_kernels.simulate(sample, self.radii, self.slopes, self.offset, after, y)
        return float(y[0]), frozen(after)

    def aim(self, memory: PlayStart, y: float, unreachable: Unreachable = "raise") -> float:
        """Return the input that brings the output to y from a start state, as `Operator.aim`."""
        return float(self.invert([as_finite("target", y)], memory, unreachable).u[0])

    def track(self, start: PlayStart = "negative") -> StepTracker[PlayStart]:
        """Return a tracker that follows a live input sample by sample."""
        return StepTracker(self, self.positions(start))

    def _check_consistent(self, positions: FloatArray) -> None:
        if not np.isfinite(positions).all():
            index = int(np.argmin(np.isfinite(positions)))
            raise ParameterError(f"start[{index}] is {positions[index]}; all must be finite")
        # Positions may be inconsistent by this share of the largest position: rounding
        slack = 1e-12 * (np.abs(positions).max() + self.radii[-1])
        apart = np.abs(np.diff(positions)) - np.diff(self.radii)
        if (apart > slack).any():
            i = int(np.argmax(apart > slack))
            raise ParameterError(
                f"play positions {positions[i]:g} and {positions[i + 1]:g} (start[{i}] and "
                f"start[{i + 1}]) lie further apart than their radii, {self.radii[i]:g} and "
                f"{self.radii[i + 1]:g}; no input leads to such positions"
            )

    def _require_invertible(self) -> None:
        if self.invertible:
            return
        if self.radii[0] != 0:
            raise NotInvertibleError(
                f"the smallest radius is {self.radii[0]:g}, so the output does not move after a "
                "reversal; add a play of radius 0 with a positive weight"
            )
        index = int(np.argmax(self.slopes <= 0))
        raise NotInvertibleError(
            f"the weights up to index {index} add up to {self.slopes[index]:g}; there is an "
            "inverse only if every cumulative sum is positive"
        )


def as_paired(
    places: npt.ArrayLike, weights: npt.ArrayLike, *, name: str
) -> tuple[FloatArray, FloatArray]:
    """Return strictly increasing places and their weights, both read-only.

    Raises a `ParameterError` if there are no places, they do not increase, lengths differ, or a
    number is not finite.
    """
    try:
        first, second = frozen(places), frozen(weights)
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} or weights are not numbers: {error}") from None
    if first.ndim != 1 or first.size == 0 or first.shape != second.shape:
        raise ParameterError(
            f"{name} have shape {first.shape} and weights {second.shape}; give as many weights "
            f"as {name}, at least one, in one dimension"
        )
    for label, values in ((name, first), ("weights", second)):
        if not np.isfinite(values).all():
            index = int(np.argmin(np.isfinite(values)))
            raise ParameterError(f"{label}[{index}] is {values[index]}; all must be finite")
    if not (np.diff(first) > 0).all():
        index = int(np.argmin(np.diff(first) > 0))
        raise ParameterError(
            f"{name} are not strictly increasing: {first[index]:g} at index {index} is followed "
            f"by {first[index + 1]:g}"
        )
    return first, second
