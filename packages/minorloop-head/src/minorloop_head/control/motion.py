"""Whether a wire can have turned as its readings say.

The greatest slope of the operator and the constants of the heat bound the rate of a wire. Readings
that jump further are not believed however long they last: only once they jump back, or agree with
the model. Readings that fall below those of a cold wire while it is heated have the wrong sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from minorloop_head.control.controller import Loop, width, within
from minorloop_head.heated_wire import HeatedWire

_GRID = 513
"""Powers at which the slope of the operator is found: 20 and more in each of its bands."""
_DRIFT, _UNSURE = 0.5, 0.3
"""Degrees a second, and share of its motion, by which the error of the model may grow while
readings are not believed: by a few degrees in 10 s."""
_CHANGED = 0.1
"""Share of the range of the powers by which surroundings may change within seconds."""
_ROW = 5
"""Believed readings in a row after which the angle is known: more than there are outliers."""
_AGREED = 1.0
"""Seconds for which readings must agree with the model to be believed again, and without readings
after which they are compared with it, whatever was before."""
_BLIND = 4.0
"""Seconds without readings until surroundings may have changed by the whole range of the powers, as
their square: water flows in within seconds, and heats or cools only then."""
_RISE, _FALL = 3.0, 2.0
"""Degrees by which the wire must rise by its current, and its readings fall, until their sign is
known: far above the noise, and before the head is far on the wrong way."""
_CLOSE = 0.5
"""Share of `jump` within which they agree then."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WireWatch(Loop):
    """Compares the readings of a wire with what it can do.

    Parameters
    ----------
    wire : HeatedWire
        The model.
    jump : float
        Most degrees by which readings differ beside the motion of the wire: noise, and the steps
        of a coarse sensor.
    interval, delay, highest
        As in `Loop`.

    Raises
    ------
    ParameterError
        If a number is out of its range.
    """

    wire: HeatedWire
    jump: float = 1.5

    def __post_init__(self) -> None:
        super().__post_init__()
        within("jump", self.jump, 1e-6, 1e6, "degrees")

    def _turn(self, heating: float) -> float:
        """Return the most degrees by which a heating power in A^2 turns the wire in an interval."""
        return self._fastest * heating * self.interval

    @cached_property
    def _fastest(self) -> float:
        return fastest(self.wire)


