"""Identify an oscillator with hysteresis by the error of its simulation.

The parameters minimise the difference between the measured displacement and the displacement that
the model predicts from the force alone. Derivatives of the simulation are exact: they are
integrated with it.

Far from the true parameters this error has many minima, because the model resonates elsewhere. So a
spring and a damper first tie the model to the measured displacement. They hold it near the record
with any parameters. The spring is then weakened in steps and finally removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from minorloop.arrays import LARGEST, BoolArray, FloatArray
from minorloop.dynamics.oscillator import Oscillator, respond
from minorloop.dynamics.sampling import Interpolation, pulses, refined, sampled
from minorloop.errors import ParameterError
from minorloop.operators.differential import BoucWen, Duhem
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

_TIES = (10.0, 1.0, 0.1)
"""Stiffness of the springs that tie the model to the record, over the stiffness of the first model.
By trial: with 10, first parameters may be wrong by 50 %; ratios of 10 are small enough steps."""
_TIED_STEPS, _TIED_GAIN = 40, 1e-3
"""Most steps with each spring, and relative gain that ends them: the minimum only starts the next
fit."""
_SOFT = 0.5
"""Share by which the slope of a soft loop falls from zero to its largest displacement: the initial
memory then fades within a period, and the derivatives of a periodic response are finite."""
_SMALL = 1e-9
"""Displacement in m that measures the slope of a law at rest."""
_PARAMETERS: dict[type, tuple[str, ...]] = {
    BoucWen: ("alpha", "gamma", "delta", "exponent"),
    Duhem: ("rising", "falling"),
    PrandtlIshlinskii: ("weights",),
}
"""Parameters of each class of hysteretic force, by the names of its fields."""
_STEPS = 60
"""Most steps of the last fit; four to ten are usual."""
_GAIN, _SMALLEST_STEP = 1e-6, 1e-12
"""Relative decrease of the sum of squares, and relative step, at which the last fit ends. For a
thousand samples or more, parameters are then within a thousandth of their standard deviations."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """End of a search for parameters."""

    residuals: FloatArray
    """Shape (N,). Simulated less measured displacements."""
    jacobian: FloatArray
    """Shape (N, P). Derivatives of the residuals with respect to the free parameters."""
    steps: int
    """Simulations."""
    converged: bool
    """Whether the error no longer decreases."""


@dataclass(frozen=True, eq=False)
class OscillatorRecord:
    """A record of force and displacement, ready for simulations."""

    u: FloatArray
    y: FloatArray
    """``u`` and ``y``: shape (T,). Force and displacement; of a periodic record, its mean period.
    """
    interval: float
    """Seconds between samples."""
    periodic: bool
    """Whether the record is one period of a settled response."""
    noise: float | None
    """Standard deviation of y, from the differences between periods."""
    between: Interpolation
    """One of "band", "straight", "held". The force between samples."""
    substeps: int
    """Steps of the integration in an interval."""
    stages: Sequence[tuple[int, FloatArray]]
    """Filters of the converter."""
    scored: BoolArray
    """Shape (T,). Samples whose error counts."""
    unsettled: int = 0
    """Number of first periods that are not in the mean, because the motion had not settled."""

    @property
    def step(self) -> float:
        """Seconds of one step of the integration."""
        return self.interval / self.substeps

    def coarse(self) -> OscillatorRecord:
        """Return the record for longer steps, without filters."""
        # Two steps in an interval are accurate enough for a minimum that is only a start
        return replace(self, substeps=min(2, self.substeps), stages=())

    @cached_property
    def force(self) -> FloatArray:
        """(K, 3) force in each step."""
        return pulses(self.u, self.substeps, self.between, periodic=self.periodic)

    @cached_property
    def filled(self) -> FloatArray:
        """(T,) measured displacements, interpolated linearly over gaps."""
        known = np.isfinite(self.y)
        return np.interp(np.arange(self.y.size), np.flatnonzero(known), self.y[known])

    @cached_property
    def motion(self) -> tuple[FloatArray, FloatArray]:
        """(K, 3) measured displacement and velocity in each step."""
        fine = refined(self.filled, 2 * self.substeps, "band", periodic=self.periodic)
        speed = np.gradient(fine, self.step / 2)
        return tuple(  # type: ignore[return-value]
            np.column_stack([x[:-2:2], x[1:-1:2], x[2::2]]) for x in (fine, speed)
        )

    def residuals(
        self, model: Oscillator, tie: tuple[float, float] | None = None
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return simulated minus measured displacements, and their derivatives (N, P).

        None if the simulation is not finite.

        ``model``: the model; ``tie``: spring and damper between the model and the
        measured displacement.
        """
        force = self.force
        if tie is not None:
            y, v = self.motion
            force = force + tie[0] * y + tie[1] * v
            spring = np.concatenate([[model.stiffness[0] + tie[0]], model.stiffness[1:]])
            model = replace(model, stiffness=spring, damping=model.damping + tie[1])
        # Most periods of simulation until the response repeats
        turns = 20 if self.periodic else 1
        # Largest relative change per period of a state, and of its derivatives, that repeat
        found = respond(model, force, self.step, gradient=True, turns=turns, settled=1e-6)
        if found is None:
            return None
        out, gradient = (
            sampled(x, self.stages, self.substeps, periodic=self.periodic) for x in found
        )
        # Derivatives of an unstable motion grow faster than the motion itself.
        if not (np.abs(out) < LARGEST).all() or not (np.abs(gradient) < LARGEST).all():
            return None
        return (out - self.y)[self.scored], gradient[self.scored]


