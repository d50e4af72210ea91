"""Has it settled, and where is it going.

The end of a hold is judged from the samples alone. A line through the trailing window gives
the slope with its uncertainty. Where noise hides so small a slope, an output that cannot be told
from a constant has settled too. A hold that is still moving is carried to its end by a fit of
decaying exponentials with fixed, log-spaced time constants.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.special import betainc, stdtr

from minorloop.arrays import FloatArray

Verdict: TypeAlias = Literal["settled", "extrapolated", "unsettled"]

SURE = 2.0
"""Standard deviations of the slope that must fit below the tolerance too."""
TAIL = 0.7
"""Share of a hold, at its end, that the exponentials are fitted to: what fades in the first
third is often nonlinear, and gone."""
TIME_CONSTANTS = tuple(np.geomspace(1 / 20, 1 / 2.5, 7).tolist())
"""Time constants to choose from, as shares of the hold."""
DOUBT = 0.3
"""Share of the way extrapolated that counts as uncertain, as decays need not be exponential."""
TRUST = 0.1
"""An end is trusted up to an uncertainty of this share of what the fitted tail has moved. As
a third of that is the way extrapolated, a ramp, which goes nowhere, exceeds it."""
FADING = 0.5
"""Time constant, as a share of the hold, with which the slope at its end is taken to fade."""
HIDDEN = 0.5
"""Share of the noise of a sample that may remain of the way of an output that stands still."""
STRETCH = 2.5
"""Windows over which an output that noise hides has to stand still."""
CHANCE = 1e-4
"""Probability with which the noise of a constant is taken for a movement, in each of two tests."""
FEWEST_STILL = 8
"""Samples without which a movement cannot be told from noise."""
_FEWEST = 4
_FEWEST_TAIL = 12
_MOST = 2000
_ROUNDING = 1e-14


@dataclass(frozen=True)
class Trend:
    """A straight line through the trailing window.

    Parameters
    ----------
    value, sd : float
        The line at the last sample and its standard deviation, in the unit of the output.
    slope, slope_sd : float
        Its slope and standard deviation, in the unit of the output per second.
    """

    value: float
    sd: float
    slope: float
    slope_sd: float

    def is_below(self, tolerance: float) -> bool:
        """Whether the slope is known to be no steeper than this."""
        return abs(self.slope) + SURE * self.slope_sd <= tolerance


@dataclass(frozen=True)
class Extrapolation:
    """Where exponentials lead.

    Parameters
    ----------
    value, sd : float
        Settled value and its standard deviation, in the unit of the output.
    remaining : float
        How far it is from the end of the hold to there.
    trusted : bool
        Whether the samples bear it out: it is no less certain than a single sample, or certain
        to a tenth of what the fitted tail of the hold has moved.
    noise : float
        Standard deviation of a sample about the fit.
    """

    value: float
    sd: float
    remaining: float
    trusted: bool
    noise: float


@dataclass(frozen=True)
class Settling:
    """How a hold ended.

    Parameters
    ----------
    value, sd : float
        The settled value, as well as it is known, and its standard deviation, in the unit of
        the output; NaN where nothing was measured.
    verdict : str
        ``settled``: the slope was below the tolerance, ``value`` is the end of the trend; or noise
        hides so small a slope and no movement can be told from noise, and ``value`` is where the
        exponentials lead, or the end of a longer trend where they lead nowhere.
        ``extrapolated``: it still moves, ``value`` is where the exponentials lead.
        ``unsettled``: they lead nowhere; ``value`` is the end of the trend.
        Where ``value`` is the end of the trend, ``sd`` counts the way that seems to remain.
    slope, slope_sd : float
        Slope over the trailing window and its standard deviation, per second.

    Notes
    -----
    A hold shows what is faster than itself. ``sd`` is honest where the hold is at least four
    times the slowest time constant that matters; what fades more slowly than that, and an
    output that is just about to turn, look more settled than they are.
    """

    value: float
    sd: float
    verdict: Verdict
    slope: float
    slope_sd: float


def trend(t: npt.ArrayLike, y: npt.ArrayLike, window: float) -> Trend | None:
    """Fit a line to the samples of the trailing window, the last four at least.

    The uncertainty is taken from the residuals, with fewer samples counted where neighbours
    are alike.

    Parameters
    ----------
    t : (T,) array_like
        Times in seconds, increasing.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    window : float
        How far to look back from the last sample, in seconds.

    Returns
    -------
    Trend or None
        None where there are fewer than four samples.
    """
    times, values = _trailing(*_measured(t, y), window)
    if times.size < _FEWEST or times[-1] == times[0]:
        return None
    x = times - times[-1]
    rows = np.column_stack([np.ones_like(x), x])
    fit = _least_squares(rows, values - values[-1])
    (value, slope), (sd, slope_sd) = fit.weights.tolist(), (fit.sd * fit.spread).tolist()
    return Trend(value + float(values[-1]), sd, slope, slope_sd)


def is_still(t: npt.ArrayLike, y: npt.ArrayLike, window: float) -> bool:
    """Whether an output cannot be told from a constant with white noise.

    The slope over the last ``STRETCH`` windows must be no surprise by Student's distribution, and
    neighbours must be no more alike than those of white noise are, by the ratio of von Neumann
    (Distribution of the ratio of the mean square successive difference to the variance, 1941).
    Its distribution is taken as a beta distribution of the same variance. What moves smoothly has
    neighbours that are alike.

    Parameters
    ----------
    t : (T,) array_like
        Times in seconds, increasing.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    window : float
        Trailing time over which a slope is taken, in seconds.

    Returns
    -------
    bool
        False where there are fewer than eight samples: noise rises from the first to the last of
        seven too often for that to be a surprise.
    """
    times, values = _trailing(*_measured(t, y), STRETCH * window)
    if times.size < FEWEST_STILL or times[-1] == times[0]:
        return False
    x = times - times.mean()
    rest = values - values[-1]
    rest -= rest.mean()
    squares = float(rest @ rest)
    if squares == 0:
        return True
    slope = float(x @ rest) / float(x @ x)
    count = times.size
    left = max(squares - slope**2 * float(x @ x), _ROUNDING * squares)
    surprise = abs(slope) * math.sqrt(float(x @ x) * (count - 2) / left)
    steps = np.diff(rest)
    ratio = float(steps @ steps) / (2 * squares)
    shape = ((count**2 - 1) / (count - 2) - 1) / 2
    alike = betainc(shape, shape, min(ratio / 2, 1.0))
    return bool(min(2 * stdtr(count - 2, -surprise), alike) >= CHANCE)


def extrapolate(t: npt.ArrayLike, y: npt.ArrayLike) -> Extrapolation | None:
    """Carry a hold to its end: y_inf + sum a_i exp(-t / tau_i), signed a_i, linear in all.

    One or two time constants of ``TIME_CONSTANTS`` are taken at a time, each choice fitted by
    least squares, and the choices averaged by their likelihood with the penalty of Schwarz
    (Estimating the dimension of a model, 1978). The spread between choices counts as
    uncertainty.

    Parameters
    ----------
    t : (T,) array_like
        Times of a hold in seconds, increasing, from its beginning.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.

    Returns
    -------
    Extrapolation or None
        None where the tail of the hold has fewer than twelve samples.
    """
    times, values = _measured(t, y)
    tail = times >= times[-1] - TAIL * (times[-1] - times[0]) if times.size else slice(0)
    times, values = _thinned(times[tail], values[tail])
    if times.size < _FEWEST_TAIL or times[-1] == times[0]:
        return None
    x = TAIL * (times - times[0]) / (times[-1] - times[0])
    last = float(values[-1])
    fits = [_decays(x, values - last, chosen) for chosen in _choices()]
    weight = _likelihoods(fits, times.size)
    goals = np.array([fit.weights[0] for fit in fits])
    value = float(weight @ goals)
    best = fits[int(np.argmax(weight))]
    doubts = [(fit.sd * fit.spread[0]) ** 2 for fit in fits] + (goals - value) ** 2
    remaining = value - float(weight @ [fit.fitted[-1] for fit in fits])
    sd = math.sqrt(float(weight @ doubts) + (DOUBT * remaining) ** 2)
    moved = float(weight @ [np.ptp(fit.fitted) for fit in fits])
    trusted = sd <= max(best.noise, TRUST * moved)
    return Extrapolation(value + last, sd, remaining, trusted, best.noise)


def judge(t: npt.ArrayLike, y: npt.ArrayLike, *, tolerance: float, window: float) -> Settling:
    """Judge a hold that has ended.

    Parameters
    ----------
    t : (T,) array_like
        Times of the hold in seconds, increasing, from its beginning.
    y : (T,) array_like
        Outputs; NaN where nothing was measured.
    tolerance : float
        Slope of a settled output, in the unit of the output per second.
    window : float
        Trailing time over which the slope is taken, in seconds.

    Returns
    -------
    Settling
    """
    line = trend(t, y, window)
    if line is None:
        values = _measured(t, y)[1]
        value = float(values[-1]) if values.size else math.nan
        return Settling(value, math.nan, "unsettled", math.nan, math.nan)
    end = extrapolate(t, y)
    known = line.is_below(tolerance)
    still = not known and is_still(t, y, window)
    slopes = (line.slope, line.slope_sd)
    if end is not None and end.trusted and not known:
        still = still and abs(end.remaining) <= HIDDEN * end.noise
        return Settling(end.value, end.sd, "settled" if still else "extrapolated", *slopes)
    if still:
        line = trend(t, y, STRETCH * window) or line
    way = FADING * float(np.ptp(t)) * abs(line.slope)
    if end is not None:
        way = max(way, abs(end.value - line.value))
    sd = math.hypot(line.sd, way)
    return Settling(line.value, sd, "settled" if known or still else "unsettled", *slopes)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares: ``spread`` times ``sd`` is the standard deviation of each weight."""

    weights: FloatArray
    spread: FloatArray
    fitted: FloatArray
    squares: float
    noise: float
    alike: float

    @property
    def sd(self) -> float:
        """Noise of a sample, raised where neighbouring residuals are alike."""
        return self.noise * math.sqrt(self.alike)


