"""Focus a scan through layers by phase shift: from where it was recorded down to any depth.

Echoes of a scan with one disc are those of sources that all fire at time 0, in a medium in which
sound is half as fast (exploding reflectors). The field of these sources at a depth is that at the
surface, with each plane wave shifted in phase (Skjelvareid, Olofsson, Birkelund and Larsen,
Synthetic aperture focusing of ultrasonic data from multilayered media using an omega-k algorithm,
IEEE Trans. UFFC 58, 2011). Where the sources are, the field at time 0 is the picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy import fft

from minorloop.arrays import FloatArray
from minorloop_head.ultrasound.recorded_scan import RecordedScan

ComplexArray: TypeAlias = npt.NDArray[np.complexfloating]
_BEYOND = 0.2
"""Width of the flanks of the band, as a share of its edges."""
_ROOM = 64
"""Places beside the scan into which waves run, so that they do not come back around."""
_DEPTHS = 4
"""Depths in the shortest wave, of which the echoes have two for each of the medium."""


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

        On a surface at depths that differ by little this is the field on the surface itself: what
        the shift neglects is the slant of the waves over this difference (split-step Fourier
        migration, Stoffa and others, Geophysics 55, 1990).
        """
        shift = np.exp(1j * self.omega[:, None, None] * np.asarray(times))
        return replace(self, spectrum=self.spectrum * shift)

    def local(self) -> Field:
        """Return the field without what most places have at the same time.

        That is the echo of a level surface, and its ringing; the median over all places has it.
        """
        wave = fft.ifft(self.spectrum, axis=0)
        wave -= np.median(wave.real, axis=(1, 2), keepdims=True)
        wave -= 1j * np.median(wave.imag, axis=(1, 2), keepdims=True)
        return replace(self, spectrum=fft.fft(wave, axis=0))

    def within(self, begin: float, end: float) -> Field:
        """Return what arrives between two times in seconds, by as few frequencies as it needs.

        Echoes at earlier and later times are left out, so that a picture of what lies between
        takes less work.
        """
        count, step = len(self.omega), self.omega[1] - self.omega[0]
        kept = int((end - begin) * count * step / (2 * np.pi)) + 1
        if kept >= count:
            return self
        # One sample for each turn of the band, as of a signal that is mixed down.
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
        """Return the vertical wavenumbers (F, KX, KY); NaN of waves that do not travel."""
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
    """Return a count of places with room beside them, so that waves do not come back around."""
    return int(fft.next_fast_len(count + min(count, _ROOM))) if count > 1 else 1


def recorded_field(scan: RecordedScan) -> Field:
    """Return the field of a scan where it was recorded."""
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
    """Return the distance of depths that shows all of a picture, in metres."""
    return float(np.pi * speed / field.omega.max() / _DEPTHS)
