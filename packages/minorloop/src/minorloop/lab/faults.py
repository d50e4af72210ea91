"""Faults of a record: the fault, its samples, and the remedy, in the same words everywhere.

`DETECTORS` find faults from the readings of a sensor alone, and `spikes` finds spikes while the
input is constant. `minorloop.identification.screening` finds faults from readings and inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import LARGEST, BoolArray, FloatArray, IntArray
from minorloop.errors import ParameterError, SignalError, are, counted
from minorloop.lab.holds import FoundHold
from minorloop.lab.noise import frozen, noise_above_resolution, noise_of, resolution

Kind: TypeAlias = Literal["code", "range", "clipped", "stuck", "outlier", "drift", "lag"]
_SHOWN = 6
"""Most samples in a list."""


@dataclass(frozen=True)
class Fault:
    """A fault of a record, which would make models of it wrong.

    Examples
    --------
    >>> record = ml.Record(np.arange(20.0), np.append(np.sin(np.arange(19.0)), 9.9e37))
    >>> record.faults[0].kind, record.faults[0].samples
    ('code', (19,))
    """

    kind: Kind
    """Type of the fault."""
    samples: tuple[int, ...]
    """Faulty samples, counted from 0; empty if all samples have the fault."""
    size: float
    """The first of these readings, the rate of a drift, or the samples of a lag."""
    text: str
    """Description of the fault."""
    remedy: str
    """Remedy for the fault."""

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}"

    @classmethod
    def at(cls, places: IntArray, values: FloatArray, kind: Kind, text: str, remedy: str) -> Fault:
        """Return the fault of some samples.

        Parameters
        ----------
        places : (N,) array of int
            The faulty samples.
        values : (T,) array
            All readings.
        kind, text, remedy
            As of `Fault`.
        """
        return cls(kind, tuple(places.tolist()), float(values[places[0]]), text, remedy)


_Detector: TypeAlias = Callable[[FloatArray], Iterable[Fault]]
"""Finds faults of one kind in readings (T,), NaN if not measured."""


def _without(y: FloatArray, detectors: Iterable[_Detector]) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the readings (T,) with NaN in place of faulty ones, and the faults.

    Each detector checks the readings that the previous detectors left.
    """
    found: list[Fault] = []
    for detect in detectors:
        faults = list(detect(y))
        if faults:
            y = y.copy()
            y[[sample for fault in faults for sample in fault.samples]] = np.nan
        found += faults
    return y, tuple(found)


def listed(samples: IntArray, values: FloatArray) -> str:
    """Return samples with their values (T,) as text, the first six of many."""
    shown = ", ".join(f"sample {k} ({values[k]:.6g})" for k in samples[:_SHOWN])
    more = samples.size - _SHOWN
    return f"{shown} and {more} more" if more > 0 else shown


def clipped(values: FloatArray, places: IntArray, extreme: str) -> Fault:
    """Return the fault of readings that are clipped at the ``"highest"`` or ``"lowest"`` of all."""
    limit = np.nanmax(values) if extreme == "highest" else np.nanmin(values)
    share = places.size / np.count_nonzero(np.isfinite(values))
    text = (
        f"the output is clipped or saturated at its {extreme}, {limit:.6g}: {places.size} readings "
        f"({share:.1%}) are within noise of it while the input goes on, first at sample "
        f"{places[0]}; the range of the sensor ends there, or the source limits the input, or the "
        "actuator saturates, and the model holds within this range only"
    )
    remedy = "use a wider range or smaller inputs, or empty these cells, unless it saturates"
    return Fault.at(places, values, "clipped", text, remedy)


def stuck(values: FloatArray, stretches: Sequence[IntArray], others: str) -> Fault:
    """Return the fault of stretches without motion; ``others`` describes the other readings."""
    first, places, count = stretches[0], np.concatenate(stretches), len(stretches)
    more = f", the first of {count} such stretches up to sample {places[-1]}" if count > 1 else ""
    text = (
        f"the output is stuck at {np.median(values[first]):.6g} from sample {first[0]} to "
        f"{first[-1]}{more}; {others}"
    )
    remedy = "check the sensor and the actuator, and measure again or empty these cells"
    return Fault.at(places, values, "stuck", text, remedy)


def far_from_others(values: FloatArray, places: IntArray, name: str = "") -> Fault:
    """Return the fault of outliers; ``name`` is that of a measured input."""
    found = counted(places.size, "outlier") + (f" of {name}" if name else "")
    text = f"{found}, far from the expected and from the neighbouring readings"
    remedy = "check the cable and the trigger of the sensor, and repeat, or empty these cells"
    if name:
        remedy = "not used as input: if the source made them, give the applied input"
    return Fault.at(places, values, "outlier", f"{text}: {listed(places, values)}", remedy)


FEWEST = 3
"""Least measured samples to fit a model."""

