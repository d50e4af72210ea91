"""Surfaces of layers in a scan: echoes that most A-scans have, on planes of a common tilt.

A scan is focused through layers by phase shift, from the plane of the recording to any depth.
Echoes of a scan with one disc equal those of sources that all fire at time 0, in a medium with half
the speed of sound (exploding reflectors). The field of these sources at a depth is that at the
surface, with each plane wave shifted in phase (Skjelvareid, Olofsson, Birkelund and Larsen,
Synthetic aperture focusing of ultrasonic data from multilayered media using an omega-k algorithm,
IEEE Trans. UFFC 58, 2011). At the depth of the sources, the field at time 0 is the picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import fft
from scipy.ndimage import median_filter

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop_head.ultrasound.recorded_scan import RecordedScan

_STEEPEST, _SLOPES = math.radians(10.0), 161
"""Largest tilt of the first surface in radians, and number of tried tilts."""
_MOST = 200
"""Number of A-scans for a first estimate of the tilt."""
_OVER = 4.0
"""Least amplitude of a surface over the median within `_AROUND` pulses around it."""
_AROUND, _APART = 12, 4
"""Pulses around a surface, and between two, which a clipped or ringing echo may last."""
_SAME = 1.0
"""Largest difference in pulses between the time of an echo and that of a repeat of louder ones."""
_QUIETER = 0.5
"""Largest amplitude of a repeat over that of the echo that it repeats."""
_TOP = 0.7
"""Least amplitude of the plateau of an echo, as a share of its largest one."""
_SMOOTH = 9
"""Number of A-scans over which the first surface is smoothed."""
_SAID, _REFUSED = 0.05, 0.2
"""Relative difference of a known thickness from that by the echoes above which there is a warning,
and above which depths would belong to another layer."""


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Surfaces between the layers of a scan, from the probe on."""

    times: FloatArray
    """Shape (N,). Time of the echo of each under the middle of the scan, in seconds."""
    amplitudes: FloatArray
    """Shape (N,). Amplitude of the median echo."""
    offsets: FloatArray
    """Shape (X, Y). Delay of the echo of the first from its mean time, in seconds."""
    plateaus: FloatArray
    """Shape (N,). Duration of the plateau of each echo near its largest amplitude, in seconds."""
    slopes: tuple[float, float]
    """Sines of the tilt of the first along x and y, positive if it is deeper at larger x."""

    @property
    def tilt(self) -> float:
        """Tilt of the first surface, in radians; NaN without one."""
        return math.asin(min(math.hypot(*self.slopes), 1.0)) if self.times.size else math.nan


def pulse_length(scan: RecordedScan) -> float:
    """Return the duration of a pulse of the band of a scan at half its amplitude, in seconds."""
    low, high = scan.pulse_band
    return 1.2 / (high - low)


def find_surfaces(scan: RecordedScan, field: Field | None = None) -> Surfaces:
    """Return the surfaces of a scan, at most one for each of its speeds.

    ``field``: of the scan, if it is known already.

    Notes
    -----
    Amplitudes are shifted by the tilt for which their median over all places is loudest: echoes at
    a few places do not affect it. The first surface is then followed from place to place by the
    front of its echo.
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
    """Return the samples of the loudest echoes that stand out and are no repeats of louder ones."""
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

    Its front, at half of the largest amplitude, also has a time if the echo is clipped.
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
    """Return warnings on thicknesses that differ from those by the echoes and the speeds.

    Raises a `RecordError` if a layer above another one differs by a fifth or more: depths would be
    wrong.
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


ComplexArray: TypeAlias = npt.NDArray[np.complexfloating]
_BEYOND = 0.2
"""Width of the flanks of the band, as a share of its edges."""
_ROOM = 64
"""Padding beside the scan in places, so that waves do not wrap around."""
_DEPTHS = 4
"""Number of depths per shortest wave; echoes have two waves for each wave of the medium."""


