"""Control of several wires at once, with compensation of the coupling of their sensors.

Angles that a camera gives are late, and sometimes missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import BoolArray, FloatArray, check_kind, check_option, frozen
from minorloop.errors import ParameterError
from minorloop_head.control.controller import Controller, within
from minorloop_head.control.guard import LARGEST, Event, Guard, GuardState
from minorloop_head.control.limits import WireLimits
from minorloop_head.control.observer import ObserverControl, PowerObserver
from minorloop_head.control.readings import ReadingState, SensorWatch, as_number
from minorloop_head.heated_wire import HeatedWire

_LEARNED, _MOST = 0.25, 25.0
"""Weight of a new gap between readings in the usual gap, and limit of a gap in steps: that of a
camera with one picture a second."""
_USUAL = 2.0
"""Least ratio of an unusual gap to the usual one."""
_BACK = 0.015
"""Share of the angles by which the head goes back in an interval: at 25 per second it is half way
in 2 s."""
_SLOWEST = 4
"""Largest factor by which a head turns more slowly."""
_NEAR = 0.5
"""Degrees about the held position within which targets are kept: the error of the model after a
short time."""
AGE = 2
"""Age in ticks of the pictures for which a loop is set up, one to two frames. Earlier pictures
wait, since a law has one delay."""
PATIENCE = 250
"""Consecutive pictures without angles after which the wires cool: for 10 s the head goes by its
model, whose error grows by a few degrees in that time. One picture with angles is enough to go on,
since a camera may give fewer pictures than the loop has ticks."""
LEAD = 6.0
"""Largest lead in degrees of a wanted angle over that of the newest picture, for a camera that may
give fewer pictures than the loop has ticks. A lost head stops within this lead, where it is found
again. The wires of `examples/simulated_board.py` turn by 55 degrees in 8 s with it, and in 5 s
without."""
Law = Callable[..., Controller]
"""Creates a controller from ``wire=`` and options, such as `ObserverControl`."""


@dataclass(frozen=True)
class Unread:
    """State of a head with respect to missing readings."""

    gap: int = 0
    """Steps without a usable reading."""
    usual: float = 0.0
    """Recent average of the steps between two readings."""
    kept: FloatArray | None = None
    """Shape (axes,). Held position: readings in degrees by the model when the gap became unusual,
    and after some time on the way back; None before."""
    dark: int = 0
    """Steps of the gap in which no picture could be searched for the view."""
    lost: int = 0
    """Number of gaps in which the head went back."""

    @property
    def slower(self) -> int:
        """Factor by which the head turns more slowly."""
        return min(1 + self.lost, _SLOWEST)


@dataclass(frozen=True, kw_only=True)
class UnreadWatch:
    """Holds the position of a head after some steps without a reading, and then moves it back.

    A model alone would take the head to its target, past all wall that the camera knows, where no
    search finds the view again. The way back to the cold head leads past known wall. The head does
    not go back without pictures that can be searched. After it went back, it turns more slowly, so
    that it sees the wall in smaller steps.

    Raises a `ParameterError` if the number is out of its range.
    """

    after: int = 3
    """Least number of steps without a reading; for a sensor with fewer readings than steps, it is
    twice the usual gap between them."""
    stays: int = 50
    """Intervals for which it stays while its view is searched: a search tries all angles at which
    the wall is known in fewer."""
    takes: int = 1
    """Intervals of the loop that a step takes."""

    def __post_init__(self) -> None:
        within("after", self.after, 1, 10_000)
        within("stays", self.stays, 1, 10_000)
        within("takes", self.takes, 1, 10_000)

    def step(self, before: Unread, gap: int, read: FloatArray, *, searched: bool = True) -> Unread:
        """Return the state one step later.

        Parameters
        ----------
        before : Unread
        gap : int
            Steps without a usable reading, now.
        read : (axes,) array
            Present readings in degrees, as the model expects them.
        searched : bool
            Whether the picture was searched for the view: not if it is black.
        """
        if not gap:
            usual = before.usual + _LEARNED * (min(float(before.gap), _MOST) - before.usual)
            return Unread(0, usual, lost=before.lost + self._goes_back(before))
        more = gap - before.gap
        state = replace(before, gap=gap, dark=before.dark + (0 if searched else more))
        if gap < max(self.after, _USUAL * before.usual):
            return replace(state, kept=None)
        kept = read if before.kept is None else before.kept
        back = self.takes * more if searched and self._goes_back(state) else 0
        return replace(state, kept=(1.0 - _BACK) ** back * kept)

    def _goes_back(self, state: Unread) -> bool:
        """Whether the head goes back: its view has been searched for as long as it stays."""
        return self.takes * (state.gap - state.dark) > self.stays

    def near(self, state: Unread, wanted: FloatArray) -> FloatArray:
        """Return wanted readings (axes,) in degrees, limited to the held position."""
        if state.kept is None:
            return wanted
        return np.clip(wanted, state.kept - _NEAR, state.kept + _NEAR)


@dataclass(frozen=True, eq=False)
class HeadState:
    """State of the control of a head: one state for each axis, and that of missing readings."""

    axes: tuple[GuardState, ...]
    unread: Unread = field(default_factory=Unread)

    @property
    def log(self) -> tuple[tuple[int, Event], ...]:
        """Axis and event, in the order of the steps."""
        events = [(axis, event) for axis, state in enumerate(self.axes) for event in state.log]
        return tuple(sorted(events, key=lambda pair: pair[1].step))


@dataclass(frozen=True, eq=False)
class HeadControl:
    """A guarded controller for each axis of a head.

    Raises
    ------
    ParameterError
        If the lead is not positive, or the coupling has another shape, is not finite, or is so
        strong that the axes cannot be separated.
    """

    axes: tuple[Guard, ...]
    """One for each wire."""
    coupling: FloatArray | None = None
    """Shape (axes, axes). ``coupling[i, j]``: change of the sensor of axis i for a degree of axis
    j, 1 on the diagonal. Without it, the axes are independent."""
    lead: float = math.inf
    """Largest lead of a wanted reading over the newest usable one, in degrees. Infinite for no
    limit. Smaller after the view was lost, see `minorloop_head.control.head.Unread.slower`."""
    unread: UnreadWatch | None = None
    """Holds the position when readings stop. Without it, the head continues by the models."""

    def __post_init__(self) -> None:
        lead = as_number(self.lead)
        if not lead > 0:
            raise ParameterError(f"lead is {self.lead!r}; give a number of degrees above 0")
        object.__setattr__(self, "lead", lead)
        count = len(self.axes)
        try:
            matrix = np.eye(count) if self.coupling is None else np.asarray(self.coupling, float)
        except (TypeError, ValueError):
            raise ParameterError(
                f"the coupling is {self.coupling!r}; give numbers, ({count}, {count})"
            ) from None
        if count == 0 or matrix.shape != (count, count):
            raise ParameterError(
                f"the coupling has shape {matrix.shape}; give ({count}, {count}), one row an axis"
            )
        if not np.isfinite(matrix).all():
            raise ParameterError("the coupling has entries that are not finite; give numbers")
        if not (np.abs(matrix - np.eye(count)).sum(axis=1) < 0.5).all():
            raise ParameterError(
                "the coupling has rows that differ from the unit matrix by 0.5 or more; such "
                "axes cannot be separated"
            )
        object.__setattr__(self, "coupling", frozen(matrix))

    def begin(
        self, measurement: npt.ArrayLike | None = None, current: npt.ArrayLike | None = None
    ) -> HeadState:
        """Return the state of a head that has settled at angles (axes,) under currents (axes,).

        Parameters
        ----------
        measurement : (axes,) array_like, optional
            Readings, in degrees.
        current : (axes,) array_like, optional
            In A.
        """
        count = len(self.axes)
        angles = np.zeros(count) if measurement is None else _numbers(measurement, count)
        currents = np.zeros(count) if current is None else _numbers(current, count)
        own = self._unmixing @ np.where(np.abs(angles) < LARGEST, angles, 0.0)
        pairs = zip(self.axes, own.tolist(), currents.tolist(), strict=True)
        return HeadState(tuple(axis.begin(angle, on) for axis, angle, on in pairs))

    def step(
        self,
        state: HeadState,
        reference: npt.ArrayLike,
        measurement: npt.ArrayLike,
        *,
        t: float | None = None,
        searched: bool = True,
    ) -> tuple[FloatArray, HeadState]:
        """Return the currents for the next interval, within the limits; nothing is raised.

        Parameters
        ----------
        state : HeadState
        reference : (axes,) array_like
            Wanted readings of the sensors, in degrees.
        measurement : (axes,) array_like
            Newest readings in degrees; NaN where there is none.
        t : float, optional
            Time of the readings in seconds.
        searched : bool
            Whether the picture was searched for the view, as in `UnreadWatch.step`.

        Returns
        -------
        current : (axes,) array
            In A.
        state : HeadState
        """
        count = len(self.axes)
        asked = _each(reference, count)
        wanted, seen = _numbers(reference, count), _numbers(measurement, count)
        estimated = np.array([axis.estimate.angle for axis in state.axes])
        last = np.array([axis.reference for axis in state.axes])
        unread = state.unread
        newest = np.array([_limiting(axis.reading) for axis in state.axes])
        wanted = self._near(wanted, newest, self.lead / unread.slower)
        if self.unread is not None:
            gap = max(max(axis.reading.missing, axis.reading.odd) for axis in state.axes)
            modelled = estimated + self._mixing @ estimated
            unread = self.unread.step(unread, gap, modelled, searched=searched)
            wanted = self.unread.near(unread, wanted)
        working = np.array([not axis.fault for axis in state.axes])
        readings = self._uncoupled(seen, estimated, working)
        targets = self._uncoupled_targets(wanted, last)
        current, states = np.empty(count), []
        for k, axis in enumerate(self.axes):
            pair = float(targets[k]), float(readings[k])
            current[k], after = axis.step(
                state.axes[k], *pair, t=t, raw=float(seen[k]), asked=asked[k]
            )
            states.append(after)
        return current, HeadState(tuple(states), unread)

    @property
    def cold(self) -> FloatArray:
        """(axes,) readings in degrees of wires that were heated and are cold again, by the models.

        A wire with hysteresis does not return fully to the angle of a new wire.
        """
        return np.asarray(self.coupling) @ [
            axis.observer.wire.operator.range[0] for axis in self.axes
        ]

    def modelled(self, state: HeadState) -> FloatArray:
        """Return the angles (axes,) that the sensors read by the estimates now, in degrees."""
        return np.asarray(self.coupling) @ [axis.estimate.angle for axis in state.axes]

    def later(self, takes: int, older: int) -> HeadControl:
        """Return the control for steps that take longer, with older readings; states remain valid.

        Parameters
        ----------
        takes : int
            Intervals that a step takes.
        older : int
            Intervals by which readings are older than those for which the control is set up.
        """
        unread = self.unread and replace(self.unread, takes=takes)
        return replace(self, axes=tuple(axis.later(older) for axis in self.axes), unread=unread)

    def reach(self, reference: npt.ArrayLike, ends: npt.ArrayLike | None = None) -> FloatArray:
        """Return the least and largest readings (axes, 2) with the other axes at their targets.

        Parameters
        ----------
        reference : (axes,) array_like
            Wanted readings in degrees, from which the other wires follow.
        ends : (axes, 2) array_like, optional
            Least and largest angle of each wire; those in the surroundings of the identification
            without it.
        """
        ends = np.array([axis.reach for axis in self.axes]) if ends is None else np.asarray(ends)
        wanted = _numbers(reference, len(self.axes))
        own = np.clip(self._unmixing @ wanted, ends[:, 0], ends[:, 1])
        return np.asarray(ends + (self._mixing @ own)[:, np.newaxis])

    def _uncoupled(self, seen: FloatArray, instead: FloatArray, working: BoolArray) -> FloatArray:
        """Return the angles (axes,) of the wires without coupling; NaN where there is no reading.

        For the effect on other axes, ``instead`` replaces angles that are faulty or not numbers.
        """
        known = np.abs(seen) < LARGEST
        filled = np.where(known & working, seen, instead + self._mixing @ instead)
        return np.where(known, seen - self._mixing @ (self._unmixing @ filled), np.nan)

    def _near(self, wanted: FloatArray, newest: FloatArray, lead: float) -> FloatArray:
        """Return wanted readings (axes,) no farther from the newest ones than a lead."""
        near = np.minimum(np.maximum(wanted, newest - lead), newest + lead)
        return np.where(np.isnan(newest), wanted, near)

    def _uncoupled_targets(self, wanted: FloatArray, instead: FloatArray) -> FloatArray:
        """Return the wanted angles (axes,) of the wires without coupling; NaN where there is none.

        A wire whose target is beyond its stroke stops at its end; the others compensate that.
        """
        known = np.abs(wanted) < LARGEST
        filled = np.where(known, wanted, instead + self._mixing @ instead)
        low, top = self._ends
        own = np.minimum(np.maximum(self._unmixing @ filled, low), top)
        return np.where(known, wanted - self._mixing @ own, np.nan)

    @cached_property
    def _mixing(self) -> FloatArray:
        """Coupling of other axes into the sensors."""
        return np.asarray(self.coupling) - np.eye(len(self.axes))

    @cached_property
    def _ends(self) -> FloatArray:
        """(2, axes) least and largest angle of each wire by its model."""
        return np.array([axis.observer.wire.operator.range for axis in self.axes]).T

    @cached_property
    def _unmixing(self) -> FloatArray:
        return np.asarray(np.linalg.inv(np.asarray(self.coupling)))


def head_control(
    law: str | Law,
    wires: tuple[HeatedWire, ...],
    *,
    coupling: FloatArray | None = None,
    limits: WireLimits | None = None,
    sensor: SensorWatch | None = None,
    lead: float = math.inf,
    unread: UnreadWatch | None = None,
    **options: Any,
) -> HeadControl:
    """Return the control of a head by one law for each axis.

    Parameters
    ----------
    law : "observer" or callable
        As in `controller`.
    wires : tuple of HeatedWire
        Model of each axis.
    coupling : (axes, axes) array_like, optional
        As in `HeadControl`.
    limits, sensor
        As in `Guard`, for every axis; the defaults of the head without them.
    lead, unread
        As in `HeadControl`.
    **options
        Of the law, for every axis: `interval`, `delay` and `highest` of any, and those of its own.

    Raises
    ------
    ParameterError
        If there is no such law, or an option is out of its range.
    """
    given: object = wires
    if not isinstance(given, Sequence) or isinstance(given, str) or not given:
        raise ParameterError(f"wires is {wires!r:.60}; give a tuple of HeatedWire, one an axis")
    limits = WireLimits() if limits is None else limits
    sensor = SensorWatch() if sensor is None else sensor
    axes = []
    for wire in wires:
        own = controller(law, wire, **options)
        if isinstance(own, ObserverControl):
            axes.append(Guard(observer=own, limits=limits, sensor=sensor))
        else:
            observer = PowerObserver(wire=wire, **_clock(options))
            axes.append(Guard(observer=observer, controller=own, limits=limits, sensor=sensor))
    return HeadControl(tuple(axes), coupling, lead, unread)


def controller(law: str | Law, wire: HeatedWire, **options: Any) -> Controller:
    """Return a controller for one wire, without its guard.

    ``law``: `ObserverControl`, or a function that makes a controller from ``wire=`` and options;
    ``**options``: of the law. Raises a `ParameterError` if the name or an option is unknown, or an
    option is out of its range.
    """
    check_kind("the model of a wire", wire, HeatedWire)
    if callable(law):
        return law(wire=wire, **options)
    check_option("controller", law, ("observer",))
    known = {each.name for each in fields(ObserverControl)} - {"wire"}
    unknown = sorted(options.keys() - known)
    if unknown:
        raise ParameterError(
            f"controller {law!r} has no option {unknown[0]!r}; give {', '.join(sorted(known))}"
        )
    return ObserverControl(wire=wire, **options)


def _limiting(known: ReadingState) -> float:
    """Return the newest reading, which limits wanted ones; NaN if it is not trusted."""
    return math.nan if known.fault in ("late", "unconfirmed", "reversed") else known.last


def _clock(options: dict[str, Any]) -> dict[str, Any]:
    return {name: options[name] for name in ("interval", "delay", "highest") if name in options}


def _numbers(values: npt.ArrayLike, count: int) -> FloatArray:
    """Return (count,) numbers, NaN for anything else."""
    return np.array([as_number(value) for value in _each(values, count)])


def _each(values: npt.ArrayLike, count: int) -> list[object]:
    """Return one value for each axis; all values for each axis if their number differs."""
    each: list[object]
    try:
        plain = isinstance(values, np.ndarray) and values.dtype == np.float64
        each = np.ravel(np.asarray(values, dtype=None if plain else object)).tolist()
    except ValueError:
        each = []
    return each if len(each) == count else [[values]] * count


def camera_control(law: str | Law, wires: tuple[HeatedWire, ...], **options: Any) -> HeadControl:
    """Return the control of a head by its camera.

    ``law``, ``wires`` and ``**options``: as of `minorloop_head.control.head.head_control`. Raises a
    `ParameterError` as `minorloop_head.control.head.head_control` does.
    """
    watch = SensorWatch(patience=PATIENCE, makes_up=PATIENCE)
    known = {"delay": AGE, "sensor": watch, "unread": UnreadWatch()}
    return head_control(law, wires, **{**known, **options})
