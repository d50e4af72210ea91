"""Find the holds of a raw log: stretches in which the input is constant but for its noise.

The input is cut where its mean changes (binary segmentation by the CUSUM statistic). Pieces of a
ramp or a sine are not holds: within them the input moves by about as much as to the next piece.

The slopes at the ends of holds show a drift of the sensor: the rest of a transient has the
direction of the step before the hold, and a drift is common to all holds.
"""

import itertools
from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray, as_finite, as_samples, check_magnitude
from minorloop.errors import ParameterError
from minorloop.lab.noise import noise_of
from minorloop.lab.settling import FEWEST_STILL

_SURE = 6.0
"""Standard deviations of noise: from the first, a change of the mean is a change of the input; up
to the second, the means of pieces with an outlier between them are equal."""
_WANDER = 0.08
"""Largest standard deviation of an input within a hold, without white noise, over the change to the
next piece. A rise by a quarter of this change has 0.07, hum seldom more than 0.05, the top of a
sine 0.2 to 0.5."""
_LAGS = (1, 4, 16, 64, 256)
"""Lags of the differences that are noise; the next lag is used if a shorter lag finds no holds."""
_LEAST_SD = 1e-9
_MOST_CUTS = 300
"""Most cuts of an input, in addition to two for each jump; a sweep would need many more."""
_LEAST_HOLDS, _HELD, _MOVING, _MOVES = 3, 0.6, 0.25, 0.01
"""Raw log: least number of holds, least share of the rows in them, least share of holds in which
the output moves, and least motion over its span."""


@dataclass(frozen=True)
class FoundHold:
    """A stretch of a log in which the input is constant."""

    begin: int
    end: int
    """``begin`` and ``end``: first sample, and the sample after the last."""
    level: float
    """Mean of the input."""
    sd: float
    """Standard deviation of the input about its mean."""


def find_holds(
    u: npt.ArrayLike, *, tolerance: float | None = None, fewest: int = FEWEST_STILL
) -> list[FoundHold]:
    """Return the holds of an input, in order.

    Raises a `SignalError` if the input is not one row of finite numbers up to 1e150; a
    `ParameterError` if the tolerance is negative.

    ``u`` (T,): the recorded input, with or without noise; ``tolerance``: changes of the input up to
    this size are noise; None estimates it; ``fewest``: least samples of a hold.
    """
    values = as_samples(u, name="u")
    check_magnitude("input", values)
    span = float(np.ptp(values)) if values.size else 0.0
    if values.ndim != 1 or values.size < fewest or span == 0:
        return []
    if tolerance is not None and as_finite("tolerance", tolerance) < 0:
        raise ParameterError(f"tolerance is {tolerance}; give a change of the input >= 0")
    if tolerance is not None:
        return _found(values, max(tolerance / _SURE, _LEAST_SD * span), fewest)
    best: list[FoundHold] = []
    for lag in _LAGS:
        if lag * fewest > values.size:
            break
        found = _found(values, _noise(values, span, lag), fewest)
        several = lag == 1 or len(found) >= _LEAST_HOLDS
        if several and _covered(found) > _covered(best):
            best = found
        if _covered(best) > values.size / 2:
            break
    return best


def _found(u: FloatArray, sd: float, fewest: int) -> list[FoundHold]:
    return _steady(u, _merged(u, _edges(u, sd, fewest), _SURE * sd, fewest), fewest)


def _covered(holds: list[FoundHold]) -> int:
    return sum(hold.end - hold.begin for hold in holds)


