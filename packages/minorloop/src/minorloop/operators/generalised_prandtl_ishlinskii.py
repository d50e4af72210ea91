"""The generalised Prandtl-Ishlinskii operator: plays and dead zones, for loops that saturate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import (
    ByValue,
    FloatArray,
    Samples,
    as_finite,
)
from minorloop.errors import ParameterError
from minorloop.figures import Drawn
from minorloop.operators._play_fit import as_record, choose_knots, choose_radii, fit_bent_plays
from minorloop.operators.dead_zones import DeadZones
from minorloop.operators.inversion import Inversion, Unreachable, as_signal
from minorloop.operators.prandtl_ishlinskii import PlayStart, PrandtlIshlinskii
from minorloop.operators.tracker import StepTracker


@dataclass(frozen=True, eq=False)
class GeneralisedPrandtlIshlinskii(ByValue, Drawn):
    """Plays followed by dead zones, ``y = offset + S(H[u])``, for asymmetric, saturating loops.

    H is a `PrandtlIshlinskii` operator and S a curve of `DeadZones`. Memory and start states are
    those of H.

    Raises
    ------
    ParameterError
        If the offset is not finite, or plays or zones are of another class.

    References
    ----------
    Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a
    modified Prandtl-Ishlinskii approach, European Journal of Control 9 (2003) 407.
    """

    plays: PrandtlIshlinskii
    """H; its offset shifts the loop along the curve S."""
    zones: DeadZones
    """S."""
    offset: float = 0.0
    """Added to the output."""

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
        signed: bool = False,
    ) -> GeneralisedPrandtlIshlinskii:
        """Fit the operator to a record, first by a linear problem, then by a nonlinear one.

        The linear problem fits H of the inputs to the inverse of S of the outputs. From its
        solution, and from plays without dead zones, bounded least squares fits the output; the
        better of both results is returned. S has slope 1 at its origin, so H is in the unit of the
        output. Other parameters and errors are as of `PrandtlIshlinskii.fit`.

        Parameters
        ----------
        thresholds : int or (K,) array_like
            Outputs at which the slope of S changes, strictly increasing, or their number: spread
            over the range of the outputs, denser towards its ends.

        Raises
        ------
        ParameterError
            Also if the thresholds are out of range.
        """
        inputs, outputs = as_record(u, y)
        places = choose_radii(inputs, radii)
        knots = choose_knots(outputs, thresholds)
        positions = PrandtlIshlinskii(places, np.zeros(places.shape)).trace(inputs, start)
        bent = fit_bent_plays(inputs, outputs, positions, knots, signed=signed)
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