def _law(operator: Any) -> dict[str, FloatArray]:
    """Return the parameters of an operator by the names of its fields."""
    return {name: np.asarray(getattr(operator, name)) for name in _PARAMETERS[type(operator)]}


def parameter_names(model: Oscillator) -> tuple[str, ...]:
    """Return the names of the parameters, in the order of `parameters_of`."""
    springs = ["stiffness", *(f"stiffness {k}" for k in range(2, model.stiffness.size + 1))]
    law = [
        f"{name.removesuffix('s')} {k}" if values.ndim else name
        for name, values in _law(model.operator).items()
        for k in range(values.size)
    ]
    return ("mass", "damping", *springs, *law)


def parameters_of(model: Oscillator) -> FloatArray:
    """Return the parameters (P,): mass, damping, springs, and those of the operator."""
    law = [values.ravel() for values in _law(model.operator).values()]
    return np.concatenate([[model.mass, model.damping], model.stiffness, *law])


def _with_parameters(model: Oscillator, parameters: FloatArray) -> Oscillator:
    """Return a model of the same structure.

    Raises a `ParameterError` if a parameter is out of its range.
    """
    law = _law(model.operator)
    sizes = [1, 1, model.stiffness.size, *(values.size for values in law.values())]
    mass, damping, springs, *found = np.split(parameters, np.cumsum(sizes)[:-1])
    shaped = {
        name: part.reshape(values.shape)
        for part, (name, values) in zip(found, law.items(), strict=True)
    }
    return Oscillator(mass.item(), damping.item(), springs, replace(model.operator, **shaped))


def fit_tied(record: OscillatorRecord, start: Oscillator, free: BoolArray) -> Oscillator | None:
    """Return the model after fits with weaker and weaker ties to the record.

    None if the start is unstable even with the strongest tie.

    ``record``: record to fit; ``start``: first model; ``free`` (P,) of bool: parameters that may
    change.
    """
    coarse, model = record.coarse(), start
    stiffness = abs(start.stiffness[0]) + abs(start.operator.step("relaxed", _SMALL)[0] / _SMALL)
    for share in _TIES:
        spring = share * float(stiffness)
        # Damping ratio of the mass on this spring alone: 0.7, so that noise does not excite it
        tie = spring, 2 * 0.7 * float(np.sqrt(spring * model.mass))
        begins = [model]
        if share == _TIES[0]:
            # With a wrong law the hysteretic force may diverge along the measured displacement.
            soft = softened(start, free, float(np.abs(record.filled).max()))
            if not np.array_equal(parameters_of(soft), parameters_of(start)):
                begins.append(soft)
        tried = (fit(coarse, one, free, tie, steps=_TIED_STEPS, gain=_TIED_GAIN) for one in begins)
        found = [one for one in tried if one is not None]
        if not found:
            return None
        model = min(found, key=lambda one: float(one[1].residuals @ one[1].residuals))[0]
    return model


def softened(model: Oscillator, free: BoolArray, reach: float) -> Oscillator:
    """Return the model with the law of a soft loop in its free parameters.

    ``model``: the model; ``free`` (P,) of bool: parameters that may change; ``reach``: largest
    displacement.
    """
    parameters, operator = parameters_of(model), model.operator
    first = 2 + model.stiffness.size
    law = parameters[first:].copy()
    if isinstance(operator, BoucWen):
        law[1:] = _SOFT / reach, 0.0, 1.0
    elif isinstance(operator, Duhem) and law.mean() != 0:
        slope = float(law.mean())
        fall = _SOFT * operator.levels / (abs(slope) * reach)
        law = slope * np.concatenate([1 - fall, 1 + fall])
    parameters[first:] = np.where(free[first:], law, parameters[first:])
    return _with_parameters(model, parameters)


def fit(
    record: OscillatorRecord,
    start: Oscillator,
    free: BoolArray,
    tie: tuple[float, float] | None = None,
    *,
    steps: int = _STEPS,
    gain: float = _GAIN,
) -> tuple[Oscillator, Minimum] | None:
    """Return the model with the least simulation error near a start; None if the start is unstable.

    Steps to an unstable model, or to a parameter out of its range, are rejected.

    ``record``, ``start`` and ``free``: as of `fit_tied`; ``tie`` (float, float): as for
    `OscillatorRecord.residuals`; ``steps``: most simulations; ``gain``: relative decrease of the
    sum of squares below which the search ends.
    """
    from scipy.optimize import least_squares

    all_of_them = parameters_of(start)

    def model_of(some: FloatArray) -> Oscillator:
        parameters = all_of_them.copy()
        parameters[free] = some
        return _with_parameters(start, parameters)

    def simulated(some: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        try:
            return record.residuals(model_of(some), tie)
        except ParameterError:  # out of its range
            return None

    begin = all_of_them[free]
    last = simulated(begin)
    if last is None:
        return None
    slopes, nowhere = last[1], np.full(last[0].size, np.inf)
    known = [begin.copy()]

    def errors(some: FloatArray) -> FloatArray:
        nonlocal last, slopes
        if not np.array_equal(some, known[0]):
            known[0], last = some.copy(), simulated(some)
            slopes = slopes if last is None else last[1]
        return nowhere if last is None else last[0]

    def jacobian(some: FloatArray) -> FloatArray:
        errors(some)
        return slopes[:, free]

    found = least_squares(
        errors,
        begin,
        jac=jacobian,
        x_scale="jac",
        ftol=gain,
        xtol=_SMALLEST_STEP,
        gtol=None,  # its unit is that of the displacement
        max_nfev=steps,
    )
    minimum = Minimum(found.fun, np.asarray(found.jac), found.nfev, found.status > 0)
    return model_of(found.x), minimum
