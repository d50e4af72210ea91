"""Summarise the residual of a fit: start-up, drift, step, and size by group, amplitude and rate."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.identification.offset_steps import MOST_ROWS, find_drift, find_offset_step
from minorloop.identification.rough_model import one_of_each
from minorloop.lab.noise import noise_of
from minorloop.threads import one_thread

_FEWEST = 30
"""Least residuals for a full summary; of fewer, only the worst is reported."""
_WINDOW, _SHARE_OF_ROWS, _SHARE_OF_ERROR = 100, 0.1, 0.3
"""A start-up ends when a window of one row in a hundred is as good as the later rows. It has at
most this share of the rows, and at least this share of the squared error."""
_SPANNED = 0.5
"""Least share of the range of the output over which a group determines a gain: with less, gain and
offset are extrapolated to more than twice the share, and cancel each other."""
PARTS = 3
"""Number of parts of equal size by amplitude, and by rate."""
_MOST = 50_000
"""Most samples whose errors are sorted by amplitude and rate."""


@dataclass(frozen=True)
class Startup:
    """Rows at the beginning that the model does not follow."""

    rows: int
    """Number of these rows."""
    largest: float
    """Largest error among them, in ranges of the output."""
    share: float
    """Share of the squared error of all fitted rows."""


@dataclass(frozen=True)
class OffsetStep:
    """A step: from a sample on, all outputs are shifted."""

    sample: int
    """First sample behind the step."""
    size: float
    """Change of the measured output against the model, in ranges."""


@dataclass(frozen=True)
class GroupDifference:
    """Differences between the outputs of groups and the model: an offset and a gain for each group.

    A group that spans less than half of the range of the output has only an offset.
    """

    groups: int
    """Number of groups."""
    share: float
    """Share of the squared error that the offsets and gains explain."""
    offset: float
    """Largest offset, in ranges."""
    gain: float
    """Largest difference of a gain from one; 0 if no group determines it."""


@dataclass(frozen=True, eq=False)
class ResidualSummary:
    """Summary of the residual on the fitted samples; errors are in ranges of the output."""

    worst_sample: int
    """Sample of the largest error."""
    worst: float
    """Largest error, model minus measured."""
    autocorrelation: float
    """Correlation of residuals of neighbouring samples; NaN for few samples."""
    startup: Startup | None = None
    """A start-up that the model does not follow."""
    drift: float = 0.0
    """Change of the measured output against the model along the record if it is steady, else 0."""
    step: OffsetStep | None = None
    """A shift of all outputs from a row on."""
    groups: GroupDifference | None = None
    """Differences between the groups, if they explain most of the error."""
    by_amplitude: tuple[tuple[float, float, float], ...] = ()
    """Tuple of (float, float, float). Samples by the size of their loop: least and greatest size,
    and error."""
    by_rate: tuple[tuple[float, float, float], ...] = ()
    """Tuple of (float, float, float). Samples by the change of the input to them: the same."""


def summary(
    u: FloatArray,
    error: FloatArray,
    used: BoolArray,
    y: FloatArray,
    basis: Callable[[IntArray], FloatArray],
    groups: IntArray | None = None,
) -> ResidualSummary:
    """Summarise the residual of a fit.

    ``u`` (T,): inputs, delayed as the output is; ``error`` (T,): model minus measured, in ranges of
    the output; ``used`` (T,) of bool: fitted samples without outliers; ``y`` (T,): measured
    outputs, in ranges; ``basis``: maps samples (M,) to functions of the memory (M, Q), such as
    those of a rough model; ``groups`` (T,) of int: number of the group of each row.
    """
    rows = np.flatnonzero(used)
    left = error[rows]
    worst = int(np.argmax(np.abs(left)))
    if rows.size < _FEWEST:
        return ResidualSummary(int(rows[worst]), float(left[worst]), float("nan"))
    startup = find_startup(left, rows)
    later = rows >= (startup.rows if startup else 0)
    rest, places = left[later], rows[later]
    differ = None if groups is None else _differences(rest, y[places], groups[places])
    step, drift = (None, 0.0) if differ else _step_or_drift(basis, rest, y[places], places)
    few = one_of_each(places.size, _MOST)
    some, error_of_some = places[few], rest[few]
    return ResidualSummary(
        int(rows[worst]),
        float(left[worst]),
        _autocorrelation(rest, places),
        startup,
        drift,
        step,
        differ,
        _by(amplitudes(u)[some], error_of_some),
        _by(np.abs(u[some] - u[np.maximum(some - 1, 0)]), error_of_some),
    )


def noise_in(error: FloatArray, y: FloatArray) -> float:
    """Return the standard deviation of the noise in a residual; the rest is an error of the model.

    Noise is the part that neighbours do not share. Noise fills gaps between readings. If there is
    still a gap, as by a bit of the converter that never changes, the residual has no noise.

    ``error`` (M,): residual of the fitted samples, model minus measured, in order; ``y`` (M,):
    measured outputs, in the same unit.
    """
    from scipy.special import ndtr

    sd = float(np.sqrt(np.mean(error**2)))
    if error.size < _FEWEST or sd == 0:
        return sd
    # Most readings in the search for gaps
    some = one_of_each(y.size, 800)
    ordered, model = np.sort(y[some]), (y + error)[some]
    # Least width of a gap between readings, in standard deviations of the residual, and number of
    # readings that the model expects in it: by chance, a gap between two states stays empty once in
    # sixty times
    gaps = np.flatnonzero(np.diff(ordered) > 2.0 * sd)
    low, high = ordered[gaps, None], ordered[gaps + 1, None]
    expected = (ndtr((high - model) / sd) - ndtr((low - model) / sd)).sum(axis=1)
    if expected.max(initial=0.0) > 6.0:
        return 0.0
    return min(noise_of(np.diff(error, 2), 2), sd)


def find_startup(error: FloatArray, rows: IntArray) -> Startup | None:
    """Find the first rows of a record if they have much of the squared error.

    ``error`` (M,): residual of the fitted samples in ranges; ``rows`` (M,): these samples.
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
    # Least ratio of the error of a start-up to that of later rows
    if np.sqrt(squares[count] / count) < 4.0 * usual:
        return None
    return Startup(int(rows[count]), largest, float(squares[count] / squares[-1]))


