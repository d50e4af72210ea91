"""Find a shift of the outputs from a row on, or a drift, which a fit has partly absorbed.

The outputs are regressed on a flexible basis along the input and on the prediction of the fit.
Cumulative sums of the orthonormal basis give, for a shift from each row on, its part outside the
regressors and the share of the residual that it explains (partial regression: Frisch and Waugh,
Econometrica 1, 1933).
"""

import numpy as np
from scipy.linalg import qr

from minorloop.arrays import FloatArray

MOST_ROWS = 5000
"""Most rows: a regression on about forty columns then takes hundredths of a second."""
_LEAST_SIDE = 8
"""Least number of rows before and behind a step."""
_SHARE, _OVER_DRIFT = 0.4, 1.3
"""Least share of the variance that a step explains, and least ratio to that of a straight line."""
_SINGULAR, _ROUNDING = 1e-9, 1e-24
_DRIFT, _SURE = 0.4, 8.0
"""Least share of the variance outside the basis that a drift explains, and least ratio of a drift
to its standard error."""
_BLOCKS = 40
"""Blocks of rows with independent errors, although neighbouring errors are alike."""


def find_offset_step(
    basis: FloatArray, prediction: FloatArray, y: FloatArray
) -> tuple[int, float] | None:
    """Return the first row behind a step and the size in the unit of the outputs; None if no step.

    ``basis`` (M, Q): regressors of each row: a constant and functions of the memory; ``prediction``
    (M,): outputs of the fit, another regressor. It may contain a part of the step, so the size is
    estimated without it. ``y`` (M,): outputs.
    """
    size, columns = basis.shape
    if size < 2 * columns or size < 4 * _LEAST_SIDE:
        return None
    q = _orthonormal(np.column_stack([basis, prediction]))
    rest = y - q @ (q.T @ y)
    squares = float(rest @ rest)
    if squares <= _ROUNDING * float(y @ y):
        return None
    # Row k: sums over the rows from k on.
    sums = np.cumsum(rest[::-1])[::-1]
    absorbed = np.cumsum(q[::-1], axis=0)[::-1]
    count = np.arange(size, 0, -1)
    own = count - np.einsum("kq,kq->k", absorbed, absorbed)
    sides = np.minimum(count, size - count)
    # Least share of a step outside the regressors: below, the input determines the result
    usable = (sides >= _LEAST_SIDE) & (own > 0.05 * count * (size - count) / size)
    shares = np.where(usable, sums**2 / np.where(usable, own, 1.0) / squares, 0.0)
    place = int(np.argmax(shares))
    time = np.linspace(-0.5, 0.5, size)
    line = time - q @ (q.T @ time)
    drift = float(line @ rest) ** 2 / max(float(line @ line), _SINGULAR) / squares
    if shares[place] < max(_SHARE, _OVER_DRIFT * drift):
        return None
    step = (np.arange(size) >= place).astype(np.float64)
    q = _orthonormal(basis)
    step -= q @ (q.T @ step)
    return place, float(step @ y / (step @ step))


def find_drift(basis: FloatArray, y: FloatArray) -> float:
    """Return the linear change of the outputs over the rows; 0 if there is no drift.

    ``basis``, ``y`` are as for `find_offset_step`.
    """
    size, columns = basis.shape
    if size < 2 * columns or size < _BLOCKS:
        return 0.0
    q = _orthonormal(basis)
    rest = y - q @ (q.T @ y)
    time = np.linspace(-0.5, 0.5, y.size)
    line = time - q @ (q.T @ time)
    own, squares = float(line @ line), float(rest @ rest)
    if own <= _SINGULAR * float(time @ time) or squares <= _ROUNDING * float(y @ y):
        return 0.0
    change = float(line @ rest) / own
    scores = line * (rest - change * line)
    blocks = np.array([part.sum() for part in np.array_split(scores, _BLOCKS)])
    sure = abs(change) * own >= _SURE * float(np.linalg.norm(blocks))
    return change if sure and change**2 * own >= _DRIFT * squares else 0.0


def _orthonormal(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of the columns."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(np.float64).tiny)
    q, r, _ = qr(scaled, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(r))
    return np.asarray(q[:, sizes > _SINGULAR * sizes[0]])
