"""Faults of the readings during a drive: what was wrong, when, and for how long."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from minorloop.head.control.guard import GuardState
from minorloop.head.control.head import HeadState

_SHORT = 5
"""Steps from which a fault is listed on its own; shorter ones that are alike are counted together:
more than are lost by chance."""
_UNREAD, _DOUBTED = "there was no reading", "readings jumped as no wire can, and were not used"
_SLOW = "steps were late: more than one interval went by"
_COUNTS = re.compile(r"\d+")
"""Numbers in a text, such as of patches that agree: faults that differ only there are alike."""


@dataclass(frozen=True)
class DriveFault:
    """A fault, or short ones that are alike.

    Parameters
    ----------
    axis : str
        Such as ``pan``, or ``pan and tilt``.
    began, lasted : float
        Time of the first, and duration of all, in seconds.
    what : str
        What was wrong, and what was done.
    times : int
        Number of faults.
    cooled : bool
        Whether the wire cooled, so that it did not go to its target.
    over : bool
        Whether it was over before the drive ended.
    """

    axis: str
    began: float
    lasted: float
    what: str
    times: int = 1
    cooled: bool = False
    over: bool = True

    def __str__(self) -> str:
        if self.times > 1:
            when = f"{self.times} times from {self.began:.2f} s, {self.lasted:.2f} s in all"
        elif self.over:
            when = f"from {self.began:.2f} s for {self.lasted:.2f} s"
        else:
            when = f"from {self.began:.2f} s to the end"
        return f"{self.axis}, {when}: {self.what}"


@dataclass
class _Open:
    """A fault that goes on: its kind, first and last time, steps and text."""

    kind: str
    began: float
    what: str
    steps: int = 0
    cooled: bool = False


class FaultLog:
    """Collects the faults of the axes while a head is driven.

    Parameters
    ----------
    names : sequence of str
        Of the axes.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._open: dict[tuple[str, str], _Open] = {}
        self._found: list[tuple[DriveFault, int]] = []

    def note(self, t: float, state: HeadState, why: str = "") -> None:
        """Take the state of the control after a step.

        Parameters
        ----------
        t : float
            In seconds.
        state : HeadState
        why : str
            Why the newest picture did not show the angles, if it is known.
        """
        for name, axis in zip(self._names, state.axes, strict=True):
            kind, what = _reading(axis, why)
            self._follow(t, name, "reading", kind, what, cooled=axis.cools)
            self._follow(t, name, "clock", "slow" if "clock" in axis.active else "", _clock(axis))

    def found(self, t: float) -> tuple[DriveFault, ...]:
        """Return all faults until a time in seconds, the first ones first."""
        ended = [*self._found]
        for (name, _), each in self._open.items():
            ended.append((_fault(name, each, t, over=False), each.steps))
        found: dict[tuple[object, ...], DriveFault] = {}
        for fault, steps in sorted(ended, key=lambda pair: pair[0].began):
            alone = steps >= _SHORT or fault.cooled
            key = fault.axis, _COUNTS.sub("", fault.what), fault.began if alone else None
            if key in found:
                before = found[key]
                lasted = before.lasted + fault.lasted
                fault = replace(before, lasted=lasted, times=before.times + 1, over=fault.over)
            found[key] = fault
        return _joined(list(found.values()))

    def _follow(
        self, t: float, name: str, of: str, kind: str, what: str, *, cooled: bool = False
    ) -> None:
        now = self._open.get((name, of))
        # A sensor is at fault after some missing readings: it is one fault.
        if now is not None and kind != now.kind and not (kind and now.kind == _UNREAD):
            self._found.append((_fault(name, now, t), now.steps))
            del self._open[name, of]
            now = None
        if kind:
            now = self._open.setdefault((name, of), now or _Open(kind, t, what))
            if kind != now.kind:
                now.kind, now.what = kind, what
            now.steps, now.cooled = now.steps + 1, now.cooled or cooled


def _reading(axis: GuardState, why: str) -> tuple[str, str]:
    """Return the kind of the fault of a reading and what is wrong; both empty if it is good."""
    if axis.fault:
        return axis.fault, _with(_newest(axis, "sensor"), why)
    if not np.isnan(axis.sensed.value):
        return "", ""
    if axis.sensed.odd and not axis.belief.believed:
        return _UNREAD, f"{_DOUBTED}; the wire went by its model"
    return _UNREAD, f"{_with(_UNREAD, why)}; the wire went by its model"


def _clock(axis: GuardState) -> str:
    said = _newest(axis, "clock")
    return _SLOW if "between two steps" in said else said


def _newest(axis: GuardState, cause: str) -> str:
    return next((event.text for event in reversed(axis.log) if event.cause == cause), "")


def _with(what: str, why: str) -> str:
    return f"{what} ({why})" if why else what


def _fault(name: str, each: _Open, t: float, *, over: bool = True) -> DriveFault:
    return DriveFault(name, each.began, t - each.began, each.what, 1, each.cooled, over)


def _joined(faults: list[DriveFault]) -> tuple[DriveFault, ...]:
    """Return faults with those that all axes had at the same time as one."""
    alike: dict[DriveFault, list[str]] = {}
    for fault in faults:
        alike.setdefault(replace(fault, axis=""), []).append(fault.axis)
    return tuple(replace(fault, axis=" and ".join(names)) for fault, names in alike.items())