def _least_squares(rows: FloatArray, y: FloatArray) -> _Fit:
    q, r = np.linalg.qr(rows)
    inverse = np.linalg.inv(r)
    weights = inverse @ (q.T @ y)
    fitted = rows @ weights
    rest = y - fitted
    # Below rounding, residuals say nothing.
    squares = max(float(rest @ rest), y.size * (_ROUNDING * float(np.abs(y).max())) ** 2)
    noise = math.sqrt(squares / (y.size - weights.size))
    like = float(rest[1:] @ rest[:-1]) / squares if squares > 0 else 0.0
    like = min(max(like, 0.0), 0.98)
    spread = np.sqrt((inverse**2).sum(axis=1))
    return _Fit(weights, spread, fitted, squares, noise, (1 + like) / (1 - like))


def _decays(x: FloatArray, y: FloatArray, shares: tuple[float, ...]) -> _Fit:
    """Fit exponentials; ``x`` and the time constants are shares of the hold."""
    return _least_squares(np.column_stack([np.ones_like(x), *(np.exp(-x / s) for s in shares)]), y)


def _choices() -> list[tuple[float, ...]]:
    pairs = itertools.combinations(TIME_CONSTANTS, 2)
    return [*((share,) for share in TIME_CONSTANTS), *pairs]


