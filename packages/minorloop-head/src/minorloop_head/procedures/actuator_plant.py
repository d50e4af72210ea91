"""A head at an address as the plant of procedures and console, and the tip that it carries."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import InstrumentError, ParameterError
from minorloop.lab.actuator import Actuator
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.values import NO_PROBE, Tip
from minorloop_head.sources import Frame, Shot
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.frame_checks import (
    BLACK,
    FROZEN,
    NO_PICTURE,
    SATURATED,
    TORN,
    WRONG_SIZE,
    check_frame,
)
from minorloop_head.vision.video import LiveCamera

if TYPE_CHECKING:
    from minorloop.lab.drivers.bench import Clock
    from minorloop_head.procedures.digitiser import Digitiser


_PUMP = "pump"
"""Name of the digital line that floods the pipe."""
_LED = re.compile(r"led (\d+)")
_INPUTS, _OUTPUTS = ("A", "A", "mm/s", "deg/s"), ("deg", "deg", "mm", "deg")
_DEGREE = math.radians(1.0)
_FACTORS = np.array([1.0, 1.0, 1e-3, _DEGREE]), np.array([_DEGREE, _DEGREE, 1e-3, _DEGREE])
"""SI units of the channels of a head and its catheter, in and out."""


class Wires(Protocol):
    """Switches of the lights and the pump, of whatever device they belong to."""

    def light(self, lights: Sequence[bool]) -> None:
        """Switch the lights on or off; return only when they are."""

    def flood(self, on: bool) -> None:
        """Switch the pump on or off; return only when it is."""


def check_axes(actuator: Actuator) -> None:
    """Refuse a head whose sensors do not belong to its sources in their order.

    Raises a `ParameterError` if a sensor is of another source.
    """
    inputs, outputs = actuator.inputs, actuator.outputs
    for k, measured in enumerate(getattr(actuator, "measures", range(len(outputs)))):
        if measured != k:
            raise ParameterError(
                f"sensor {outputs[k].name!r} is of {inputs[measured].name!r}; in a head sensor "
                f"{k + 1} is of source {k + 1}, {inputs[k].name!r}: correct 'of', or the order"
            )


class ActuatorPlant:
    """A head that an actuator drives, with or without a catheter that moves it.

    Raises a `ParameterError` if the actuator has other channels, or as `check_axes`.

    ``actuator``: two currents in A, two angles in degrees; with a catheter also advance in mm/s and
    mm and roll in deg/s and deg. Without one, advance and roll stay 0. Two currents alone are a
    head without sensors: its angles are NaN, and its camera has to measure them. ``clock``: delays
    each exchange until a tick after the one before; without it the caller does so.
    """

    def __init__(self, actuator: Actuator, clock: Clock | None = None) -> None:
        units = tuple(c.unit for c in actuator.inputs), tuple(c.unit for c in actuator.outputs)
        if units not in ((_INPUTS[:2], ()), (_INPUTS[:2], _OUTPUTS[:2]), (_INPUTS, _OUTPUTS)):
            known = ", ".join(str(channel) for channel in (*actuator.inputs, *actuator.outputs))
            raise ParameterError(
                f"the actuator has {known}; a head has two currents in A and two angles in deg, "
                "and perhaps rates of advance and roll in mm/s and deg/s, in mm and deg; without "
                "sensors it has two currents in A alone"
            )
        check_axes(actuator)
        self.actuator, self._clock, self._due = actuator, clock, -math.inf
        self._began: float | None = None
        self._ticks = 0
        self._count = len(units[0])
        self._exchange = getattr(actuator, "at_once", actuator.exchange)
        found = [(int(m[1]), name) for name in self._lines if (m := _LED.fullmatch(name))]
        self._leds = [name for _, name in sorted(found)]

    @property
    def tick(self) -> float:
        """Duration of one ``exchange``, in seconds."""
        return self.actuator.tick

    @property
    def time(self) -> float | None:
        """Seconds from the first ``exchange`` to the last one; None where each takes one tick.

        On a loaded machine an exchange begins late, and the wires turn meanwhile. The time is
        rounded to whole ticks, the unit of the control, so that no remainders add up.
        """
        simulated = hasattr(self.actuator, "clock")  # each of its exchanges takes one tick
        return None if self._began is None or simulated else self.tick * self._ticks

    @property
    def serial(self) -> str | None:
        """Serial number of the head; None if the actuator does not know it."""
        found: str | None = getattr(self.actuator, "serial", None)
        return found

    @property
    def travels(self) -> bool:
        """Whether a catheter moves the head along the pipe."""
        return self._count == len(_INPUTS)

    @property
    def sensors(self) -> bool:
        """Whether the joints have sensors."""
        return len(self.actuator.outputs) > 0

    @property
    def leds(self) -> int:
        """Number of lines that switch LEDs."""
        return len(self._leds)

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold pan and tilt currents in A, advance in m/s and roll in rad/s for a tick.

        Returns pan and tilt of the joints, advance and roll (4,), in rad and m; NaN for angles
        without a sensor.

        Raises a `LimitError` if an input is beyond its limits, and nothing is applied then; an
        `InstrumentError` if a device fails, and the head is safe then.
        """
        self._wait()
        count, read = self._count, np.zeros(4)
        seen = self._exchange(np.asarray(u, dtype=np.float64)[:count] / _FACTORS[0][:count])
        read[:count] = seen if self.sensors else np.nan
        return np.asarray(read * _FACTORS[1])

    def stance(self) -> tuple[float, ...]:
        """Return nothing: the tip of a head that is not simulated needs no pose."""
        return ()

    def safe(self) -> None:
        """Make the head safe."""
        self.actuator.safe()

    def light(self, lights: Sequence[bool]) -> None:
        """Switch the lines ``led 1``, ``led 2``, ...; lights without a line stay as they are."""
        values = dict(zip(self._leds, map(bool, lights), strict=False))
        if values:
            self._switch(values)

    def flood(self, on: bool) -> None:
        """Switch the line ``pump``.

        Raises an `InstrumentError` if there is no such line.
        """
        if _PUMP not in self._lines:
            raise InstrumentError(f"the bench has no line {_PUMP!r}, so the pipe cannot be flooded")
        self._switch({_PUMP: bool(on)})

    def close(self) -> None:
        """Close the connections."""
        getattr(self.actuator, "close", lambda: None)()

    def _wait(self) -> None:
        """Wait until the next tick is due; a late tick delays all later ones."""
        if self._clock is not None:
            self._clock.sleep(max(self._due - self._clock.now(), 0.0))
            now = self._clock.now()
            if self._began is None:
                self._began = now
            else:  # without the minimum, two exchanges may round to the same tick
                self._ticks = max(round((now - self._began) / self.tick), self._ticks + 1)
            self._due = now + self.tick

    @property
    def _lines(self) -> tuple[str, ...]:
        found: tuple[str, ...] = getattr(self.actuator, "lines", ())
        return found

    def _switch(self, values: dict[str, bool]) -> None:
        switch: Any = getattr(self.actuator, "switch", None)
        if switch is not None:
            switch(values)


