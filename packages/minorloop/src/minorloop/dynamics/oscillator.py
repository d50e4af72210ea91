"""A mass on a spring with hysteresis: the operator is in the restoring force.

In a cascade the operator and the dynamics follow each other; here the displacement that the
operator receives is the result of the force that it gives. So it damps vibrations, and makes the
resonance depend on the amplitude.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_waveform, as_whole, frozen
from minorloop.dynamics import _newmark_kernels, _oscillator_kernels
from minorloop.dynamics.sampling import (
    Interpolation,
    Stage,
    checked_stages,
    decimated,
    even_interval,
    pulses,
)
from minorloop.errors import ParameterError, SignalError
from minorloop.operators.differential import Differential
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

_MOST_TURNS = 50
"""Periods after which a response counts as settled anyway."""
_SETTLED = 1e-9
"""Relative change of the state from period to period of a response that has settled."""


@dataclass(frozen=True, eq=False)
class Oscillator:
    """``mass y'' + damping y' + stiffness y + z = u``, where z is hysteretic.

    Raises
    ------
    ParameterError
        If a number is not finite, the mass is not positive, or the operator is another one.

    References
    ----------
    Noel and Schoukens, Hysteretic benchmark with a dynamic nonlinearity, Workshop on Nonlinear
    System Identification Benchmarks, 2016. Newmark, A method of computation for structural
    dynamics, ASCE J. Engineering Mechanics 85 (1959) 67.
    """

    mass: float
    """In kg, positive."""
    damping: float
    """In N s/m."""
    stiffness: FloatArray
    """In N/m; or, of shape (n,), the coefficients of y, y^2, ... in the restoring force."""
    operator: Any
    """Hysteretic force in N as a function of the displacement in m, relaxed at rest: a `BoucWen`,
    `Duhem` or `PrandtlIshlinskii`."""

    def __post_init__(self) -> None:
        for name in ("mass", "damping"):
            object.__setattr__(self, name, as_finite(name, getattr(self, name)))
        if self.mass <= 0:
            raise ParameterError(f"mass is {self.mass:g} kg; give a positive number")
        spring = frozen(np.atleast_1d(np.asarray(self.stiffness, dtype=np.float64)))
        if spring.ndim != 1 or not spring.size or not np.isfinite(spring).all():
            raise ParameterError(
                f"stiffness is {self.stiffness!r}; give a finite number, or the coefficients of "
                "y, y^2, ..."
            )
        object.__setattr__(self, "stiffness", spring)
        if not isinstance(self.operator, Differential | PrandtlIshlinskii):
            raise ParameterError(
                f"operator is a {type(self.operator).__name__}; give a BoucWen, Duhem or "
                "PrandtlIshlinskii"
            )

    def simulate(
        self,
        t: npt.ArrayLike,
        u: npt.ArrayLike,
        *,
        between: Interpolation = "band",
        substeps: int = 8,
        periodic: bool = False,
        stages: tuple[Stage, ...] = (),
    ) -> FloatArray:
        """Return the displacements (T,) in m for forces (T,) in N at even times (T,) in seconds.

        For operators of differential type the method is that of Runge and Kutta, with a step that
        ends at every corner of the law, for plays that of Newmark.

        Parameters
        ----------
        between : {"band", "straight", "held"}
            Force between samples: without content above half the sampling rate, linear, or each
            sample held over the interval before it.
        substeps : int
            Steps of the integration in an interval.
        periodic : bool
            Whether the force repeats after the record; then the response is the one that has
            settled, after as many turns as that needs. Otherwise the oscillator is at rest first.
        stages : sequence of (int, array)
            Filters of a converter that samples ``substeps`` times as fast and decimates: factor and
            symmetric taps of each. None if the displacement is sampled directly.

        Raises
        ------
        SignalError
            If the times are not even, or the oscillator is unstable with this force.
        ParameterError
            If an option is out of its range.
        """
        times, forces = as_waveform(t, u)
        interval = even_interval(times)
        count = as_whole("substeps", substeps, 1)
        filters = checked_stages(stages, count)
        force = pulses(forces, count, between, periodic=periodic)
        y = self._response(force, interval / count, periodic)
        if y is None:
            raise SignalError(
                "the displacement grows without bound for this force; check the units, make the "
                "damping or the stiffness larger, or give more substeps"
            )
        shown = y[:-1] if periodic else y
        if filters:
            return decimated(shown, filters, periodic=periodic)
        return np.ascontiguousarray(shown[::count])

    @property
    def plant(self) -> tuple[float, float, FloatArray, FloatArray, FloatArray]:
        """Mass, damping, spring, levels and values, as the compiled loops take them."""
        return self.mass, self.damping, self.stiffness, *self.operator.law

    def _response(self, force: FloatArray, step: float, periodic: bool) -> FloatArray | None:
        """Return the displacement after each step, (K + 1,); None where it is not finite."""
        motion = Motion(self)
        y, none = np.empty(len(force) + 1), np.empty((len(force) + 1, 0))
        for _ in range(_MOST_TURNS if periodic else 1):
            before = motion.state.copy()
            if not motion.run(force, step, y, none):
                return None
            if np.allclose(motion.state, before, rtol=_SETTLED, atol=0.0):
                break
        return y


class Motion:
    """The state of an oscillator at rest, and its derivatives, which steps update.

    Parameters
    ----------
    model : Oscillator
        The oscillator.
    gradient : bool
        Whether derivatives with respect to the parameters are wanted: mass, damping, springs, and
        those of the operator.
    """

    def __init__(self, model: Oscillator, *, gradient: bool = False) -> None:
        self.model, operator = model, model.operator
        self._differential = isinstance(operator, Differential)
        law = operator.law[1] if self._differential else operator.weights
        parameters = 2 + model.stiffness.size + law.size if gradient else 0
        self.state, self.slopes = np.zeros(3), np.zeros((3, parameters))
        self._plays: Any = None

    def run(self, force: FloatArray, step: float, y_out: FloatArray, gradient: FloatArray) -> bool:
        """Continue with a force (K, 3), and return whether the displacements are finite.

        Parameters
        ----------
        force : (K, 3) array
            From `sampling.pulses`.
        step : float
            Seconds of a step.
        y_out : (K + 1,) array
            Receives the displacements.
        gradient : (K + 1, P) array
            Receives their derivatives.
        """
        model, state = self.model, (self.state, self.slopes, y_out, gradient)
        if self._differential:
            return bool(_oscillator_kernels.respond(force, step, model.plant, *state))
        if self._plays is None:
            self._begin(float(force[0, 0]))
        plant = model.mass, model.damping, model.stiffness
        return bool(_newmark_kernels.march(force, step, *plant, self._plays, *state))

    def _begin(self, force: float) -> None:
        """Set the positions and the acceleration at rest, and its derivative to the mass."""
        operator = self.model.operator
        n = operator.radii.size
        memory = np.zeros(n), np.zeros((n, self.slopes.shape[1]))
        self._plays = (operator.radii, operator.weights, operator.offset, *memory)
        self.state[2] = (force - operator.offset) / self.model.mass
        if self.slopes.size:
            self.slopes[2, 0] = -self.state[2] / self.model.mass