def looks_like_raw_log(t: npt.ArrayLike | None, u: npt.ArrayLike, y: npt.ArrayLike) -> str:
    """Return a sentence if a record is a raw log with holds and transients, otherwise "".

    ``t`` (T,): times in seconds, if known, only for the sentence; ``u`` and ``y`` (T,): input and
    output, NaN if not measured.
    """
    inputs, outputs = np.asarray(u, dtype=np.float64), np.asarray(y, dtype=np.float64)
    # Longer logs are reduced to 25000 means of neighbours
    width = max(-(-inputs.size // 25_000), 1)
    whole = inputs.size - inputs.size % width
    if width > 1:
        inputs, outputs = (
            part[:whole].reshape(-1, width).mean(axis=1) for part in (inputs, outputs)
        )
    held = find_holds(inputs)
    if len(held) < _LEAST_HOLDS or _covered(held) < _HELD * inputs.size:
        return ""
    known = outputs[np.isfinite(outputs)]
    span = float(np.ptp(known)) if known.size else 0.0
    if np.mean([_moves(outputs[hold.begin : hold.end], span) for hold in held]) < _MOVING:
        return ""
    length = width * float(np.median([hold.end - hold.begin for hold in held]))
    typical = f"about {length:.0f} samples"
    if t is not None:
        times = np.asarray(t, dtype=np.float64)[::width]
        seconds = np.median([times[hold.end - 1] - times[hold.begin] for hold in held])
        typical += f" ({seconds:.3g} s)"
    return (
        f"this looks like a raw log: {np.size(u)} samples with {len(held)} holds of {typical}, in "
        "which the output still moves; reduce it to settled points first (minorloop reduce)"
    )


def turning_points(values: FloatArray, threshold: float) -> IntArray:
    """Return the samples at which a signal reverses by more than a threshold.

    ``values`` (T,): the signal; ``threshold``: smaller reversals are noise.
    """
    way = np.sign(np.diff(values))
    moving = np.flatnonzero(way)
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    found: list[int] = []
    extreme, last = 0, 0  # the extreme so far, and the direction that leads to it
    for place in [*turns.tolist(), values.size - 1]:
        change = values[place] - values[extreme]
        if last == 0 or change * last > 0:
            if abs(change) > threshold or last != 0:
                last = last or (1 if change > 0 else -1)
                extreme = place
        elif abs(change) > threshold:
            found.append(extreme)
            extreme, last = place, -last
    return np.array(found, dtype=np.int64)


def _noise(u: FloatArray, span: float, lag: int) -> float:
    """Return the standard deviation of the noise, at least that of a coarse last digit.

    Lag 1 takes second differences; a longer lag takes differences, which include hum.
    """
    steps = np.abs(np.diff(u))
    digit = float(steps[steps > 1e-12 * span].min(initial=span))
    apart = np.diff(u, 2) / np.sqrt(3) if lag == 1 else u[lag:] - u[:-lag]
    sd = noise_of(apart, 1) if apart.size else 0.0
    # The noise of a quantised input counts as at most a thousandth of its span
    return max(sd, min(digit / 2, span / 1000), _LEAST_SD * span)


def _edges(u: FloatArray, sd: float, fewest: int) -> list[int]:
    """Return where the mean changes, with both ends."""
    # Standard deviations from which a difference of neighbours is a change of the input
    jumps = np.flatnonzero(np.abs(np.diff(u)) > 10.0 * sd) + 1
    edges = [0, *jumps.tolist(), u.size]
    sums = np.concatenate([[0.0], np.cumsum(u - u.mean())])
    queue = deque(itertools.pairwise(edges))
    cuts = set(edges)
    most = _MOST_CUTS + 2 * len(edges)
    while queue and len(cuts) < most:
        begin, end = queue.popleft()
        count = end - begin
        if count < 2 * fewest:
            continue
        left = np.arange(1, count)
        excess = sums[begin + 1 : end] - sums[begin] - left / count * (sums[end] - sums[begin])
        surprise = np.abs(excess) * np.sqrt(count / (left * (count - left)))
        best = int(np.argmax(surprise))
        if surprise[best] > _SURE * sd:
            middle = begin + 1 + best
            cuts.add(middle)
            queue.extend([(begin, middle), (middle, end)])
    return sorted(cuts)


def _merged(u: FloatArray, edges: list[int], least: float, fewest: int) -> list[tuple[int, int]]:
    """Return the pieces; merge long pieces of equal mean with at most an outlier between them."""
    kept: list[tuple[int, int]] = []
    latest, level = -1, np.nan  # the latest long piece
    for begin, end in itertools.pairwise(edges):
        first = begin
        if end - begin >= fewest:
            mean = float(u[begin:end].mean())
            if latest >= 0 and begin - kept[latest][1] < fewest and abs(mean - level) <= least:
                first = kept[latest][0]
                del kept[latest:]
            latest, level = len(kept), mean
        kept.append((first, end))
    return kept


def _steady(u: FloatArray, pieces: list[tuple[int, int]], fewest: int) -> list[FoundHold]:
    """Return the long pieces in which the input does not move."""
    pieces = [(a, b) for a, b in pieces if b - a >= fewest]
    if not pieces:
        return []
    levels = np.array([np.median(u[a:b]) for a, b in pieces])
    steps = np.abs(np.diff(levels))
    around = np.full((2, levels.size), np.inf)
    around[0, 1:], around[1, :-1] = steps, steps
    least = around.min(axis=0)
    moved = np.array([_wander(u[a:b]) for a, b in pieces]) / np.maximum(least, 1e-300)
    if np.median(moved) > _WANDER:
        return []
    return [
        FoundHold(a, b, float(u[a] + (u[a:b] - u[a]).mean()), float(u[a:b].std()))
        for (a, b), share in zip(pieces, moved, strict=True)
        if share <= 2 * _WANDER
    ]


def _wander(values: FloatArray) -> float:
    """Return the standard deviation without white noise, which neighbouring differences show."""
    white = float(np.mean(np.diff(values) ** 2)) / 2
    return float(np.sqrt(max(float(values.var()) - white, 0.0)))


def _moves(y: FloatArray, span: float) -> bool:
    """Whether an output moves within a hold by more than its noise."""
    values = y[np.isfinite(y)]
    if values.size < FEWEST_STILL:
        return False
    part = max(values.size // 8, 1)
    noise = noise_of(np.diff(values), 1)
    change = abs(float(values[:part].mean() - values[-part:].mean()))
    return bool(change > max(_MOVES * span, 4 * noise * np.sqrt(2 / part)))