@dataclass(frozen=True, eq=False)
class Field:
    """The field of a scan on a plane or a gently bent surface, by its frequencies."""

    spectrum: ComplexArray
    """Shape (F, X, Y)."""
    omega: FloatArray
    """Shape (F,). Angular frequencies, in rad/s."""
    steps: tuple[float, float]
    """Between places along x and y, in metres."""

    def down(self, speed: float, depth: float) -> Field:
        """Return the field deeper in a layer.

        ``speed``: of sound, in m/s. ``depth``: in metres; negative is up.
        """
        wave = self._vertical(speed)
        spread = self._spread(wave) * np.exp(1j * depth * wave)
        _, nx, ny = self.spectrum.shape
        return replace(self, spectrum=fft.ifft2(spread, axes=(1, 2))[:, :nx, :ny])

    def earlier(self, times: npt.ArrayLike) -> Field:
        """Return the field with each place (X, Y) earlier by a time in seconds.

        If the depths of a surface differ by little, this is the field on the surface itself: the
        shift neglects the slant of the waves over this difference (split-step Fourier migration,
        Stoffa and others, Geophysics 55, 1990).
        """
        shift = np.exp(1j * self.omega[:, None, None] * np.asarray(times))
        return replace(self, spectrum=self.spectrum * shift)

    def local(self) -> Field:
        """Return the field without the signal common to most places at the same time.

        It is the echo of a level surface with its ringing: the median over all places.
        """
        wave = fft.ifft(self.spectrum, axis=0)
        wave -= np.median(wave.real, axis=(1, 2), keepdims=True)
        wave -= 1j * np.median(wave.imag, axis=(1, 2), keepdims=True)
        return replace(self, spectrum=fft.fft(wave, axis=0))

    def within(self, begin: float, end: float) -> Field:
        """Return the field between two times in seconds, with as few frequencies as it needs.

        Without echoes at earlier and later times, a picture of this range takes less work.
        """
        count, step = len(self.omega), self.omega[1] - self.omega[0]
        kept = int((end - begin) * count * step / (2 * np.pi)) + 1
        if kept >= count:
            return self
        # One sample for each cycle of the bandwidth, as of a down-mixed signal.
        wave = fft.ifft(self.earlier(np.full(self.spectrum.shape[1:], begin)).spectrum, axis=0)
        spectrum = fft.fft(wave[:kept], axis=0) * (count / kept)
        omega = self.omega[0] + step * count / kept * np.arange(kept)
        field = Field(spectrum, omega, self.steps)
        return field.earlier(np.full(spectrum.shape[1:], -begin))

    def image(self, speed: float, depths: FloatArray) -> ComplexArray:
        """Return the picture (Z, X, Y) of a layer at equally spaced depths, in metres."""
        wave = self._vertical(speed)
        spread = self._spread(wave) * np.exp(1j * depths[0] * wave)
        spread = spread.astype(np.complex64)
        step = np.exp(1j * (depths[1] - depths[0]) * wave).astype(np.complex64)
        _, nx, ny = self.spectrum.shape
        found = np.empty((len(depths), nx, ny), dtype=np.complex64)
        for each in found:
            each[:] = fft.ifft2(spread.sum(axis=0))[:nx, :ny]
            spread *= step
        return found

    def _vertical(self, speed: float) -> FloatArray:
        """Return the vertical wavenumbers (F, KX, KY); NaN of evanescent waves."""
        kx, ky = (
            2 * np.pi * fft.fftfreq(_padded(n), step) if n > 1 else np.zeros(1)
            for n, step in zip(self.spectrum.shape[1:], self.steps, strict=True)
        )
        across = kx[:, None] ** 2 + ky**2
        squares = (2 * self.omega[:, None, None] / speed) ** 2 - across
        return np.sqrt(np.where(squares > 0, squares, np.nan))

    def _spread(self, wave: FloatArray) -> ComplexArray:
        """Return the plane waves (F, KX, KY) of the field."""
        _, nx, ny = self.spectrum.shape
        found = fft.fft2(self.spectrum, s=(_padded(nx), _padded(ny)), axes=(1, 2))
        travels = np.isfinite(wave)
        np.nan_to_num(wave, copy=False)
        return np.asarray(found * travels)


def _padded(count: int) -> int:
    """Return a padded count of places, so that waves do not wrap around."""
    return int(fft.next_fast_len(count + min(count, _ROOM))) if count > 1 else 1


def recorded_field(scan: RecordedScan) -> Field:
    """Return the field of a scan in the plane of the recording."""
    low, high = scan.pulse_band
    count = len(scan.traces)
    frequency = fft.rfftfreq(count, scan.interval)
    kept = (frequency > (1 - _BEYOND) * low) & (frequency < (1 + _BEYOND) * high)
    frequency = frequency[kept]
    rise = (frequency / low - 1) / _BEYOND + 1
    fall = (1 - frequency / high) / _BEYOND + 1
    weight = np.clip(np.minimum(rise, fall), 0, 1) * 2 / count
    omega = 2 * np.pi * frequency
    spectrum = fft.rfft(scan.traces - scan.traces.mean(axis=0), axis=0)[kept]
    spectrum *= (weight * np.exp(-1j * omega * scan.start))[:, None, None]
    return Field(spectrum, omega, scan.steps)


def envelope(field: Field, times: FloatArray) -> FloatArray:
    """Return the amplitude (T, X, Y) of a field at times in seconds, equally spaced."""
    _, nx, ny = field.spectrum.shape
    wave = field.spectrum.reshape(len(field.omega), nx * ny)
    turns = np.exp(1j * times[:, None] * field.omega)
    return np.asarray(np.abs(turns @ wave).reshape(-1, nx, ny))


def depth_step(field: Field, speed: float) -> float:
    """Return the largest step of depths that resolves a picture, in metres."""
    return float(np.pi * speed / field.omega.max() / _DEPTHS)
