"""Linear systems in state space: exact simulation between samples, and conversion to and from z."""

import warnings
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.dynamics import _kernels
from minorloop.errors import ParameterError
from minorloop.threads import one_thread

Between: TypeAlias = Literal["held", "straight"]
"""Input between samples: each sample is held over the previous interval, or the input is linear
from sample to sample."""
StateSpace: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, float]
"""A (n, n), B (n,), C (n,) and D."""

_REAL = 1e-9
"""Relative imaginary part up to which a pole counts as real: well above the rounding of roots."""


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

    ``system``: A, B, C, D; ``x`` (n,): state at the first sample, or for a held input one interval
    before it; ``t`` and ``u`` (T,): times and inputs; ``delay``: dead time at the input, in
    seconds; ``before``: input before the first sample; ``between`` {"held", "straight"}: see
    `Between`.
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

    # Time steps that agree to 8 digits share a matrix exponential: differences of sampled times
    # have such rounding errors
    unit = 10.0 ** (np.floor(np.log10(steps)) - 7)
    unit = np.maximum(unit, np.finfo(float).tiny)  # steps may be that short
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


def canonical(numerator: FloatArray, denominator: FloatArray) -> StateSpace:
    """Return the controllable canonical form, whose settled state is known exactly.

    It consists of A (n, n), B (n,), C (n,) and D.

    ``numerator`` and ``denominator`` (n + 1,): coefficients, highest power first; the first of the
    denominator is 1.
    """
    n, feedthrough = denominator.size - 1, float(numerator[0])
    a, b = np.zeros((n, n)), np.zeros(n)
    if n:
        a[0], b[0] = -denominator[1:], 1.0
        a[np.arange(1, n), np.arange(n - 1)] = 1.0
    return a, b, numerator[1:] - feedthrough * denominator[1:], feedthrough


def sampled(
    numerator: FloatArray, denominator: FloatArray, interval: float
) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator in z with the same outputs at the samples."""
    from scipy.linalg import expm

    a, b, c, d = canonical(numerator, denominator)
    n = b.size
    if n == 0:
        return numerator, denominator
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    block = np.asarray(expm(interval * block))
    bottom = np.atleast_1d(np.real(np.poly(block[:n, :n])))
    return _markov_numerator(bottom, block[:n, :n], block[:n, n], c, d), bottom


def continuous(
    numerator: FloatArray, denominator: FloatArray, interval: float
) -> tuple[FloatArray, FloatArray]:
    """Return numerator and denominator in s, by the principal matrix logarithm.

    Raises a `ParameterError` if a pole is at 0 or on the negative real axis, where this logarithm
    does not exist.
    """
    from scipy.linalg import logm

    refuse_alternating(np.asarray(np.roots(denominator), dtype=np.complex128))
    a, b, c, d = canonical(numerator, denominator)
    n = b.size
    block = np.eye(n + 1)
    block[:n, :n], block[:n, n] = a, b
    with warnings.catch_warnings():
        # It warns of errors above 2e-13, which do not matter for records.
        warnings.simplefilter("ignore", RuntimeWarning)
        rate = np.real(logm(block)) / interval
    bottom = np.atleast_1d(np.real(np.poly(rate[:n, :n]))) if n else np.ones(1)
    top = _markov_numerator(bottom, rate[:n, :n], rate[:n, n], c, d)
    return _without_rounding(top, bottom), bottom


def refuse_alternating(poles: npt.NDArray[np.complex128]) -> None:
    """Refuse poles in the z-plane that continuous systems of the same order do not have.

    Raises a `ParameterError` if a pole is at 0 or on the negative real axis: its mode ends within
    one sample, or changes its sign at every sample.
    """
    for pole in poles:
        if pole.real <= 0 and abs(pole.imag) <= _REAL * max(abs(pole), _REAL):
            raise ParameterError(
                f"the pole {pole.real:.4g} is at 0 or on the negative real axis, where the "
                "principal logarithm does not exist: no continuous system of this order has "
                "it; identify with a lower order or sample faster"
            )


def _markov_numerator(
    denominator: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, d: float
) -> FloatArray:
    """Return the numerator from Markov parameters, without cancellation in its first terms."""
    markov, x = [d], b
    for _ in range(b.size):
        markov.append(float(c @ x))
        x = a @ x
    return np.convolve(denominator, markov)[: denominator.size]


def _without_rounding(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Set leading coefficients to zero that are only rounding errors."""
    fastest = float(np.abs(np.roots(denominator)).max(initial=0.0)) or 1.0
    terms = np.abs(numerator) * fastest ** -np.arange(numerator.size, dtype=np.float64)
    # A coefficient adds less than this share of the largest term at the fastest pole: rounding
    keep = np.flatnonzero(terms > 1e-10 * terms.max(initial=0.0))
    first = int(keep[0]) if keep.size else numerator.size - 1
    return np.concatenate([np.zeros(first), numerator[first:]])
