"""Scans of layered blocks with drilled holes, by rays: another way than that which focuses them.

The time of an echo is that of the ray through the layers that Snell's law bends, there and back;
its amplitude falls with the directivity of the disc at the angle of this ray in the first layer and
with the way. Surfaces are level or tilted and have reverberations of the holes: once more through a
layer, by way of the surface below, and there and back twice.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import j1

from minorloop_head.ultrasound.recorded_scan import RecordedScan

SPEEDS = (2700.0, 5900.0, 6320.0, 4700.0)


@dataclass(frozen=True)
class LayeredBlock:
    """What a scan shows: lengths in metres."""

    scan: RecordedScan
    layers: np.ndarray
    """(H,) layer of each hole, from 1 on."""
    places: np.ndarray
    """(H, 2) x and y."""
    depths: np.ndarray
    """(H,) below the top of the layer."""
    tilt: float
    """In radians."""


def travel(away, depths, speeds):
    """Return times (N,) of the way to points at distances (N,) through layers, and sines there."""
    slow, fast = np.zeros_like(away), np.full_like(away, 1 / max(speeds) * (1 - 1e-9))
    for _ in range(60):
        p = 0.5 * (slow + fast)
        reach = sum(
            d * c * p / np.sqrt(1 - (c * p) ** 2) for d, c in zip(depths, speeds, strict=True)
        )
        slow, fast = np.where(reach < away, p, slow), np.where(reach < away, fast, p)
    times = sum(d / c / np.sqrt(1 - (c * p) ** 2) for d, c in zip(depths, speeds, strict=True))
    return times, p * speeds[0]


def pulse(t, frequency, bandwidth):
    width = bandwidth * frequency / 2 / np.sqrt(2 * np.log(2))
    return np.exp(-0.5 * (2 * np.pi * width * t) ** 2) * np.cos(2 * np.pi * frequency * t)


def drawn_block(
    seed, *, raster=False, noise=None, bits=None, holes=None, front=None, thick=None, speeds=None
):
    """Draw a block of one or two layers in water with three to eight holes in each."""
    draw = np.random.default_rng(seed)
    count = int(draw.integers(1, 3))
    c = np.array([1480.0, *draw.choice(SPEEDS, count, replace=False)]) if speeds is None else speeds
    frequency = draw.uniform(2e6, 5e6)
    d = np.array([draw.uniform(0.02, 0.06), *draw.uniform(0.02, 0.045, len(c) - 1)])
    d = d if thick is None else np.asarray(thick)
    disc = draw.uniform(4e-3, 8e-3)
    step = (0.6 if raster else 0.17) * disc * draw.uniform(0.5, 1.0) / (2 if raster else 1)
    rate = frequency * draw.uniform(5, 12)
    nx, ny = (34, 30) if raster else (int(draw.uniform(0.09, 0.16) / step), 1)
    x, y = step * np.arange(nx), step * np.arange(ny)
    tilt = np.radians(draw.uniform(-2.5, 2.5)) if draw.random() < 0.5 else 0.0
    # In the frame of the block, the probe moves along a tilted line, and its beam leans.
    moved = x - x.mean()
    along, height = x.mean() + moved * np.cos(tilt), d[0] + moved * np.sin(tilt)
    noise = draw.uniform(0.3, 1.5) if noise is None else noise
    front = np.exp(draw.uniform(np.log(60.0), np.log(1200.0))) if front is None else front
    start = 2 * d[0] / c[0] * draw.uniform(0.5, 0.7)
    late = 2 * (height - d[0])[:, None] / c[0]
    end = 2 * (d / c).sum() + 4e-6 + abs(late).max()
    t = np.arange(start, end, 1 / rate)
    bandwidth = draw.uniform(0.5, 0.8)
    trace = np.zeros((t.size, nx, ny))
    gx, gy = np.meshgrid(along, y, indexing="ij")
    heights = np.repeat(height, ny)

    def add(times, amplitude):
        times, amplitude = np.broadcast_arrays(times, amplitude)
        width = 1.5 / (bandwidth * frequency)
        for i in range(nx):
            for j in range(ny):
                at = np.abs(t - times[i, j]) < width
                trace[at, i, j] += amplitude[i, j] * pulse(
                    t[at] - times[i, j], frequency, bandwidth
                )

    tops = np.cumsum([0.0, *(2 * d / c)])
    found = []
    for n in range(1, len(c)):
        number = int(draw.integers(3, 9)) if holes is None else holes
        least = 3.0 * c[n] / (bandwidth * frequency) + 0.6e-3
        spans = np.linspace(0.06, 0.94, number + 1)
        order = draw.permutation(number)
        for k in range(number):
            place = [x[-1] * draw.uniform(spans[k] + 0.02, spans[k + 1] - 0.02), 0.0]
            if raster:
                place[1] = y[-1] * draw.uniform(0.1, 0.9)
            share = (order[k] + draw.uniform(0.2, 0.8)) / number
            deep = least + share * (d[n] - 2 * least)
            loud = draw.uniform(12, 40)
            away = np.hypot(gx - place[0], gy - place[1])
            ways, sines = travel(away.ravel(), [heights, *d[1:n], deep], c[: n + 1])
            leans = np.arcsin(sines) * np.sign(place[0] - gx.ravel()) - tilt
            ka = np.pi * disc * frequency / c[0] * np.abs(np.sin(leans))
            gains = (2 * j1(ka) / np.maximum(ka, 1e-9)) ** 2
            gains[ka < 1e-6] = 1.0
            direct = ways.min()
            amplitude = (loud * gains * direct / ways).reshape(nx, ny)
            times = 2 * ways.reshape(nx, ny)
            add(times, amplitude)
            first = tops[n] + 2 * deep / c[n]
            add(times + first - tops[n], 0.08 * amplitude)
            for m in range(1, len(c)):
                add(times + tops[m + 1] - tops[m], 0.15 * amplitude)
            below = 2 * tops[n + 1] - 2 * first - 3e-3 / c[n]
            add(times + below, 0.2 * amplitude)
            # Where the beam meets the surface over the hole, as the scan counts places.
            seen = x.mean() + (place[0] - x.mean() - d[0] * np.tan(tilt)) * np.cos(tilt)
            found.append((n + 1, seen, place[1], deep))
    for n, loud in enumerate([front, *draw.uniform(80, 200, len(c) - 1)]):
        shadow = 1 + 0.1 * draw.standard_normal((nx, ny))
        add(tops[n + 1] + late, loud * shadow)
        for k in range(1, 4):
            add(tops[n + 1] + late + k * 1.1e-6, loud * 0.05**k * shadow)
    bits = int(draw.choice([8, 12])) if bits is None else bits
    trace += noise * draw.standard_normal(trace.shape)
    trace = np.clip(np.rint(trace), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    low, high = (1 - bandwidth) * frequency, (1 + bandwidth) * frequency
    scan = RecordedScan(
        trace,
        1 / rate,
        start,
        (step, step if raster else np.nan),
        tuple(c),
        tuple(d),
        (low, high),
        disc,
    )
    holes = np.array(found).reshape(-1, 4)
    return LayeredBlock(scan, holes[:, 0].astype(int), holes[:, 1:3], holes[:, 3], tilt)


def matched(block, found, *, near=3e-3, deep=1.5e-3):
    """Return the errors of place and depth of the holes that were found, the missed and the false.

    A flaw is that of the nearest hole of its layer within 3 mm, and 1.5 mm of depth.
    """
    left, errors, missed = list(found.flaws), [], 0
    for layer, place, depth in zip(block.layers, block.places, block.depths, strict=True):
        around = [
            (np.hypot(one.x - place[0], np.nan_to_num(one.y) - place[1]), abs(one.depth - depth), n)
            for n, one in enumerate(left)
            if one.layer == layer
        ]
        around = [each for each in around if each[0] < near and each[1] < deep]
        if not around:
            missed += 1
            continue
        best = min(around)
        errors.append(best[:2])
        left.pop(best[2])
    return np.array(errors).reshape(-1, 2), missed, len(left)
