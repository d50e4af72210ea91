"""Kinds of damage to a record of a plant: of the sensor, the actuator, the clock and the log.

Each takes a `Case` and a generator of random numbers and gives inputs and outputs as the log of
such a record has them. The actuator gets other inputs than the log says where the source fails.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks._plants import Array, Case

Damage = Callable[[Case, np.random.Generator], tuple[Array, Array]]


@dataclass(frozen=True)
class Kind:
    """A kind of damage, words of an advice that names its cause, and why no record can show it.

    ``unseen`` is empty for kinds that a record shows.
    """

    damage: Damage
    words: tuple[str, ...]
    unseen: str = ""


def applied(case: Case, u: Array) -> tuple[Array, Array]:
    """The log, where the actuator got other inputs than it has."""
    return case.u, case.y + case.output(u) - case.output(case.u)


def _part(size: int, share: float, rng: np.random.Generator) -> slice:
    """A contiguous part of the rows, anywhere."""
    count = int(share * size)
    first = int(rng.integers(size - count))
    return slice(first, first + count)


def _place(size: int, rng: np.random.Generator) -> int:
    """A row in the middle 60 %."""
    return int(size * rng.uniform(0.2, 0.8))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1, 1]))


def _clip(values: Array, rng: np.random.Generator) -> Array:
    """Values without 12 to 30 % of their range at one end or both."""
    low, high = values.min(), values.max()
    cut, ends = rng.uniform(0.12, 0.3) * (high - low), int(rng.integers(3))
    return np.clip(values, low + cut if ends != 1 else low, high - cut if ends != 0 else high)


def clipped(noise: float) -> Damage:
    """A sensor at the ends of its range; ``noise`` in ranges is added behind it."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        y = _clip(case.y, rng)
        return case.u, y + noise * case.span * rng.normal(size=y.size)

    return damage


