"""Stretches of a record in which the output does not move: stuck, and clipped."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import BoolArray, FloatArray
from minorloop.identification.rough_model import RecordFault, RoughRecord, one_of_each, spread
from minorloop.lab.frozen import frozen

_EQUAL = 1e-9
"""Readings that differ by less than this share of the span count as equal."""

_WINDOWS, _SHORTEST, _FEWEST_SHARE = 12, 6, 25
_MOST = 100_000
"""Most readings among which windows are compared."""
_MOVING_SD, _MOVING = 2.0, 0.03
"""Standard deviations of the residual, and share of the span, from which the output must move."""
_FLAT = 0.28
"""Largest share of the expected movement in a window that counts as flat."""
_BINS, _LEAST_CHANGE = 12, 0.12
"""Bins of the input for the usual slopes, and the expected change, in spans, from which an output
that does not move is stuck."""
_LEAST_OF_NOISE = 6.0
"""The same in standard deviations of the noise, for a noisy sensor that repeats itself exactly."""


def stuck(record: RoughRecord, clipped: set[int]) -> Iterator[RecordFault]:
    """Find stretches without motion of the output, although such inputs move it elsewhere.

    Those of a noisy sensor that repeats itself exactly may be short, and many. Of others, which
    may have noise, the longest is found.
    """
    values, repeated = record.values, frozen(record.values)
    exact = [
        (change, begin, end)
        for begin, end in repeated.runs
        if (change := _usual_change(record, begin, end)) >= _LEAST_OF_NOISE * repeated.noise
        and not clipped.issuperset(record.places[begin:end])
    ]
    if exact:
        yield _stuck(record, exact)
        return
    found = [
        (begin, end)
        for begin, end in (_longest_run(values), _least_moving(record))
        if end - begin >= max(values.size // _FEWEST_SHARE, _SHORTEST - 1)
        and not clipped.issuperset(record.places[begin:end])
        and not _before_it_moves(record, begin, end)
    ]
    changes = [(_usual_change(record, begin, end), begin, end) for begin, end in found]
    change, begin, end = next(
        (one for one in changes if one[0] >= _LEAST_CHANGE * record.span), (0.0, 0, 0)
    )
    if change:
        yield _stuck(record, [(change, begin, end)])


def _before_it_moves(record: RoughRecord, begin: int, end: int) -> bool:
    """Whether a stretch is the beginning, at an end of the outputs: small inputs move nothing.

    Such is a cold wire below its transformation.
    """
    level = np.median(record.values[begin:end])
    ends = record.values.min(), record.values.max()
    return begin == 0 and min(abs(level - end) for end in ends) <= _MOVING * record.span


def _stuck(record: RoughRecord, found: list[tuple[float, int, int]]) -> RecordFault:
    """Describe stretches, each with the usual change of the output, its begin and its end."""
    change, begin, end = found[0]
    samples = np.concatenate([record.places[first:last] for _, first, last in found])
    more = ""
    if len(found) > 1:
        more = f", the first of {len(found)} such stretches up to sample {samples[-1]}"
    return RecordFault(
        "stuck",
        tuple(map(int, samples)),
        f"the output is stuck at {np.median(record.values[begin:end]):.6g} from sample "
        f"{samples[0]} to {record.places[end - 1]}{more}; elsewhere such inputs change it by about "
        f"{change:.3g}: check the sensor and the actuator, and measure again or empty these cells",
    )


def _longest_run(values: FloatArray) -> tuple[int, int]:
    """Begin and end of the longest run of equal values."""
    edges = np.flatnonzero(np.diff(values) != 0) + 1
    edges = np.concatenate([[0], edges, [values.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def _least_moving(record: RoughRecord) -> tuple[int, int]:
    """Begin and end of the stretch that moves least in comparison with the rough model."""
    some = one_of_each(record.places.size, _MOST)
    values, rough = record.values[some], record.rough[record.places[some]]
    width = max(values.size // _WINDOWS, _SHORTEST)
    if values.size < 3 * width:
        return 0, 0
    step = max(width // 8, 1)
    of_rough, of_values = (
        np.lib.stride_tricks.sliding_window_view(part, width)[::step] for part in (rough, values)
    )
    moves, still = of_rough.std(axis=1), of_values.std(axis=1)
    moving = moves > max(_MOVING_SD * spread(values - rough), _MOVING * record.span)
    flat = moving & (still < _FLAT * moves)
    if not flat.any():
        return 0, 0
    best = int(np.argmax(np.where(flat, moves - still, -np.inf)))
    allowed = 3 * float(still[best]) + _EQUAL * record.span
    first, last = some[best * step], some[best * step + width - 1]
    return _stretch(record.values, int(first), int(last - first + 1), allowed)


def _usual_change(record: RoughRecord, begin: int, end: int) -> float:
    """Change of the output over a stretch, at slopes that other stretches exceed mostly."""
    u, values = record.u[record.places], record.values
    du, dy = np.diff(u), np.diff(values)
    middle = (u[1:] + u[:-1]) / 2 - u.min()
    bins = 2 * np.minimum(_BINS * middle / (np.ptp(u) or 1.0), _BINS - 1).astype(int) + (du > 0)
    other = du != 0
    other[max(begin - 1, 0) : end] = False
    slopes = np.zeros(2 * _BINS)
    for k in np.unique(bins[other]):
        some = other & (bins == k)
        if np.count_nonzero(some) > 1:
            slopes[k] = np.percentile(dy[some] / du[some], 25)
    steps = slice(begin, end - 1)
    path = np.cumsum(slopes[bins[steps]] * du[steps])
    return float(np.ptp(np.append(path, 0.0)))


def _stretch(values: FloatArray, first: int, width: int, allowed: float) -> tuple[int, int]:
    """Longest stretch around a window whose values stay within ``allowed`` of its median."""
    middle = float(np.median(values[first : first + width]))
    near = np.abs(values - middle) <= allowed
    begin, end = first, first + width
    while begin > 0 and near[begin - 1]:
        begin -= 1
    while end < values.size and near[end]:
        end += 1
    return begin, end


def clipped(record: RoughRecord) -> Iterator[RecordFault]:
    """Find extremes that many readings equal exactly, and that are reached at full slope."""
    values = record.values
    for word, extreme in (("highest", values.max()), ("lowest", values.min())):
        at = np.abs(values - extreme) <= _EQUAL * record.span
        count = int(np.count_nonzero(at))
        if count < max(4, 0.012 * values.size):
            continue
        near = ~at & (np.abs(values - extreme) <= 0.05 * record.span)
        others = np.unique(values[near], return_counts=True)[1]
        if count < 3 * others.max(initial=1) or not _abrupt(record, at, float(extreme)):
            continue
        samples = record.places[at]
        yield RecordFault(
            "clipped",
            tuple(map(int, samples)),
            f"the output is clipped: {count} readings equal the {word}, {extreme:.6g}, exactly, "
            f"first at sample {samples[0]}; there the range of the sensor ends, and the model is "
            "not valid beyond it. Use a wider range, or empty these cells",
        )


def _abrupt(record: RoughRecord, at: BoolArray, extreme: float) -> bool:
    """Whether the output reaches the extreme at a usual slope, and stays while u moves."""
    values, u = record.values, record.u[record.places]
    entries = np.flatnonzero(at[1:] & ~at[:-1]) + 1
    held = np.flatnonzero(at[1:] & at[:-1])
    if not entries.size or not np.any(u[held] != u[held + 1]):
        return False
    usual = float(np.median(np.abs(np.diff(values[~at])))) if np.count_nonzero(~at) > 1 else 0.0
    slope = np.zeros(entries.size)
    for back in (1, 3):
        slope = np.maximum(slope, np.abs(extreme - values[np.maximum(entries - back, 0)]) / back)
    return bool(np.median(slope) > 0.15 * usual)
