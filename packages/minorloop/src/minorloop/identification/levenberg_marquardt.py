"""Nonlinear least squares by the method of Levenberg and Marquardt."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from minorloop.arrays import FloatArray

Model: TypeAlias = "Callable[[FloatArray], tuple[FloatArray, FloatArray] | None]"
"""From parameters (P,) to residuals (N,) and derivatives (N, P); None where there are none."""

_FIRST, _LEAST, _MOST = 1e-3, 1e-12, 1e12
"""Damping at the beginning, and its limits; relative to the squared norms of the columns."""
_SMALL_GAIN = 1e-6
"""Relative decrease of the sum of squares, as predicted, at which the search ends: parameters are
then within a thousandth of their standard deviations for a thousand samples and more."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Result of a search."""

    parameters: FloatArray
    """Shape (P,). The best that were found."""
    residuals: FloatArray
    """Shape (N,). There."""
    jacobian: FloatArray
    """Shape (N, P). There."""
    steps: int
    """Steps that were tried."""
    converged: bool
    """Whether no further decrease is predicted."""


def minimise(
    model: Model, start: FloatArray, *, steps: int = 100, gain: float = _SMALL_GAIN
) -> Minimum | None:
    """Return parameters with the least sum of squares of the residuals; None if it starts nowhere.

    Steps to where there is no model are refused, and the damping grows.

    Parameters
    ----------
    model : callable
        Residuals and their derivatives.
    start : (P,) array
        Where to begin.
    steps : int
        Most steps that are tried.
    gain : float
        Relative decrease of the sum of squares below which the search ends.

    References
    ----------
    Marquardt, J. SIAM 11 (1963) 431. More, The Levenberg-Marquardt algorithm, Lecture Notes in
    Mathematics 630 (1978) 105: scaling that only grows.
    """
    x = start.copy()
    here = model(x)
    if here is None:
        return None
    residuals, jacobian = here
    cost = float(residuals @ residuals)
    scale = np.zeros(x.size)
    damping = _FIRST
    for count in range(steps):
        scale = np.maximum(scale, np.linalg.norm(jacobian, axis=0))
        safe = np.where(scale > 0, scale, 1.0)
        columns = jacobian / safe
        normal, slope = columns.T @ columns, columns.T @ residuals
        move = -np.linalg.solve(normal + damping * np.eye(x.size), slope)
        predicted = -float(2 * move @ slope + move @ normal @ move)
        if predicted <= gain * cost and damping <= _FIRST:
            return Minimum(x, residuals, jacobian, count, True)
        there = model(x + move / safe)
        won = -np.inf if there is None else cost - float(there[0] @ there[0])
        if there is not None and won > 0:
            x = x + move / safe
            residuals, jacobian = there
            cost -= won
        # The damping follows how well the step was predicted (Nielsen 1999).
        ratio = won / predicted if predicted > 0 else -1.0
        factor = 0.1 if ratio > 0.75 else 1.0 if ratio > 0.25 else 4.0
        damping = max(damping * factor, _LEAST)
        if damping > _MOST:
            return Minimum(x, residuals, jacobian, count + 1, False)
    return Minimum(x, residuals, jacobian, steps, False)