class BenchTip:
    """The tip of a head on a bench: lights and a pump, perhaps a probe, and no focus.

    Its pictures come from a separate camera, see `minorloop_head.procedures.actuator_plant`.
    """

    def __init__(self, wires: Wires, probe: Digitiser | None = None) -> None:
        self._wires, self._probe = wires, probe

    def frame(self) -> Frame:
        """Raise an error: the camera is not part of the bench.

        Raises an `InstrumentError` always.
        """
        raise InstrumentError("a bench has no camera; give one with --camera")

    def switch(self, lights: Sequence[bool]) -> None:
        """Switch lights on or off."""
        self._wires.light(lights)

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Do nothing; the camera is exposed by itself."""

    def move_to(self, stance: tuple[float, ...]) -> None:
        """Do nothing; the tip is where the head is."""

    def focus_at(self, distance: float) -> None:
        """Do nothing; the focus is fixed."""

    def flood(self, on: bool) -> None:
        """Fill the pipe with water, or drain it."""
        self._wires.flood(on)

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other.

        Raises an `InstrumentError` if there is no probe, or it does not answer.
        """
        if self._probe is not None:
            return self._probe.shots(count)
        raise InstrumentError(NO_PROBE)


_SAID = {
    FROZEN: "repeats the same picture; restart it",
    f"{BLACK}, {FROZEN}": "repeats the same black picture; check its lights, or restart it",
    f"{SATURATED}, {FROZEN}": "repeats the same white picture; check its exposure, or restart it",
    TORN: "gives torn pictures; check its cable",
    NO_PICTURE: "gives noise or an even grey; check its cable",
}


class CameraTip:
    """Lights, focus and probe of a tip, and the pictures of a camera, which are checked.

    ``view``: of the camera.
    """

    def __init__(self, tip: Tip, camera: LiveCamera, view: HeadCalibration) -> None:
        self._tip, self._camera = tip, camera
        self._lens, self._latency = view.lens, view.latency
        self._before: Image | None = None
        self._lit, self._settled = True, 0.0

    def frame(self) -> Frame:
        """Return the newest picture under the present lights; wait for it after they were switched.

        Raises an `InstrumentError` as `newest` does.
        """
        while (found := self.newest()) is None:
            pass
        return found

    def newest(self) -> Frame | None:
        """Return the newest picture; None if it may show the lights before they were switched.

        Raises an `InstrumentError` if none comes in time, or it has another size than calibrated,
        repeats the last one, is torn, or is no picture.
        """
        found = self._camera.frame()
        if found.t < self._settled:
            return None
        verdict = check_frame(found.image, self._lens, self._before, lit=self._lit)
        before = self._before
        if verdict in (BLACK, SATURATED) and before is not None:
            verdict += f", {FROZEN}" if np.array_equal(found.image, before) else ""
        self._before = found.image
        if verdict == WRONG_SIZE:
            height, width = found.image.shape
            self._camera.renew()
            raise InstrumentError(
                f"{self._camera.address} gives pictures of {width} by {height} pixels and was "
                f"calibrated with {self._lens.width} by {self._lens.height}; set its size, or give "
                "its calibration with --head"
            )
        if verdict in _SAID:
            raise InstrumentError(f"{self._camera.address} {_SAID[verdict]}")
        return found

    def switch(self, lights: Sequence[bool]) -> None:
        """Set which lights are on from the next frame."""
        self._lit = any(lights)
        self._tip.switch(lights)
        self._settled = time.monotonic() + self._latency

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set exposure time in seconds and gain of the camera."""
        self._camera.expose(exposure, gain)

    def move_to(self, stance: tuple[float, ...]) -> None:
        """Take over the pose of the plant."""
        self._tip.move_to(stance)

    def focus_at(self, distance: float) -> None:
        """Set the focus of the tip to a distance in metres."""
        self._tip.focus_at(distance)

    def flood(self, on: bool) -> None:
        """Fill the pipe with water for the probe, or drain it."""
        self._tip.flood(on)

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other."""
        return self._tip.shots(count)