_OVERLOAD = 9e36
"""Magnitude from which a reading is an overload code, as 9.9e37 and 9.91e37 are."""
_SENTINELS = (
    *(-999.0, -9999.0, -99999.0, -999999.0, -9999999.0, -999.25, -999.9, -9999.9, -6999.0, -7999.0),
    *(9999.0, 99999.0, 999999.0, 9999999.0, 999.99, 9999.9, 9999.99, 99999.9, 7999.0),
    *(32767.0, -32768.0, 65535.0, 2147483647.0, -2147483648.0, 4294967295.0),
    *(1e20, -1e20, 1e30, -1e30, 1e35, -1e35),
)
"""Values that loggers and file formats use for a missing reading."""
_ABSURD, _ABSURD_SHARE, _FEWEST_ABSURD = 1e4, 0.001, 12
"""Least distance from the median of an absurd reading, over the greatest of all other distances;
largest share of absurd readings; and least readings for this check."""


def codes(y: FloatArray, noun: str = "reading") -> tuple[Fault, ...]:
    """Find the readings that are overload codes or sentinels, or absurdly far from all others.

    ``y`` (T,): outputs, NaN if not measured; ``noun``: their name in messages.
    """
    suspect = np.abs(y) >= _OVERLOAD
    for sentinel in _SENTINELS if np.abs(y).max(initial=0.0, where=~np.isnan(y)) > 998 else ():
        suspect |= np.abs(y - sentinel) <= 1e-6 * abs(sentinel)
    suspect |= _absurd(np.where(suspect, np.nan, y))
    if not suspect.any():
        return ()
    rest = y[np.isfinite(y) & ~suspect]
    suspect &= np.isfinite(y)
    if rest.size < 3:
        return ()
    low, high = rest.min(), rest.max()
    # Distance of a sentinel from the range of all other readings, over that range
    apart = 0.25 * (high - low)
    suspect &= (y < low - apart) | (y > high + apart)
    places = np.flatnonzero(suspect)
    if not places.size:
        return ()
    code = "a code" if places.size == 1 else "codes"
    text = (
        f"{counted(places.size, noun)} {are(places.size)} {code} of the instrument and not a "
        f"measurement, {listed(places, y)}"
    )
    remedy = "not used: check the range of the instrument and repeat"
    if noun == "input":
        remedy = "give the applied input, or cut these rows"
    return (Fault.at(places, y, "code", text, remedy),)


def without_codes(u: FloatArray, y: FloatArray) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the outputs with NaN in place of codes, and their faults.

    Raises a `SignalError` if an input is an overload code, or nearly all outputs are codes.

    ``u`` and ``y`` (T,): inputs, and outputs, NaN if not measured.
    """
    over = np.flatnonzero(np.abs(u) >= _OVERLOAD)
    if over.size and codes(u):
        raise SignalError(
            f"u is {u[over[0]]:g} at index {over[0]}, an overload code and not an input; give the "
            "applied input, or cut these rows"
        )
    finite = y[np.isfinite(y)]
    sound = int(np.count_nonzero(np.abs(finite) < _OVERLOAD))
    if sound < min(finite.size, FEWEST) and np.abs(finite).max() <= LARGEST:
        raise SignalError(
            f"{f'{finite.size - sound} of' if sound else 'all'} {finite.size} outputs are overload "
            f"codes such as {finite[np.abs(finite) >= _OVERLOAD][0]:g}, not measurements; check "
            "the range of the instrument and repeat, or scale the outputs to below "
            f"{_OVERLOAD:g}"
        )
    return _without(y, [codes])


def _absurd(y: FloatArray) -> BoolArray:
    """Return the readings (T,) that are ten thousand times further away than all others."""
    known = np.isfinite(y)
    values = y[known]
    if values.size < _FEWEST_ABSURD:
        return np.zeros(y.size, dtype=np.bool_)
    with np.errstate(over="ignore", invalid="ignore"):
        distance = np.abs(y - np.median(values))
        last = values.size - 1 - max(int(_ABSURD_SHARE * values.size), 1)
        others = np.partition(distance[known], last)[last]
        found: BoolArray = known & (others > 0) & (distance > _ABSURD * others)
    return found


def usable(
    y: FloatArray, limits: tuple[float, float] | None = None
) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the readings (T,) with NaN in place of unusable readings, and the faults."""
    return _without(y, (partial(_beyond, limits), *DETECTORS))


def _beyond(limits: tuple[float, float] | None, y: FloatArray) -> Iterator[Fault]:
    """Find readings at or beyond the limits of the sensor."""
    low, high = limits or (-np.inf, np.inf)
    if not low < high:
        raise ParameterError(f"the range of the sensor is [{low:g}, {high:g}]; give low below high")
    places = np.flatnonzero((y <= low) | (y >= high))
    if places.size:
        text = (
            f"{counted(places.size, 'reading')} {are(places.size)} beyond the range of the sensor"
        )
        remedy = "move the sensor or reduce the input, or correct the range (--holds range=...)"
        text += f", {low:g} to {high:g}: {listed(places, y)}"
        yield Fault.at(places, y, "range", text, remedy)


