"""Find out whether an output is cut at a level, by the likelihood of a rough model with a cut.

An output that is cut rises to a level along any branch and stays there; an output that saturates
bends. The polynomials of plays of the rough model are fitted without a level, cut at a level, and
bent towards a level. An output without its cut may need a lower degree than the cut output. So each
fit chooses its degree, and fits are compared by the criterion of Schwarz.

References
----------
Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978.
Tobin, Estimation of relationships for limited dependent variables, Econometrica 26, 1958.
"""

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification.rough_model import RoughRecord, few, weighted
from minorloop.lab.noise import noise_of, spread

_ABOVE = (0.0, 0.5)
"""Distances of the level of a bend above the highest reading, in widths of the bend."""
_SURE = 6.0
"""Logarithm of the likelihood ratio of a cut to its alternatives from which an output is cut."""
_ROUNDS, _SETTLED = 8, 1e-4
"""Most Gauss-Newton steps of a fit, and relative decrease of the squared error that ends them."""
_TINY = 1e-6
"""Least weight of readings at the level, and least squared error; they avoid singular systems."""
_AT = 2.0
"""Distance below the level within which a reading is at the level, in deviations of the noise."""


def cut_depth(record: RoughRecord, way: int, *, rail: bool = False) -> float | None:
    """Return the depth of a cut below the highest output (``way`` 1; -1: above the lowest output).

    The depth is in the unit of the output and includes the noise of readings; it is None without a
    cut. If the density of the readings shows a ``rail``, a cut as likely as no cut is enough.
    """
    places = few(record.places)
    off = record.y[places] - record.rough[places]
    # Error of outliers against the rough model, in robust deviations and in spans
    places = places[np.abs(off) <= max(8.0 * spread(off), 0.2 * record.span)]
    y = way * record.y[places] / record.span
    y -= np.median(y)
    fits = [_CutFit(rows, y) for rows in _bases(record, places)]
    noise = min(
        noise_of(np.diff(record.values, 2), 2) / record.span, min(spread(fit.error) for fit in fits)
    )
    top = float(y.max())
    # Distances of a level below the highest reading, in standard deviations of the noise
    levels = [top - depth * noise for depth in (0.0, 1.0, 2.0, 3.0)]
    cut, level = min((fit.cost(noise, level), level) for fit in fits for level in levels)
    depth = (top - level + _AT * noise) * record.span
    gain = min(fit.cost(noise) for fit in fits) - cut
    if rail:
        return depth if gain >= 0 else None
    # Least share of the readings at a level: a few extremes do not show a level
    rare = np.mean(y >= level - _AT * noise) < 0.05
    if rare or gain < _SURE:
        return None
    # Widths of the bend of an output that saturates, in spans
    bent = min(
        fit.cost(noise, top + above * bend, bend)
        for fit in fits for bend in (0.05, 0.12, 0.3) for above in _ABOVE
    )  # fmt: skip
    return depth if bent - cut >= _SURE else None


def _bases(record: RoughRecord, places: IntArray) -> Iterator[FloatArray]:
    """Yield the polynomials of each degree at these samples, (N, Q)."""
    rows, highest = record.basis.rows(places), record.basis.degree
    degree = np.append(0, np.tile(np.arange(1, highest + 1), (rows.shape[1] - 1) // highest))
    # Degrees of the polynomials
    for most in (2, 4, 8):
        if most <= highest:
            yield rows[:, degree <= most]


class _CutFit:
    """Fits of some polynomials (N, Q) to outputs (N,), in spans."""

    def __init__(self, rows: FloatArray, y: FloatArray) -> None:
        self.rows, self.y = rows, y
        self.first = weighted(rows, y, np.ones(y.size))
        self.error = y - rows @ self.first

    def cost(self, noise: float, level: float = np.inf, bend: float = 0.0) -> float:
        """Half of Schwarz's criterion of an output that is cut at a level, or bends towards it."""
        samples, unknowns = self.rows.shape
        squares = float(self.error @ self.error) if np.isinf(level) else self._least(level, bend)
        squares += samples * (noise / 2) ** 2  # errors below the noise are chance
        unknowns += np.isfinite(level)
        return float(samples * np.log(squares + _TINY) + unknowns * np.log(samples)) / 2

    def _least(self, level: float, bend: float) -> float:
        """Squared error of the best fit, by Gauss-Newton steps from the fit without a level."""
        found, least = self.first, np.inf
        for _ in range(_ROUNDS):
            x = self.rows @ found
            output, slope = _saturated(x, level, bend)
            error = self.y - output
            squares = float(error @ error)
            settled = squares > (1 - _SETTLED) * least
            least = min(least, squares)
            if settled:
                break
            # Divide the error of a bent output by a slope of at least 0.05, so that a step stays
            # finite
            step = np.where(slope > 0, error / np.maximum(slope, 0.05), 0.0)
            found = weighted(self.rows, x + step, slope**2 + _TINY)
        return least


def _saturated(x: FloatArray, level: float, bend: float) -> tuple[FloatArray, FloatArray]:
    """Output (N,) that is cut at a level, or bends towards it; and its slope (N,)."""
    if not bend:
        return np.minimum(x, level), (x < level).astype(float)
    from scipy.special import expit

    below = (level - x) / bend
    return level - bend * np.logaddexp(0.0, below), expit(below)
