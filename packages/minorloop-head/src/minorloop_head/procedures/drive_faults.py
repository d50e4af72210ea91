"""Faults of the readings during a drive, with their times and durations."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from minorloop_head.control.guard import GuardState
from minorloop_head.control.head import HeadState
from minorloop_head.vision.wall_patches import UNTURNED

_SHORT = 5
"""Least number of steps of a fault that explains a missed target: more than are lost by chance."""
_UNREAD = "there was no reading"
_DOUBTED = "readings jumped faster than the wire can move, and were not used"
_UNUSED = _UNREAD, _DOUBTED, UNTURNED
"""Kinds of faults before the sensor counts as at fault."""
_SLOW = 0.4
"""Intervals by which a step is late, if the guard reports it too: less than the limit of the guard,
so that rounding does not matter."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")
"""Numbers in a text, such as of patches that agree: faults that differ only in them are alike."""


@dataclass(frozen=True)
class DriveFault:
    """Like faults of an axis, or equal ones of both axes, as one."""

    axis: str
    """Such as ``pan``, or ``pan and tilt``."""
    began: float
    lasted: float
    """Time of the first, and duration of all, in seconds."""
    what: str
    """Description of the fault, and the reaction to it."""
    times: int = 1
    """Number of faults."""
    cooled: bool = False
    """Whether the wire cooled, so that it did not go to its target."""
    over: bool = True
    """Whether it was over before the drive ended."""
    late: bool = False
    """Whether it stands for all late steps of the drive."""

    def __str__(self) -> str:
        if self.late:
            what = self.what if self.times > 1 else self.what.replace("steps were", "step was")
            return f"{self.times} {what}"
        if self.times > 1:
            when = f"{self.times} times from {self.began:.2f} s, {self.lasted:.2f} s in all"
        elif self.over:
            when = f"from {self.began:.2f} s for {self.lasted:.2f} s"
        else:
            when = f"from {self.began:.2f} s to the end"
        return f"{self.axis}, {when}: {self.what}"


@dataclass
class _Noted:
    """A fault of an axis, its beginning and end, and whether the wire cooled."""

    axis: str
    kind: str
    what: str
    began: float
    until: float
    over: bool = False
    steps: int = 0
    cooled: bool = False

    @property
    def fault(self) -> DriveFault:
        """Description of the fault, from its beginning to its end."""
        lasted = self.until - self.began
        return DriveFault(self.axis, self.began, lasted, self.what, 1, self.cooled, self.over)


