"""Flaws in the layers of a recorded scan: their places, depths and sizes.

::

    found = scan_flaws(read_scan("block.mat"))
    found.flaws, found.layers, found.tilt, found.advice
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError, RecordError, counted
from minorloop_head.ultrasound.echoes import vertex
from minorloop_head.ultrasound.recorded_scan import RecordedScan
from minorloop_head.ultrasound.scan_surfaces import (
    Field,
    Surfaces,
    contradictions,
    depth_step,
    find_surfaces,
    pulse_length,
    recorded_field,
)

_LEAST = 6.0
"""Least amplitude of a flaw over the noise at its depth. Noise alone reaches it in one of 7e7
independent places; the margin is for the grain of a material, whose tails are longer."""
_SURE = 2.0
"""Multiple of this least amplitude for a certain flaw, and for a wide one."""
_WIDE = 4.0
"""Least size of a wide flaw in widths of a point; it may be a remainder of a surface."""
_MOST, _TAILED = 0.97, 2.65
"""Quantile of the amplitude in a layer, and its ratio to the noise if there is only noise. If it is
higher, grain or sparks make the tail, and the noise is scaled up to it. Flaws take less than the
rest."""
_RAYLEIGH = 1.1774
"""Median of the amplitude of noise over the standard deviation of each of its parts."""
_POINT = 0.6
"""Width of a focused point at half its amplitude over the diameter of the disc, from the two-way
directivity of the disc as a Gaussian."""
_WIDER = 1.3
"""Least width, over that of a point, that is a size instead of a bound."""
_BESIDE = 4.0
"""Reach of the side lobes of a point, in widths."""
_LOBES = ((2.0, 0.25), (4.0, 0.06))
"""Pulses before and after a point in which they lie, and their largest amplitude over that of the
point: remainders of the branches of its hyperbola at the ends of the scan and at gaps."""
_TAIL = 6.0
"""Pulses after an echo in which its creeping wave round the flaw arrives, below a first lobe."""
_NARROW = 0.5
"""Least width of a faint flaw over the usual one of certain flaws: narrower ones are grain or
noise."""
_UNDERSIDE = 5.0
"""Pulses by which an echo from the underside of a flaw may arrive early, due to its extent."""
_BEFORE, _AFTER = 1.5, 3.0
"""Pulses before and after a surface in which its echo hides others. Before the first surface they
are as many as after it: its rise, which may be clipped, is not level."""
_SAME = 2.0
"""Largest distance of the parts of one flaw, in pulses."""
_LATER = 0.5
"""Delay of branches of hyperbolas after their tops, as a share of the time of the layer."""
_FEWEST = 8
"""Fewest places along a line to distinguish noise from flaws."""


@dataclass(frozen=True)
class ScanFlaw:
    """A flaw; lengths in metres, NaN if unknown."""

    layer: int
    """Number from 1 on; the first layer is in front of the probe."""
    x: float
    y: float
    """Place, counted from the first A-scan; y is NaN on a line."""
    place_sd: float
    """Standard deviation of either."""
    depth: float
    depth_sd: float
    """Depth below the top of the layer, and its standard deviation at the stated speed."""
    below: float
    """Depth below the probe."""
    width: float
    length: float
    """Sizes along x and along y at half the focused amplitude: 6 dB drop."""
    size: float
    """The larger of both if it is more than that of a point, or, for an unknown disc, than the
    usual one of flaws in the layer; else NaN, and they are upper bounds."""
    level: float
    """Amplitude over that of noise and structure at its depth, in dB."""
    time: float
    """Time of its echo, in seconds after the pulse, with the first surface at its mean time."""
    amplitude: float
    grade: str
    """``confirmed`` if twice as loud as a flaw must be, else ``probable``."""
    why: str = ""
    """Other explanation of the echo; empty for a flaw."""


@dataclass(frozen=True, eq=False)
class ScanLayer:
    """A layer of a scan, and its picture."""

    number: int
    speed: float
    """Speed of sound, in m/s."""
    top: float
    bottom: float
    """Times of the echoes of its surfaces in seconds; the bottom may be the end of the scan."""
    thickness: float
    """Thickness in metres; NaN without a surface at its bottom."""
    depths: FloatArray
    """Shape (Z,). Depths of the picture below the top of the layer, in metres."""
    above: float
    """Depth of its top below the probe, in metres."""
    picture: FloatArray
    """Shape (Z, X, Y). Focused amplitude; NaN where the echo of a surface hides others."""


@dataclass(frozen=True, eq=False)
class ScanFlaws:
    """Layers and flaws in a scan."""

    scan: RecordedScan
    surfaces: Surfaces
    layers: tuple[ScanLayer, ...]
    flaws: tuple[ScanFlaw, ...]
    """Flaws in the order of layers, then of places."""
    repeats: tuple[ScanFlaw, ...]
    """Echoes that other echoes explain."""
    advice: tuple[str, ...]
    """Sentences on what limits the result."""

    @property
    def tilt(self) -> float:
        """Tilt of the first surface, in radians; NaN without one."""
        return self.surfaces.tilt


def scan_flaws(scan: RecordedScan, *, least: float = _LEAST) -> ScanFlaws:
    """Return the layers and the flaws of a recorded scan.

    Parameters
    ----------
    scan : RecordedScan
    least : float
        Least amplitude of a flaw over the noise and structure at its depth.

    Raises
    ------
    RecordError
        If speeds and thicknesses contradict the surfaces, or there are too few A-scans.

    Notes
    -----
    Places are aligned by the echo of the first surface. The signal common to most of them, surfaces
    and their ringing, is subtracted as their median. The field is continued down to the first
    surface, each place by the time of its own echo, so that the layers below are level. In each
    layer it is focused by phase shift, and compared with its median amplitude at each depth.
    """
    if not 1.0 < least < 1e3:
        raise ParameterError(f"least is {least}; give 1 to 1000")
    if scan.traces.shape[1] * scan.traces.shape[2] < _FEWEST:
        places = scan.traces.shape[1] * scan.traces.shape[2]
        raise RecordError(f"{places} A-scans are too few to find flaws; give at least {_FEWEST}")
    scan, dead = _without_dead(scan)
    field = recorded_field(scan)
    surfaces = find_surfaces(scan, field)
    field = field.earlier(surfaces.offsets).local().earlier(-surfaces.offsets)
    advice = [*dead, *contradictions(scan, surfaces), *_advice(scan, surfaces)]
    layers, found = [], list[ScanFlaw]()
    for layer in _layers(scan, surfaces, field):
        layers.append(layer)
        if np.isnan(layer.picture).all():
            advice.append(f"the echoes of its surfaces hide all of layer {layer.number}")
        found += _candidates(scan, surfaces, layer, least)
    flaws, repeats = _explained(found, surfaces.times, scan)
    if not flaws and not surfaces.times.size:
        advice.append(
            "no echo stands out of the noise, neither of a surface nor of a flaw, so that the part "
            "is not inspected; check coupling and gain, and which field has the A-scans"
        )
    return ScanFlaws(scan, surfaces, tuple(layers), flaws, repeats, tuple(advice))


def _without_dead(scan: RecordedScan) -> tuple[RecordedScan, list[str]]:
    """Return a scan with constant A-scans replaced by the mean of neighbours along x, and advice.

    A gap would cut the echo of a flaw in two.
    """
    dead = np.ptp(scan.traces, axis=0) == 0
    if not dead.any():
        return scan, []
    traces = scan.traces.copy()
    for y in np.flatnonzero(dead.any(axis=0) & ~dead.all(axis=0)):
        gaps, alive = np.flatnonzero(dead[:, y]), np.flatnonzero(~dead[:, y])
        at = np.searchsorted(alive, gaps)
        before, after = alive[np.maximum(at - 1, 0)], alive[np.minimum(at, alive.size - 1)]
        traces[:, gaps, y] = 0.5 * (traces[:, before, y] + traces[:, after, y])
    return replace(scan, traces=traces), [
        f"{counted(int(dead.sum()), 'A-scan')} without a signal replaced by the mean of the "
        "neighbours; flaws there are missed"
    ]


def _advice(scan: RecordedScan, surfaces: Surfaces) -> list[str]:
    said = []
    if not scan.start_known:
        said.append(
            "the time of the first sample is unknown, and 0 is assumed, the pulse; if it is "
            "later, the first layer is thicker than stated; give it with --given start=US"
        )
    if scan.clipped and surfaces.times.size:
        long = surfaces.plateaus[0]
        off = _unsure(scan, surfaces, min(2, len(scan.speeds)))
        said.append(
            f"the echo of the first surface is clipped; the middle of the {1e6 * long:.1f} us for "
            "which it is loud is taken for its time, so that all depths below it may be off by "
            f"{1e3 * off:.1f} mm; record with less gain"
        )
    missing = len(scan.speeds) - surfaces.times.size
    if missing > 1:
        said.append(
            f"{counted(surfaces.times.size, 'surface')} found, and {len(scan.speeds)} layers "
            "given: those after the last surface are taken for one"
        )
    return said


def _unsure(scan: RecordedScan, surfaces: Surfaces, number: int) -> float:
    """Return the uncertainty of depths after a clipped echo of the top of a layer, in metres."""
    if number < 2 or not scan.clipped:
        return 0.0
    long = float(surfaces.plateaus[number - 2]) - pulse_length(scan)
    return 0.25 * scan.speeds[number - 1] * max(long, 0.0)


def _layers(scan: RecordedScan, surfaces: Surfaces, field: Field) -> Iterator[ScanLayer]:
    """Yield each layer with its picture."""
    end = scan.start + len(scan.traces) * scan.interval
    times = [0.0, *surfaces.times]
    half, pulse = 0.5 * surfaces.plateaus, pulse_length(scan)
    above = 0.0
    for n, speed in enumerate(scan.speeds[: len(surfaces.times) + 1]):
        top, last = times[n], n >= len(surfaces.times)
        bottom = end if last else times[n + 1]
        begin = max(scan.start - top, 0.0)
        latest = bottom + (surfaces.offsets.max() if n == 0 else 0.0) - top
        step = depth_step(field, speed)
        depths = np.arange(0.5 * speed * begin, 0.5 * speed * min(latest, end - top), step)
        if depths.size < 2:
            break
        hides = 0.0 if last else half[n] + (_BEFORE if n else _AFTER) * pulse
        ends = bottom - hides + surfaces.offsets * (n == 0)
        # The first surface may be tilted, and is taken away before it is filtered and focused.
        shown = field if n or last else recorded_field(_cut_after(scan, ends)).local()
        begin, ending = 2 * depths[[0, -1]] / speed
        shown = shown.within(begin - pulse, ending + _LATER * (ending - begin) + 4 * pulse)
        picture = np.abs(shown.image(speed, depths))
        after = 2 * depths[:, None, None] / speed + top
        hidden = after > ends
        if n:
            hidden = hidden | (after < top + half[n - 1] + _AFTER * pulse)
        thick = math.nan if last else 0.5 * speed * (bottom - top)
        picture = np.where(hidden, np.nan, picture)
        yield ScanLayer(n + 1, speed, top, bottom, thick, depths, above, picture)
        if last:
            break
        field = field.down(speed, thick)
        if n == 0:
            # From here on the first surface is at time 0 everywhere.
            field = field.earlier(surfaces.offsets)
        above += thick


def _cut_after(scan: RecordedScan, times: FloatArray) -> RecordedScan:
    """Return a scan without signals that arrive at each place (X, Y) after a time in seconds."""
    at = scan.start + scan.interval * np.arange(len(scan.traces))
    centred = scan.traces - scan.traces.mean(axis=0)
    return replace(scan, traces=np.where(at[:, None, None] < times, centred, 0.0))


def _candidates(
    scan: RecordedScan, surfaces: Surfaces, layer: ScanLayer, least: float
) -> list[ScanFlaw]:
    """Return the places of a layer that stand out from the others at their depth."""
    loud = layer.picture
    seen = np.isfinite(loud).any(axis=(1, 2))
    if not seen.any():
        return []
    noise = np.full(len(loud), np.nan)
    noise[seen] = np.nanmedian(loud[seen], axis=(1, 2)) / _RAYLEIGH
    step = float(layer.depths[1] - layer.depths[0])
    pulse = max(int(0.5 * layer.speed * pulse_length(scan) / step), 1)
    floor = max(np.nanmedian(noise), scan.resolution / math.sqrt(12))
    noise = np.maximum(maximum_filter(np.nan_to_num(noise), 2 * pulse + 1), floor)
    ratio = loud / noise[:, None, None]
    ratio /= max(1.0, float(np.nanquantile(ratio, _MOST)) / _TAILED)
    ratio = np.nan_to_num(ratio)
    unsure = _unsure(scan, surfaces, layer.number)
    beside = [2 * _cells(scan, axis) + 1 for axis in (0, 1)]
    tops = maximum_filter(ratio, (2 * pulse + 1, *beside))
    found = []
    for place in np.argwhere((ratio == tops) & (ratio >= least)):
        z, x, y = (int(each) for each in place)
        inside = all(0 < k < n - 1 or n == 1 for k, n in zip(place, loud.shape, strict=True))
        if not inside:  # its middle is beyond the scan or behind a surface
            continue
        level, shape = float(ratio[z, x, y]), np.nan_to_num(loud)
        fine = vertex(shape[:, x, y], z)[0]
        across = [
            _half_width(line, n, step) for line, n, step in (
                (shape[z, :, y], x, scan.steps[0]), (shape[z, x], y, scan.steps[1])
            )
        ]  # fmt: skip
        depth = float(layer.depths[0] + fine * step)
        width, length = across[0][1], across[1][1]
        sd = 0.5 * layer.speed * pulse_length(scan) / level
        found.append(
            ScanFlaw(
                layer.number,
                across[0][0],
                across[1][0],
                max(width / level, 0.1 * scan.steps[0]),
                depth,
                math.hypot(sd, step, unsure),
                layer.above + depth,
                width,
                length,
                float(np.nanmax([width, length])),
                20 * math.log10(level),
                layer.top + 2 * depth / layer.speed,
                float(loud[z, x, y]),
                "confirmed" if level >= _SURE * least else "probable",
            )
        )
    sure = [one.size for one in found if one.grade == "confirmed"]
    usual = float(np.median(sure)) if sure else 0.0
    point = _point(scan, layer) if scan.disc > 0 else usual
    return [
        replace(one, size=one.size if one.size > _WIDER * point else math.nan)
        for one in found
        if one.grade == "confirmed" or _NARROW * usual < one.size < _WIDE * (point or math.inf)
    ]


def _cells(scan: RecordedScan, axis: int) -> int:
    """Return the width of a focused point in steps, at least one on an existing axis."""
    if scan.traces.shape[1 + axis] == 1:
        return 0
    size = _POINT * scan.disc if scan.disc > 0 else 0.0
    return max(int(np.ceil(size / scan.steps[axis])), 1)


def _point(scan: RecordedScan, layer: ScanLayer) -> float:
    """Return the width of a focused point at half its amplitude, in metres."""
    low, high = scan.pulse_band
    quarter = 0.5 * layer.speed / (low + high)
    return max(_POINT * scan.disc, quarter, float(np.nanmax(scan.steps)))


def _half_width(line: FloatArray, n: int, step: float) -> tuple[float, float]:
    """Return place and width at half the amplitude of a peak in a line of places, in metres."""
    if line.size == 1:
        return math.nan, math.nan
    half = 0.5 * line[n]
    ends = []
    for side in (-1, 1):
        m = n
        while 0 <= m + side < line.size and line[m] > half:
            m += side
        here, before = line[m], line[m - side]
        ends.append(m - side * (half - here) / (before - here) if here < half < before else m)
    place = vertex(line, n)[0] if 0 < n < line.size - 1 else float(n)
    return place * step, float(ends[1] - ends[0]) * step


def _explained(
    found: Sequence[ScanFlaw], times: FloatArray, scan: RecordedScan
) -> tuple[tuple[ScanFlaw, ...], tuple[ScanFlaw, ...]]:
    """Return the flaws, and the echoes that louder ones explain."""
    flaws, repeats = list[ScanFlaw](), list[ScanFlaw]()
    pulse = pulse_length(scan)
    for each in sorted(found, key=lambda one: -one.amplitude):
        if any(_is_part(each, one, pulse) for one in flaws):
            continue
        why = next((said for one in flaws if (said := _explanation(each, one, times, scan))), "")
        if why:
            repeats.append(replace(each, why=why, grade="look again"))
        else:
            flaws.append(each)
    for group in (flaws, repeats):
        group.sort(key=lambda one: (one.layer, one.x, one.depth))
    return tuple(flaws), tuple(repeats)


def _apart(one: ScanFlaw, other: ScanFlaw) -> float:
    return math.hypot(one.x - other.x, np.nan_to_num(one.y - other.y))


def _is_part(each: ScanFlaw, one: ScanFlaw, pulse: float) -> bool:
    """Return whether a place is a part of a flaw at another."""
    near = _apart(each, one) < 0.75 * np.nanmax([one.width, one.length])
    return bool(each.layer == one.layer and near and abs(each.time - one.time) < _SAME * pulse)


def _explanation(each: ScanFlaw, one: ScanFlaw, times: FloatArray, scan: RecordedScan) -> str:
    """Return the explanation of an echo by a louder one, or an empty string."""
    away = _apart(each, one)
    wide = float(np.nanmax([one.width, one.length, each.width]))
    pulse, share = pulse_length(scan), each.amplitude / one.amplitude
    at = f"the flaw at {1e3 * one.x:.1f} mm, {1e3 * one.below:.1f} mm below the probe"
    later = each.time - one.time
    if each.layer == one.layer:
        near = (abs(later) < far * pulse and share < most for far, most in _LOBES)
        if away < _BESIDE * wide and any(near):
            return f"a side lobe of {at}"
        if away < wide and 0 < later < _TAIL * pulse and share < _LOBES[0][1]:
            return f"a creeping wave round {at}"
    if away > wide or share > 0.5:
        return ""
    tops = [0.0, *times]
    for n, bottom in enumerate(times):
        if n and abs(later - (bottom - tops[n])) < pulse:
            return f"{at}, once more through layer {n + 1}"
        if n + 1 == one.layer and -pulse < bottom + (bottom - one.time) - each.time < (
            _UNDERSIDE * pulse
        ):
            return f"the underside of {at}, by way of the surface below"
    if one.layer > 1 and abs(later - (one.time - tops[one.layer - 1])) < pulse:
        return f"{at}, there and back twice"
    return ""
