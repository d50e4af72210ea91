"""Faults of the readings during a drive: what was wrong, when, and for how long."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

from minorloop_head.control.guard import GuardState
from minorloop_head.control.head import HeadState
from minorloop_head.vision.wall_patches import UNTURNED

_SHORT = 5
"""Steps from which a fault is listed on its own; shorter ones that are alike are counted together:
more than are lost by chance."""
_MANY = 10
"""Faults that are alike from which on they are counted together, however long they are."""
_UNREAD, _DOUBTED = "there was no reading", "readings jumped as no wire can, and were not used"
_UNUSED = _UNREAD, _DOUBTED, UNTURNED
"""Kinds of faults before the sensor counts as at fault."""
_SLOW = 0.4
"""Intervals by which a step may be late before it counts, if the guard says so too: less than its
limit, so that rounding does not matter."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")
"""Numbers in a text, such as of patches that agree: faults that differ only there are alike."""
_NEAR, _SHARE = 0.2, 0.1
"""Seconds, or share of the longer one, by which faults of two axes may differ that are named as
one."""


@dataclass(frozen=True)
class DriveFault:
    """A fault, or short ones that are alike."""

    axis: str
    """Such as ``pan``, or ``pan and tilt``."""
    began: float
    lasted: float
    """Time of the first, and duration of all, in seconds."""
    what: str
    """What was wrong, and what was done."""
    times: int = 1
    """Number of faults."""
    cooled: bool = False
    """Whether the wire cooled, so that it did not go to its target."""
    over: bool = True
    """Whether it was over before the drive ended."""
    late: bool = False
    """Whether it is that steps came late, all of the drive in one."""

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
class _Open:
    """A fault that goes on: its kind, when it began, its text, steps, and if the wire cooled."""

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
    interval : float
        From a step to the next if none is late, in seconds.
    delay : int
        Age in intervals of the pictures that the control is set up for.
    """

    def __init__(self, names: Sequence[str], interval: float, delay: int = 1) -> None:
        self._names, self._interval, self._delay = tuple(names), interval, delay
        self._t = 0.0
        self._old: list[tuple[float, float]] = []
        self._late: list[tuple[float, float]] = []
        self._kept: list[float] = []
        self._open: dict[tuple[str, str], _Open] = {}
        self._found: list[tuple[DriveFault, int]] = []

    def note(self, t: float, state: HeadState, why: str = "", age: float = math.nan) -> None:
        """Take the state of the control after a step.

        Parameters
        ----------
        t : float
            In seconds.
        state : HeadState
        why : str
            Why the newest picture did not show the angles, if it is known.
        age : float
            Of that picture in seconds; NaN if it is not known.
        """
        if age > (self._delay + 1) * self._interval:  # from then on a law turns back too late
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
        """Return all faults until a time in seconds, the first ones first, then late steps."""
        found: dict[tuple[object, ...], DriveFault] = {}
        every = sorted(self._each(t), key=lambda pair: pair[0].began)
        count = Counter(_kind(fault) for fault, steps in every if steps >= _SHORT)
        for fault, steps in every:
            alone = fault.cooled or (steps >= _SHORT and count[_kind(fault)] < _MANY)
            key = *_kind(fault), fault.began if alone else None
            if key in found:
                before = found[key]
                lasted = before.lasted + fault.lasted
                fault = replace(before, lasted=lasted, times=before.times + 1, over=fault.over)
            found[key] = fault
        return (*_joined(found.values()), *self._all_old(0.0, t), *self._all_late())

    def during(self, name: str, first: float, last: float) -> str:
        """Return the fault that was on last between two times in seconds; empty if none was.

        ``name``: of an axis. If it had no fault, and the head was kept where it was because another
        axis was not read, it is the fault of that one.
        """
        on = _joined(
            fault
            for fault, steps in self._each(self._t)
            if (steps >= _SHORT or fault.cooled)
            and fault.began < last
            and fault.began + fault.lasted > first
        )
        own = [each for each in on if name in each.axis]
        if own:
            return str(own[-1])
        if on and any(first <= t <= last for t in self._kept):
            return f"the head waited, or went back to where it was read before: {on[-1]}"
        return next((each.what for each in self._all_old(first, last)), "")

    def _each(self, t: float) -> list[tuple[DriveFault, int]]:
        """Return each fault until a time with its number of steps."""
        still = [
            (_fault(name, each, t, over=False), each.steps)
            for (name, _), each in self._open.items()
        ]
        return [*self._found, *still]

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
        if now is not None and kind != now.kind and not grown:
            self._found.append((_fault(name, now, t), now.steps))
            del self._open[name, of]
            now = None
        if kind:
            now = self._open.setdefault((name, of), now or _Open(kind, t, what))
            if kind != now.kind:
                now.kind, now.what = kind, what
            now.steps, now.cooled = now.steps + 1, now.cooled or cooled


def _kind(fault: DriveFault) -> tuple[str, str]:
    """Return the axis and the fault, alike for all faults that differ in a count only."""
    return fault.axis, _NUMBER.sub("", fault.what)


def _reading(axis: GuardState, why: str) -> tuple[str, str]:
    """Return the kind of the fault of a reading and what is wrong; both empty if it is good."""
    if axis.fault:
        return axis.fault, _with(_newest(axis, "sensor"), why)
    if axis.reading.used:
        return "", ""
    if axis.reading.odd and not axis.reading.believed:
        return _DOUBTED, f"{_DOUBTED}; the wire went by its model"
    if why.startswith(UNTURNED):
        return UNTURNED, f"readings were not used, because {why}; the wire went by its model"
    return _UNREAD, f"{_with(_UNREAD, why)}; the wire went by its model"


def _newest(axis: GuardState, cause: str) -> str:
    return next((event.text for event in reversed(axis.log) if event.cause == cause), "")


def _with(what: str, why: str) -> str:
    return f"{what} ({why})" if why else what


def _fault(name: str, each: _Open, t: float, *, over: bool = True) -> DriveFault:
    return DriveFault(name, each.began, t - each.began, each.what, 1, each.cooled, over)


def _joined(faults: Iterable[DriveFault]) -> tuple[DriveFault, ...]:
    """Return faults with those that all axes had at about the same time as one."""
    found: list[DriveFault] = []
    for fault in faults:
        k = next((k for k, each in enumerate(found) if _same(each, fault)), None)
        if k is None:
            found.append(fault)
        else:
            found[k] = _as_one(found[k], fault)
    return tuple(found)


def _same(one: DriveFault, other: DriveFault) -> bool:
    """Return whether two axes had a fault at about the same time."""
    longer, more = max(one.lasted, other.lasted), max(one.times, other.times)
    return (
        other.axis not in one.axis
        and (_kind(one)[1], one.cooled, one.over) == (_kind(other)[1], other.cooled, other.over)
        and abs(one.began - other.began) <= _NEAR
        and abs(one.lasted - other.lasted) <= max(_NEAR, _SHARE * longer)
        and abs(one.times - other.times) <= _SHARE * more
    )


def _as_one(one: DriveFault, other: DriveFault) -> DriveFault:
    """Return a fault of two axes; where a number in the text differs, it has both."""
    others = iter(_NUMBER.findall(other.what))

    def both(found: re.Match[str]) -> str:
        second = next(others)
        return found[0] if found[0] == second else f"{found[0]} and {second}"

    return replace(
        one,
        axis=f"{one.axis} and {other.axis}",
        began=min(one.began, other.began),
        lasted=max(one.lasted, other.lasted),
        times=max(one.times, other.times),
        what=_NUMBER.sub(both, one.what),
    )
