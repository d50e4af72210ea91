"""Echoes in a trace: are they usable, when did they come, and how many shots make one good trace.

Nothing here raises on a bad trace: what is wrong with it is a word in the result, so that a loop
goes on and no depth is made up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.signal import hilbert

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import ParameterError, SignalError
from minorloop.lab.actuator import Shot

DEAD_TIME = 2.5e-6
"""How long the disc rings after its pulse, in seconds: nothing is read before."""
MOST_OFF = 0.3e-3
"""How far off its target the spot of a shot may be, in metres."""
_LEAST_SNR = 4.0
_CLIPPED = 0.985


@dataclass(frozen=True)
class Pulse:
    """The pulse there and back, as far as it is known.

    Parameters
    ----------
    frequency : float
        Centre, in Hz.
    bandwidth : float
        At half the amplitude, as a share of the frequency.

    Raises
    ------
    ParameterError
        If a number is not positive.
    """

    frequency: float = 10e6
    bandwidth: float = 0.6

    def __post_init__(self) -> None:
        if not (as_finite("frequency", self.frequency) > 0 and self.bandwidth > 0):
            raise ParameterError(
                f"a pulse of {self.frequency} Hz and bandwidth {self.bandwidth}; give positive "
                "numbers"
            )

    def samples(self, interval: float) -> FloatArray:
        """(T,) samples, the middle one at the peak of the envelope."""
        width = self.bandwidth * self.frequency / 2 / np.sqrt(2 * np.log(2))
        reach = int(4 / (2 * np.pi * width) / interval)
        t = interval * np.arange(-reach, reach + 1)
        envelope = np.exp(-0.5 * (2 * np.pi * width * t) ** 2)
        shape: FloatArray = envelope * np.cos(2 * np.pi * self.frequency * t)
        return shape


@dataclass(frozen=True)
class Echo:
    """One echo in a trace.

    Parameters
    ----------
    time : float
        Since the pulse, in seconds; NaN where there is none.
    amplitude : float
        Of its envelope behind the matched filter, in the unit of the trace.
    snr : float
        Amplitude over the standard deviation of the noise behind the filter.
    """

    time: float
    amplitude: float
    snr: float


NO_ECHO = Echo(np.nan, 0.0, 0.0)


def fault_of(shot: Shot, full_scale: float = 1.0) -> str:
    """What is wrong with a trace, or nothing.

    Parameters
    ----------
    shot : Shot
        As fired.
    full_scale : float
        Of the converter.

    Returns
    -------
    str
        ``"not a trace"`` (wrong shape, too short, not real numbers, not finite, or without a
        positive sample interval), ``"dropout"`` (flat where noise should be), ``"clipped"`` (at
        full scale after the dead time), or ``""``.
    """
    trace = _numbers(shot.trace)
    if trace is None or not _positive(shot.sample_interval):
        return "not a trace"
    dead = int(min(DEAD_TIME / shot.sample_interval, trace.size))
    if trace.size < dead + 200:
        return "not a trace"
    heard = trace[dead:]
    # A stretch of 1 us without the least noise was not measured.
    stretch = max(int(1e-6 / shot.sample_interval), 8)
    whole = heard[: heard.size // stretch * stretch].reshape(-1, stretch)
    if (np.ptp(whole, axis=1) == 0).any() and (np.ptp(heard) == 0 or heard.std() > 2e-3):
        return "dropout"
    return "clipped" if np.abs(heard).max() >= _CLIPPED * full_scale else ""


def _positive(value: object) -> bool:
    """Whether something is a finite number above 0."""
    return isinstance(value, (int, float, np.number)) and 0 < float(value) < np.inf


def _numbers(values: object) -> FloatArray | None:
    """Something as (T,) finite samples, or None where it is not such."""
    try:
        found = np.asarray(values)
    except ValueError:
        return None
    if found.dtype.kind not in "iuf" or found.ndim != 1 or not np.isfinite(found).all():
        return None
    return found.astype(np.float64)


def matched(trace: npt.ArrayLike, interval: float, pulse: Pulse) -> npt.NDArray[np.complex128]:
    """Analytic correlation (T,) of a trace with a pulse of unit energy."""
    samples = pulse.samples(interval)
    samples = samples / np.linalg.norm(samples)
    filtered = np.convolve(np.asarray(trace, dtype=np.float64), samples[::-1], mode="same")
    analytic: npt.NDArray[np.complex128] = hilbert(filtered)
    return analytic


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
    """The echoes of a trace in the order of their times.

    Parameters
    ----------
    trace : (T,) array_like
        Samples since the pulse.
    interval : float
        Between samples, in seconds.
    pulse : Pulse, optional
        To match; 10 MHz and 60 % without.
    gate : (float, float), optional
        Where to look, in seconds; all after the dead time without.
    share : float
        Of the loudest echo in the gate that another must have.
    most : int
        How many to give, the loudest.
    fine : bool
        Whether to time the wave rather than its envelope: six times less scatter, but off by
        whole waves where noise is loud, or where the phase of the pulse is not known.

    Returns
    -------
    tuple of Echo
        Empty where nothing stands out of the noise by 4 standard deviations.

    Raises
    ------
    SignalError
        If the trace is not one-dimensional and finite.

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
        place, height = _vertex(loud, int(n))
        if fine:
            place = _crest(filtered.real, place)
        echoes.append(Echo(place * interval, height, height / max(noise, 1e-12)))
    return tuple(echoes)


