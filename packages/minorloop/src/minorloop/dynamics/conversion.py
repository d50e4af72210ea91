"""Convert transfer functions between s and z, for inputs held over each interval."""

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.dynamics.propagation import StateSpace
from minorloop.errors import ParameterError

_REAL = 1e-9
"""Relative imaginary part up to which a pole counts as real: well above the rounding of roots."""
_NEGLIGIBLE = 1e-10
"""A coefficient adds less than this share of the largest term at the fastest pole: rounding."""


def canonical(numerator: FloatArray, denominator: FloatArray) -> StateSpace:
    """Return the controllable canonical form, whose settled state is known exactly.

    Parameters
    ----------
    numerator, denominator : (n + 1,) arrays
        Coefficients, highest power first; the first of the denominator is 1.

    Returns
    -------
    A (n, n), B (n,), C (n,), D
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
    numerator: FloatArray,
    denominator: FloatArray,
    interval: float,
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
    rate = np.real(logm(block)) / interval
    bottom = np.atleast_1d(np.real(np.poly(rate[:n, :n]))) if n else np.ones(1)
    top = _markov_numerator(bottom, rate[:n, :n], rate[:n, n], c, d)
    return _without_rounding(top, bottom), bottom


def refuse_alternating(poles: npt.NDArray[np.complex128]) -> None:
    """Refuse poles in the z-plane that no continuous system of the same order has.

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
    """Return the numerator from Markov parameters, without cancellation in the first ones."""
    markov, x = [d], b
    for _ in range(b.size):
        markov.append(float(c @ x))
        x = a @ x
    return np.convolve(denominator, markov)[: denominator.size]


def _without_rounding(numerator: FloatArray, denominator: FloatArray) -> FloatArray:
    """Set leading coefficients to zero that are only rounding errors."""
    fastest = float(np.abs(np.roots(denominator)).max(initial=0.0)) or 1.0
    terms = np.abs(numerator) * fastest ** -np.arange(numerator.size, dtype=np.float64)
    keep = np.flatnonzero(terms > _NEGLIGIBLE * terms.max(initial=0.0))
    first = int(keep[0]) if keep.size else numerator.size - 1
    return np.concatenate([np.zeros(first), numerator[first:]])
