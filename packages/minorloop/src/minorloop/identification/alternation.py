"""Alternation between an operator and its dynamics, each fitted with the other one fixed.

With the dynamics fixed, the operator is identified from a record without dynamics. The inputs of
this record pass the dynamics before the operator. Its outputs are those of the present operator
plus the residual through the inverse of the dynamics behind the operator; a filter limits the
inverse to frequencies where the noise stays small. With the operator fixed, nonlinear least squares
finds the dynamics whose outputs are nearest to the measured outputs.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.dynamics.cascade import filtered_inverse
from minorloop.dynamics.creep import Creep, fit_creep
from minorloop.identification.dynamic_parts import DynamicParts, DynamicRecord
from minorloop.identification.plane_result import Identification
from minorloop.operators.preisach import Preisach

Static: TypeAlias = Callable[[FloatArray, FloatArray], Identification]

_ROUNDS, _SETTLED = 25, 2e-3
"""Most alternations; they end when an alternation with either filter gains less than this share."""
_DEPTH = 4
"""Number of alternations from which the next is extrapolated."""
_FILTERS = (5.0, 1.0)
"""Factors of the time constant of that filter: the slow filter converges from any beginning, then
the fast filter converges further."""


@dataclass(frozen=True, eq=False)
class Found:
    """A fit of operator and dynamics."""

    record: DynamicRecord
    """The record that was fitted."""
    result: Identification
    """The operator."""
    dynamics: DynamicParts
    """The dynamics."""
    error: float
    """Error on the fitted samples, over the range of the output."""

    @property
    def operator(self) -> Preisach:
        """The operator."""
        return self.result.model

    @cached_property
    def squares(self) -> FloatArray:
        """(B,) mean squared error on the left-out pieces of each block of the record."""
        return self.record.squares(self.dynamics.outputs(self.record, self.operator))

    @property
    def left_out_error(self) -> float:
        """Root-mean-square error on the left-out pieces, over the range of the output."""
        return float(np.sqrt(np.mean(self.squares)))


def alternate(
    record: DynamicRecord,
    dynamics: DynamicParts,
    static: Static,
    operator: Preisach | None = None,
    *,
    creeping: bool = False,
) -> Found:
    """Alternate between operator and dynamics until the error no longer falls.

    The parameters are extrapolated from the last rounds (Anderson, J. ACM 12, 1965). Plain
    alternation is slow, because operator and dynamics both explain part of the record.

    ``record``: the record; ``dynamics``: first guess, with the structure of the result;
    ``static``: identification of an operator from inputs and outputs; ``operator``: operator to
    begin with; ``creeping``: whether to fit creep.
    """
    best, waited = None, 0
    begun: list[FloatArray] = []
    reached: list[FloatArray] = []
    for _ in range(_ROUNDS):
        result = static(*without(dynamics, record, operator, _FILTERS[waited]))
        operator, began = result.model, dynamics.vector
        dynamics = _fitted_poles(record, dynamics, operator)
        if creeping:
            dynamics = replace(dynamics, creep=_fitted_creep(record, dynamics, operator))
        if dynamics.vector.size != began.size:  # creep was added or removed
            begun, reached = [], []
        else:
            begun.append(began)
            reached.append(dynamics.vector)
        error = record.error(dynamics.outputs(record, operator), record.fitted)
        waited = 0 if best is None or error < (1 - _SETTLED) * best.error else waited + 1
        if waited == len(_FILTERS):
            break
        if best is None or error <= best.error:
            best = Found(record, result, dynamics, error)
            if begun:
                ahead = _extrapolated(begun[-_DEPTH:], reached[-_DEPTH:])
                low, high = dynamics.bounds(float(record.t[-1]))
                ahead[: low.size] = np.clip(ahead[: low.size], low, high)
                dynamics = dynamics.at(ahead)
        else:  # return to the best fit, from which plain alternation does not increase the error
            operator, dynamics = best.operator, best.dynamics
            begun, reached = [], []
    assert best is not None
    return best


def _extrapolated(begun: list[FloatArray], reached: list[FloatArray]) -> FloatArray:
    """Return the limit to which rounds that began and ended at these vectors seem to converge."""
    steps = np.array(reached) - np.array(begun)
    if len(steps) < 2 or not np.diff(steps, axis=0).any():
        return reached[-1].copy()
    share = np.linalg.lstsq(np.diff(steps, axis=0).T, steps[-1], rcond=1e-6)[0]
    return np.asarray(reached[-1] - share @ np.diff(np.array(reached), axis=0))


def without(
    dynamics: DynamicParts, record: DynamicRecord, operator: Preisach | None, slower: float = 1.0
) -> tuple[FloatArray, FloatArray]:
    """Return the record of the operator alone, without dynamics; NaN in rows that are not fitted.

    The time constant of the filter of the inverse is ``slower`` times as long as usual.
    """
    known, u, linear = record.fitted, dynamics.before(record.u), dynamics.linear
    y = np.where(known, record.y, np.nan)
    if operator is None:
        if dynamics.first == "linear":
            return u, y
        slow = float(linear.time_constants.sum()) / record.interval
        return u, earlier(y, round(dynamics.delay + slow))
    w = operator.simulate(u, record.start)
    prompt = dynamics.after(w)
    if dynamics.creep is not None:
        whole = np.where(known, y, dynamics.crept(record, prompt))
        y = dynamics.creep.compensate(record.t, whole, before=float(prompt[0]))
    if dynamics.first == "linear":
        return u, np.where(known, y, np.nan)
    inverse, late = filtered_inverse(linear, slower * dynamics.filter_time)
    left = np.interp(record.t + late, record.t[known], (y - prompt)[known])
    return u, np.where(known, w + inverse.simulate(record.t, left), np.nan)


def earlier(y: FloatArray, samples: int) -> FloatArray:
    """Return outputs (T,) shifted earlier by ``samples``, NaN at the end."""
    return np.append(y, np.full(samples, np.nan))[samples:]


def _fitted_poles(
    record: DynamicRecord, dynamics: DynamicParts, operator: Preisach
) -> DynamicParts:
    """Return the dynamics with the poles and dead time that fit the outputs best."""
    from scipy.optimize import least_squares

    # Dead time in samples that counts as none where there are no poles
    if not dynamics.poles and dynamics.delay < 0.5:
        return replace(dynamics, delay=0.0)
    free = dynamics.poles + 1
    # The output of an operator that comes first does not depend on the dynamics.
    w = None if dynamics.ahead else operator.simulate(record.u, record.start)

    def errors(x: FloatArray) -> FloatArray:
        now = dynamics.at(x)
        prompt = now.prompt(record, operator) if w is None else now.after(w)
        return (now.crept(record, prompt) - record.y)[record.fitted]

    low, high = (bound[:free] for bound in dynamics.bounds(float(record.t[-1])))
    begin = dynamics.vector[:free]
    margin = np.minimum(1e-3, 0.1 * (high - low))
    # Most steps of the search for the dynamics, their finite difference, and the gain of the last
    answer = least_squares(
        errors,
        np.clip(begin, low + margin, high - margin),
        bounds=(low, high),
        diff_step=np.full(free, 1e-4),
        max_nfev=8,
        ftol=1e-4,
    )
    return dynamics.at(answer.x)


def _fitted_creep(
    record: DynamicRecord, dynamics: DynamicParts, operator: Preisach
) -> Creep | None:
    """Return the creep that fits the outputs best; None if there is none."""
    prompt = dynamics.prompt(record, operator)
    slowest = float(dynamics.time_constants.max(initial=record.interval))
    # Creep times: from five times the slowest time constant to a third of the record
    shortest, longest = 5.0 * slowest, float(record.t[-1]) / 3.0
    times = None if dynamics.creep is None else dynamics.creep.times
    if times is None and shortest > longest:
        return None
    y = np.where(record.fitted, record.y, np.nan)
    creep = fit_creep(record.t, prompt, y, shortest=shortest, longest=longest, times=times)
    return creep.normalised() if creep.gain > 0 and creep.strengths.any() else None
