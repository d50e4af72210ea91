"""What in a record is no honest measurement: codes, outliers, stuck and clipped stretches, lag."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.rough_model import basis, few, least_error, robust_fit, spread
from minorloop.operators.memory import Start
from minorloop.threads import one_thread

OVERLOAD = 9e36
"""Magnitude from which a reading is an overload code, as 9.9e37 and 9.91e37 are."""
SENTINELS = (
    *(-999.0, -9999.0, -99999.0, -999999.0, -9999999.0, -999.25, -999.9, -9999.9, -6999.0, -7999.0),
    *(9999.0, 99999.0, 999999.0, 9999999.0, 999.99, 9999.9, 9999.99, 99999.9, 7999.0),
    *(32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(1e20, -1e20, 1e30, -1e30, 1e35, -1e35),
)
"""Values that loggers and files write for a reading that they do not have."""
_CODE_APART = 0.25
"""Spans of the other readings by which a sentinel must lie outside them."""
_FEWEST = 12
_SHOWN = 6
_EQUAL = 1e-9
"""Share of the span by which two readings differ that count as equal."""

_FAR, _FAR_INPUT = 3.0, 30.0
"""Widths of the middle 90 % by which an outlier is outside, more where its input is outside."""

_WINDOWS, _SHORTEST, _FEWEST_SHARE = 12, 6, 25
_MOVING_SD, _MOVING, _LAZY = 2.0, 0.03, 0.28
_BINS, _LEAST_CHANGE = 12, 0.12
"""Bins of the input for usual slopes, and the change in spans that a stuck output misses."""

_LONGEST_LAG, _TURNS, _FEWEST_TURNS = 10, (6, 4, 3), 4
_BETTER, _BETTER_BY = 0.72, 0.007
"""Share of the error that a shift leaves, and spans that it gains, that tell of a lag."""
_OVERSHOOT, _OVERSHOOT_HINTED, _HINT = 0.02, 0.012, 0.85
"""Spans by which an output goes on that tell of a lag, fewer where a shift leaves that share."""


@dataclass(frozen=True)
class Code:
    """A reading that is a code of the instrument and no measurement.

    Parameters
    ----------
    sample : int
        Which, counted from 0.
    value : float
        The code.
    """

    sample: int
    value: float


@dataclass(frozen=True)
class Finding:
    """Something in a record that a model should not be made from.

    Parameters
    ----------
    kind : {"outlier", "stuck", "clipped", "lag"}
        What it is.
    samples : tuple of int
        Where, counted from 0; empty for a lag.
    text : str
        What it is and what to do, in one sentence.
    """

    kind: Literal["outlier", "stuck", "clipped", "lag"]
    samples: tuple[int, ...]
    text: str


def codes(y: FloatArray) -> tuple[Code, ...]:
    """Readings that are overload codes or sentinels, apart from all others.

    Parameters
    ----------
    y : (T,) array
        Outputs; NaN where nothing was measured.
    """
    suspect = np.abs(y) >= OVERLOAD
    tolerance = 1e-6 * np.abs(SENTINELS)
    for value, close in zip(SENTINELS, tolerance, strict=True):
        suspect |= np.abs(y - value) <= close
    suspect &= np.isfinite(y)
    rest = y[np.isfinite(y) & ~suspect]
    if not suspect.any() or rest.size < 3:
        return ()
    low, high = rest.min(), rest.max()
    apart = _CODE_APART * (high - low)
    suspect &= (y < low - apart) | (y > high + apart)
    return tuple(Code(int(k), float(y[k])) for k in np.flatnonzero(suspect))


def screened(
    u: FloatArray, y: FloatArray, start: Start, lag: int, *, sought: bool = False
) -> tuple[Finding, ...]:
    """What is wrong with a record, most important first.

    Parameters
    ----------
    u, y : (T,) arrays
        The record, without codes; y is NaN where nothing was measured.
    start : start state
        Memory before the first sample.
    lag : int
        Samples by which the model lets the output follow the input.
    sought : bool
        Whether that lag is the best of several; then none beyond it is looked for.

    Returns
    -------
    tuple of Finding
    """
    known = np.isfinite(y)
    known[:lag] = False
    if np.count_nonzero(known) < _FEWEST:
        return ()
    with one_thread():
        return _screened(u, y, known, start, lag, sought)


def _screened(
    u: FloatArray, y: FloatArray, known: BoolArray, start: Start, lag: int, sought: bool
) -> tuple[Finding, ...]:
    record = _Record.of(u, y, known, start, lag)
    found = [*_outliers(record)]
    sound = known.copy()
    for one in found:
        sound[list(one.samples)] = False
    if found:
        record = _Record.of(u, y, sound, start, lag)
    clipped = [*_clipped(record)]
    flat = [*clipped, *_stuck(record, {k for one in clipped for k in one.samples})]
    for one in flat:
        if one.kind == "stuck":
            sound[list(one.samples)] = False
    late = [] if sought else [*_lagging(record, sound)]
    if late:  # A lagging output has not begun yet at first.
        flat = [one for one in flat if one.kind != "stuck" or one.samples[-1] > _LONGEST_LAG]
    return (*found, *flat, *late)


@dataclass(frozen=True, eq=False)
class _Record:
    """A record with its rough model; places are the samples measured."""

    u: FloatArray
    y: FloatArray
    places: IntArray
    matrix: FloatArray
    rough: FloatArray
    span: float
    lag: int

    @classmethod
    def of(cls, u: FloatArray, y: FloatArray, known: BoolArray, start: Start, lag: int) -> _Record:
        """With the rough model fitted to the known samples."""
        heard = np.concatenate([np.full(lag, u[0]), u[: u.size - lag]])
        places = np.flatnonzero(known)
        matrix = basis(heard, start, places.size)
        low, high = np.percentile(y[places], [2, 98])
        rough = robust_fit(matrix, y, known)
        span = float(high - low) or float(np.ptp(y[places])) or 1.0
        return cls(heard, y, places, matrix, rough, span, lag)

    @property
    def values(self) -> FloatArray:
        return self.y[self.places]


def _outliers(record: _Record) -> Iterator[Finding]:
    """Readings far outside the others at inputs that are not."""
    out, far = _outside(record.values), _outside(record.u[record.places])
    # An input that goes beyond the others explains an output that does.
    places = record.places[out > _FAR + _FAR_INPUT * far]
    if not places.size or places.size > record.places.size // 10:
        return
    rest = record.y[np.setdiff1d(record.places, places)]
    word = "outlier" if places.size == 1 else "outliers"
    yield Finding(
        "outlier",
        tuple(map(int, places)),
        f"{places.size} {word}: {_listed(record.y, places)}; the other readings lie in "
        f"[{rest.min():.6g}, {rest.max():.6g}]. Repeat the measurement, or empty these cells, "
        "which counts as not measured",
    )


def _outside(values: FloatArray) -> FloatArray:
    """Distance outside the middle 90 % of the values, in widths of it."""
    low, high = np.percentile(values, [5, 95])
    width = float(high - low) or float(np.ptp(values)) or 1.0
    return np.asarray(np.maximum(np.maximum(low - values, values - high), 0) / width)


def _stuck(record: _Record, clipped: set[int]) -> Iterator[Finding]:
    """The stretch in which the output stays where, at such inputs, it otherwise moves."""
    values = record.values
    found = [
        (begin, end)
        for begin, end in (_longest_run(values), _laziest(record))
        if end - begin >= max(values.size // _FEWEST_SHARE, _SHORTEST - 1)
        and not clipped.issuperset(record.places[begin:end])
    ]
    changes = [(_usual_change(record, begin, end), begin, end) for begin, end in found]
    change, begin, end = next(
        (one for one in changes if one[0] >= _LEAST_CHANGE * record.span), (0.0, 0, 0)
    )
    if not change:
        return
    samples = record.places[begin:end]
    yield Finding(
        "stuck",
        tuple(map(int, samples)),
        f"the output is stuck at {np.median(values[begin:end]):.6g} from sample {samples[0]} to "
        f"{samples[-1]}, where such inputs otherwise change it by about {change:.3g}: check "
        "the sensor and the actuator, and measure again or empty these cells",
    )


def _longest_run(values: FloatArray) -> tuple[int, int]:
    """Begin and end of the longest run of equal values."""
    edges = np.flatnonzero(np.diff(values) != 0) + 1
    edges = np.concatenate([[0], edges, [values.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def _laziest(record: _Record) -> tuple[int, int]:
    """Begin and end of the stretch that moves least beside what the rough model says."""
    values, rough = record.values, record.rough[record.places]
    width = max(values.size // _WINDOWS, _SHORTEST)
    if values.size < 3 * width:
        return 0, 0
    step = max(width // 8, 1)
    of_rough, of_values = (
        np.lib.stride_tricks.sliding_window_view(part, width)[::step] for part in (rough, values)
    )
    moves, still = of_rough.std(axis=1), of_values.std(axis=1)
    moving = moves > max(_MOVING_SD * spread(values - rough), _MOVING * record.span)
    lazy = moving & (still < _LAZY * moves)
    if not lazy.any():
        return 0, 0
    best = int(np.argmax(np.where(lazy, moves - still, -np.inf)))
    return _stretch(values, best * step, width, 3 * float(still[best]) + _EQUAL * record.span)


def _usual_change(record: _Record, begin: int, end: int) -> float:
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
    """The longest stretch around a window in which the values stay as near to its middle."""
    middle = float(np.median(values[first : first + width]))
    near = np.abs(values - middle) <= allowed
    begin, end = first, first + width
    while begin > 0 and near[begin - 1]:
        begin -= 1
    while end < values.size and near[end]:
        end += 1
    return begin, end


def _clipped(record: _Record) -> Iterator[Finding]:
    """Extremes that many readings equal exactly, and that are reached at full slope."""
    values = record.values
    for word, extreme in (("highest", values.max()), ("lowest", values.min())):
        at = np.abs(values - extreme) <= _EQUAL * record.span
        count = int(np.count_nonzero(at))
        if count < max(4, 0.012 * values.size):
            continue
        near = ~at & (np.abs(values - extreme) <= 0.05 * record.span)
        others = np.unique(values[near], return_counts=True)[1]
        if count < 4 * others.max(initial=1) or not _abrupt(record, at, float(extreme)):
            continue
        samples = record.places[at]
        yield Finding(
            "clipped",
            tuple(map(int, samples)),
            f"the output is clipped: {count} readings equal the {word}, {extreme:.6g}, exactly, "
            f"first at sample {samples[0]}; the sensor or its range ends there, and the model "
            "knows nothing beyond. Use a wider range, or empty these cells",
        )


def _abrupt(record: _Record, at: BoolArray, extreme: float) -> bool:
    """Whether the extreme is entered at a slope that is usual elsewhere, and held while u moves."""
    values, u = record.values, record.u[record.places]
    entries = np.flatnonzero(at[1:] & ~at[:-1]) + 1
    held = np.flatnonzero(at[1:] & at[:-1])
    if not entries.size or not np.any(u[held] != u[held + 1]):
        return False
    usual = float(np.median(np.abs(np.diff(values[~at])))) if np.count_nonzero(~at) > 1 else 0.0
    before = np.maximum(entries - 3, 0)
    slope = np.abs(extreme - values[before]) / np.maximum(entries - before, 1)
    return bool(np.median(slope) > 0.15 * usual)


def _lagging(record: _Record, sound: BoolArray) -> Iterator[Finding]:
    """A shift with which the rough model does far better, or an output that turns late."""
    rows = np.flatnonzero(sound)
    size = record.y.size
    rows = few(rows[(rows >= _LONGEST_LAG + record.lag) & (rows < size - _LONGEST_LAG)])
    if rows.size < 2 * record.matrix.shape[1]:
        return
    shifts = range(-_LONGEST_LAG, _LONGEST_LAG + 1)
    errors = [least_error(record.matrix[rows - shift], record.y[rows]) for shift in shifts]
    here, best = errors[_LONGEST_LAG], int(np.argmin(errors))
    shift = shifts[best]
    better = errors[best] < _BETTER * here and here - errors[best] > _BETTER_BY * record.span
    late, overshoot = _late(record)
    hinted = shift > 0 and errors[best] < _HINT * here
    if overshoot > (_OVERSHOOT_HINTED if hinted else _OVERSHOOT):
        shift = late
        why = f"it goes on by {overshoot:.1%} of range after the input has turned"
    elif better and shift:
        why = (
            f"the error of a rough model falls from {here / record.span:.1%} to "
            f"{errors[best] / record.span:.1%} of range with it"
        )
    else:
        return
    way = "follows" if shift > 0 else "comes before"
    more = " more" if record.lag else ""
    todo = "it may help to shift one of the two columns"
    if record.lag + shift > 0:
        todo = f'lag="auto" or lag={record.lag + shift} (--lag auto) takes it into account'
    yield Finding(
        "lag",
        (),
        f"the output {way} the input by about {abs(shift)}{more} samples, a lag that the model "
        f"does not have: {why}; {todo}",
    )


def _late(record: _Record) -> tuple[int, float]:
    """How many samples the output goes on for after the input has turned, and how far, in spans.

    Without a lag an output that goes with its input turns with it, whatever its hysteresis.
    """
    sound = np.zeros(record.u.size, dtype=np.bool_)
    sound[record.places] = True
    for width in _TURNS:
        turns = _turns(record.u, sound, width)
        if turns.size >= _FEWEST_TURNS:
            break
    else:
        return 0, 0.0
    y = record.y
    before = np.sign(y[turns] - y[turns - width])
    after = before * (y[turns[None, :] + np.arange(1, width + 1)[:, None]] - y[turns])
    # Without the largest, so that one odd turn is no lag.
    mean = np.sort(after, axis=1)[:, :-1].mean(axis=1) / record.span
    last = int(np.argmax(mean))
    return last + 1, float(mean[last])


def _turns(u: FloatArray, sound: BoolArray, width: int) -> IntArray:
    """Where the input turns after and before so many sound samples of one direction."""
    way = np.sign(np.diff(u))
    turns = np.flatnonzero((way[1:] != way[:-1]) & (way[1:] != 0)) + 1
    turns = turns[(turns >= width) & (turns < u.size - width)]
    around = turns[:, None] + np.arange(-width, width)
    same = way[around] * np.repeat([1, -1], width) == way[turns - 1, None]
    kept = same.all(axis=1) & sound[around].all(axis=1) & sound[turns + width]
    return np.asarray(turns[kept])


def _listed(y: FloatArray, places: IntArray) -> str:
    shown = ", ".join(f"sample {k} ({y[k]:.6g})" for k in places[:_SHOWN])
    return shown if places.size <= _SHOWN else f"{shown} and {places.size - _SHOWN} more"
