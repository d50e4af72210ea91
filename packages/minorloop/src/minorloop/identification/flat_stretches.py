"""Stretches of a record in which the output does not move: a stuck or clipped output."""

from collections.abc import Iterator

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.identification.cut_outputs import cut_depth
from minorloop.identification.rough_model import RoughRecord, one_of_each
from minorloop.lab import faults
from minorloop.lab.faults import Fault
from minorloop.lab.noise import frozen, noise_above_resolution, noise_of, spread

_EQUAL = 1e-9
"""Readings that differ by less than this share of the span count as equal."""

_WINDOWS, _SHORTEST, _FEWEST_SHARE = 12, 6, 25
_MOST = 100_000
"""Most readings in the comparison of windows."""
_MOVING_SD, _MOVING = 2.0, 0.03
"""Standard deviations of the residual, and share of the span, from which the output must move."""
_BINS, _LEAST_CHANGE = 12, 0.12
"""Bins of the input for the usual slopes; and least expected change, in spans, at which an output
that does not move is stuck."""
_LEAST_OF_NOISE = 6.0
"""Least expected change in deviations of the noise, for a noisy sensor with exact repetitions."""

_WIDTHS = np.array(
    [_EQUAL, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 0.012, 0.018, 0.025, 0.035, 0.05, 0.07, 0.1, 0.14]
)
"""Widths of a rail to try, in spans: up to six standard deviations of noise."""
_FEWEST, _LEAST_PATH = 4, 0.1
"""Least readings at a rail (inputs, unless the record is coarse), and least range of these inputs
over that of all: below its threshold an actuator also rests, at one or two inputs of a plan."""
_BELOW, _MORE, _DENSER, _LIKELY = 0.06, 1.5, 2.0, -0.5
"""Least width of each of two bands below a rail, in spans; least ratio of the readings at the rail
to those in the lower band; largest ratio of those in the upper to the lower band; and least
logarithm of the likelihood ratio of a clipped to a saturating output, by the depths in both."""


