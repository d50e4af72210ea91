"""Records that begin at rest, and the single steps in a record of holds."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_waveform, check_scale
from minorloop.errors import SignalError
from minorloop.identification.output_error import Stretch

Arrays: TypeAlias = tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]
"""t, u and y, (T,) each."""


@dataclass(frozen=True, eq=False)
class Sampled:
    """An evenly sampled record; u[k] lasts from sample k to the next."""

    interval: float
    u: FloatArray
    y: FloatArray

    @property
    def changes(self) -> npt.NDArray[np.int64]:
        """Samples at which the input changes."""
        return np.flatnonzero(np.diff(self.u)) + 1


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the input and the hold after it, scaled to a unit step of the output."""

    rising: bool
    """Whether the output rises."""
    stretch: Stretch
    """Input 0 and then 1; output minus its rest value, over its settled change."""


def as_sampled(record: Arrays) -> Sampled:
    """Check a record and convert it to the convention of `Sampled`.

    An output is read at the end of the interval with its input, as an `Actuator` records it.

    Raises a `SignalError` if the shapes differ, the samples are not evenly spaced, the input never
    changes, or a number is beyond 1e150.
    """
    t, u = as_waveform(record[0], record[1])
    _, y = as_waveform(record[0], record[2], name="y")
    for name, values in (("input", u), ("output", y)):
        check_scale(name, values)
    steps = np.diff(t)
    interval = float(np.median(steps))
    # Largest relative deviation of a sampling interval from the median
    if np.abs(steps - interval).max() > 1e-3 * interval:
        worst = int(np.argmax(np.abs(steps - interval)))
        raise SignalError(
            f"t increases by {steps[worst]:g} s at index {worst + 1} and by {interval:g} s "
            "elsewhere; sample evenly, or interpolate"
        )
    u = np.append(u[1:], u[-1])
    if np.ptp(u) == 0:
        raise SignalError(
            f"the input is {u[0]:g} throughout; include the hold before the step, which shows the "
            "output at rest"
        )
    return Sampled(interval, u, y)


def whole(record: Sampled) -> Stretch:
    """The record from the end of its first hold on, minus its values at rest there."""
    first = int(record.changes[0])
    begin = first + 1 - _tail(first + 1)
    rest = float(record.y[begin : first + 1].mean())
    return Stretch(record.u[begin:] - record.u[first - 1], record.y[begin:] - rest)


def steps_in(record: Sampled) -> list[Step]:
    """Every step of a record of holds, with the end of the hold before it.

    Steps that do not change the output are left out: they have no response to scale.
    """
    found = []
    edges = np.concatenate([[0], record.changes, [record.y.size - 1]])
    for before, now, after in zip(edges[:-2], edges[1:-1], edges[2:], strict=True):
        begin = now + 1 - _tail(now + 1 - before)
        rest = float(record.y[begin : now + 1].mean())
        settled = float(record.y[after + 1 - _tail(after - now) : after + 1].mean())
        change = settled - rest
        # A step is divided by its change of the output; smaller changes do not count, by trial.
        if abs(change) <= 1e-9 * np.ptp(record.y):
            continue
        y = (record.y[begin : after + 1] - rest) / change
        u = np.where(np.arange(begin, after + 1) >= now, 1.0, 0.0)
        found.append(Step(change > 0, Stretch(u, y)))
    return found


def _tail(samples: int) -> int:
    """The last tenth of a hold, at least one sample."""
    # Last share of a hold, whose mean is the settled output
    return max(1, int(0.1 * samples))
