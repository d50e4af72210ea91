"""Steering of a head to angles, without camera or catheter."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, IntArray
from minorloop.errors import ParameterError, SafetyError
from minorloop.lab.actuator import Actuator
from minorloop.lab.run import left_safe
from minorloop_head.control.controller import INTERVAL, within
from minorloop_head.control.head import HeadControl, HeadState
from minorloop_head.geometry import AXES
from minorloop_head.procedures.drive_faults import DriveFault, FaultLog

_STEADY = 0.2
"""Share of a hold, at its end, over which the angles are averaged."""
_CHECK = (
    "check whether the hold is too short, the pictures come late, a load sways the head, or it "
    "differs from its file"
)
"""Advice if a head whose camera measures its angles misses a target without a known fault."""
_RATE = 10.0
"""Least pictures per second for a head whose camera measures its angles."""
_LATELY = 25
"""Number of last steps whose median is the usual duration: searches for a lost view take longer."""
_REHEARSED = 25
"""Number of steps of the control without a head, which compile it before a current is on."""
_OFF = 0.05
"""Tolerance of a reached target and of a still angle, as a share of the reach of the wire; warnings
of `minorloop drive` use the same."""
_MOST = 0.05, 0.95
"""Quantiles of the readings whose difference is the motion: without noise and outliers."""


@dataclass(frozen=True, eq=False)
class SteeredHead:
    """Record of a head that was steered to targets, and the result for each target."""

    t: FloatArray
    """Shape (T,). Ends of the ticks, in seconds."""
    wanted: FloatArray
    read: FloatArray
    current: FloatArray
    """Shape (T, 2). Targets and readings in degrees, NaN where a sensor was lost; currents in A."""
    targets: FloatArray
    """Shape (N, 2). In degrees."""
    row: IntArray
    """Shape (T,). Number of the target, from 0."""
    used: BoolArray
    """Shape (T, 2). Whether the control used the reading; where not, the wire went by its model."""
    modelled: FloatArray
    """Shape (T, 2). Angles by the model of the control, which used readings correct, in degrees."""
    unreachable: tuple[str, ...] = ()
    """A sentence for each target that the guard found out of reach until the end of its hold."""
    missed: tuple[str, ...] = ()
    """Sentences on other targets that were not reached or not held still at the end of their hold:
    one for both axes if the reason is the same."""
    unconfirmed: tuple[str, ...] = ()
    """A sentence for each other target that only the model shows as reached: readings were not used
    or missing."""
    faults: tuple[DriveFault, ...] = ()
    """Faults of the readings."""

    @property
    def done(self) -> bool:
        """Whether every target was reached, and no wire cooled because of its readings."""
        off = self.unreachable or self.missed or self.unconfirmed
        return not (off or any(each.cooled for each in self.faults))

    @property
    def warnings(self) -> tuple[str, ...]:
        """All sentences; late steps come last, because they rarely are the cause of the others."""
        late = [str(each) for each in self.faults if each.late]
        faults = [str(each) for each in self.faults if not each.late]
        return (*faults, *self.unreachable, *self.missed, *self.unconfirmed, *late)

    @cached_property
    def reached(self) -> FloatArray:
        """(N, 2) mean used readings at the end of each hold, in degrees.

        NaN where there was no reading, or where more than half of the readings were not used.
        """
        return self._of_used(np.mean)

    @cached_property
    def moved(self) -> FloatArray:
        """(N, 2) range of the central 90 % of used readings at the end of each hold, in degrees.

        NaN as `reached`.
        """
        return self._of_used(lambda seen: np.ptp(np.quantile(seen, _MOST)))

    @cached_property
    def expected(self) -> FloatArray:
        """(N, 2) mean angles at the end of each hold by the model of the control, in degrees."""
        return np.array([self.modelled[each].mean(axis=0) for each in self._ends])

    @cached_property
    def had_readings(self) -> BoolArray:
        """(N, 2) whether there were readings at the end of each hold, used or not."""
        return np.array([np.isfinite(self.read[each]).any(axis=0) for each in self._ends])

    def _of_used(self, found: Callable[[FloatArray], np.floating[Any]]) -> FloatArray:
        """Return a statistic (N, 2) of the used readings at the end of each hold."""
        values = np.full(self.targets.shape, np.nan)
        for n, k in np.ndindex(values.shape):
            seen, used = self.read[self._ends[n], k], self.used[self._ends[n], k]
            if used.any() and 2 * used.sum() >= np.isfinite(seen).sum():
                values[n, k] = found(seen[used])
        return values

    @cached_property
    def _ends(self) -> list[IntArray]:
        """Ticks at the end of each hold, over which angles are averaged."""
        holds = [np.flatnonzero(self.row == n) for n in range(len(self.targets))]
        return [each[-max(round(_STEADY * len(each)), 1) :] for each in holds]


Unfinished = Callable[[SteeredHead, bool], None]


def check_targets(
    control: HeadControl, targets: npt.ArrayLike, hold: float, tick: float = INTERVAL
) -> tuple[FloatArray, float]:
    """Return targets (N, 2) in degrees, and their hold in seconds in whole ticks.

    Raises a `ParameterError` if the targets are not (N, 2) numbers or beyond the reach of the
    wires, or the hold is shorter than a tick or longer than an hour.
    """
    wanted = np.atleast_2d(np.asarray(targets, dtype=np.float64))
    if wanted.ndim != 2 or wanted.shape[1] != 2 or not np.isfinite(wanted).all():
        raise ParameterError(f"the targets have shape {wanted.shape}; give (N, 2) angles in deg")
    hold = tick * round(within("hold", hold, tick, 3600.0, "s") / tick)
    for n, each in enumerate(wanted, 1):
        _check_reach(control, each, n)
    return wanted, hold


def steer(
    head: Actuator,
    control: HeadControl,
    targets: npt.ArrayLike,
    hold: float = 8.0,
    *,
    unfinished: Unfinished = lambda found, safe: None,
) -> SteeredHead:
    """Bring a cold head to targets, hold each, and leave it safe.

    A head with a ``time`` may take longer than a tick for a reading: the control uses that time.
    If pictures measure its angles, ``age`` is that of the newest picture, and ``searched`` whether
    it was searched for the view, as in `SeenHead`.

    Raises a `ParameterError` as `check_targets`, and nothing is switched on then; a `SafetyError`
    if the head does not confirm at the end that it is safe.

    ``head``: two currents in A, two angles in degrees; ``control``: with the interval of the head's
    tick; ``targets`` (N, 2): readings of pan and tilt, in degrees; ``hold``: seconds for each
    target; ``unfinished``: if an error or a signal ends the drive, called after the head was made
    safe, with the record so far, and whether the head confirmed that it is safe.
    """
    wanted, hold = check_targets(control, targets, hold, head.tick)
    faults = FaultLog(AXES, head.tick, control.axes[0].observer.delay)
    drive = _Drive(head, control, wanted, faults)
    try:
        with left_safe(head):
            drive.carry_out(hold)
    except BaseException as error:
        if drive.rows:
            unfinished(drive.found(), not isinstance(error, SafetyError))
        raise
    found, given_up = drive.found(), drive.given_up
    otherwise = _CHECK if hasattr(head, "age") else ""
    return replace(
        found,
        unreachable=tuple(given_up.values()),
        missed=tuple(_missed(control, found, set(given_up), faults, otherwise)),
        unconfirmed=tuple(_unconfirmed(control, found, set(given_up))),
    )


class _Drive:
    """Brings a head to targets, and collects the record."""

    def __init__(
        self, head: Actuator, control: HeadControl, wanted: FloatArray, faults: FaultLog
    ) -> None:
        self._head, self._control, self._wanted, self._faults = head, control, wanted, faults
        self._t, self._state = 0.0, control.begin()
        self._pictures = getattr(head, "pictures", math.nan)
        self._took: deque[float] = deque(maxlen=_LATELY)
        self._later = {(1, 0): control}
        self.rows: list[tuple[float, int, FloatArray, FloatArray]] = []
        self._judged: list[tuple[BoolArray, FloatArray]] = []
        self.given_up: dict[tuple[int, int], str] = {}

    def carry_out(self, hold: float) -> None:
        """Hold each target for ``hold`` seconds."""
        head, control, faults = self._head, self._control, self._faults
        tick = head.tick
        state = self._state
        for n in range(_REHEARSED):
            _, state = control.step(state, self._wanted[0], np.zeros(2), t=n * tick)
        seen = np.asarray(head.exchange(np.zeros(2)))
        self._state, began = control.begin(seen), _time(head, 0.0)
        for n, each in enumerate(self._wanted):
            while self._t < (n + 1) * hold - 0.5 * tick:
                current, self._state = self._paced().step(
                    self._state, each, seen, t=self._t, searched=getattr(head, "searched", True)
                )
                why, age = getattr(head, "why", ""), getattr(head, "age", math.nan)
                faults.note(self._t, self._state, why, age)
                self._judged.append(_judged(control, self._state))
                seen, before = np.asarray(head.exchange(current)), self._t
                self._t = _time(head, tick * (len(self.rows) + 1)) - began
                self._took.append(self._t - before)
                self.rows.append((self._t, n, seen, current))
            self.given_up |= {(n, k): text for k, text in _given_up(self._state, n + 1).items()}

    def _paced(self) -> HeadControl:
        """Return the control for the usual duration of a step and the age of the newest picture.

        A picture is taken at the beginning of a step. Its current begins near the end, after the
        search: a step of several ticks adds them to its age. A picture older by one tick is usual.
        """
        head, delay = self._head, self._control.axes[0].observer.delay
        ticks = 1
        if self._took and hasattr(head, "age"):
            ticks = max(round(float(np.median(self._took)) / head.tick), 1)
        age = getattr(head, "age", math.nan)
        older = 0 if math.isnan(age) else round(age / head.tick) - delay
        key = ticks, max(older if older > 1 else 0, ticks - 1)
        if key not in self._later:
            self._later[key] = self._control.later(*key)
        return self._later[key]

    def found(self) -> SteeredHead:
        """Return the record until now."""
        times, row, read, current = (np.array(each) for each in zip(*self.rows, strict=True))
        # A step judges the reading of the tick before: the last reading needs one more.
        last = self._control.step(self._state, self._wanted[row[-1]], read[-1], t=self._t)[1]
        judged = [*self._judged[1 : len(self.rows)], _judged(self._control, last)]
        used, modelled = (np.array(each) for each in zip(*judged, strict=True))
        return SteeredHead(
            times,
            self._wanted[row],
            read,
            current,
            self._wanted[: row[-1] + 1],
            row,
            used,
            modelled,
            faults=(*self._faults.found(self._t), *self._too_few_pictures()),
        )

    def _too_few_pictures(self) -> Iterator[DriveFault]:
        """Yield a fault if the camera gave fewer pictures than the head needs."""
        rate = (getattr(self._head, "pictures", math.nan) - self._pictures) / self._t
        if rate < _RATE:
            slower = ": the head was turned more slowly" if len(self._later) > 1 else ""
            what = (
                f"{rate:.2g} pictures a second came, and {_RATE:g} are needed{slower}; check the "
                "camera, its network, and what else this computer does"
            )
            yield DriveFault(" and ".join(AXES), 0.0, self._t, what, over=False)


def _judged(control: HeadControl, state: HeadState) -> tuple[BoolArray, FloatArray]:
    """Return whether the newest readings (2,) were used, and the angles (2,) by the model."""
    used = np.array([axis.reading.used for axis in state.axes])
    return used, control.modelled(state)


def _time(head: Actuator, counted: float) -> float:
    """Return the time of a head in seconds; the time counted in ticks if the head has none."""
    return float(getattr(head, "time", counted))


def _check_reach(control: HeadControl, target: FloatArray, row: int) -> None:
    """Refuse a target that the wires cannot reach in any surroundings."""
    beyond = []
    for name, axis, wanted, (low, high) in zip(
        AXES, control.axes, target.tolist(), control.reach(target).tolist(), strict=True
    ):
        # A cold wire goes no further down, but control of the other axis compensates its coupling.
        low, high = (round(end, 1) + 0.0 for end in (min(low, axis.reach[0]), high))
        if not low - axis.tolerance <= wanted <= high + axis.tolerance:
            beyond.append(
                f"{name} of target {row} is {wanted:g} degrees, and the wires reach {low:.1f} to "
                f"{high:.1f} degrees there"
            )
    if beyond:
        raise ParameterError(f"{'; '.join(beyond)}; give a target within them")


def _given_up(state: HeadState, row: int) -> dict[int, str]:
    """Return a sentence for each axis whose target is out of reach."""
    return {
        k: f"{name} did not reach target {row}: {axis.unreachable}"
        for k, (name, axis) in enumerate(zip(AXES, state.axes, strict=True))
        if axis.unreachable is not None
    }


def _missed(
    control: HeadControl,
    found: SteeredHead,
    given_up: set[tuple[int, int]],
    faults: FaultLog,
    otherwise: str,
) -> Iterator[str]:
    """Yield a sentence on other axes that were not still at their target at the end of its hold.

    It ends with the active fault, or ``otherwise`` without one. Axes with the same fault share a
    sentence.
    """
    every: dict[tuple[int, str], list[str]] = {}
    for (n, k), at in np.ndenumerate(found.reached):
        near, moved = _near(control, found, found.reached, (n, k)), found.moved[n, k]
        swings = bool(near and moved > _tolerance(control, k))
        if (n, k) in given_up or (near and not swings) or _doubted(control, found, (n, k)):
            continue
        what = "was not still at" if swings else "did not reach"
        where = _unread(found, (n, k)) if np.isnan(at) else f"it was at {at:.1f} degrees"
        where = f"it moved by {moved:.1f} degrees" if swings else where
        hold = found.t[found.row == n]
        why = faults.during(AXES[k], float(hold[0]), float(hold[-1])) or otherwise
        said = f"{AXES[k]} {what} target {n + 1}, {found.targets[n, k]:g} degrees: {where}"
        every.setdefault((n, why), []).append(said)
    for (_, why), axes in every.items():
        yield f"{', and '.join(axes)} at the end of its hold{why and '; '}{why}"


def _unconfirmed(
    control: HeadControl, found: SteeredHead, given_up: set[tuple[int, int]]
) -> Iterator[str]:
    """Yield a sentence for each other axis that may or may not have been at its target."""
    for n, k in np.ndindex(found.targets.shape):
        if (n, k) in given_up or not _doubted(control, found, (n, k)):
            continue
        yield (
            f"{AXES[k]} is not confirmed at target {n + 1}, {found.targets[n, k]:g} degrees: "
            f"{_unread(found, (n, k))} at the end of its hold; by its model it was at "
            f"{found.expected[n, k]:.1f} degrees"
        )


def _unread(found: SteeredHead, at: tuple[int, int]) -> str:
    return "its readings were not used" if found.had_readings[at] else "there was no reading"


def _doubted(control: HeadControl, found: SteeredHead, at: tuple[int, int]) -> bool:
    """Return whether an axis was at its target by its model alone, without a used reading."""
    return bool(np.isnan(found.reached[at]) and _near(control, found, found.expected, at))


def _near(
    control: HeadControl, found: SteeredHead, angles: FloatArray, at: tuple[int, int]
) -> bool:
    """Return whether an angle of a row and an axis is near its target; not if it is NaN."""
    return bool(abs(angles[at] - found.targets[at]) <= _tolerance(control, at[1]))


def _tolerance(control: HeadControl, axis: int) -> float:
    """Return the degrees by which an axis may miss a target, or move at it."""
    low, high = control.axes[axis].reach
    return _OFF * (high - low)
