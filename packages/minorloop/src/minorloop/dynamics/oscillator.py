"""A mass on a spring with hysteresis: the operator is in the restoring force.

In a cascade the operator and the dynamics follow each other. Here the operator receives the
displacement and returns a force, which changes the displacement. So it damps vibrations, and makes
the resonance depend on the amplitude.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite, as_waveform, as_whole, frozen
from minorloop.dynamics import _newmark_kernels, _oscillator_kernels
from minorloop.dynamics.sampling import (
    Interpolation,
    Stage,
    checked_stages,
    even_interval,
    pulses,
    sampled,
)
from minorloop.errors import ParameterError, SignalError
from minorloop.operators.differential import Differential
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii


@dataclass(frozen=True, eq=False)
class Oscillator:
    """``mass y'' + damping y' + stiffness y + z = u``, where z is hysteretic.

    Raises a `ParameterError` if a number is not finite, the mass is not positive, or the operator
    is of another class.

    References
    ----------
    Noel and Schoukens, Hysteretic benchmark with a dynamic nonlinearity, Workshop on Nonlinear
    System Identification Benchmarks, 2016. Newmark, A method of computation for structural
    dynamics, ASCE J. Engineering Mechanics 85 (1959) 67.

    Examples
    --------
    >>> force = ml.BoucWen(1.0, 0.5, 0.5)
    >>> structure = ml.Oscillator(2.0, 0.5, 10.0, force)
    >>> structure.simulate(np.arange(5) / 10, np.ones(5)).shape
    (5,)
    """

    mass: float
    """Mass in kg, positive."""
    damping: float
    """Damping in N s/m."""
    stiffness: FloatArray
    """Stiffness in N/m, or coefficients (n,) of y, y^2, ... in the restoring force."""
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

        For operators of differential type the method is that of Runge and Kutta, whose steps end at
        every corner of the law; for plays it is that of Newmark.

        Raises a `SignalError` if the times are not even, or the oscillator is unstable with this
        force; a `ParameterError` if an option is out of its range.

        Parameters
        ----------
        between : {"band", "straight", "held"}
            Force between samples: without content above half the sampling rate, linear, or each
            sample held over the previous interval.
        substeps : int
            Steps of the integration in an interval.
        periodic : bool
            Whether the force repeats after the record; the response is then the settled response.
            Otherwise the oscillator is at rest first.
        stages : sequence of (int, array)
            Filters of a converter that samples ``substeps`` times as fast and decimates: factor and
            symmetric taps of each. Empty if the displacement is sampled directly.
        """
        times, forces = as_waveform(t, u)
        interval = even_interval(times)
        count = as_whole("substeps", substeps, 1)
        filters = checked_stages(stages, count)
        force = pulses(forces, count, between, periodic=periodic)
        # Most periods, after which a response counts as settled
        turns = 50 if periodic else 1
        # Largest relative change of the state per period of a settled response
        found = respond(self, force, interval / count, turns=turns, settled=1e-9)
        if found is None:
            raise SignalError(
                "the displacement grows without bound for this force; check the units, make the "
                "damping or the stiffness larger, or give more substeps"
            )
        return sampled(found[0], filters, count, periodic=periodic)

    @property
    def plant(self) -> tuple[float, float, FloatArray, FloatArray, FloatArray]:
        """Mass, damping, spring, levels and values, for the compiled loops."""
        return self.mass, self.damping, self.stiffness, *self.operator.law


def respond(
    model: Oscillator,
    force: FloatArray,
    step: float,
    *,
    gradient: bool = False,
    turns: int = 1,
    settled: float = 0.0,
) -> tuple[FloatArray, FloatArray] | None:
    """Return the displacements (K + 1,) from rest, and their derivatives (K + 1, P).

    None if they are not finite.

    Parameters
    ----------
    model : Oscillator
        The oscillator.
    force : (K, 3) array
        Force from `sampling.pulses`.
    step : float
        Seconds of a step.
    gradient : bool
        Whether to compute derivatives with respect to the parameters: mass, damping, springs, and
        those of the operator. P is 0 otherwise.
    turns : int
        Most repetitions of the force; the last counts.
    settled : float
        Relative change of the state and of its derivatives per turn, at which the turns end.
    """
    operator = model.operator
    differential = isinstance(operator, Differential)
    law = operator.law[1] if differential else operator.weights
    parameters = 2 + model.stiffness.size + law.size if gradient else 0
    state, slopes = np.zeros(3), np.zeros((3, parameters))
    y, out = np.empty(len(force) + 1), np.empty((len(force) + 1, parameters))
    run: Callable[..., bool]
    if differential:
        run = partial(_oscillator_kernels.respond, force, step, model.plant)
    else:
        n = operator.radii.size
        memory = np.zeros(n), np.zeros((n, parameters))
        plays = (operator.radii, operator.weights, operator.offset, *memory)
        state[2] = (force[0, 0] - operator.offset) / model.mass
        slopes[2, :1] = -state[2] / model.mass
        plant = model.mass, model.damping, model.stiffness
        run = partial(_newmark_kernels.march, force, step, *plant, plays)
    for _ in range(turns):
        before = np.vstack([state, slopes.T])
        if not run(state, slopes, y, out):
            return None
        now = np.vstack([state, slopes.T])
        if (np.abs(now - before) <= settled * np.abs(now)).all():
            break
    return y, out