def _autocorrelation(error: FloatArray, rows: IntArray) -> float:
    """Correlation of the residuals of successive samples."""
    next_to = np.diff(rows) == 1
    centred = error - error.mean()
    square = float(np.mean(centred**2))
    if not next_to.any() or square == 0:
        return float("nan")
    return float(np.mean((centred[1:] * centred[:-1])[next_to]) / square)


def _step_or_drift(
    basis: Callable[[IntArray], FloatArray], error: FloatArray, y: FloatArray, rows: IntArray
) -> tuple[OffsetStep | None, float]:
    """Find a row from which on the outputs are shifted, or else their drift along the record.

    The fit may have absorbed part of the shift or drift.
    """
    some = one_of_each(rows.size, MOST_ROWS)
    columns, fitted, measured = basis(rows[some]), (y + error)[some], y[some]
    with one_thread():
        found = find_offset_step(columns, fitted, measured)
        if found is None:
            return None, find_drift(columns, measured)
    place, size = found
    return OffsetStep(int(rows[some[place]]), size), 0.0


def _differences(error: FloatArray, y: FloatArray, groups: IntArray) -> GroupDifference | None:
    """Return offsets and gains of the groups, if they explain most of the residual."""
    names = np.unique(groups)
    left, span = error.copy(), float(np.ptp(y))
    offsets, gains = [], []
    for name in names:
        rows = groups == name
        x = y[rows] - y.mean()
        if np.count_nonzero(rows) < 5:  # too few rows for a gain
            continue
        gain, offset = 0.0, float(error[rows].mean())
        if span and np.ptp(x) >= _SPANNED * span:
            gain, offset = np.polyfit(x, error[rows], 1)
        left[rows] -= offset + gain * x
        offsets.append(abs(float(offset)))
        gains.append(abs(float(gain)))
    squares = float(error @ error)
    if len(offsets) < 2 or squares == 0:
        return None
    share = 1 - float(left @ left) / squares
    if share < 0.5:  # offsets and gains explain less than half of the squared error
        return None
    return GroupDifference(len(names), share, max(offsets), max(gains))


def amplitudes(u: FloatArray) -> FloatArray:
    """(T,) distance of the turning points before and after each sample."""
    moved = np.flatnonzero(np.append(True, np.diff(u) != 0))
    way = np.sign(np.diff(u[moved]))
    turns = moved[np.flatnonzero(np.diff(way) != 0) + 1]
    ends = np.concatenate([[0], turns, [u.size - 1]])
    sizes = np.abs(np.diff(u[ends]))
    return np.asarray(sizes[np.clip(np.searchsorted(ends, np.arange(u.size)) - 1, 0, None)])


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
