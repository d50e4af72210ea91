"""Steering of a head to angles, without camera or catheter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, IntArray
from minorloop.errors import ParameterError
from minorloop.head.control.controller import within
from minorloop.head.control.head import HeadControl, HeadState
from minorloop.head.procedures.drive_faults import DriveFault, FaultLog
from minorloop.lab.actuator import Actuator
from minorloop.lab.run import left_safe

_AXES = "pan", "tilt"
_STEADY = 0.2
"""Share of a hold, at its end, of which the readings are averaged."""
_OFF = 0.05
"""Share of the reach of a wire by which a target is missed: as `minorloop drive` warns."""


@dataclass(frozen=True, eq=False)
class SteeredHead:
    """How a head reached its targets.

    Parameters
    ----------
    t : (T,) array
        Ends of the ticks, in seconds.
    wanted, read, current : (T, 2) array
        Targets and readings in degrees, NaN where a sensor was lost; currents in A.
    targets : (N, 2) array
        In degrees.
    row : (T,) array of int
        Number of the target, from 0.
    unreachable : tuple of str
        A sentence for each target that the guard found out of reach until the end of its hold.
    missed : tuple of str
        A sentence for each other target that was not reached at the end of its hold.
    faults : tuple of DriveFault
        Of the readings.
    """

    t: FloatArray
    wanted: FloatArray
    read: FloatArray
    current: FloatArray
    targets: FloatArray
    row: IntArray
    unreachable: tuple[str, ...] = ()
    missed: tuple[str, ...] = ()
    faults: tuple[DriveFault, ...] = ()

    @property
    def done(self) -> bool:
        """Whether every target was reached, and no wire cooled because of its readings."""
        return not (self.unreachable or self.missed or any(each.cooled for each in self.faults))

    @cached_property
    def reached(self) -> FloatArray:
        """(N, 2) mean readings at the end of each hold, in degrees; NaN where there are none."""
        reached = np.full(self.targets.shape, np.nan)
        for n in range(len(self.targets)):
            read = self.read[self.row == n]
            for k, seen in enumerate(read[-max(round(_STEADY * len(read)), 1) :].T):
                if np.isfinite(seen).any():
                    reached[n, k] = np.nanmean(seen)
        return reached


def steer(
    head: Actuator, control: HeadControl, targets: npt.ArrayLike, hold: float = 8.0
) -> SteeredHead:
    """Bring a cold head to targets, hold each, and leave it safe.

    A head with a ``time`` may take longer than a tick for a reading: the wires go by that time.

    Parameters
    ----------
    head : Actuator
        Two currents in A, two angles in degrees.
    control : HeadControl
        With the interval of the head's tick.
    targets : (N, 2) array_like
        Readings of pan and tilt, in degrees.
    hold : float
        Seconds for each target.

    Raises
    ------
    ParameterError
        If the targets are not (N, 2) numbers or beyond the reach of the wires, or the hold is
        shorter than a tick; nothing is switched on then.
    SafetyError
        If the head does not confirm at the end that it is safe.
    """
    wanted = np.atleast_2d(np.asarray(targets, dtype=np.float64))
    if wanted.ndim != 2 or wanted.shape[1] != 2 or not np.isfinite(wanted).all():
        raise ParameterError(f"the targets have shape {wanted.shape}; give (N, 2) angles in deg")
    tick = head.tick
    hold = tick * round(within("hold", hold, tick, 3600.0, "s") / tick)
    for n, each in enumerate(wanted, 1):
        _check_reach(control, each, n)
    rows: list[tuple[float, int, FloatArray, FloatArray]] = []
    given_up: dict[tuple[int, int], str] = {}
    faults = FaultLog(_AXES)
    with left_safe(head):
        seen = np.asarray(head.exchange(np.zeros(2)))
        state, t, began = control.begin(seen), 0.0, _time(head, 0.0)
        for n, each in enumerate(wanted):
            while t < (n + 1) * hold - 0.5 * tick:
                current, state = control.step(state, each, seen, t=t)
                faults.note(t, state, getattr(head, "why", ""))
                seen = np.asarray(head.exchange(current))
                t = _time(head, tick * (len(rows) + 1)) - began
                rows.append((t, n, seen, current))
            given_up |= {(n, k): text for k, text in _given_up(state, n + 1).items()}
    times, row, read, current = (np.array(each) for each in zip(*rows, strict=True))
    found = SteeredHead(times, wanted[row], read, current, wanted, row)
    return replace(
        found,
        unreachable=tuple(given_up.values()),
        missed=tuple(_missed(control, found, set(given_up))),
        faults=faults.found(t),
    )


def _time(head: Actuator, counted: float) -> float:
    """Return the time of a head in seconds; that counted in ticks for one without."""
    return float(getattr(head, "time", counted))


def _check_reach(control: HeadControl, target: FloatArray, row: int) -> None:
    """Refuse a target that the wires cannot reach in any surroundings."""
    for name, axis, wanted, (low, high) in zip(
        _AXES, control.axes, target.tolist(), control.reach(target).tolist(), strict=True
    ):
        # A cold wire goes no further down: the other axis compensates what it couples in.
        low = min(low, axis.reach[0])
        if not low - axis.tolerance <= wanted <= high + axis.tolerance:
            raise ParameterError(
                f"{name} of target {row} is {wanted:g} degrees, and the wires reach {low:.1f} to "
                f"{high:.1f} degrees there; give a target within them"
            )


def _given_up(state: HeadState, row: int) -> dict[int, str]:
    """Return a sentence for each axis whose target is out of reach."""
    return {
        k: f"{name} did not reach target {row}: {axis.unreachable}"
        for k, (name, axis) in enumerate(zip(_AXES, state.axes, strict=True))
        if axis.unreachable is not None
    }


def _missed(
    control: HeadControl, found: SteeredHead, given_up: set[tuple[int, int]]
) -> Iterator[str]:
    """Yield a sentence for each other axis that was not at its target at the end of its hold."""
    for (n, k), at in np.ndenumerate(found.reached):
        low, high = control.axes[k].reach
        if (n, k) in given_up or abs(at - found.targets[n, k]) <= _OFF * (high - low):
            continue
        where = "there was no reading" if np.isnan(at) else f"it was at {at:.1f} degrees"
        yield (
            f"{_AXES[k]} did not reach target {n + 1}, {found.targets[n, k]:g} degrees: {where} at "
            "the end of its hold"
        )
