"""Exact simulation of a continuous linear system between samples, dead time included."""

from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.dynamics import _kernels
from minorloop.threads import one_thread

Between: TypeAlias = Literal["held", "straight"]
"""Input between samples: each sample is held over the interval before it, or the input is linear
from sample to sample."""
StateSpace: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, float]
"""A (n, n), B (n,), C (n,) and D."""

_DIGITS = 8
"""Time steps that agree to so many digits share a matrix exponential: the differences of sampled
times have rounding errors of this order."""


def propagate(
    system: StateSpace,
    x: FloatArray,
    t: FloatArray,
    u: FloatArray,
    *,
    delay: float,
    before: float,
    between: Between,
) -> FloatArray:
    """Return the outputs (T,) of a continuous system from state x.

    Parameters
    ----------
    system : tuple
        A, B, C, D.
    x : (n,) array
        State at the first sample, or for a held input one interval before it.
    t, u : (T,) arrays
        Times and inputs.
    delay : float
        Dead time at the input, in seconds.
    before : float
        Input before the first sample.
    between : {"held", "straight"}
        See `Between`.
    """
    knots = t if between == "straight" else np.concatenate([[2 * t[0] - t[1]], t])
    points = np.union1d(knots, (knots + delay)[knots + delay < t[-1]]) if delay else knots
    begin, end = _ends(points - delay, knots, t, u, before, between)
    a, b, c, d = system
    phi, at_begin, at_end, which = transitions(a, b, np.diff(points))
    states = np.empty((begin.size, x.size))
    _kernels.march(phi, at_begin, at_end, which, begin, end, x.copy(), states)
    y = states @ c + d * end
    if between == "held":
        return y[np.searchsorted(points, t) - 1]
    first = float(x @ c) + d * (before if delay else u[0])
    return np.concatenate([[first], y])[np.searchsorted(points, t)]


def transitions(
    a: FloatArray, b: FloatArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, npt.NDArray[np.int64]]:
    """Return the exact transitions over time steps, for inputs that are linear within a step.

    Steps that agree to eight digits share one transition.

    Returns
    -------
    phi : (M, n, n) array
        Factors of the state.
    at_begin, at_end : (M, n) arrays
        Factors of the input at both ends of a step.
    which : (K,) array of int
        Index of the transition of each of the K steps.

    References
    ----------
    Van Loan, Computing integrals involving the matrix exponential, IEEE TAC 23, 1978.
    """
    from scipy.linalg import expm

    unit = 10.0 ** (np.floor(np.log10(steps)) - _DIGITS + 1)
    unit = np.maximum(unit, np.finfo(float).tiny)  # a step may be as short as that
    lengths, which = np.unique(np.round(steps / unit) * unit, return_inverse=True)
    n = b.size
    block = np.zeros((lengths.size, n + 2, n + 2))
    block[:, :n, :n] = a * lengths[:, None, None]
    block[:, :n, n] = b * lengths[:, None]
    block[:, n, n + 1] = 1.0
    with one_thread():
        done = np.asarray(expm(block))
    at_end = np.ascontiguousarray(done[:, :n, n + 1])
    at_begin = np.ascontiguousarray(done[:, :n, n]) - at_end
    phi = np.ascontiguousarray(done[:, :n, :n])
    return phi, at_begin, at_end, np.asarray(which, dtype=np.int64)


def _ends(
    points: FloatArray,
    knots: FloatArray,
    t: FloatArray,
    u: FloatArray,
    before: float,
    between: Between,
) -> tuple[FloatArray, FloatArray]:
    """Return the input at both ends of each step between the times ``points``."""
    # The middle of a step is never at a jump of the input; its ends may be.
    middle = (points[1:] + points[:-1]) / 2
    early = middle < knots[0]
    if between == "held":
        value = u[np.minimum(np.searchsorted(t, middle), u.size - 1)]
        value = np.where(early, before, value)
        return value, value
    value = np.interp(points, t, u)
    return np.where(early, before, value[:-1]), np.where(early, before, value[1:])