def clipped_far(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sensor that ends 30 to 40 % below or above an end of the output, before larger noise."""
    y, side = case.output(case.u), _sign(rng)
    limit = (side * y).max() - rng.uniform(0.3, 0.4) * np.ptp(y)
    y = side * np.minimum(side * y, limit)
    return case.u, y + rng.uniform(0.01, 0.02) * case.span * rng.normal(size=y.size)


def limited(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A source that cannot give all that the log says."""
    return applied(case, _clip(case.u, rng))


def outliers(count: int, ranges: float) -> Damage:
    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        y = case.y.copy()
        some = rng.choice(y.size, count, replace=False)
        y[some] += ranges * case.span * rng.choice([-1, 1], count)
        return case.u, y

    return damage


def readings(values: Callable[[Case], float], share: float) -> Damage:
    """Some readings, three at least, are a value that the logger writes for none."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        y = case.y.copy()
        y[rng.choice(y.size, max(3, int(share * y.size)), replace=False)] = values(case)
        return case.u, y

    return damage


def late(rows: int) -> Damage:
    """The output so many rows later than the input, or earlier."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        where = np.clip(np.arange(case.y.size) - rows, 0, case.y.size - 1)
        return case.u, case.y[where]

    return damage


def low_pass(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sensor of first order, with a time constant of 3 to 10 rows."""
    share, y = 1 / rng.uniform(3, 10), case.y.copy()
    for k in range(1, y.size):
        y[k] = y[k - 1] + share * (case.y[k] - y[k - 1])
    return case.u, y


def averaging(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A mean of the last 5 to 15 readings."""
    sums = np.cumsum(np.concatenate([np.full(15, case.y[0]), case.y]))
    count = int(rng.integers(5, 16))
    return case.u, (sums[15:] - sums[15 - count : sums.size - count]) / count


def slow_source(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A source that changes by at most a third to a whole of the usual step."""
    most = rng.uniform(0.33, 1) * float(np.mean(np.abs(np.diff(case.u))))
    u = case.u.copy()
    for k in range(1, u.size):
        u[k] = u[k - 1] + np.clip(case.u[k] - u[k - 1], -most, most)
    return applied(case, u)


def added(shape: Callable[[Array, np.random.Generator], Array]) -> Damage:
    """A sensor whose zero follows ``shape`` along the record, 0 to 1."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        along = np.linspace(0, 1, case.y.size)
        return case.u, case.y + _sign(rng) * case.span * shape(along, rng)

    return damage


def gain(shape: Callable[[Array, np.random.Generator], Array]) -> Damage:
    """A sensor whose gain follows ``shape`` along the record; its zero is anywhere."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        along = np.linspace(0, 1, case.y.size)
        zero = case.y.min() + rng.uniform(-0.5, 1.5) * case.span
        return case.u, zero + shape(along, rng) * (case.y - zero)

    return damage


def stuck(noise: bool) -> Damage:
    """The sensor, for a fifth of the rows."""

    def damage(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
        y, rows = case.y.copy(), _part(case.y.size, 0.2, rng)
        y[rows] = y[rows.start]
        if noise:
            y[rows] += case.noise * rng.normal(size=rows.stop - rows.start)
        return case.u, y

    return damage


def stuck_source(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    u, rows = case.u.copy(), _part(case.u.size, 0.2, rng)
    u[rows] = u[rows.start]
    return applied(case, u)


def sample_and_hold(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Readings that are new in a tenth of the rows only, and are repeated else."""
    new = rng.uniform(size=case.y.size) < 0.1
    new[0] = True
    return case.u, case.y[np.maximum.accumulate(np.where(new, np.arange(new.size), 0))]


def interpolated(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Four gaps of a fifteenth of the rows each, filled with straight lines by the logger."""
    y = case.y.copy()
    for _ in range(4):
        rows = _part(y.size, 1 / 15, rng)
        y[rows] = np.linspace(y[rows.start], y[rows.stop], rows.stop - rows.start)
    return case.u, y


def without_rows(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A log without a fifth of its rows in a piece, and without one in twenty elsewhere."""
    kept = rng.uniform(size=case.y.size) > 0.05
    kept[_part(kept.size, 0.2, rng)] = False
    return case.u[kept], case.y[kept]


def outputs_lost(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A logger that loses some outputs, and moves the later ones up."""
    kept = np.ones(case.y.size, dtype=bool)
    first = _place(kept.size, rng)
    kept[first : first + int(rng.integers(3, 15))] = False
    y = case.y[kept]
    return case.u[: y.size], y


def repeated_rows(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A log with a tenth of its rows twice, one block behind the other."""
    rows = _part(case.y.size, 0.1, rng)
    order = np.insert(np.arange(case.y.size), rows.stop, np.arange(rows.start, rows.stop))
    return case.u[order], case.y[order]


def repeated_outputs(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A buffer of outputs that was read twice."""
    rows = _part(case.y.size, 0.05, rng)
    order = np.insert(np.arange(case.y.size), rows.stop, np.arange(rows.start, rows.stop))
    return case.u, case.y[order][: case.y.size]


def shuffled(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Eight blocks of rows in another order."""
    blocks = np.array_split(np.arange(case.y.size), 8)
    order = np.concatenate([blocks[k] for k in rng.permutation(8)])
    return case.u[order], case.y[order]


def shuffled_outputs(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Two of eight blocks of outputs exchanged."""
    blocks = np.array_split(np.arange(case.y.size), 8)
    one, other = rng.choice(8, 2, replace=False)
    blocks[one], blocks[other] = blocks[other], blocks[one]
    return case.u, case.y[np.concatenate(blocks)]


def two_clocks(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Outputs by a clock that is 1 to 5 % fast."""
    rows = np.arange(case.y.size)
    return case.u, np.interp(rows * (1 - rng.uniform(0.01, 0.05)), rows, case.y)


def jitter(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Outputs that are read up to four rows too late, each by another time."""
    rows = np.arange(case.y.size)
    return case.u, np.interp(rows - rng.uniform(0, 4, rows.size), rows, case.y)


def swapped(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """The columns exchanged."""
    return case.y, case.u


def inverted(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    return case.u, -case.y


def inverted_input(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    return -case.u, case.y


def inverted_later(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A cable that was exchanged during the record."""
    y = case.y.copy()
    y[_place(y.size, rng) :] *= -1
    return case.u, y


def coarse(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A resolution of the output of a fourth to an eighth of its range."""
    step = np.ptp(case.y) / int(rng.integers(4, 9))
    return case.u, step * np.round(case.y / step)


def coarse_input(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Inputs that are logged with a resolution of a fourth to an eighth of their range."""
    step = np.ptp(case.u) / int(rng.integers(4, 9))
    return step * np.round(case.u / step), case.y


def hum(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sine of 0.1 to 0.4 ranges and any period above two rows."""
    phase = 2 * np.pi * (rng.uniform(0.02, 0.45) * np.arange(case.y.size) + rng.uniform())
    return case.u, case.y + rng.uniform(0.1, 0.4) * case.span * np.sin(phase)


def spikes(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Pulses of 0.3 to 2 ranges in one to five of a hundred rows, all of one sign."""
    hit = rng.uniform(size=case.y.size) < rng.uniform(0.01, 0.05)
    return case.u, case.y + _sign(rng) * hit * rng.uniform(0.3, 2, hit.size) * case.span


def noisy(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Noise of 0.2 to 0.6 ranges."""
    return case.u, case.y + rng.uniform(0.2, 0.6) * case.span * rng.normal(size=case.y.size)


def heavy_noise(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Noise of Cauchy's distribution, 0.02 to 0.1 ranges wide."""
    return case.u, case.y + rng.uniform(0.02, 0.1) * case.span * rng.standard_cauchy(case.y.size)


def shifted_source(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A source whose zero moves by 0.1 to 0.3 ranges during the record."""
    u = case.u.copy()
    u[_place(u.size, rng) :] += _sign(rng) * rng.uniform(0.1, 0.3) * np.ptp(u)
    return applied(case, u)


def weaker_source(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A source that gives 0.4 to 0.8 of the change from a row on."""
    u, first = case.u.copy(), _place(case.u.size, rng)
    u[first:] = u[0] + rng.uniform(0.4, 0.8) * (u[first:] - u[0])
    return applied(case, u)


def source_glitches(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A source that goes to zero for some rows, five times, and the log does not show it."""
    u = case.u.copy()
    for _ in range(5):
        u[_part(u.size, 0.02, rng)] = case.u[0]
    return applied(case, u)


def folded(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """An optical sensor beyond its focus: readings fall again above 0.6 to 0.85 of the range."""
    top = case.y.min() + rng.uniform(0.6, 0.85) * np.ptp(case.y)
    return case.u, top - np.abs(top - case.y)


def wrapped(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A counter that begins again above 0.4 to 0.8 of the range."""
    width = rng.uniform(0.4, 0.8) * np.ptp(case.y)
    return case.u, case.y.min() + np.mod(case.y - case.y.min(), width)


def dead_bit(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A converter of which one of the three highest bits is always 0."""
    bit = np.ptp(case.y) / 2 ** float(rng.integers(1, 4))
    above = case.y - case.y.min()
    return case.u, case.y - bit * (np.floor(above / bit) % 2)


def dead_zone(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sensor that reads the same within 0.15 to 0.3 of the range."""
    low = case.y.min() + rng.uniform(0.15, 0.55) * np.ptp(case.y)
    inside = np.clip(case.y - low, 0, rng.uniform(0.15, 0.3) * np.ptp(case.y))
    return case.u, case.y - inside


def other_plant(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """Another specimen in the second part: hysteresis four times, gain 0.7 to 1.3 times."""
    first, x = _place(case.y.size, rng), (case.u - case.u[0]) / np.ptp(case.u)
    radius, place, play = rng.uniform(0.1, 0.3), float(x[0]), np.empty(x.size)
    for k, value in enumerate(x):
        place = min(max(place, value - radius), value + radius)
        play[k] = place
    y = case.y.copy()
    y[first:] = case.y.min() + np.ptp(case.y) * rng.uniform(0.7, 1.3) * play[first:]
    return case.u, y


def backwards(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """The last row first."""
    return case.u[::-1], case.y[::-1]


def slack(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A mount of the sensor with a play of 0.1 to 0.25 ranges."""
    half, place, y = rng.uniform(0.05, 0.125) * case.span, float(case.y[0]), np.empty(case.y.size)
    for k, value in enumerate(case.y):
        place = min(max(place, float(value) - half), float(value) + half)
        y[k] = place
    return case.u, y


def compressed(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """A sensor that saturates smoothly."""
    middle = (case.y.max() + case.y.min()) / 2
    width = rng.uniform(0.4, 0.8) * np.ptp(case.y)
    return case.u, middle + width * np.tanh((case.y - middle) / width)


def crosstalk(case: Case, rng: np.random.Generator) -> tuple[Array, Array]:
    """0.1 to 0.3 of the input in the output."""
    return case.u, case.y + rng.uniform(0.1, 0.3) * case.span / np.ptp(case.u) * (
        case.u - case.u[0]
    )


def _ramp(least: float, most: float) -> Callable[[Array, np.random.Generator], Array]:
    return lambda along, rng: rng.uniform(least, most) * along


def _step(along: Array, rng: np.random.Generator) -> Array:
    return rng.uniform(0.1, 0.3) * (along > rng.uniform(0.2, 0.8))


def _warming(along: Array, rng: np.random.Generator) -> Array:
    return rng.uniform(0.15, 0.4) * np.exp(-along / rng.uniform(0.1, 0.4))


def _wandering(along: Array, rng: np.random.Generator) -> Array:
    return rng.uniform(0.2, 0.5) * np.cumsum(rng.normal(size=along.size)) / along.size**0.5


def _slow_wave(along: Array, rng: np.random.Generator) -> Array:
    return rng.uniform(0.1, 0.3) * np.sin(2 * np.pi * (rng.uniform(1, 4) * along + rng.uniform()))


def _smaller_gain(along: Array, rng: np.random.Generator) -> Array:
    return np.where(along > rng.uniform(0.2, 0.8), rng.uniform(0.6, 0.85), 1.0)


def _half(along: Array, rng: np.random.Generator) -> Array:
    return np.where(along > rng.uniform(0.2, 0.8), 0.5, 1.0)


def _falling_gain(along: Array, rng: np.random.Generator) -> Array:
    return 1 - rng.uniform(0.2, 0.5) * along


def _hysteresis(why: str) -> str:
    return f"a plant with {why} gives the same record"


_CHANGES = ("shift", "drift", "changes along", "gain")
_LATE = ("lag", "late", "rate")
KINDS: dict[str, Kind] = {
    "clipped, exactly": Kind(clipped(0.0), ("clipped",)),
    "clipped, noise of 0.01 %": Kind(clipped(1e-4), ("clipped",)),
    "clipped far, noise of 1 to 2 %": Kind(clipped_far, ("clipped",)),
    "clipped, noise of 0.1 %": Kind(clipped(1e-3), ("clipped",)),
    "clipped, noise of 0.5 %": Kind(clipped(5e-3), ("clipped",)),
    "clipped, noise of 1 %": Kind(clipped(1e-2), ("clipped",)),
    "limited input": Kind(limited, ("source", "clipped")),
    "stuck for a fifth": Kind(stuck(False), ("stuck",)),
    "stuck for a fifth, with noise": Kind(stuck(True), ("stuck",)),
    "source stuck for a fifth": Kind(stuck_source, ("stuck",)),
    "sample and hold": Kind(sample_and_hold, ("stuck", *_LATE)),
    "interpolated": Kind(interpolated, ("stuck", "outlier", "line")),
    "outlier of 30 ranges": Kind(outliers(1, 30.0), ("outlier", "set aside", "far")),
    "outlier of 1,000 ranges": Kind(outliers(1, 1000.0), ("outlier", "set aside", "far")),
    "outlier of a range": Kind(outliers(1, 1.0), ("outlier", "set aside", "far")),
    "five outliers of a range": Kind(outliers(5, 1.0), ("outlier", "set aside", "far")),
    "spikes": Kind(spikes, ("outlier", "far")),
    "three cells of -9999": Kind(readings(lambda case: -9999.0, 0.0), ("-9999",)),
    "overload codes": Kind(readings(lambda case: 9.9e37, 0.01), ("code",)),
    "dropouts to a rail": Kind(
        readings(lambda case: case.y.min() - 0.5 * case.span, 0.05), ("outlier", "far")
    ),
    "lag of 5": Kind(late(5), ("lag",)),
    "lag of 15": Kind(late(15), ("lag",)),
    "output before the input": Kind(late(-3), ("lag", "before")),
    "low-pass sensor": Kind(low_pass, _LATE),
    "averaging filter": Kind(averaging, _LATE),
    "slow source": Kind(slow_source, _LATE),
    "drift": Kind(added(_ramp(0.15, 0.4)), _CHANGES),
    "warming up": Kind(added(_warming), ("start-up", *_CHANGES)),
    "random walk of the zero": Kind(added(_wandering), _CHANGES),
    "slow wave of the zero": Kind(added(_slow_wave), _CHANGES),
    "offset step": Kind(added(_step), _CHANGES),
    "gain step": Kind(gain(_smaller_gain), _CHANGES),
    "half scale after a restart": Kind(gain(_half), _CHANGES),
    "falling gain": Kind(gain(_falling_gain), _CHANGES),
    "zero of the source moves": Kind(shifted_source, _CHANGES),
    "weaker source": Kind(weaker_source, _CHANGES),
    "glitches of the source": Kind(source_glitches, ("outlier", "far", "error")),
    "missing rows": Kind(without_rows, ("error", "miss")),
    "outputs lost": Kind(outputs_lost, (*_CHANGES, *_LATE)),
    "repeated rows": Kind(repeated_rows, ("error",)),
    "repeated outputs": Kind(repeated_outputs, (*_CHANGES, *_LATE)),
    "shuffled blocks": Kind(shuffled, ("error",)),
    "shuffled outputs": Kind(shuffled_outputs, ("error", *_CHANGES)),
    "two clocks": Kind(two_clocks, _LATE),
    "jitter": Kind(jitter, _LATE),
    "swapped columns": Kind(swapped, ("columns", "before", "swap")),
    "sign": Kind(inverted, ("falls", "sign")),
    "sign of the input": Kind(inverted_input, ("falls", "sign")),
    "sign changes later": Kind(inverted_later, ("sign", "falls", *_CHANGES)),
    "coarse resolution": Kind(coarse, ("resol", "clipped")),
    "coarse input": Kind(coarse_input, ("resol", "error")),
    "hum": Kind(hum, ("noise", "error")),
    "noise": Kind(noisy, ("noise", "error")),
    "heavy noise": Kind(heavy_noise, ("noise", "error", "outlier")),
    "folded": Kind(folded, ("falls", "error")),
    "wrapped": Kind(wrapped, ("falls", "error", "jump")),
    "dead bit": Kind(dead_bit, ("error", "jump")),
    "another plant later": Kind(other_plant, _CHANGES),
    "backwards": Kind(backwards, ("before", "error")),
    "wrong gain": Kind(gain(lambda along, rng: 0 * along + 0.7), (), _hysteresis("that gain")),
    "constant offset": Kind(added(lambda along, rng: 0 * along + 0.2), (), "the zero is a choice"),
    "smooth compression": Kind(compressed, (), _hysteresis("that curve")),
    "crosstalk of the input": Kind(crosstalk, (), _hysteresis("that slope")),
    "slack of the mount": Kind(slack, (), _hysteresis("that much play")),
    "dead zone of the sensor": Kind(dead_zone, (), _hysteresis("that curve")),
}
"""Kinds of damage by name."""