@dataclass(frozen=True)
class Belief:
    """What is known of an angle by its readings."""

    believed: bool = False
    """Whether the newest reading is."""
    seen: float = math.nan
    """That reading in degrees, NaN before the first."""
    gap: int = 0
    """Steps since."""
    row: int = 0
    """Believed readings in a row; if they are not, those in a row that agree with the model."""
    error: float = 0.0
    """Last believed reading less the model, in degrees."""
    jumped: float = 0.0
    """Degrees by which readings have jumped since."""
    slack: float = math.inf
    """Degrees by which the wire may have left the model since; infinite before any is known."""
    astray: float = 0.0
    """Seconds for which readings have not been believed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionWatch(WireWatch):
    """Believes only readings to which a wire can have turned; parameters as of `WireWatch`."""

    def step(
        self,
        before: Belief,
        reading: float,
        model: float,
        *,
        motion: float = 0.0,
        heating: float = 0.0,
        steps: int = 1,
    ) -> Belief:
        """Return what is known after one more reading.

        Parameters
        ----------
        before : Belief
        reading : float
            In degrees; NaN where there is none.
        model : float
            What the model expects, in degrees.
        motion : float
            By which it has turned in the last interval, in degrees.
        heating : float
            Power in A^2 that has heated the wire then, less what has left it.
        steps : int
            Intervals since the last reading was due.
        """
        gap = before.gap + steps
        if math.isnan(reading):
            changed = min(gap * self.interval / _BLIND, 1.0) ** 2 * self._width
            turned = self._turn(changed) * steps + _UNSURE * abs(motion)
            return replace(before, gap=gap, slack=before.slack + turned)
        error = reading - model
        away = min(abs(error - before.error), abs(error))
        heated = self._turn(abs(heating))
        change = self._turn(_CHANGED * self._width)
        once = heated + change
        most = self.jump + gap * once
        follows = abs(reading - before.seen) <= most and gap * self.interval <= _AGREED
        if gap > steps:  # Nothing has shown on which way it went: it was about that of the model.
            follows = follows and away <= before.slack + self.jump + gap * change
        if follows:
            jumped, row = before.jumped, before.row + 1
            if not before.believed and away > _CLOSE * self.jump:
                row = 0
            believed = before.believed or row * self.interval >= _AGREED
        else:
            jumped, row = self._jumped(before, reading, error, motion * gap), 1
            back = not before.believed and abs(jumped) <= most
            believed = back or away <= before.slack + self.jump + once * steps
        if not believed:
            slack = before.slack + _DRIFT * self.interval + _UNSURE * abs(motion)
            astray = before.astray + steps * self.interval
            return Belief(False, reading, 0, row, before.error, jumped, slack, astray)
        if reading == before.seen:  # It says nothing of a motion.
            slack = before.slack + (heated + abs(motion)) * steps
            return Belief(True, reading, 0, row, before.error, 0.0, slack)
        return Belief(True, reading, 0, row, error, 0.0, 0.0 if row >= _ROW else before.slack)

    @cached_property
    def _width(self) -> float:
        return width(self.wire)

    def _jumped(self, before: Belief, reading: float, error: float, motion: float) -> float:
        """Return the degrees by which readings have jumped since the last believed one."""
        if before.believed or math.isnan(before.seen):
            return error - before.error
        return before.jumped + reading - before.seen - motion


@dataclass(frozen=True)
class Sign:
    """What is known of the sign of the readings."""

    reversed: bool = False
    """Whether it is wrong; that remains."""
    risen: float = math.inf
    read: float = math.nan
    """Angle by the current alone and reading, both in degrees, since which they are compared."""
    seen: float = math.nan
    """Newest reading in degrees, NaN before the first."""
    gap: int = 0
    """Steps since."""


@dataclass(frozen=True, eq=False, kw_only=True)
class SignWatch(WireWatch):
    """Finds readings that fall while the wire is heated; parameters as of `WireWatch`.

    No wire reads less than a cold one, and none that is heated falls there. The model must follow
    the current alone: one that is corrected by the readings agrees with a wrong sign too.
    """

    def step(self, before: Sign, reading: float, model: float, *, steps: int = 1) -> Sign:
        """Return what is known after one more reading.

        Parameters
        ----------
        before : Sign
        reading : float
            In degrees; NaN where there is none.
        model : float
            Angle of the wire by its current alone, in degrees.
        steps : int
            Intervals since the last reading was due.
        """
        gap = before.gap + steps
        if before.reversed or math.isnan(reading):
            return replace(before, gap=gap)
        most = self.jump + self._turn(self.highest**2) * gap
        # After a jump the readings are compared anew: it is no motion.
        follows = abs(reading - before.seen) <= most
        if not follows or model < before.risen:
            return Sign(False, model, reading, reading)
        if model < before.risen + _RISE:
            return Sign(False, before.risen, before.read, reading)
        fallen = reading < before.read - _FALL
        below = reading < self.wire.operator.range[0] - _FALL
        if fallen and below:
            return replace(before, reversed=True)
        # Readings are late: they have twice the rise to fall.
        if model < before.risen + 2 * _RISE:
            return Sign(False, before.risen, before.read, reading)
        return Sign(False, model, reading, reading)


def fastest(wire: HeatedWire) -> float:
    """Return the largest rate of a wire for a heating power, in degrees a second per A^2.

    With the slope s of the operator, dy/dt = s (p - w) / (tau + q s), which grows with s. No
    branch is steeper than those of the loop between the ends of the levels.
    """
    low, high = wire.operator.levels[[0, -1]].tolist()
    grid = np.linspace(low, high, _GRID)
    loop = wire.operator.simulate(np.concatenate([grid, grid[-2::-1]]))
    slope = float(np.abs(np.diff(loop)).max()) / float(grid[1] - grid[0])
    return slope / (wire.lag + wire.latent * slope)
