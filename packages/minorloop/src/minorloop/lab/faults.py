"""Faults of a record: what is wrong, where, and what to do about it, in the same words everywhere.

Detectors give them: those of readings alone are in `minorloop.lab.readings`, those that need the
inputs too in `minorloop.identification.screening`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import are, counted

__all__ = ["Fault", "clipped", "codes_among", "far_from_others", "listed", "stuck", "without"]

Kind: TypeAlias = Literal["code", "range", "clipped", "stuck", "outlier", "drift", "lag"]
_SHOWN = 6
"""Samples that are listed at most."""


@dataclass(frozen=True)
class Fault:
    """A fault of a record, which would spoil what is made of it.

    Examples
    --------
    >>> record = ml.Record(np.arange(20.0), np.append(np.sin(np.arange(19.0)), 9.9e37))
    >>> record.faults[0].kind, record.faults[0].samples
    ('code', (19,))
    """

    kind: Kind
    """Type of the fault."""
    samples: tuple[int, ...]
    """Samples that it spoils, counted from 0; empty where it is in all of them."""
    size: float
    """The first of these readings, the rate of a drift, or the samples of a lag."""
    text: str
    """What was found."""
    remedy: str
    """What to do about it."""

    def __str__(self) -> str:
        return f"{self.text}; {self.remedy}"

    @classmethod
    def at(cls, places: IntArray, values: FloatArray, kind: Kind, text: str, remedy: str) -> Fault:
        """Return the fault of some samples.

        Parameters
        ----------
        places : (N,) array of int
            These samples.
        values : (T,) array
            All readings.
        kind, text, remedy
            As of `Fault`.
        """
        return cls(kind, tuple(places.tolist()), float(values[places[0]]), text, remedy)


def without(values: FloatArray, faults: Iterable[Fault]) -> FloatArray:
    """Return readings (T,) with NaN in place of those that faults spoil."""
    samples = [sample for fault in faults for sample in fault.samples]
    if not samples:
        return values
    kept = values.copy()
    kept[samples] = np.nan
    return kept


def listed(samples: IntArray, values: FloatArray) -> str:
    """Return samples with their values (T,) as text, the first six of many."""
    shown = ", ".join(f"sample {k} ({values[k]:.6g})" for k in samples[:_SHOWN])
    more = samples.size - _SHOWN
    return f"{shown} and {more} more" if more > 0 else shown


def codes_among(values: FloatArray, places: IntArray, noun: str) -> Fault:
    """Return the fault of values (T,) some of which (N,) are codes; ``noun`` says what they are."""
    many, output = places.size, noun != "input"
    code = "a code" if many == 1 else "codes"
    text = f"{counted(many, noun)} {are(many)} {code} of the instrument and no measurement"
    remedy = "not used: check the range of the instrument and repeat"
    remedy = remedy if output else "give what was applied, or cut these rows"
    return Fault.at(places, values, "code", f"{text}, {listed(places, values)}", remedy)


def clipped(values: FloatArray, places: IntArray, extreme: str) -> Fault:
    """Return the fault of readings at the ``"highest"`` or ``"lowest"`` of all."""
    limit = np.nanmax(values) if extreme == "highest" else np.nanmin(values)
    text = (
        f"the output is clipped at its {extreme}, {limit:.6g}: {places.size} readings are within "
        f"noise of it while the input goes on, first at sample {places[0]}; there the range of the "
        "sensor ends, or the source limits the input, and a model is not valid beyond it"
    )
    remedy = "use a wider range or smaller inputs, or empty these cells"
    return Fault.at(places, values, "clipped", text, remedy)


def stuck(values: FloatArray, stretches: Sequence[IntArray], others: str) -> Fault:
    """Return the fault of stretches without motion; ``others`` says what the other readings do."""
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
    what = counted(places.size, "outlier") + (f" of {name}" if name else "")
    text = f"{what}, far from what is expected and from the readings around"
    remedy = "check the cable and the trigger of the sensor, and repeat, or empty these cells"
    if name:
        remedy = "not taken for the input: if the source made this, give what was applied"
    return Fault.at(places, values, "outlier", f"{text}: {listed(places, values)}", remedy)
