"""Linear algebra of symmetric matrices: factors, triangles, conjugate gradients."""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray

_TOGETHER = 32
"""Number of rows that are copied or scaled at once."""


def cholesky(matrix: FloatArray) -> FloatArray:
    """Lower triangular factor of a positive definite matrix."""
    return np.asarray(np.linalg.cholesky(matrix))


def cholesky_inverse(root: FloatArray) -> FloatArray:
    """Inverse of the matrix with this Cholesky factor."""
    from scipy.linalg import lapack

    # The lower triangle in C order is the upper one in Fortran order.
    inverse = np.asarray(lapack.dpotri(root.T, lower=0)[0].T)
    mirror(inverse)
    return inverse


def triangular_solve(
    lower: npt.NDArray[Any], right: npt.NDArray[Any], transposed: bool = False
) -> FloatArray:
    """Solution with a lower triangular matrix, or with its transpose."""
    from scipy.linalg import solve_triangular

    found = solve_triangular(
        lower, right, lower=True, check_finite=False, trans="T" if transposed else "N"
    )
    return np.asarray(found)


def triangular_inverse(lower: FloatArray) -> FloatArray:
    """Inverse of a lower triangular matrix."""
    from scipy.linalg import lapack

    # The lower triangle in C order is the upper one in Fortran order.
    return np.asarray(lapack.dtrtri(lower.T, lower=0)[0].T)


def upper_solve(upper: FloatArray, right: FloatArray, *, transposed: bool) -> FloatArray:
    """Solution with an upper triangular matrix in Fortran order, or with its transpose."""
    from scipy.linalg import lapack

    return np.asarray(lapack.dtrtrs(upper, right, lower=0, trans=int(transposed))[0])


def mirror(matrix: FloatArray) -> None:
    """Copy the lower triangle of a matrix (n, n) to the upper triangle, some rows at a time."""
    for first in range(0, len(matrix), _TOGETHER):
        last = first + _TOGETHER
        corner = np.tril(matrix[first:last, first:last])
        matrix[first:last, first:last] = corner + np.tril(corner, -1).T
        matrix[:first, first:last] = matrix[first:last, :first].T


def scale_symmetric(matrix: FloatArray, scale: FloatArray) -> None:
    """Multiply rows and columns of a matrix (n, n) by a scale (n,), in place."""
    for first in range(0, len(matrix), _TOGETHER):
        matrix[first : first + _TOGETHER] *= scale[first : first + _TOGETHER, None] * scale


def conjugate_gradients(
    product: Callable[[FloatArray], FloatArray],
    condition: Callable[[FloatArray], FloatArray],
    right: FloatArray,
    enough: float,
    most: int,
) -> FloatArray:
    """(n,) solution of a positive definite system by conjugate gradients.

    ``condition`` is the preconditioner. The iteration ends at a residual below ``enough``, or after
    ``most`` steps.
    """
    z, left, direction, before = np.zeros_like(right), right.copy(), None, 1.0
    for _ in range(most):
        conditioned = condition(left)
        rho = float(left @ conditioned)
        if not rho > 0:
            break
        direction = conditioned if direction is None else conditioned + rho / before * direction
        along = product(direction)
        length, before = rho / (direction @ along), rho
        z += length * direction
        left -= length * along
        if np.linalg.norm(left) <= enough:
            break
    return z
