"""Optimal design: the best input to measure next.

The best next input gives the largest reduction of the variance of the outputs for future inputs,
which random sequences represent. The reduction depends on the prior and the measured inputs, and
on the measured outputs only through the hyperparameters.

References
----------
MacKay, Information-based objective functions for active data selection, Neural Computation 4,
1992, section 4. Cohn, Neural network exploration using optimal experiment design, Neural
Networks 9, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, Levels, as_levels, as_whole, writable
from minorloop.errors import ParameterError
from minorloop.identification import _prior_kernels as _kernels
from minorloop.identification.design_matrix import PlaneSpec
from minorloop.identification.likelihood import regressors
from minorloop.identification.posterior import MOST_DENSE_CELLS, Posterior
from minorloop.identification.prior import Hyperparameters
from minorloop.identification.prior_fit import posterior_after
from minorloop.operators.memory import Memory
from minorloop.operators.plane import relay_outputs
from minorloop.threads import one_thread

if TYPE_CHECKING:
    from minorloop.identification.plane_result import Identification

CANDIDATES = 21
"""Number of candidates for the next input, evenly over the allowed range."""
_SEQUENCES, LENGTH = 40, 8
"""Number of random sequences that represent future inputs, and number of inputs of each."""
MOST_HOLDS = 1000
"""Largest budget; each hold takes the time of a fit."""


@dataclass(frozen=True)
class NextInput:
    """The input to measure next, and the expected reduction of the standard deviation."""

    u: float
    """The input."""
    sd: float
    """Mean standard deviation of future outputs now."""
    sd_after: float
    """Mean standard deviation of future outputs after this hold."""

    @property
    def gain(self) -> float:
        """Expected relative reduction of the standard deviation by this hold."""
        return 1 - self.sd_after / self.sd


def next_input(
    identification: Identification, memory: Memory, *, step: float = np.inf
) -> NextInput:
    """Find the best input to measure next.

    Raises a `ParameterError` if the model was identified without the prior or has more than 64
    levels, or ``step`` is not positive.

    Parameters
    ----------
    identification : Identification
        Identification of the measurements so far, with the prior.
    memory : Memory
        Memory of the actuator now; its last entry is the present input.
    step : float
        Largest allowed change from the present input.

    Examples
    --------
    >>> u = ml.design(np.linspace(0.0, 1.0, 9), 6)
    >>> found = ml.identify(u, u**2, ml.Plane(8, lag=0), prior=ml.Gaussian())
    >>> memory = ml.Memory.after(u, low=0.0, high=1.0)
    >>> 0.0 <= ml.next_input(found, memory).u <= 1.0
    True
    """
    if not hasattr(identification, "posterior"):
        raise ParameterError(
            f"identification is a {type(identification).__name__}; give a result of identify"
        )
    if not isinstance(memory, Memory):
        raise ParameterError(
            f"memory is a {type(memory).__name__}; give a Memory, such as Memory.after(inputs, "
            "low=..., high=...)"
        )
    if identification.posterior is None:
        raise ParameterError("next_input needs the prior; identify with prior=Gaussian()")
    if identification.posterior.spec.cells > MOST_DENSE_CELLS:
        raise ParameterError(
            f"next_input needs dense matrices, and the plane has {identification.unknowns} "
            "unknowns; give at most 64 levels"
        )
    candidates = _allowed(identification.matrix.spec.levels, memory, step)
    with one_thread():
        return _best(identification.posterior, memory, candidates)


def design(levels: npt.ArrayLike, holds: int, *, step: float = np.inf) -> FloatArray:
    """Design inputs (n,) before anything is measured, the most informative first.

    Raises a `ParameterError` if an option is out of its range.

    Parameters
    ----------
    levels : (L + 1,) array_like
        Thresholds of the model that will be identified.
    holds : int
        Number of inputs, 3 to 1000.
    step : float
        As in `next_input`; the first input is the lowest level.

    Examples
    --------
    >>> ml.design([0.0, 0.25, 0.5, 0.75, 1.0], 3).round(2).tolist()
    [0.0, 0.85, 0.35]
    """
    spec, h = PlaneSpec(as_levels(levels), diagonal="reversible"), Hyperparameters()
    count = as_whole("holds", holds, 3, MOST_HOLDS)
    inputs = [float(spec.levels[0])]
    with one_thread():
        while len(inputs) < count:
            u = np.array(inputs)
            dense = regressors(spec, u, np.ones(u.size, dtype=np.bool_), "negative")
            memory = Memory.after(inputs, low=spec.levels[0], high=spec.levels[-1])
            allowed = _allowed(spec.levels, memory, step)
            inputs.append(_best(posterior_after(spec, h, dense), memory, allowed).u)
    return np.array(inputs)


def _allowed(levels: Levels, memory: Memory, step: float) -> FloatArray:
    """Candidates for the next input."""
    if isinstance(step, bool) or not isinstance(step, int | float | np.number) or not step > 0:
        raise ParameterError(f"step is {step!r}; give the largest allowed change, above 0")
    least, most = max(float(levels[0]), memory.u - step), min(float(levels[-1]), memory.u + step)
    return np.linspace(least, most, CANDIDATES)


def _best(posterior: Posterior, memory: Memory, candidates: FloatArray) -> NextInput:
    """First of the pair of inputs that reduces the variance most, by beam search."""
    h, unit = posterior.hyperparameters, posterior.unit
    own = (h.discrepancy**2 + h.noise**2) * unit**2
    aim = _future_rows(posterior)
    total = float(np.sum(aim**2))
    first = _rows(posterior, memory, candidates) @ posterior.factor
    gains = _gains(aim, first, own)
    best, value = candidates[0], -np.inf
    # Optimise the second input for the best six first inputs
    for k in np.argsort(gains)[::-1][:6]:
        spent = first[k] / np.sqrt(first[k] @ first[k] + own)
        after = Memory.after(
            [*memory.extrema[1:], float(candidates[k])],
            low=memory.extrema[0],
            high=float(posterior.spec.levels[-1]),
        )
        second = _rows(posterior, after, candidates) @ posterior.factor
        # Reduction of all covariances by the first measurement.
        left = aim - np.outer(aim @ spent, spent)
        rest = second - np.outer(second @ spent, spent)
        both = gains[k] + float(_gains(left, rest, own).max())
        if both > value:
            best, value, here = candidates[k], both, float(gains[k])
    count, missed = aim.shape[0], (h.discrepancy * unit) ** 2
    return NextInput(
        float(best),
        float(np.sqrt(total / count + missed)),
        float(np.sqrt(max(total - here, 0.0) / count + missed)),
    )


def _gains(aim: FloatArray, candidates: FloatArray, own: float) -> FloatArray:
    """Reduction of the summed variance of the future outputs by measuring each candidate."""
    shared = np.einsum("sm,sm->m", *[aim @ candidates.T] * 2)
    return np.asarray(shared / (np.einsum("mk,mk->m", candidates, candidates) + own))


def _future_rows(posterior: Posterior) -> FloatArray:
    """Regressors of the random future sequences (fixed seed), times the posterior factor."""
    spec = posterior.spec
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(_SEQUENCES):
        u = rng.uniform(spec.levels[0], spec.levels[-1], LENGTH)
        rows.append(regressors(spec, u, np.ones(LENGTH, dtype=np.bool_), "negative")[0])
    return np.vstack(rows) @ posterior.factor


def _rows(posterior: Posterior, memory: Memory, candidates: FloatArray) -> FloatArray:
    """(m, n) regressors after each candidate."""
    spec = posterior.spec
    shares = np.empty((candidates.size, spec.cells))
    past = np.array(memory.extrema)
    _kernels.look_ahead(writable(spec.levels), spec.diagonal == "uniform", past, candidates, shares)
    columns = [relay_outputs(spec.relay, shares)]
    if spec.offset:
        columns.append(np.ones((candidates.size, 1)))
    if spec.slope:
        columns.append(candidates[:, None])
    return np.hstack(columns)