def _likelihoods(fits: list[_Fit], count: int) -> FloatArray:
    """A weight for each fit, (fits,), summing to one."""
    squares = np.array([fit.squares for fit in fits])
    if not squares.all():
        return np.asarray((squares == 0) / np.count_nonzero(squares == 0), dtype=np.float64)
    unknowns = np.array([fit.weights.size for fit in fits])
    score = count * np.log(squares) + unknowns * math.log(count)
    independent = count / fits[int(np.argmin(score))].alike
    logarithm = -0.5 * (independent * np.log(squares) + unknowns * math.log(count))
    weight = np.exp(logarithm - logarithm.max())
    return np.asarray(weight / weight.sum(), dtype=np.float64)


def _measured(t: npt.ArrayLike, y: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    times, values = np.asarray(t, dtype=np.float64), np.asarray(y, dtype=np.float64)
    known = np.isfinite(values)
    return times[known], values[known]


def _trailing(t: FloatArray, y: FloatArray, window: float) -> tuple[FloatArray, FloatArray]:
    """Samples of the trailing window, and the last few where a slow meter gave no more."""
    if t.size == 0:
        return t, y
    first = int(np.argmax(t >= t[-1] - window * (1 + 1e-9)))
    first = min(first, max(t.size - _FEWEST, 0))
    return t[first:], y[first:]


def _thinned(t: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Means of neighbours, where there are more samples than a fit gains from."""
    width = -(-t.size // _MOST)
    if width <= 1:
        return t, y
    whole = t.size - t.size % width
    cut = slice(t.size - whole, None)
    return t[cut].reshape(-1, width).mean(axis=1), y[cut].reshape(-1, width).mean(axis=1)
