"""Judge from the samples of a hold whether the output has settled, and extrapolate it if not.

A line through the trailing window gives the slope with its uncertainty. An output whose slope is
not known to be small is extrapolated by a fit of decaying exponentials with fixed, log-spaced time
constants. It also counts as settled if the whole hold shows that it hardly moves any more, or if it
cannot be distinguished from a constant and the exponentials predict little further change.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray

Verdict: TypeAlias = Literal["settled", "extrapolated", "unsettled"]

SPAN_SHARE = 0.002
"""A settled output moves by less than this share of the span of the outputs in another hold."""
_TAIL = 0.7
"""Last share of a hold, to which the exponentials are fitted: the faster decays of the first third
are often nonlinear."""
_TIME_CONSTANTS = tuple(np.geomspace(1 / 20, 1 / 2.5, 7).tolist())
"""Time constants to choose from, as shares of the hold."""
_SLOWER = 1.0
"""Time constant of a decay that is too slow to be extrapolated, as a share of the hold."""
_TRUST = 0.1
"""A limit is trusted up to an uncertainty of this share of the change of the fitted tail. A ramp,
which has no limit, exceeds it."""
_STRETCH = 2.5
"""Number of windows over which a noisy output has to be constant."""
FEWEST_STILL = 8
"""Least samples that distinguish movement from noise."""
_SLOW = 1 + len(_TIME_CONSTANTS)
"""Number of choices with the slower time constant: alone, and with each of the others."""
_FEWEST = 4
"""Least samples of a straight line: it leaves two degrees of freedom for the noise."""
_FEWEST_TAIL = 12
"""Least samples of a tail, by trial: four for each unknown of two decays with a limit."""
ENOUGH = math.ceil(_FEWEST_TAIL / _TAIL)
"""Least evenly spaced readings of a hold with such a tail: fewer noisy readings do not show whether
the output has settled."""
_ROUNDS = 20
"""Iterations of a fixed point that converges by half or faster in each."""
_ROUNDING = 1e-14
"""Residual over the output that is rounding: about fifty times the precision of float64."""


@dataclass(frozen=True)
class Trend:
    """A straight line through the trailing window."""

    value: float
    sd: float
    """``value`` and ``sd``: the line at the last sample and its standard deviation, in the unit of
    the output."""
    slope: float
    slope_sd: float
    """``slope`` and ``slope_sd``: slope of the line and its standard deviation, in the unit of the
    output per second."""

    def is_below(self, tolerance: float) -> bool:
        """Whether the slope is known to be at most the tolerance."""
        # Two standard deviations are added to the slope before the comparison
        return abs(self.slope) + 2.0 * self.slope_sd <= tolerance


@dataclass(frozen=True, eq=False)
class Extrapolation:
    """The limit of exponentials fitted to a hold."""

    value: float
    sd: float
    """``value`` and ``sd``: settled value and its standard deviation, in the unit of the output."""
    least_sd: float
    """Standard deviation without the possible rest of a slower decay."""
    remaining: float
    """Change from the end of the hold to the limit."""
    trusted: bool
    """Whether the limit is at least as certain as a single sample, or certain to a tenth of the
    change of the fitted tail."""
    noise: float
    """Standard deviation of a sample about the fit."""
    changes: FloatArray
    change_sds: FloatArray
    likelihoods: FloatArray
    """``changes``, ``change_sds`` and ``likelihoods``: shape (C,). For each choice of time
    constants, also with the slower one: the change of the output in another such hold, its standard
    deviation, and the likelihood of the choice; their sum is one."""

    def probability(self, limit: float) -> float:
        """Return the probability that another such hold changes the output by at most ``limit``."""
        from scipy.special import ndtr  # every command that reads a file would import it

        spread = np.maximum(self.change_sds, np.finfo(float).tiny)
        edges = np.array([[limit], [-limit]]) - self.changes
        upper, lower = ndtr(edges / spread)
        return float(self.likelihoods @ (upper - lower))


@dataclass(frozen=True)
class Settling:
    """Settled output at the end of a hold, with its uncertainty.

    Notes
    -----
    A hold shows only decays that are faster than itself. ``sd`` is reliable if the hold is at least
    four times the slowest relevant time constant; if the samples show a slower one, ``sd`` includes
    the whole extrapolated change. Decays slower than the hold, and an output that is about to
    reverse, look more settled than they are.
    """

    value: float
    sd: float
    """``value`` and ``sd``: estimate of the settled value and its standard deviation, in the unit
    of the output; NaN if not measured."""
    verdict: Verdict
    """``settled``: the slope is below the tolerance, and ``value`` is the end of the trend; or the
    limit of the exponentials and the change up to it are known to within the allowed change in
    another such hold, and ``value`` is the limit; or noise hides so small a change and a larger one
    is unlikely, and ``value`` is the limit if it is trusted, otherwise the end of a longer trend.
    ``extrapolated``: the output still moves, or noise hides whether it does, and ``value`` is the
    limit of the exponentials. ``unsettled``: the limit is not trusted; ``value`` is the end of the
    trend. If ``value`` is the end of the trend, ``sd`` includes the apparent further change."""
    slope: float
    slope_sd: float
    """``slope`` and ``slope_sd``: slope over the trailing window and its standard deviation, per
    second."""


def trend(t: npt.ArrayLike, y: npt.ArrayLike, window: float) -> Trend | None:
    """Fit a line to the samples of the trailing window, at least the last four.

    The uncertainty follows from the residuals; correlated neighbours count as fewer samples.

    It is None if there are fewer than four samples.

    ``t`` (T,): times in seconds, increasing; ``y`` (T,): outputs; NaN if not measured; ``window``:
    length of the window up to the last sample, in seconds.
    """
    times, values = _trailing(*_measured(t, y), window)
    if times.size < _FEWEST or times[-1] == times[0]:
        return None
    x = times - times[-1]
    rows = np.column_stack([np.ones_like(x), x])
    fit = _least_squares(_Basis.of(rows), values - values[-1])
    (value, slope), (sd, slope_sd) = fit.weights.tolist(), (fit.sd * fit.spread).tolist()
    return Trend(value + float(values[-1]), sd, slope, slope_sd)


def is_still(t: npt.ArrayLike, y: npt.ArrayLike, window: float) -> bool:
    """Whether an output cannot be distinguished from a constant with white noise.

    The slope over the last 2.5 windows must not be significant by Student's distribution.
    Neighbours must not be more similar than those of white noise, by the ratio of von Neumann
    (Distribution of the ratio of the mean square successive difference to the variance, 1941),
    whose distribution is approximated by a beta distribution of the same variance. An output that
    moves smoothly has similar neighbours. Parameters are as of `trend`.

    It is False if there are fewer than eight samples: seven samples of noise rise from first to
    last too often.
    """
    from scipy.special import betainc, stdtr

    times, values = _trailing(*_measured(t, y), _STRETCH * window)
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
    # Probability that the noise of a constant counts as movement, in each of two tests
    return bool(min(2 * stdtr(count - 2, -surprise), alike) >= 1e-4)


def extrapolate(t: npt.ArrayLike, y: npt.ArrayLike) -> Extrapolation | None:
    """Extrapolate a hold by y_inf + sum a_i exp(-t / tau_i), with signed a_i.

    Each choice of one or two ``_TIME_CONSTANTS`` is fitted by least squares. The choices are
    averaged by their likelihood with the penalty of Schwarz (Estimating the dimension of a model,
    1978). The spread between choices is part of the uncertainty. t and y are as of `judge`.

    It is None if the tail of the hold has fewer than twelve samples.
    """
    times, values = _measured(t, y)
    tail = times >= times[-1] - _TAIL * (times[-1] - times[0]) if times.size else slice(0)
    times, values = _thinned(times[tail], values[tail])
    if times.size < _FEWEST_TAIL or times[-1] == times[0]:
        return None
    x = _TAIL * (times - times[0]) / (times[-1] - times[0])
    last = float(values[-1])
    choices = _decays(x.tobytes())
    every = [_least_squares(choice.basis, values - last) for choice in choices]
    fits = every[:-_SLOW]
    weight = _likelihoods(fits, times.size)
    goals = np.array([fit.weights[0] for fit in fits])
    value = float(weight @ goals)
    best = fits[int(np.argmax(weight))]
    doubts = [(fit.sd * fit.spread[0]) ** 2 for fit in fits] + (goals - value) ** 2
    remaining = value - float(weight @ [fit.fitted[-1] for fit in fits])
    # Share of the extrapolated change that counts as uncertain: decays need not be exponential
    sd = math.sqrt(float(weight @ doubts) + (0.3 * remaining) ** 2)
    moved = float(weight @ [np.ptp(fit.fitted) for fit in fits])
    likelihoods = _likelihoods(every, times.size)
    # The longest time constant also fits a slower decay, which leaves a larger further change.
    away = [abs(fit.weights[0] - value) for fit in every[-_SLOW:]]
    pairs = list(zip(choices, every, strict=True))
    return Extrapolation(
        value=value + last,
        sd=math.hypot(sd, float(likelihoods[-_SLOW:] @ away)),
        least_sd=sd,
        remaining=remaining,
        trusted=sd <= max(best.noise, _TRUST * moved),
        noise=best.noise,
        changes=np.array([choice.ahead @ fit.weights for choice, fit in pairs]),
        change_sds=np.array([choice.ahead_spread * fit.sd for choice, fit in pairs]),
        likelihoods=likelihoods,
    )


def judge(t: npt.ArrayLike, y: npt.ArrayLike, *, tolerance: float, window: float) -> Settling:
    """Judge a finished hold.

    ``t`` (T,): times of the hold in seconds, increasing, from its beginning; ``y`` (T,): outputs;
    NaN if not measured; ``tolerance``: slope of a settled output, in the unit of the output per
    second; ``window``: trailing time for the slope, in seconds.
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
    if end is not None and not known:
        allowed = tolerance * float(np.ptp(_measured(t, y)[0]))
        left = abs(end.remaining)
        near = left <= allowed and end.least_sd <= allowed
        # Least probability of no further change, if noise hides whether the output still moves
        hidden = still and end.probability(allowed) >= 0.6
        if near or end.trusted or (still and not hidden):
            settled = near or (hidden and left <= allowed)
            verdict: Verdict = "settled" if settled else "extrapolated"
            return Settling(end.value, end.sd, verdict, *slopes)
    if still:
        line = trend(t, y, _STRETCH * window) or line
    # Assumed time constant of the slope at the end of a hold, as a share of the hold
    way = 0.5 * float(np.ptp(t)) * abs(line.slope)
    if end is not None:
        way = max(way, abs(end.value - line.value))
    sd = math.hypot(line.sd, way)
    return Settling(line.value, sd, "settled" if known or still else "unsettled", *slopes)