def _clipped(y: FloatArray) -> Iterator[Fault]:
    """Find extremes that a noisy output repeats exactly several times in a row."""
    known = y[np.isfinite(y)]
    if not known.size:
        return
    for word, extreme in (("lowest", known.min()), ("highest", known.max())):
        at = y == extreme
        # Equal readings in a row, at an end of the range of the output, that count as clipped
        often = np.diff(_runs(at)).max() >= 4
        if often and noise_above_resolution(known[known != extreme]):
            yield clipped(y, np.flatnonzero(at), word)


def _stuck(y: FloatArray) -> Iterator[Fault]:
    """Find stretches without the noise that a sensor has elsewhere."""
    places = np.flatnonzero(np.isfinite(y))
    found = frozen(y[places])
    stretches = [places[begin:end] for begin, end in found.runs]
    if stretches:
        yield stuck(y, stretches, f"others scatter with a standard deviation of {found.noise:.2g}")


DETECTORS: tuple[_Detector, ...] = (codes, _clipped, _stuck)
"""Each detector checks the readings that the previous detectors left."""


_WIDTH = 21
"""Number of readings of the running median, which follows every rise or fall exactly."""
_LONGEST = 8
"""Most readings of a burst."""
_SHARP = 0.3
"""Least difference of each reading of a spike from its neighbours, over its largest distance."""
_LARGE = 0.25
"""Least distance over the largest for spikes that are found together."""
_FEWEST_STEADY = 20
"""Least readings to distinguish spikes from noise."""


def spikes(y: npt.ArrayLike) -> BoolArray:
    """Return (T,) whether each reading is a spike, as from a disturbed line or a lost echo.

    All are False for fewer than twenty readings, or if more than a tenth would be spikes.

    ``y`` (T,): readings of a sensor while its input is constant, NaN if not measured.
    """
    values = np.asarray(y, dtype=np.float64)
    known = np.flatnonzero(np.isfinite(values))
    found = np.zeros(values.size, dtype=np.bool_)
    if known.size < _FEWEST_STEADY:
        return found
    left = known
    # A large spike shifts the median beside it, so smaller spikes show only without it.
    while left.size >= _FEWEST_STEADY and (more := _largest(values[left])).any():
        found[left[more]] = True
        left = left[~more]
    # If more than a tenth are spikes, the output itself is like this
    return found if np.count_nonzero(found) <= 0.1 * known.size else np.zeros_like(found)


def without_spikes(
    y: FloatArray, holds: Sequence[FoundHold]
) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return the readings with NaN in place of spikes within holds, and their fault."""
    found = np.zeros(y.size, dtype=np.bool_)
    for hold in holds:
        found[hold.begin : hold.end] = spikes(y[hold.begin : hold.end])
    if not found.any():
        return y, ()
    return np.where(found, np.nan, y), (far_from_others(y, np.flatnonzero(found)),)


def input_without_spikes(u: FloatArray, name: str) -> tuple[FloatArray, tuple[Fault, ...]]:
    """Return a measured input with straight lines in place of its spikes, and their fault.

    A model would take a spike for an extreme, which wipes out its memory.
    """
    found = spikes(u)
    if not found.any():
        return u, ()
    samples = np.arange(u.size)
    level = np.interp(samples, samples[~found], u[~found])
    return level, (far_from_others(u, np.flatnonzero(found), name),)


def _largest(y: FloatArray) -> BoolArray:
    """Return the largest spikes: far from a running median, and from both neighbours alike."""
    from scipy.ndimage import median_filter

    away = y - median_filter(y, _WIDTH, mode="mirror")
    # Usual distance within three widths, which a spike exceeds many times: in an oscillation all
    # distances are large
    usual = median_filter(np.abs(away), 3 * _WIDTH, mode="mirror")
    # Distance of a spike from the median, in standard deviations of the noise, and in steps
    noise = max(8.0 * noise_of(np.diff(y, 2), 2), 4.0 * resolution(y))
    limit = np.maximum(noise, 8.0 * usual)
    size = np.zeros(y.size)
    for way in (1, -1):
        for begin, end in _runs(way * away > limit).tolist():
            # The first readings of a hold may belong to the previous hold.
            if begin == 0 or end - begin > _LONGEST:
                continue
            far = np.abs(away[begin:end]).max()
            beside = np.append(y[begin - 1], y[end : end + 1])
            rise = np.min(way * y[begin:end]) - np.max(way * beside)
            # If the neighbouring readings differ by more than a rise, it may be an overshoot.
            if rise >= max(_SHARP * far, np.ptp(beside)):
                size[begin:end] = far
    found: BoolArray = (size > 0) & (size >= _LARGE * size.max())
    return found


def _runs(at: BoolArray) -> IntArray:
    """(N, 2) begin and end of each run of true values."""
    return np.flatnonzero(np.diff(at, prepend=False, append=False)).reshape(-1, 2)
