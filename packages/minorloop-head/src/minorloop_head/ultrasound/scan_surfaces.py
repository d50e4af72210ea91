"""Surfaces of layers in a scan: echoes that most A-scans have, on planes of a common tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop_head.ultrasound.recorded_scan import RecordedScan
from minorloop_head.ultrasound.synthetic_aperture import Field, envelope, recorded_field

_STEEPEST, _SLOPES = math.radians(10.0), 161
"""Largest tilt of the first surface in radians, and how many are tried."""
_MOST = 200
"""A-scans of which the tilt is found first."""
_OVER = 4.0
"""Amplitude of a surface over the median one around it, within `_AROUND` pulses."""
_AROUND, _APART = 12, 4
"""Pulses around a surface, and between two, which a clipped or ringing echo may last."""
_SAME = 1.0
"""Pulses within which an echo arrives as a repeat of louder ones would."""
_QUIETER = 0.5
"""Largest amplitude of a repeat over that of the echo that it repeats."""
_TOP = 0.7
"""Share of the amplitude that the plateau of an echo has."""
_SMOOTH = 9
"""A-scans over which the first surface is smooth."""
_SAID, _REFUSED = 0.05, 0.2
"""Share by which a thickness that is known may differ from that by the echoes until it is said, and
until the depths would be those of another layer."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces between the layers of a scan, from the probe on."""

    times: FloatArray
    """Shape (N,). Of the echo of each under the middle of the scan, in seconds."""
    amplitudes: FloatArray
    """Shape (N,). Of the median echo."""
    offsets: FloatArray
    """Shape (X, Y). Of the echo of the first from its mean time, in seconds."""
    plateaus: FloatArray
    """Shape (N,). How long the echo of each stays near its largest amplitude, in seconds."""
    slopes: tuple[float, float]
    """Sines of the tilt of the first along x and y, positive where it is deeper at larger x."""

    @property
    def tilt(self) -> float:
        """Of the first surface, in radians; NaN without one."""
        return math.asin(min(math.hypot(*self.slopes), 1.0)) if self.times.size else math.nan


def pulse_length(scan: RecordedScan) -> float:
    """Return how long a pulse of the band of a scan lasts at half its amplitude, in seconds."""
    low, high = scan.pulse_band
    return 1.2 / (high - low)


def find_surfaces(scan: RecordedScan, field: Field | None = None) -> Surfaces:
    """Return the surfaces of a scan, at most one for each of its speeds.

    ``field``: of the scan, if it is known already.

    Notes
    -----
    Amplitudes are shifted by the tilt for which their median over all places is loudest: what is
    at a few places only has no part in it. The first surface is then followed from place to place
    by the front of its echo.
    """
    field = field or recorded_field(scan)
    length = pulse_length(scan)
    times = scan.start + np.arange(0, len(scan.traces) * scan.interval, length / 6)
    loud = envelope(field, times)
    step = times[1] - times[0]
    places = [
        each * (np.arange(n) - 0.5 * (n - 1)) if n > 1 else np.zeros(1)
        for n, each in zip(loud.shape[1:], scan.steps, strict=True)
    ]
    grid = np.stack(np.meshgrid(*places, indexing="ij"))
    slopes = _slopes(loud, grid, step * scan.speeds[0] / 2)
    delays = 2 / scan.speeds[0] * np.tensordot(slopes, grid, axes=1)
    stack = _stack(loud, delays / step)
    found = _peaks(stack, len(scan.speeds), length / step)
    if not found.size:
        nothing = np.empty(0)
        return Surfaces(nothing, nothing, np.zeros_like(delays), nothing, (math.nan, math.nan))
    delays = _followed(loud, delays / step, found[0], _APART * length / step) * step
    delays -= delays.mean()
    stack = _stack(loud, delays / step)
    found = _peaks(stack, len(scan.speeds), length / step)
    spans = np.array([_plateau(stack, each) for each in found])
    design = np.stack([np.ones(delays.size), *grid.reshape(2, -1)], axis=1)
    turned = np.linalg.lstsq(design, delays.ravel(), rcond=None)[0][1:] * scan.speeds[0] / 2
    return Surfaces(
        scan.start + step * spans.mean(axis=1),
        stack[found],
        delays,
        step * np.ptp(spans, axis=1),
        (float(turned[0]), float(turned[1])),
    )