def settled_after(t: npt.ArrayLike, y: npt.ArrayLike, *, change: float, window: float) -> float:
    """Return the hold time after which the output would be settled, in seconds.

    The rest at the end of the hold is assumed to decay with the time constant of the slope there.
    The result is NaN if it is not known: too few samples, or an output that leaves its limit.

    ``t``, ``y``, ``window`` are as of `judge`; ``change``: allowed change of a settled output in
    another hold of this length, in its unit.
    """
    line, end = trend(t, y, window), extrapolate(t, y)
    if line is None or end is None or change <= 0 or not line.slope * end.remaining > 0:
        return math.nan
    held = enough = float(np.ptp(_measured(t, y)[0]))
    decay = end.remaining / line.slope
    for _ in range(_ROUNDS):
        moves = abs(line.slope) * enough  # in another hold with the present slope
        enough = held + decay * max(math.log(moves / change), 0.0)
    return enough


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
        """Noise of a sample, larger if neighbouring residuals are correlated."""
        return self.noise * math.sqrt(self.alike)


@dataclass(frozen=True, eq=False)
class _Basis:
    """Columns of a least-squares problem with their factors."""

    rows: FloatArray
    q: FloatArray
    inverse: FloatArray
    spread: FloatArray

    @classmethod
    def of(cls, rows: FloatArray) -> _Basis:
        q, r = np.linalg.qr(rows)
        inverse = np.linalg.inv(r)
        return cls(rows, q, inverse, np.sqrt((inverse**2).sum(axis=1)))


