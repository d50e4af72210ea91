"""Random plants with hysteresis and random records of them, for the study of advice.

No plant is a Preisach operator on the levels of the fit: relays at random thresholds, bent plays,
the model of Bouc and Wen, the magnet of Jiles and Atherton, dry friction, the phase of a wire with
memory of its shape, and the settled simulated strip.
Inputs are between 0 and 1 inside; a record has an input and an output in units of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from minorloop.twins.ipmc import Ipmc

Array = npt.NDArray[np.float64]
Plant = Callable[[Array], Array]
FINE = 0.01
"""Largest change of the input, as a share of its range, in one step of an equation."""


@dataclass(frozen=True, eq=False)
class Case:
    """A plant, what was measured of it, and an unseen input with its true output.

    ``output`` is the plant itself: outputs for inputs from the beginning on, without noise.
    """

    kind: str
    shape: str
    u: Array
    y: Array
    noise: float
    span: float
    unseen: Array
    truth: Array
    levels: int
    holdout: float
    quantum: float
    output: Plant


def a_case(seed: int) -> Case:
    """A random plant with a random record; the same seed gives the same case."""
    rng = np.random.default_rng([seed, 815])
    kind = str(rng.choice([*PLANTS, "strip"], p=[0.24, 0.24, 0.17, 0.12, 0.1, 0.08, 0.05]))
    shape = "staircase" if kind == "strip" else str(rng.choice(list(RECORDS)))
    x = RECORDS[shape](rng)
    unseen = np.concatenate([[0.0], sweeps(rng, 12, 20)])
    if kind == "strip":
        unseen = np.concatenate([[0.0], rng.uniform(0, 1, 40)])
        plant: Plant = _strip(rng)
    else:
        plant = PLANTS[kind](rng)
    measured, truth = plant(x), plant(unseen)
    width = float(np.ptp(plant(np.array([0.0, 1.0, 0.0]))))
    scale, offset = 10 ** rng.uniform(-5, 2.5), rng.uniform(-2, 2)
    u_scale, u_offset = 10 ** rng.uniform(-2, 2), rng.choice([-0.5, 0.0])
    noise = float(rng.choice([0.0, 1.0], p=[0.1, 0.9]) * rng.uniform(0, 0.01))
    measured = (measured / width + offset) + noise * rng.normal(size=x.size)
    quantum = float(rng.choice([0.0, 2.0 ** -rng.integers(8, 15)], p=[0.6, 0.4]))
    if quantum:
        measured = np.round(measured / quantum) * quantum

    def output(u: Array) -> Array:
        return scale * (plant(u / u_scale - u_offset) / width + offset)

    return Case(
        kind, shape, u_scale * (x + u_offset), scale * measured, scale * noise, scale,
        u_scale * (unseen + u_offset), scale * (truth / width + offset),
        25 if x.size < 100 or x.size > 900 else int(rng.integers(8, 13)),
        float(rng.choice([0.0, 0.3])), scale * quantum, output,
    )  # fmt: skip


def relays(rng: np.random.Generator) -> Plant:
    """Six hundred relays around one to three centres, and a memoryless part."""
    centres = rng.uniform([0.3, 0.02], [0.7, 0.25], (int(rng.integers(1, 4)), 2))
    spread = rng.uniform(0.05, 0.2, (len(centres), 2)) * [1.0, 0.6]
    which = rng.integers(len(centres), size=600)
    middle, half = (centres[which] + spread[which] * rng.normal(size=(600, 2))).T
    up, down = middle + np.abs(half), middle - np.abs(half)
    share, bend = rng.uniform(0, 0.5), rng.uniform(1, 4)

    def run(x: Array) -> Array:
        on = np.zeros(up.size, dtype=bool)
        out = np.empty(x.size)
        for k, value in enumerate(x):
            on = np.where(value >= up, True, np.where(value <= down, False, on))
            out[k] = on.mean()
        return out + share * np.tanh(bend * (x - 0.5))

    return run


def bent_plays(rng: np.random.Generator) -> Plant:
    """Plays with decaying weights, seen through a bent curve."""
    radii = np.sort(rng.uniform(0, 0.4, 12))
    weights = np.exp(-radii / rng.uniform(0.05, 0.4)) * rng.uniform(0.2, 1, 12)
    slope, bend, middle = rng.uniform(0.1, 1) * weights.sum(), rng.uniform(0.5, 3), rng.uniform()

    def run(x: Array) -> Array:
        places = x[0] + radii
        out = np.empty(x.size)
        for k, value in enumerate(x):
            places = np.minimum(np.maximum(places, value - radii), value + radii)
            out[k] = weights @ places
        inner = (out + slope * x) / (weights.sum() + slope)
        return np.tanh(bend * (inner - middle)) + 0.2 * inner

    return run


def bouc_wen(rng: np.random.Generator) -> Plant:
    """Linear part less the hysteretic part of Bouc and Wen, as piezo stages are described."""
    stiff, power = rng.uniform(3, 12), rng.uniform(1, 2)
    beta = rng.uniform(0.5, 0.9)
    share = rng.uniform(0.15, 0.9) / (2 * beta)

    def run(x: Array) -> Array:
        z, last, out = -1.0, x[0], np.empty(x.size)
        for k, value in enumerate(x):
            for step in _steps(value - last):
                grown = abs(z) ** power * (beta * np.sign(step * z) + 1 - beta)
                z += stiff * step * (1 - grown)
            last = value
            out[k] = value - share * z / stiff
        return out

    return run


def magnet(rng: np.random.Generator) -> Plant:
    """Magnetisation after Jiles and Atherton, from negative saturation."""
    return _magnet(rng.uniform(0.05, 0.12), rng.uniform(0.05, 0.15), rng)


def slow_magnet(rng: np.random.Generator) -> Plant:
    """A magnet that saturates slowly and has a wide loop."""
    return _magnet(rng.uniform(0.12, 0.35), rng.uniform(0.1, 0.4), rng)


def _magnet(a: float, k_pin: float, rng: np.random.Generator) -> Plant:
    c, alpha = rng.uniform(0.1, 0.4), rng.uniform(0.0, 0.05)

    def anhysteretic(h: float) -> float:
        ratio = h / a
        return ratio / 3 if abs(ratio) < 1e-3 else 1 / np.tanh(ratio) - 1 / ratio

    def run(x: Array) -> Array:
        m = -0.95
        field, last, out = 2 * x - 1, -1.0, np.empty(x.size)
        for k, value in enumerate(field):
            for step in _steps((value - last) / 2):
                last += 2 * step
                aim = anhysteretic(last + alpha * m)
                pull = (aim - m) / (np.sign(step) * k_pin - alpha * (aim - m))
                near = (anhysteretic(last + 1e-4) - anhysteretic(last - 1e-4)) / 2e-4
                rate = ((1 - c) * pull if (aim - m) * step > 0 else 0.0) + c * near
                m += rate * 2 * step
            last = value
            out[k] = m
        return out

    return run


def friction(rng: np.random.Generator) -> Plant:
    """Elastic, perfectly plastic elements in parallel, which yield abruptly, and a spring."""
    limits = rng.uniform(0.05, 0.5, int(rng.integers(1, 9)))
    spring = rng.uniform(0.05, 0.5)

    def run(x: Array) -> Array:
        force, last, out = -limits, x[0], np.empty(x.size)
        for k, value in enumerate(x):
            force, last = np.clip(force + value - last, -limits, limits), value
            out[k] = force.sum() / limits.size + spring * value
        return out

    return run


def wire(rng: np.random.Generator) -> Plant:
    """Phase fraction of a wire with memory of its shape: two curves, scaled between reversals.

    Ikuta, Tsukamoto and Hirose, Mathematical model and experimental verification of shape memory
    alloy for designing micro actuator, MEMS 1991: a minor curve is the major one, scaled.
    """
    heating, cooling = rng.uniform(0.5, 0.75), rng.uniform(0.25, 0.5)
    steep = rng.uniform(8, 25)

    def curve(value: float, middle: float) -> float:
        return float(1 / (1 + np.exp(-steep * (value - middle))))

    def run(x: Array) -> Array:
        share, last, out = 0.0, x[0], np.empty(x.size)
        for k, value in enumerate(x):
            if value > last:
                left = (1 - curve(value, heating)) / (1 - curve(last, heating))
                share = 1 - (1 - share) * left
            elif value < last:
                share *= curve(value, cooling) / curve(last, cooling)
            last, out[k] = value, share
        return out + 0.05 * x

    return run


def _strip(rng: np.random.Generator) -> Plant:
    """The simulated strip, 200 s at each input."""
    specimen = int(rng.integers(1000))

    def run(x: Array) -> Array:
        twin = Ipmc(specimen)
        twin.reset()
        return np.array(
            [float(twin.apply(-1.2 + 2.4 * v, 200.0, 200.0).y[-1]) for v in np.clip(x, 0, 1)]
        )

    return run


def _steps(change: float) -> Array:
    count = int(np.ceil(abs(change) / FINE))
    return np.full(count, change / max(count, 1))


PLANTS = {
    "relays": relays,
    "plays": bent_plays,
    "bouc-wen": bouc_wen,
    "magnet": magnet,
    "friction": friction,
    "wire": wire,
}


def sweeps(rng: np.random.Generator, turns: int, each: int) -> Array:
    """Straight sweeps between random turning points, about ``each`` samples a full range."""
    ends = np.concatenate([[0.0, 1.0], rng.uniform(0, 1, turns)])
    return np.concatenate([*_between(ends, each), ends[-1:]])


def _between(ends: Array, each: int) -> list[Array]:
    return [
        np.linspace(a, b, max(int(each * abs(b - a)), 2), endpoint=False) for a, b in pairwise(ends)
    ]


def _staircase(rng: np.random.Generator) -> Array:
    """Up and down through eleven levels, one shorter at each turn."""
    grid, low, high = np.linspace(0, 1, 11), 0, 10
    steps = [0]
    while low < high:
        steps += range(low + 1, high + 1)
        low += 1
        steps += range(high - 1, low - 1, -1)
        high -= 1
    return grid[steps]


def _ramps(rng: np.random.Generator) -> Array:
    return sweeps(rng, int(rng.integers(10, 20)), int(rng.integers(35, 60)))[:500]


def _sine(rng: np.random.Generator) -> Array:
    """A sine whose amplitude falls and rises again, 8 to 14 periods."""
    count, periods = int(rng.integers(300, 500)), rng.uniform(8, 14)
    s = np.linspace(0, 1, count)
    size = 0.5 * (0.55 + 0.45 * np.cos(2 * np.pi * rng.integers(1, 3) * s))
    return 0.5 - size * np.cos(2 * np.pi * periods * s)


def _minor_loops(rng: np.random.Generator) -> Array:
    """Reversal curves: from the top down to a level and up again."""
    each = int(rng.integers(25, 45))
    ends = [0.0, 1.0]
    for level in rng.permutation(np.linspace(0, 0.9, int(rng.integers(5, 9)))):
        ends += [float(level), 1.0]
    return np.concatenate(_between(np.array(ends), each))


def _log(rng: np.random.Generator) -> Array:
    """A longer log of blocks of different amplitude, 1,000 to 1,400 samples."""
    count = int(rng.integers(1000, 1400))
    s = np.linspace(0, 1, count)
    block = np.repeat(rng.uniform(0.25, 1, 12), count // 12 + 1)[:count]
    block[: count // 12 + 1] = 1
    return np.clip(0.5 - 0.5 * block * np.cos(2 * np.pi * 24 * s), 0, 1)


def _levels_at_random(rng: np.random.Generator) -> Array:
    """Held levels at random, each measured once."""
    return np.concatenate([[0.0, 1.0], rng.uniform(0, 1, int(rng.integers(250, 450)))])


def _random_staircase(rng: np.random.Generator) -> Array:
    """Few held levels at random, each measured one to six times."""
    ends = np.concatenate([[0.0, 1.0], rng.uniform(0, 1, int(rng.integers(40, 120)))])
    return np.repeat(ends, int(rng.integers(1, 7)))


def _multisine(rng: np.random.Generator) -> Array:
    """A sum of three to six sines, 0 to 1."""
    s = np.linspace(0, 1, int(rng.integers(400, 900)))
    waves = rng.integers(1, 16, (int(rng.integers(3, 7)), 1))
    x = np.sin(2 * np.pi * (waves * s + rng.uniform(0, 1, waves.shape))).sum(axis=0)
    return np.concatenate([np.linspace(0, 1, 40), (x - x.min()) / np.ptp(x)])


RECORDS = {
    "staircase": _staircase,
    "ramps": _ramps,
    "sine": _sine,
    "minor loops": _minor_loops,
    "log": _log,
    "random levels": _levels_at_random,
    "random staircase": _random_staircase,
    "multisine": _multisine,
}
