"""What the residual of a fit shows: a start-up, drift, and where the error is large."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray

_FEWEST = 30
"""Residuals below which only the worst is reported."""
_WINDOW, _SHARE_OF_ROWS, _SHARE_OF_ERROR = 100, 0.1, 0.3
"""A start-up is over where this part of the rows is as good as the others; it has at most the share
of the rows, and at least the share of the squared error."""
_TIMES = 4.0
"""Error of a start-up over that of the other rows."""
_DRIFT = 0.5
"""Share of the variance of the residual that a drift explains."""
PARTS = 3
"""Parts of equal size by amplitude and by rate."""
_MOST = 50_000
"""Samples by whose amplitude and rate errors are sorted, about."""


@dataclass(frozen=True)
class Startup:
    """Rows at the beginning that the model does not follow.

    Parameters
    ----------
    rows : int
        Number of these rows of the record.
    largest : float
        Largest error among them, in ranges of the output.
    share : float
        Share of the squared error of all fitted rows.
    """

    rows: int
    largest: float
    share: float


@dataclass(frozen=True, eq=False)
class ResidualSummary:
    """What the residual on the fitted samples shows; errors are in ranges of the output.

    Parameters
    ----------
    worst_sample : int
        Sample of the largest error.
    worst : float
        That error, model less measured.
    autocorrelation : float
        Correlation of residuals of neighbouring samples; NaN for few samples.
    startup : Startup, optional
        A start-up that the model does not follow.
    drift : float
        Change along the record where the residual changes steadily; 0 otherwise.
    by_amplitude : tuple of (float, float, float)
        Of samples by the size of their loop: its least and greatest size, and the error.
    by_rate : tuple of (float, float, float)
        The same by the change of the input from sample to sample.
    """

    worst_sample: int
    worst: float
    autocorrelation: float
    startup: Startup | None = None
    drift: float = 0.0
    by_amplitude: tuple[tuple[float, float, float], ...] = ()
    by_rate: tuple[tuple[float, float, float], ...] = ()


def summary(u: FloatArray, error: FloatArray, used: BoolArray) -> ResidualSummary:
    """Summarise the residual of a fit.

    Parameters
    ----------
    u : (T,) array
        Inputs, delayed as the output is.
    error : (T,) array
        Model less measured, in ranges of the output.
    used : (T,) array of bool
        Fitted samples without outliers.
    """
    rows = np.flatnonzero(used)
    left = error[rows]
    worst = int(np.argmax(np.abs(left)))
    if rows.size < _FEWEST:
        return ResidualSummary(int(rows[worst]), float(left[worst]), float("nan"))
    startup = find_startup(left, rows)
    later = rows >= (startup.rows if startup else 0)
    rest, places = left[later], rows[later]
    some, error_of_some = _thin(places), _thin(rest)
    return ResidualSummary(
        int(rows[worst]),
        float(left[worst]),
        _autocorrelation(rest, places),
        startup,
        _drift(rest, places),
        _by(amplitudes(u)[some], error_of_some),
        _by(np.abs(u[some] - u[np.maximum(some - 1, 0)]), error_of_some),
    )


def find_startup(error: FloatArray, rows: IntArray) -> Startup | None:
    """Find the first rows of a record if they have much of the squared error.

    Parameters
    ----------
    error : (M,) array
        Residual of the fitted samples in ranges.
    rows : (M,) array of int
        These samples.
    """
    size = error.size
    if size < _FEWEST:
        return None
    width = max(size // _WINDOW, 3)
    most = int(_SHARE_OF_ROWS * size)
    usual = float(np.sqrt(np.mean(error[most:] ** 2)))
    squares = np.concatenate([[0.0], np.cumsum(error**2)])
    mean = (squares[width:] - squares[:-width]) / width
    over = np.flatnonzero(mean[: most + 1] <= (1.5 * usual) ** 2)
    count = int(over[0]) if over.size else most + 1
    if not 0 < count <= most or squares[count] < _SHARE_OF_ERROR * squares[-1]:
        return None
    largest = float(np.abs(error[:count]).max())
    if np.sqrt(squares[count] / count) < _TIMES * usual:
        return None
    return Startup(int(rows[count]), largest, float(squares[count] / squares[-1]))


def _autocorrelation(error: FloatArray, rows: IntArray) -> float:
    """Correlation of the residuals of samples that follow each other."""
    next_to = np.diff(rows) == 1
    centred = error - error.mean()
    square = float(np.mean(centred**2))
    if not next_to.any() or square == 0:
        return float("nan")
    return float(np.mean((centred[1:] * centred[:-1])[next_to]) / square)


def _drift(error: FloatArray, rows: IntArray) -> float:
    """Change of the residual along the record if a straight line explains much of it."""
    time = rows - rows.mean()
    square = float(time @ time)
    centred = error - error.mean()
    if not square or not np.any(centred):
        return 0.0
    slope = float(time @ centred) / square
    explained = slope**2 * square / float(centred @ centred)
    return slope * float(np.ptp(rows)) if explained >= _DRIFT else 0.0


def amplitudes(u: FloatArray) -> FloatArray:
    """(T,) distance of the turning points before and after each sample."""
    moved = np.flatnonzero(np.append(True, np.diff(u) != 0))
    way = np.sign(np.diff(u[moved]))
    turns = moved[np.flatnonzero(np.diff(way) != 0) + 1]
    ends = np.concatenate([[0], turns, [u.size - 1]])
    sizes = np.abs(np.diff(u[ends]))
    return np.asarray(sizes[np.clip(np.searchsorted(ends, np.arange(u.size)) - 1, 0, None)])


def _thin(places: npt.NDArray[Any]) -> Any:
    """About 50,000 of the places, evenly distributed."""
    return places[:: max(places.size // _MOST, 1)]


def _by(feature: FloatArray, error: FloatArray) -> tuple[tuple[float, float, float], ...]:
    """Error of the samples in parts of equal size, by a feature."""
    order = np.argsort(feature, kind="stable")
    parts = [part for part in np.array_split(order, PARTS) if part.size]
    return tuple(
        (
            float(feature[part].min()),
            float(feature[part].max()),
            float(np.sqrt(np.mean(error[part] ** 2))),
        )
        for part in parts
    )