def _least_squares(basis: _Basis, y: FloatArray) -> _Fit:
    weights = basis.inverse @ (basis.q.T @ y)
    fitted = basis.rows @ weights
    rest = y - fitted
    # Residuals below rounding contain no information.
    squares = max(float(rest @ rest), y.size * (_ROUNDING * float(np.abs(y).max())) ** 2)
    noise = math.sqrt(squares / (y.size - weights.size))
    like = float(rest[1:] @ rest[:-1]) / squares if squares > 0 else 0.0
    like = min(max(like, 0.0), 0.98)
    return _Fit(weights, basis.spread, fitted, squares, noise, (1 + like) / (1 - like))


@dataclass(frozen=True, eq=False)
class _DecayChoice:
    """Exponentials with a choice of time constants: a constant and one column for each.

    ``ahead`` (unknowns,) times the weights is the change of the output in another such hold, with
    ``ahead_spread`` times the noise as standard deviation.
    """

    basis: _Basis
    ahead: FloatArray
    ahead_spread: float


@lru_cache(maxsize=4)
def _decays(grid: bytes) -> list[_DecayChoice]:
    """Return the choices at times (T,) that are shares of the hold; the slower ones come last.

    The holds of a plan have the same times, so the factors are used for all of them.
    """
    pairs = itertools.combinations(_TIME_CONSTANTS, 2)
    usual = [*((share,) for share in _TIME_CONSTANTS), *pairs]
    slower = [(_SLOWER,), *((share, _SLOWER) for share in _TIME_CONSTANTS)]
    return [_choice(np.frombuffer(grid), shares) for shares in [*usual, *slower]]


def _choice(x: FloatArray, shares: tuple[float, ...]) -> _DecayChoice:
    columns = [np.exp(-x / share) for share in shares]
    basis = _Basis.of(np.column_stack([np.ones_like(x), *columns]))
    ahead = [math.exp(-(_TAIL + 1) / share) - math.exp(-_TAIL / share) for share in shares]
    change = np.array([0.0, *ahead])
    return _DecayChoice(basis, change, float(np.linalg.norm(change @ basis.inverse)))


def _likelihoods(fits: list[_Fit], count: int) -> FloatArray:
    """Return a weight for each fit, (fits,), that sum to one."""
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
    """Return the samples of the trailing window, or the last few of a slow meter."""
    if t.size == 0:
        return t, y
    first = int(np.argmax(t >= t[-1] - window * (1 + 1e-9)))
    first = min(first, max(t.size - _FEWEST, 0))
    return t[first:], y[first:]


def _thinned(t: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means of neighbours, if there are more samples than a fit needs."""
    # Most samples of a tail in a fit, by trial; of more, neighbours are averaged first
    width = -(-t.size // 2000)
    if width <= 1:
        return t, y
    whole = t.size - t.size % width
    cut = slice(t.size - whole, None)
    return t[cut].reshape(-1, width).mean(axis=1), y[cut].reshape(-1, width).mean(axis=1)