class FaultLog:
    """Collects the faults of the axes while a head is driven.

    ``names``: of the axes; ``interval``: from a step to the next if none is late, in seconds;
    ``delay``: age of the pictures for which the control is set up, in intervals.
    """

    def __init__(self, names: Sequence[str], interval: float, delay: int = 1) -> None:
        self._names, self._interval, self._delay = tuple(names), interval, delay
        self._t = 0.0
        self._old: list[tuple[float, float]] = []
        self._late: list[tuple[float, float]] = []
        self._kept: list[float] = []
        self._noted: list[_Noted] = []
        self._open: dict[tuple[str, str], _Noted] = {}

    def note(self, t: float, state: HeadState, why: str = "", age: float = math.nan) -> None:
        """Take the state of the control after a step.

        ``t``: in seconds. ``why``: why the newest picture did not show the angles, if it is known.
        ``age``: of that picture in seconds; NaN if it is not known.
        """
        if age > (self._delay + 1) * self._interval:  # with older ones, control reverses too late
            self._old.append((t, age))
        late = t - self._t - self._interval
        slow = late > _SLOW * self._interval
        if slow and any("clock" in axis.active for axis in state.axes):
            self._late.append((t, late))
        if state.unread.kept is not None:
            self._kept.append(t)
        for name, axis in zip(self._names, state.axes, strict=True):
            kind, what = _reading(axis, why)
            self._follow(t, name, "reading", kind, what, cooled=axis.cools)
            wrong = "clock" in axis.active and not slow
            self._follow(t, name, "clock", "wrong" if wrong else "", _newest(axis, "clock"))
        self._t = t

    def found(self, t: float) -> tuple[DriveFault, ...]:
        """Return all faults until a time in seconds in order of time, then late steps.

        Like faults of an axis are joined, unless the wire cooled.
        """
        found: dict[tuple[object, ...], DriveFault] = {}
        for each in self._noted:
            each.until = each.until if each.over else t
            key = each.axis, _NUMBER.sub("", each.what), each.began if each.cooled else None
            one = each.fault
            if key in found:
                before = found[key]
                lasted, times = before.lasted + one.lasted, before.times + 1
                one = replace(before, lasted=lasted, times=times, over=one.over)
            found[key] = one
        return (*_join_axes(found.values()), *self._all_old(0.0, t), *self._all_late())

    def during(self, name: str, first: float, last: float) -> str:
        """Return the last fault active between two times in seconds; empty if there was none.

        ``name``: of an axis. If it had no fault, and the head held its position because another
        axis was not read, the fault of the other axis is returned.
        """
        on = _join_axes(
            each.fault
            for each in self._noted
            if (each.steps >= _SHORT or each.cooled) and each.began < last and each.until > first
        )
        own = [each for each in on if name in each.axis]
        if own:
            return str(own[-1])
        if on and any(first <= t <= last for t in self._kept):
            return f"the head waited, or went back to where it was read before: {on[-1]}"
        return next((each.what for each in self._all_old(first, last)), "")

    def _all_old(self, first: float, last: float) -> Iterator[DriveFault]:
        """Yield one fault for all pictures between two times that were too old, if any was."""
        old = [(t, age) for t, age in self._old if first <= t <= last]
        if old:
            what = (
                f"pictures were up to {max(age for _, age in old):.2g} s old, and the control is "
                f"set up for {self._delay * self._interval:.2g} s: the head was turned more "
                "slowly; check the camera and its network"
            )
            axes, lasted = " and ".join(self._names), len(old) * self._interval
            yield DriveFault(axes, old[0][0], lasted, what, len(old))

    def _all_late(self) -> Iterator[DriveFault]:
        """Yield one fault for all steps that were late, if any was."""
        if self._late:
            by = [late for _, late in self._late]
            what = f"steps were late, by up to {max(by):.2g} s"
            began, axes = self._late[0][0], " and ".join(self._names)
            yield DriveFault(axes, began, sum(by), what, len(by), late=True)

    def _follow(
        self, t: float, name: str, of: str, kind: str, what: str, *, cooled: bool = False
    ) -> None:
        now = self._open.get((name, of))
        # A sensor is at fault after some readings that were not used: it is one fault.
        grown = now is not None and now.kind in _UNUSED and kind not in ("", *_UNUSED)
        if now is not None:
            now.until = t
            if kind != now.kind and not grown:
                now.over, now = True, None
                del self._open[name, of]
        if kind:
            if now is None:
                now = self._open[name, of] = _Noted(name, kind, what, t, t)
                self._noted.append(now)
            elif kind != now.kind:
                now.kind, now.what = kind, what
            now.steps, now.cooled = now.steps + 1, now.cooled or cooled


def _reading(axis: GuardState, why: str) -> tuple[str, str]:
    """Return kind and description of the fault of a reading; both empty if it is good."""
    if axis.fault:
        return axis.fault, _with_reason(_newest(axis, "sensor"), why)
    if axis.reading.used:
        return "", ""
    if axis.reading.odd and not axis.reading.believed:
        return _DOUBTED, f"{_DOUBTED}; the wire went by its model"
    if why.startswith(UNTURNED):
        return UNTURNED, f"readings were not used, because {why}; the wire went by its model"
    return _UNREAD, f"{_with_reason(_UNREAD, why)}; the wire went by its model"


def _newest(axis: GuardState, cause: str) -> str:
    return next((event.text for event in reversed(axis.log) if event.cause == cause), "")


def _with_reason(what: str, why: str) -> str:
    return f"{what} ({why})" if why else what


def _join_axes(faults: Iterable[DriveFault]) -> tuple[DriveFault, ...]:
    """Return faults, with equal faults of all axes joined to one."""
    axes: dict[DriveFault, list[str]] = {}
    for each in faults:
        axes.setdefault(replace(each, axis=""), []).append(each.axis)
    return tuple(replace(each, axis=" and ".join(names)) for each, names in axes.items())
