"""Rank and condition of the design: whether the data determine the model."""

import numpy as np
from scipy import linalg

from minorloop.arrays import FloatArray
from minorloop.identification.design_matrix import DesignMatrix
from minorloop.threads import one_thread

_MOST_WORK = 2e9
"""Samples times squared unknowns up to which singular values are computed directly: it takes about
a second."""


def _singular_values(matrix: DesignMatrix) -> FloatArray:
    """Singular values of the design with unit columns, largest first.

    A small design gives them directly. A large one gives them through its Gram matrix; values
    below about 1e-8 of the largest are then noise.
    """
    if _is_small(matrix):
        dense = matrix.dense()
        if matrix.counts is not None:
            dense *= np.sqrt(matrix.counts)[:, None]
        norms = np.linalg.norm(dense, axis=0)
        return np.asarray(linalg.svdvals(dense / np.where(norms > 0, norms, 1.0)))
    gram = matrix.gram(matrix.counts)
    gram += np.tril(gram, -1).T
    scale = np.sqrt(np.where(gram.diagonal() > 0, gram.diagonal(), 1.0))
    gram /= scale[:, None] * scale[None, :]
    values = linalg.eigvalsh(gram, overwrite_a=True, check_finite=False)
    return np.sqrt(np.maximum(values[::-1], 0.0))


def rank_and_condition(matrix: DesignMatrix) -> tuple[int, float]:
    """Rank of the design with unit columns, and the condition of its determined part."""
    with one_thread():
        values = _singular_values(matrix)
    if not values.size or values[0] == 0:
        return 0, np.inf
    least = values[0] * (1e-10 if _is_small(matrix) else 1e-7)
    rank = int(np.count_nonzero(values > least))
    return rank, float(values[0] / values[rank - 1])


def _is_small(matrix: DesignMatrix) -> bool:
    """Whether the singular values are computed from the design itself."""
    return matrix.samples * matrix.spec.unknowns**2 <= _MOST_WORK