def _slopes(loud: FloatArray, grid: FloatArray, step: float) -> FloatArray:
    """Return the sines of the tilt along x and y whose median echoes are loudest."""
    flat = loud.reshape(len(loud), -1)
    some = np.unique(np.linspace(0, flat.shape[1] - 1, _MOST).astype(int))
    flat, places = flat[:, some], grid.reshape(2, -1)[:, some]
    best = np.zeros(2)
    for axis in np.flatnonzero(np.ptp(places, axis=1)):
        tried = np.sin(np.linspace(-_STEEPEST, _STEEPEST, _SLOPES))
        scores = []
        for slope in tried:
            best[axis] = slope
            scores.append((_stack(flat, best @ places / step) ** 2).sum())
        best[axis] = tried[int(np.argmax(scores))]
    return best


def _stack(loud: FloatArray, delays: FloatArray) -> FloatArray:
    """Return the median amplitude (T,) over all places, each earlier by its delay in samples."""
    flat, shifts = loud.reshape(len(loud), -1), np.rint(delays).astype(int).ravel()
    rows = np.arange(len(flat))[:, None] + shifts
    inside = (rows >= 0) & (rows < len(flat))
    values = np.take_along_axis(flat, np.clip(rows, 0, len(flat) - 1), axis=0)
    return np.median(np.where(inside, values, 0.0), axis=1)


def _peaks(stack: FloatArray, most: int, length: float) -> FloatArray:
    """Return the samples of the loudest echoes that stand out and repeat no louder ones."""
    around = median_filter(stack, 2 * int(_AROUND * length) + 1, mode="nearest")
    inner = stack[1:-1]
    tops = (inner >= stack[:-2]) & (inner > stack[2:]) & (inner > _OVER * around[1:-1])
    kept: list[int] = []
    for each in sorted((np.flatnonzero(tops) + 1).tolist(), key=lambda n: -stack[n]):
        if len(kept) < most and all(_apart(stack, one, each, _APART * length) for one in kept):
            repeats = [
                a + b - c
                for a in kept
                for b in kept
                for c in kept
                if b > c and stack[each] < _QUIETER * stack[a]
            ]
            if not any(abs(each - one) < _SAME * length for one in repeats):
                kept.append(each)
    return np.array(sorted(kept), dtype=np.intp)


def _apart(stack: FloatArray, one: int, other: int, least: float) -> bool:
    """Return whether two tops are those of two echoes."""
    first, last = sorted((one, other))
    return last - first >= least and stack[first:last].min() < 0.5 * stack[other]


def _followed(loud: FloatArray, delays: FloatArray, top: int, reach: float) -> FloatArray:
    """Return the delays in samples at which the first surface itself arrives.

    Its front, where the amplitude first is half of the largest, also tells when it is clipped.
    """
    span = np.arange(-int(reach), int(reach) + 1)
    rows = span[:, None, None] + np.rint(top + delays).astype(int)
    near = np.take_along_axis(loud, np.clip(rows, 0, len(loud) - 1), axis=0)
    high = near >= 0.5 * near.max(axis=0)
    first = np.maximum(high.argmax(axis=0), 1)[None]
    after, before = (np.take_along_axis(near, first - k, axis=0)[0] for k in (0, 1))
    half = 0.5 * near.max(axis=0)
    fine = first[0] - np.clip((after - half) / np.maximum(after - before, 1e-30), 0, 1)
    front = np.rint(top + delays) + fine
    size = [min(_SMOOTH, n) for n in front.shape]
    smooth = median_filter(front - delays, size, mode="nearest")
    return np.asarray(delays + smooth)


def _plateau(stack: FloatArray, top: int) -> tuple[int, int]:
    """Return the first and the last sample around a top that are nearly as loud."""
    low = np.flatnonzero(stack < _TOP * stack[top])
    first = int(low[low < top].max(initial=-1)) + 1
    return first, int(low[low > top].min(initial=len(stack))) - 1


def contradictions(scan: RecordedScan, surfaces: Surfaces) -> list[str]:
    """Return sentences on thicknesses that differ from those by the echoes and the speeds.

    Raises a `RecordError` if a layer that another one follows differs by a fifth or more: depths
    would be wrong.
    """
    said = []
    before = 0.0
    for n, (time, known) in enumerate(zip(surfaces.times, scan.thicknesses, strict=False)):
        speed, passed = scan.speeds[n], time - before
        before = time
        thick = 0.5 * speed * passed
        if not known > 0 or abs(thick / known - 1) <= _SAID:
            continue
        sentence = (
            f"layer {n + 1} is {1e3 * thick:.1f} mm thick by its echoes at {speed:g} m/s, and "
            f"{1e3 * known:.1f} mm are given, which would need {2 * known / passed:.0f} m/s"
        )
        if abs(thick / known - 1) > _REFUSED and n + 1 < len(scan.speeds):
            raise RecordError(f"{sentence}; give them as they are, in the order of the layers")
        said.append(sentence)
    return said
