"""Steering of a head to angles, without camera or catheter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop.head.control.controller import within
from minorloop.head.control.head import HeadControl, HeadState
from minorloop.lab.actuator import Actuator
from minorloop.lab.run import left_safe

_AXES = "pan", "tilt"
_STEADY = 0.2
"""Share of a hold, at its end, of which the readings are averaged."""


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
    unreachable : tuple of str
        A sentence for each target that the guard found out of reach until the end of its hold.
    """

    t: FloatArray
    wanted: FloatArray
    read: FloatArray
    current: FloatArray
    targets: FloatArray
    unreachable: tuple[str, ...] = ()

    @cached_property
    def reached(self) -> FloatArray:
        """(N, 2) mean readings at the end of each hold, in degrees; NaN where there are none."""
        ticks = self.t.size // len(self.targets)
        last = max(round(_STEADY * ticks), 1)
        ends = self.read.reshape(len(self.targets), ticks, 2)[:, -last:]
        seen = np.isfinite(ends)
        count = seen.sum(axis=1)
        total = np.where(seen, ends, 0.0).sum(axis=1)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def steer(
    head: Actuator, control: HeadControl, targets: npt.ArrayLike, hold: float = 8.0
) -> SteeredHead:
    """Bring a cold head to targets, hold each, and leave it safe.

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
    ticks = round(within("hold", hold, head.tick, 3600.0, "s") / head.tick)
    for row, each in enumerate(wanted, 1):
        _check_reach(control, each, row)
    every = np.repeat(wanted, ticks, axis=0)
    read, current = np.empty_like(every), np.empty_like(every)
    missed: list[str] = []
    with left_safe(head):
        seen = np.asarray(head.exchange(np.zeros(2)))
        state = control.begin(seen)
        for k, each in enumerate(every):
            current[k], state = control.step(state, each, seen, t=k * head.tick)
            seen = np.asarray(head.exchange(current[k]))
            read[k] = seen
            if (k + 1) % ticks == 0:
                missed += _missed(state, (k + 1) // ticks)
    t = head.tick * np.arange(1.0, len(every) + 1.0, dtype=np.float64)
    return SteeredHead(np.asarray(t), every, read, current, wanted, tuple(missed))


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


def _missed(state: HeadState, row: int) -> list[str]:
    """Return a sentence for each axis whose target is out of reach."""
    return [
        f"{name} did not reach target {row}: {axis.unreachable}"
        for name, axis in zip(_AXES, state.axes, strict=True)
        if axis.unreachable is not None
    ]