def stuck(record: RoughRecord, clipped: set[int]) -> Iterator[Fault]:
    """Find stretches without motion of the output, although such inputs move it elsewhere.

    If a noisy sensor repeats its reading exactly, all stretches are found, also short ones. Of
    other stretches, which may have noise, the longest is found.
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
    """Whether a stretch is the beginning, at an end of the outputs, where small inputs do nothing.

    An example is a cold wire below its transformation.
    """
    level = np.median(record.values[begin:end])
    ends = record.values.min(), record.values.max()
    return begin == 0 and min(abs(level - end) for end in ends) <= _MOVING * record.span


def _stuck(record: RoughRecord, found: list[tuple[float, int, int]]) -> Fault:
    """Describe stretches, each with the usual change of the output, its begin and its end."""
    stretches = [record.places[begin:end] for _, begin, end in found]
    change = f"elsewhere such inputs change it by about {found[0][0]:.3g}"
    return faults.stuck(record.y, stretches, change)


def _longest_run(values: FloatArray) -> tuple[int, int]:
    """Begin and end of the longest run of equal values."""
    edges = np.flatnonzero(np.diff(values) != 0) + 1
    edges = np.concatenate([[0], edges, [values.size]])
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def _least_moving(record: RoughRecord) -> tuple[int, int]:
    """Begin and end of the stretch with the least motion in comparison with the rough model."""
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
    # Largest share of the expected movement in a window that counts as flat
    flat = moving & (still < 0.28 * moves)
    if not flat.any():
        return 0, 0
    best = int(np.argmax(np.where(flat, moves - still, -np.inf)))
    allowed = 3 * float(still[best]) + _EQUAL * record.span
    first, last = some[best * step], some[best * step + width - 1]
    return _stretch(record.values, int(first), int(last - first + 1), allowed)


def _usual_change(record: RoughRecord, begin: int, end: int) -> float:
    """Change of the output over a stretch, with the 25th percentiles of the slopes elsewhere."""
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


def clipped(record: RoughRecord) -> Iterator[Fault]:
    """Find extremes where the output suddenly stays within its noise while the input continues.

    With little noise or few inputs, the density of the readings shows this; with more noise, the
    shape of the branches. If noisy readings are dense, the branches must not contradict it.
    """
    u, size, places = _landings(record)
    y, noise = record.y[places], noise_of(np.diff(record.values, 2), 2)
    for word, way in (("highest", 1), ("lowest", -1)):
        depth = float((way * record.values).max()) - way * record.values
        live = noise_above_resolution(record.values[depth > _EQUAL * record.span]) > 0
        width = _rail(way * u, way * y, way * size, record.span, noise, live)
        if width is None or width > _EQUAL * record.span:
            cut = cut_depth(record, way, rail=width is not None)
            width = cut and (width or cut)
        if width is None:
            continue
        yield faults.clipped(record.y, record.places[depth <= width], word)


def _landings(record: RoughRecord) -> tuple[FloatArray, FloatArray, IntArray]:
    """Inputs, the changes that led to them, and the last measured row of each constant input."""
    change = np.diff(record.u, prepend=record.u[:1])
    change[record.curves.begins] = 0.0
    number = np.cumsum(change != 0)
    places = record.places[np.append(np.diff(number[record.places]) != 0, True)]
    return record.u[places], np.append(0.0, change[change != 0])[number[places]], places


def _rail(
    u: FloatArray, y: FloatArray, size: FloatArray, span: float, noise: float, live: bool
) -> float | None:
    """Width of a rail above, in the unit of the output; None without one.

    ``u`` and ``y`` (N,): inputs and outputs; ``size`` (N,): changes that led to the inputs;
    ``span`` and ``noise``: range of the output, and standard deviation of its noise; ``live``:
    whether the readings elsewhere have noise, so that equal readings are a rail.
    """
    up = size > 0
    step = float(np.median(size[up])) if up.any() else 1.0
    # With fewer rising inputs, hardly any lie just below a rail; with longer usual steps, over the
    # range of the input, the last step to a rail shows nothing
    coarse = np.count_nonzero(up) < 35 and step < 0.2 * np.ptp(u)
    weights = np.minimum(size / step, 1.0)
    depth = y.max() - y
    for width in map(float, _WIDTHS * span):
        at = depth <= width if coarse else up & (depth <= width)
        count = np.count_nonzero(at) if coarse else np.unique(u[at]).size
        if count < _FEWEST:
            continue
        beyond = up & (u >= np.median(u[at]))
        # Inputs beyond the median of those at the rail must lead to the rail in half of the cases
        if np.count_nonzero(at & beyond) < 0.5 * np.count_nonzero(beyond):
            continue  # stuck: such inputs move the output elsewhere
        if width <= _EQUAL * span and live:
            return width
        if np.ptp(u[at]) < _LEAST_PATH * np.ptp(u):
            continue
        # Largest scatter of the readings at a rail over the noise, and their rise over the width
        noisy = y[at].std() <= 1.35 * noise + _EQUAL * span
        if not noisy or _rise(u[at], y[at]) > 0.35 * width:
            continue
        if coarse:
            # Least size of the last step to a rail in a coarse record, in spans
            found = _abrupt(u, depth, width) > 0.03 * span
        else:
            found = _sudden(depth[up], weights[up], width, span)
        if found:
            return width
    return None


def _rise(u: FloatArray, y: FloatArray) -> float:
    """Rise of a straight line through readings, over the range of their inputs."""
    centred = u - u.mean()
    return abs(float(centred @ y)) / float(centred @ centred) * float(np.ptp(u))


def _sudden(depth: FloatArray, weights: FloatArray, width: float, span: float) -> bool:
    """Whether many readings are at a rail, and readings below it are not denser towards it.

    The readings of a clipped output are evenly dense. If an output saturates exponentially, their
    density is in inverse proportion to their depth.
    """
    band = max(_BELOW * span, 2 * width)
    edges = np.array([0.0, width, width + band, width + 2 * band])
    above = [float(weights[depth <= edge].sum()) for edge in edges[1:]]
    at, upper, lower = above[0], above[1] - above[0], above[2] - above[1]
    below = (depth > width) & (depth <= edges[-1])
    ratios = np.log(depth[below] * np.log1p(2 * band / width) / (2 * band))
    denser = upper > _DENSER * (lower + 0.5) or weights[below] @ ratios < _LIKELY
    return bool(at >= _MORE * max(lower, 1.0) and not denser)


def _abrupt(u: FloatArray, depth: FloatArray, width: float) -> float:
    """Mean rise of the last steps to a rail, 0 if no step leads there."""
    entries = np.flatnonzero((depth[1:] <= width) & (depth[:-1] > width) & (np.diff(u) > 0))
    return float(np.mean(depth[entries])) - width if entries.size else 0.0
