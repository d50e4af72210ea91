"""Linear dynamics from a step, or from any record that begins at rest."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.dynamics.linear import Linear
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import output_error
from minorloop.identification.linear_fit import Kind, LinearFit, StepResponse, TriedEquation
from minorloop.identification.output_error import Coefficients, Stretch, Structure
from minorloop.identification.steps import Arrays, as_sampled, steps_in, whole
from minorloop.threads import one_thread

HIGHEST_ORDER, LONGEST_DEAD_TIME = 4, 2
"""Largest number of poles, and largest dead time in samples, to try."""
_NEARLY = 1.05
_ALMOST_EXACT = 1e-5
"""Ratio and difference of simulation errors, over the range, up to which they count as equal."""
_LEAST_ERROR = 1e-7
"""Simulation error, over the range, below which errors are rounding; by trial."""
_POLE_TOLERANCE = 1e-6
"""Imaginary part up to which a pole counts as real, and real part up to which it counts as not
positive. Rounding splits a double pole into two that are 1e-8 apart."""


def arx(
    t: npt.ArrayLike, u: npt.ArrayLike, y: npt.ArrayLike, *, second: Arrays | None = None
) -> LinearFit:
    """Identify linear dynamics from a record that begins at rest.

    Difference equations A(q) y = B(q) u with up to four coefficients in A, no more in B, and a dead
    time of up to two samples are fitted by least squares. Noise biases this fit, so the equations
    are then refined until their simulated output is nearest to the measured output. The result is
    the equation with the least Bayesian information criterion among those within 5 % of the least
    simulation error on the second record; without a second record, among all. Unstable equations
    are excluded. Those with negative or complex poles must simulate better by 5 % than all others.

    Raises a `SignalError` if the shapes differ, the samples are not even or too few, nothing
    changes, or no stable equation fits; a `ParameterError` if the second record has another
    interval.

    ``t`` (T,): evenly spaced times in seconds; ``u`` and ``y`` (T,): input and output; y[k] is read
    at the end of the interval with input u[k]. The record begins with a hold at whose end the plant
    is at rest. ``second``: another record, which chooses the equation. Its gain is fitted again,
    because hysteresis changes the gain.

    References
    ----------
    Ljung, System Identification, 2nd edition, 1999, sections 4.2, 7.3 and 16.4. Sohn and
    colleagues, SWNT-reinforced polyaniline fibres, eq. 4: ARX from one step.
    """
    record, *others = (as_sampled(one) for one in ((t, u, y), second) if one is not None)
    for other in others:
        if abs(record.interval - other.interval) > 1e-3 * record.interval:
            raise ParameterError(
                f"the records are sampled every {record.interval:g} s and every {other.interval:g} "
                "s; give both at one interval"
            )
    return _identified([whole(record)], [whole(one) for one in others], record.interval)


def step_response(t: npt.ArrayLike, u: npt.ArrayLike, y: npt.ArrayLike) -> StepResponse:
    """Identify the unit step response, separately for rising and falling output.

    The fit of a direction without steps is None.

    The record is cut into its steps; each is scaled by its own settled change, and all steps of one
    direction are fitted together as `arx` does.

    Raises a `SignalError` as `arx`; also if no step moves the output.

    ``t`` (T,): evenly spaced times in seconds; ``u`` and ``y`` (T,): input in holds, and output. At
    the end of each hold the plant is at rest.
    """
    record = as_sampled((t, u, y))
    steps = steps_in(record)
    if not steps:
        raise SignalError("no step moves the output; record one with a hold before and after it")
    fits: dict[bool, LinearFit] = {}
    for rising in {step.rising for step in steps}:
        own = [step.stretch for step in steps if step.rising == rising]
        fits[rising] = _identified(own, (), record.interval)
    return StepResponse(fits.get(True), fits.get(False))


def _identified(
    stretches: Sequence[Stretch], second: Sequence[Stretch], interval: float
) -> LinearFit:
    structures = [
        Structure(na, nb, 1 + dead)
        for na in range(1, HIGHEST_ORDER + 1)
        for nb in range(1, na + 1)
        for dead in range(LONGEST_DEAD_TIME + 1)
    ]
    samples = sum(one.y.size for one in stretches)
    # Least samples for each coefficient, by trial
    needed = 3 * structures[-1].parameters
    if samples < needed:
        raise SignalError(
            f"{samples} samples for up to {structures[-1].parameters} coefficients; give at least "
            f"{needed}"
        )
    if max(float(np.ptp(one.y)) for one in stretches) == 0:
        raise SignalError("the output never changes; there is nothing to identify")
    with one_thread():
        tried = [_candidate(stretches, second, structure) for structure in structures]
    candidates = [one for one in tried if one is not None]
    if not candidates:
        raise SignalError(
            "no stable difference equation with a settled gain fits the record; does it begin "
            "at rest, and does the output follow the input?"
        )
    best = chosen(candidates)
    found = best.coefficients
    covariance = output_error.covariance(stretches, found)
    model = _as_linear(found, interval).normalised()
    return LinearFit(
        model=model,
        gain=found.dc_gain,
        candidate=best,
        candidates=tuple(candidates),
        covariance=covariance,
        stretches=tuple(stretches),
        second=tuple(second),
    )


def chosen(candidates: Sequence[TriedEquation]) -> TriedEquation:
    """Choose the candidate that predicts best with the fewest coefficients.

    ``candidates``: at least one.
    """
    plain = [one for one in candidates if one.kind == "plain"]
    least = min(one.score for one in candidates)
    if plain:
        best_plain = min(one.score for one in plain)
        if best_plain <= _NEARLY * least + _ALMOST_EXACT:
            candidates, least = plain, best_plain
    judged = any(one.free_run is not None for one in candidates)
    if judged:
        candidates = [one for one in candidates if one.score <= _NEARLY * least + _ALMOST_EXACT]
    return min(candidates, key=lambda one: (one.bic, one.structure.parameters))


def _free_run_error(stretches: Sequence[Stretch], found: Coefficients) -> float:
    """Root-mean-square error of the simulated output over the range; each record has its gain."""
    errors, span = [], 0.0
    for one in stretches:
        simulated = found.simulate(one.u)
        power = float(simulated @ simulated)
        gain = float(simulated @ one.y) / power if power > 0 else 0.0
        errors.append(one.y - gain * simulated)
        span = max(span, float(np.ptp(one.y)))
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)) / (span or 1.0))


def _candidate(
    stretches: Sequence[Stretch], second: Sequence[Stretch], structure: Structure
) -> TriedEquation | None:
    found = output_error.output_error(stretches, structure)
    if found is None or found.dc_gain == 0:
        return None
    samples = sum(one.y.size for one in stretches)
    span = max(float(np.ptp(one.y)) for one in stretches)
    mean_square = output_error.cost(stretches, found) / samples / span**2
    # Below this, errors are rounding and differences between them mean nothing.
    counted = max(mean_square, _LEAST_ERROR**2)
    return TriedEquation(
        structure=structure,
        coefficients=found,
        kind=_kind(found),
        bic=samples * float(np.log(counted)) + structure.parameters * float(np.log(samples)),
        nrmse=float(np.sqrt(mean_square)),
        free_run=_free_run_error(second, found) if second else None,
    )


def _kind(found: Coefficients) -> Kind:
    poles = np.asarray(found.poles)
    if (np.abs(poles.imag) > _POLE_TOLERANCE).any():
        return "oscillatory"
    return "alternating" if (poles.real <= _POLE_TOLERANCE).any() else "plain"


def _as_linear(found: Coefficients, interval: float) -> Linear:
    order = found.a.size
    numerator = np.zeros(order + 1)
    numerator[1 : 1 + found.b.size] = found.b
    denominator: FloatArray = np.concatenate([[1.0], found.a])
    return Linear(numerator, denominator, interval, (found.delay - 1) * interval)