def _vertex(values: FloatArray, n: int) -> tuple[float, float]:
    """Place, in samples, and height of the parabola through a peak and its neighbours."""
    before, here, after = values[n - 1], values[n], values[n + 1]
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return n + float(shift), float(here - 0.25 * (before - after) * shift)


def _crest(wave: FloatArray, place: float) -> float:
    """The crest of a wave nearest to a place, in samples; the place itself where none is near."""
    first = max(int(place) - 8, 1)
    near = np.arange(first, min(first + 18, wave.size - 1))
    crests = near[(wave[near] >= wave[near - 1]) & (wave[near] > wave[near + 1]) & (wave[near] > 0)]
    if crests.size == 0:
        return place
    return _vertex(wave, int(crests[np.argmin(np.abs(crests - place))]))[0]


def front_echo(
    shot: Shot, distance: float, speed: float, *, pulse: Pulse | None = None, slack: float = 1.5e-3
) -> Echo:
    """The first echo near the distance at which the wall is expected.

    Parameters
    ----------
    shot : Shot
        As fired.
    distance : float
        Of the wall along the beam, in metres.
    speed : float
        Of sound in the water, in m/s.
    pulse : Pulse, optional
        To match.
    slack : float
        How far off the wall may be, in metres.

    Returns
    -------
    Echo
        ``NO_ECHO`` where there is none, the trace is unusable, or distance or speed is not a
        positive number.
    """
    if fault_of(shot) in ("not a trace", "dropout"):
        return NO_ECHO
    if not (_positive(distance) and _positive(speed)):
        return NO_ECHO
    gate = (2 * (distance - slack) / speed, 2 * (distance + slack) / speed)
    echoes = find_echoes(shot.trace, shot.sample_interval, pulse, gate=gate)
    return echoes[0] if echoes else NO_ECHO


def choose_modality(
    shots: Sequence[Shot], distance: float, speed: float, *, least: float = 0.02
) -> str:
    """``"sonar"`` where the wall is heard, ``"camera"`` where it is not.

    Parameters
    ----------
    shots : sequence of Shot
        At one place; one will do, more are surer.
    distance : float
        Of the wall along the beam, in metres.
    speed : float
        Of sound in water, in m/s.
    least : float
        Amplitude of an echo that counts, in the unit of the traces.

    Notes
    -----
    Through air nothing of the pulse comes back from steel, so the loudest echo near the wall
    tells; more than half of the shots must have one.
    """
    heard = [front_echo(shot, distance, speed) for shot in shots]
    count = sum(echo.amplitude >= least and echo.snr >= _LEAST_SNR for echo in heard)
    return "sonar" if shots and count > len(shots) / 2 else "camera"


@dataclass(frozen=True, eq=False)
class Burst:
    """Shots at one place made into one trace.

    Parameters
    ----------
    trace : (T,) array
        Their mean; empty where no shot was usable.
    sample_interval : float
        In seconds.
    angles : (2,) array
        Mean pan and tilt as measured, in radians.
    used, fired : int
        How many shots are in the mean, and how many there were.
    noise : float
        Standard deviation of a sample of the mean.
    verdict : str
        Why there is no trace, or nothing.
    """

    trace: FloatArray
    sample_interval: float
    angles: FloatArray
    used: int
    fired: int
    noise: float
    verdict: str = ""


def average(
    shots: Sequence[Shot],
    angles: npt.ArrayLike,
    off: npt.ArrayLike,
    *,
    most_off: float = MOST_OFF,
    full_scale: float = 1.0,
) -> Burst:
    """Make the shots of one burst into one trace.

    Parameters
    ----------
    shots : sequence of Shot
        In at most some 16 ms, in which the head hardly moves.
    angles : (N, 2) array_like
        Pan and tilt of the head at each shot as measured, in radians.
    off : (N,) array_like
        How far the spot of each shot was off its target as tracked, in metres; NaN where it was
        not tracked.
    most_off : float
        Shots farther off are left out.
    full_scale : float
        Of the converter.

    Returns
    -------
    Burst
        The verdict is that of most of the unusable shots where none is usable.

    Notes
    -----
    A shot equal to the one before it to the last sample is of a sonar that repeats itself; both
    are ``frozen``, since nobody can tell whether the first was new. Of shots of several lengths
    or sample intervals, those of the most frequent kind are used.

    Shots whose distance from the median of all is more than three times the usual are left out
    too; the mean of the others is that of Huber for what is not noise but accident.
    """
    places = np.asarray(angles, dtype=np.float64).reshape(-1, 2)
    far = np.asarray(off, dtype=np.float64).ravel()
    if not len(shots) == len(places) == far.size:
        raise SignalError(f"{len(shots)} shots, {len(places)} angles and {far.size} distances")
    faults = [fault_of(shot, full_scale) for shot in shots]
    faults = _with_frozen(shots, faults)
    with np.errstate(invalid="ignore"):
        tracked = far <= most_off
    kinds = [
        (len(shot.trace), float(shot.sample_interval)) if not fault else None
        for shot, fault in zip(shots, faults, strict=True)
    ]
    told = [kind for kind in kinds if kind is not None]
    usual = max(set(told), key=lambda kind: (told.count(kind), kind), default=None)
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
    """The faults, with ``frozen`` for each of two usable shots in a row that are the same."""
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
        heard = traces[:, int(DEAD_TIME / interval) :]
        distance = np.sqrt(((heard - np.median(heard, axis=0)) ** 2).mean(axis=1))
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
