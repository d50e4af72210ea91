"""Find echoes in traces, check traces for faults, and average the shots of a burst.

A bad trace raises no error: the result names its fault, so that a loop continues.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop_head.sources import Shot

DEAD_TIME = 2.5e-6
"""Seconds for which the disc rings after its pulse; samples before are ignored."""
MOST_OFF = 0.3e-3
"""Largest distance in metres of the spot of a shot from its target: about the pitch of a raster."""
_LEAST_SNR = 4.0
"""Least amplitude of an echo over the noise; noise alone reaches it in one of 3000 samples."""
_SLACK, _LEAST_ECHO = 1.5e-3, 0.02
"""Largest distance of the wall from its expected place in m, and least amplitude of its echo."""
_CLIPPED = 0.985
"""Least value of a clipped sample, as a share of full scale."""


@dataclass(frozen=True)
class Pulse:
    """The expected pulse after its way there and back.

    Raises a `ParameterError` if a number is not positive.
    """

    frequency: float = 10e6
    """Centre frequency, in Hz."""
    bandwidth: float = 0.6
    """Full width at half the amplitude, as a share of the frequency."""

    def __post_init__(self) -> None:
        if not (as_finite("frequency", self.frequency) > 0 and self.bandwidth > 0):
            raise ParameterError(
                f"a pulse of {self.frequency} Hz and bandwidth {self.bandwidth}; give positive "
                "numbers"
            )

    def samples(self, interval: float) -> FloatArray:
        """Return (T,) samples, the middle one at the peak of the envelope."""
        width = self.bandwidth * self.frequency / 2 / np.sqrt(2 * np.log(2))
        reach = int(4 / (2 * np.pi * width) / interval)
        t = interval * np.arange(-reach, reach + 1)
        envelope = np.exp(-0.5 * (2 * np.pi * width * t) ** 2)
        shape: FloatArray = envelope * np.cos(2 * np.pi * self.frequency * t)
        return shape


@dataclass(frozen=True)
class Echo:
    """One echo in a trace."""

    time: float
    """Since the pulse, in seconds; NaN where there is none."""
    amplitude: float
    """Amplitude of its envelope after the matched filter, in the unit of the trace."""
    snr: float
    """Amplitude over the standard deviation of the noise after the filter."""


NO_ECHO = Echo(np.nan, 0.0, 0.0)


def trace_fault(shot: Shot) -> str:
    """Return the fault of a trace, or an empty string.

    It is ``not a trace`` (wrong shape, too short, not real numbers, not finite, or without a
    positive sample interval), ``dropout`` (flat where noise should be), or ``clipped`` (at full
    scale, which is 1, after the dead time).
    """
    trace = _numbers(shot.trace)
    if trace is None or not _positive(shot.sample_interval):
        return "not a trace"
    dead = int(min(DEAD_TIME / shot.sample_interval, trace.size))
    if trace.size < dead + 200:
        return "not a trace"
    received = trace[dead:]
    # A stretch of 1 us without any noise was not measured.
    stretch = max(int(1e-6 / shot.sample_interval), 8)
    whole = received[: received.size // stretch * stretch].reshape(-1, stretch)
    if (np.ptp(whole, axis=1) == 0).any() and (np.ptp(received) == 0 or received.std() > 2e-3):
        return "dropout"
    return "clipped" if np.abs(received).max() >= _CLIPPED else ""


def _positive(value: object) -> bool:
    """Return whether a value is a finite number above 0."""
    return isinstance(value, (int, float, np.number)) and 0 < float(value) < np.inf


def _numbers(values: object) -> FloatArray | None:
    """Return values as (T,) finite samples, or None if they are not."""
    try:
        found = np.asarray(values)
    except ValueError:
        return None
    if found.dtype.kind not in "iuf" or found.ndim != 1 or not np.isfinite(found).all():
        return None
    return found.astype(np.float64)


def matched(trace: npt.ArrayLike, interval: float, pulse: Pulse) -> npt.NDArray[np.complex128]:
    """Return the analytic correlation (T,) of a trace with a pulse of unit energy."""
    from scipy import fft  # steering a probe does not need it

    samples = pulse.samples(interval)
    samples = samples / np.linalg.norm(samples)
    filtered = np.convolve(np.asarray(trace, dtype=np.float64), samples[::-1], mode="same")
    # As in scipy.signal, whose import takes longer than all others of a console process together.
    spectrum, half = fft.fft(filtered), (filtered.size + 1) // 2
    spectrum[1:half] *= 2.0
    spectrum[filtered.size // 2 + 1 :] = 0.0
    return np.asarray(fft.ifft(spectrum))


def find_echoes(
    trace: npt.ArrayLike,
    interval: float,
    pulse: Pulse | None = None,
    *,
    gate: tuple[float, float] | None = None,
    share: float = 0.3,
    most: int = 4,
    fine: bool = True,
) -> tuple[Echo, ...]:
    """Return the echoes of a trace in the order of their times.

    It is empty if no peak is above 4 standard deviations of the noise. Raises a `SignalError` if
    the trace is not one-dimensional and finite.

    ``trace`` (T,): samples since the pulse.
    ``interval``: between samples, in seconds.
    ``pulse``: to match; 10 MHz and 60 % without it.
    ``gate``: first and last time of an echo, in seconds; without it, all after the dead time.
    ``share``: least amplitude of an echo, as a share of the loudest one in the gate.
    ``most``: largest number of returned echoes, the loudest.
    ``fine``: whether to time the wave instead of its envelope: the scatter is six times smaller,
    but the time errs by whole waves if noise is loud or the phase of the pulse is unknown.

    Notes
    -----
    Matched filter, envelope, and the vertex of a parabola through three samples of it, or of the
    crest of the wave nearest to it (Jacovitti and Scarano, Discrete time techniques for time
    delay estimation, 1993).
    """
    samples = np.asarray(trace, dtype=np.float64)
    if samples.ndim != 1 or not np.isfinite(samples).all():
        raise SignalError(f"a trace of shape {samples.shape} must be (T,) and finite")
    start, stop = gate or (DEAD_TIME, np.inf)
    first = max(int(np.ceil(start / interval)), 1)
    last = int(min(stop / interval, samples.size - 2))
    if last - first < 3:
        return ()
    filtered = matched(samples, interval, pulse or Pulse())
    loud = np.abs(filtered)
    quiet = loud[int(DEAD_TIME / interval) :]
    # The median of a Rayleigh distribution is 1.1774 of the standard deviation of each part.
    noise = float(np.median(quiet)) / 1.1774 if quiet.size else 0.0
    inside = loud[first : last + 1]
    peaks = np.flatnonzero((inside[1:-1] > inside[:-2]) & (inside[1:-1] >= inside[2:])) + 1 + first
    least = max(_LEAST_SNR * noise, share * inside.max(), 1e-12)
    peaks = peaks[loud[peaks] >= least]
    peaks = np.sort(peaks[np.argsort(-loud[peaks])][:most])
    echoes = []
    for n in peaks:
        place, height = vertex(loud, int(n))
        if fine:
            place = _crest(filtered.real, place)
        echoes.append(Echo(place * interval, height, height / max(noise, 1e-12)))
    return tuple(echoes)


def vertex(values: FloatArray, n: int) -> tuple[float, float]:
    """Return place, in samples, and height of the parabola through a peak and its neighbours."""
    before, here, after = values[n - 1], values[n], values[n + 1]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return n + float(shift), float(here - 0.25 * (before - after) * shift)


def _crest(wave: FloatArray, place: float) -> float:
    """Return the crest nearest to a place, in samples; the place itself if none is near."""
    first = max(int(place) - 8, 1)
    near = np.arange(first, min(first + 18, wave.size - 1))
    crests = near[(wave[near] >= wave[near - 1]) & (wave[near] > wave[near + 1]) & (wave[near] > 0)]
    if crests.size == 0:
        return place
    return vertex(wave, int(crests[np.argmin(np.abs(crests - place))]))[0]


def front_echo(shot: Shot, distance: float, speed: float) -> Echo:
    """Return the first echo near the expected distance of the wall.

    It is ``NO_ECHO`` if there is none, the trace is faulty, or distance or speed is not a positive
    number.

    ``shot``: as fired; ``distance``: of the wall along the beam, in metres; ``speed``: of sound in
    the water, in m/s.
    """
    if trace_fault(shot) in ("not a trace", "dropout"):
        return NO_ECHO
    if not (_positive(distance) and _positive(speed)):
        return NO_ECHO
    gate = (2 * (distance - _SLACK) / speed, 2 * (distance + _SLACK) / speed)
    echoes = find_echoes(shot.trace, shot.sample_interval, gate=gate)
    return echoes[0] if echoes else NO_ECHO


def has_wall_echo(shots: Sequence[Shot], distance: float, speed: float) -> bool:
    """Return whether more than half of the shots have an echo of the wall; shots in air have none.

    ``shots``: at one place; more shots are more certain. ``distance``: of the wall along the beam,
    in metres. ``speed``: of sound in water, in m/s.
    """
    echoes = [front_echo(shot, distance, speed) for shot in shots]
    count = sum(echo.amplitude >= _LEAST_ECHO and echo.snr >= _LEAST_SNR for echo in echoes)
    return count > len(shots) / 2


@dataclass(frozen=True, eq=False)
class Burst:
    """The mean of the shots at one place."""

    trace: FloatArray
    """Shape (T,). Mean of the usable shots; empty if there was none."""
    sample_interval: float
    """In seconds."""
    angles: FloatArray
    """Shape (2,). Mean of measured pan and tilt, in radians."""
    used: int
    fired: int
    """Number of shots in the mean, and of fired shots."""
    noise: float
    """Standard deviation of a sample of the mean."""
    verdict: str = ""
    """Reason why there is no trace, or an empty string."""


def average(
    shots: Sequence[Shot], angles: npt.ArrayLike, off: npt.ArrayLike, *, most_off: float = MOST_OFF
) -> Burst:
    """Average the usable shots of one burst.

    If no shot is usable, the verdict of the burst is the most frequent fault.

    ``shots``: fired within some 16 ms, in which the head hardly moves. ``angles`` (N, 2): measured
    pan and tilt of the head at each shot, in radians. ``off`` (N,): tracked distance of the spot of
    each shot from its target, in metres; NaN if it was not tracked. ``most_off``: shots farther
    away are left out.

    Notes
    -----
    Two equal shots in a row are both ``frozen``: the device repeats itself, and the first may
    already be old. Of shots of several lengths or sample intervals, those of the most frequent
    kind are used. Of four shots or more, outliers are left out: those whose distance from the
    median trace is more than three times the median distance.
    """
    places = np.asarray(angles, dtype=np.float64).reshape(-1, 2)
    far = np.asarray(off, dtype=np.float64).ravel()
    if not len(shots) == len(places) == far.size:
        raise SignalError(f"{len(shots)} shots, {len(places)} angles and {far.size} distances")
    faults = _with_frozen(shots, [trace_fault(shot) for shot in shots])
    with np.errstate(invalid="ignore"):
        tracked = far <= most_off
    kinds = [
        (len(shot.trace), float(shot.sample_interval)) if not fault else None
        for shot, fault in zip(shots, faults, strict=True)
    ]
    known = [kind for kind in kinds if kind is not None]
    usual = max(set(known), key=lambda kind: (known.count(kind), kind), default=None)
    good = [
        n
        for n, fault in enumerate(faults)
        if not fault and tracked[n] and np.isfinite(places[n]).all() and kinds[n] == usual
    ]
    if not good:
        reasons = [fault or "off target" for fault in faults]
        verdict = max(set(reasons), key=reasons.count) if reasons else "no shot"
        return Burst(np.empty(0), 0.0, np.full(2, np.nan), 0, len(shots), np.nan, verdict)
    return _mean(shots, places, good)


def _with_frozen(shots: Sequence[Shot], faults: list[str]) -> list[str]:
    """Return the faults, with ``frozen`` for each of two usable shots in a row that are equal."""
    found = list(faults)
    for n in range(1, len(shots)):
        fine = not faults[n - 1] and not faults[n]
        if fine and np.array_equal(shots[n - 1].trace, shots[n].trace):
            found[n - 1 : n + 1] = ["frozen", "frozen"]
    return found


def _mean(shots: Sequence[Shot], places: FloatArray, good: list[int]) -> Burst:
    interval = shots[good[0]].sample_interval
    traces = np.array([shots[n].trace for n in good], dtype=np.float64)
    kept = np.array(good)
    if len(good) >= 4:
        received = traces[:, int(DEAD_TIME / interval) :]
        distance = np.sqrt(((received - np.median(received, axis=0)) ** 2).mean(axis=1))
        near = distance <= 3 * np.median(distance) + 1e-12
        traces, kept = traces[near], kept[near]
    count = len(kept)
    mean = traces.mean(axis=0)
    quiet = slice(int(DEAD_TIME / interval), None)
    if count > 1:
        spread = float(np.median(traces[:, quiet].std(axis=0, ddof=1))) / np.sqrt(count)
    else:
        spread = 1.4826 * float(np.median(np.abs(np.diff(mean[quiet])))) / np.sqrt(2)
    return Burst(mean, interval, places[kept].mean(axis=0), count, len(shots), spread)
