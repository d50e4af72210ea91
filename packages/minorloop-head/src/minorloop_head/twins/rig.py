"""The simulated inspection head in a pipe: wires, catheter, camera and probe.

Pan and tilt of the wires are 30 degrees when the camera looks along the pipe, since a wire pulls in
one direction only. Flow may sway the base of the head; this moves camera and probe, but the joint
sensors do not measure it. A `Rig` and its `SimulatedTip` may run in separate processes: only a
`_Stance` passes between them. Angles are in radians, lengths in metres.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, as_finite
from minorloop.errors import LimitError, ParameterError
from minorloop_head.geometry import Mount, Pinhole, Tool, wrapped
from minorloop_head.sources import Frame, Shot
from minorloop_head.twins.camera import LENS, Camera
from minorloop_head.twins.catheter import Catheter
from minorloop_head.twins.head import Head
from minorloop_head.twins.mounted import Mounted
from minorloop_head.twins.pipe import Bore, Dirt, Pipe
from minorloop_head.twins.surroundings import FULL, Filling, Sway
from minorloop_head.twins.ultrasound import Ultrasound

RATE = 10e-3
"""Rate of the extension, in m/s."""
_MARK_RADIUS, _MARK_ALBEDO = 0.15e-3, 0.35
"""Radius of a mark in metres, and its albedo relative to the metal: a dot of ink."""
_SPREAD, _TILT = 0.2e-3, 0.01
_KNOWN, _KNOWN_TILT = 0.03e-3, 1.5e-3
"""Standard deviations of offset (metres) and slope: of a specimen, and of its calibration, which
equals that of a calibration against a target."""
STRAIGHT = math.radians(30.0)
"""Pan and tilt of the joints of a head that looks along the pipe."""
_UNITS = np.array([math.radians(1.0), math.radians(1.0), 1e-3, math.radians(1.0)])
"""Units of the channels of head and catheter: degrees, mm and degrees."""

_Stance: TypeAlias = tuple[float, float, float, float, float, float]
"""True pan and tilt, their rates, advance and roll."""


class Rig:
    """A head and the catheter that carries it, on one clock.

    ``head``: nominal, with 0.05 degrees of noise and a delay of one tick, without it. ``catheter``:
    nominal, with a noise of 0.02 mm and degrees, without it. ``sway``: of the base of the head
    while the pipe is not flooded; no sway without it. ``flooded``: filling of the pipe after
    ``flood``; without it, ``flood`` changes nothing.
    """

    def __init__(
        self,
        head: Head | None = None,
        catheter: Catheter | None = None,
        *,
        sway: Sway | None = None,
        flooded: Filling | None = None,
    ) -> None:
        self.head, self.sway = head or Head(noise=0.05, delay=0.04), sway
        self._flooded, self._drained = flooded, (self.head.surroundings, sway)
        self.catheter = catheter or Catheter(noise=0.02)
        self.tick, self.time = self.head.tick, None
        self._before = self._line_of_sight()

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold two currents and the rates of advance and roll for a tick.

        Returns pan, tilt, advance and roll (4,) at its end; NaN where a sensor is lost.

        Raises a `LimitError` if an input is beyond its limits.
        """
        self._before = self._line_of_sight()
        angles = np.asarray(self.head.exchange(u[:2]))
        place = np.asarray(self.catheter.exchange(u[2:] / _UNITS[2:]))
        return np.asarray(_UNITS * np.concatenate([angles, place]))

    def safe(self) -> None:
        """Let the wires cool and stop the catheter."""
        self.head.safe()
        self.catheter.safe()

    def flood(self, on: bool) -> None:
        """Let water in, which cools the wires and sways the head from now on, or out again."""
        around, sway = self._drained
        if on and self._flooded is not None:
            around, sway = self._flooded.around(around), self._flooded.sway
        self.head.surround(around)
        self.sway = sway

    def stance(self) -> _Stance:
        """Return the true state, for the simulated tip and for scoring after a run."""
        now = self._line_of_sight()
        pan_rate, tilt_rate = ((now - self._before) / self.tick).tolist()
        advance, roll = (_UNITS[2:] * self.catheter._output_now()).tolist()
        pan, tilt = now.tolist()
        return pan, tilt, pan_rate, tilt_rate, advance, roll

    def _line_of_sight(self) -> FloatArray:
        """Return pan and tilt (2,) of the camera."""
        swayed = np.zeros(2) if self.sway is None else self.sway.at(self.head.clock)
        return np.asarray(np.radians(self.head._output_now()) - STRAIGHT + swayed)


class RigWires:
    """The two currents of a rig as an actuator without outputs, and the pictures of its tip."""

    inputs, outputs = Head.inputs, ()

    def __init__(self, rig: Rig, tip: SimulatedTip) -> None:
        self._rig, self._tip = rig, tip
        self.tick, self.serial = rig.tick, rig.head.serial
        self._framed = True

    def exchange(self, u: FloatArray) -> FloatArray:
        """Hold two currents for a tick; there are no readings."""
        if not self._framed:  # a frame advances the clock of the camera
            self._tip.wait(self.tick)
        self._framed = False
        self._rig.exchange(np.append(u, [0.0, 0.0]))
        return np.empty(0)

    def safe(self) -> None:
        """Let the wires cool."""
        self._rig.safe()

    def frame(self) -> Frame:
        """Return a picture from the present pose of the head."""
        self._tip.move_to(self._rig.stance())
        self._framed = True
        return self._tip.frame()


class SimulatedTip:
    """The tip of a rig: a camera with its lights, a micro-tool, and a probe for use in water.

    ``pipe``: the dry pipe; images always show it dry.
    ``mount``: place of the head in the pipe with the catheter at 0; on the axis without it.
    ``specimen``: seed of the specimens of camera and probe; nominal without it.
    ``seed``: seed of their noise.
    ``optics``: of the camera; its own without it.
    ``flooded``: of the pipe after ``flood``, for the probe; full of water of 20 degrees without it.
    ``probe``: further options of `Ultrasound`.
    ``flow``: called when the pipe is flooded or emptied, with a flag, such as ``flood`` of a `Rig`.
    """

    def __init__(
        self,
        pipe: Pipe,
        *,
        mount: Mount | None = None,
        specimen: int | None = None,
        seed: int = 0,
        optics: Pinhole = LENS,
        flooded: Filling | None = None,
        probe: Mapping[str, Any] | None = None,
        flow: Callable[[bool], None] | None = None,
    ) -> None:
        self._mount, self._flow = mount or Mount(), flow
        self._known_mount = self._mount
        self.pipe = pipe
        self.camera = Camera(pipe, self._mount, optics, specimen=specimen, seed=seed)
        self.tool = _MicroTool(pipe, self._mount, specimen=specimen)
        water = flooded or Filling(level=FULL * pipe.radius)
        self._probe_of = {
            wet: partial(
                Ultrasound,
                filled,
                self._mount,
                specimen=specimen,
                seed=seed,
                temperature=water.temperature,
                pressure=water.pressure,
                **(probe or {}),
            )
            for wet, filled in ((False, pipe), (True, replace(pipe, water=water.level)))
        }
        self._probes: dict[bool, Ultrasound] = {}
        self._wet, self._framed = False, True
        self._stance: tuple[float, ...] = (0.0,) * 6

    def move_to(self, stance: tuple[float, ...]) -> None:
        """Set the place of the rig; a camera without a frame since the last call waits for one."""
        if not self._framed:
            self.camera._advance(self.camera.sensor.interval)
        self._stance, self._framed = stance, False
        pan, tilt, pan_rate, tilt_rate, *_ = stance
        mount = self._mount_now()
        self.camera.move(mount)
        self.camera.look(pan, tilt, rates=(pan_rate, tilt_rate))
        marks = len(self.tool.marks)
        self.tool.move(mount)
        self.tool.look(pan, tilt)
        self.tool._advance(self.camera.sensor.interval)
        if len(self.tool.marks) > marks:
            self.camera.repaint(self.tool.pipe)

    def extend(self, length: float) -> None:
        """Extend the tool to a length in metres, or until it touches the wall."""
        self.tool.extend(length)

    def tool_state(self) -> tuple[float, bool]:
        """Return the extension in metres, and whether the tool touches the wall."""
        return self.tool.extension, self.tool.touching

    def frame(self) -> Frame:
        """Return the image that begins now."""
        self._framed = True
        return self.camera.frame()

    def wait(self, seconds: float) -> None:
        """Let time pass without a frame."""
        self.camera._advance(seconds)

    def switch(self, lights: Sequence[bool]) -> None:
        """Switch lights on or off from the next frame on."""
        self.camera.switch(lights)

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """Set the exposure time, in seconds, and the gain."""
        self.camera.expose(exposure, gain)

    def focus_at(self, distance: float) -> None:
        """Move the focus to a distance in metres."""
        self.camera.focus_at(distance)

    def flood(self, on: bool) -> None:
        """Fill the pipe with water, or empty it."""
        self._wet = on
        if self._flow is not None:
            self._flow(on)

    def prepare(self) -> None:
        """Compute the beam of the probe, which takes seconds, before the first shot needs it."""
        self._probe(True)

    def shots(self, count: int) -> list[Shot]:
        """Fire pulses, one after the other, and return their shots."""
        probe = self._probe(self._wet)
        pan, tilt, pan_rate, tilt_rate, *_ = self._stance
        probe.move(self._mount_now())
        probe.look(pan, tilt, rates=(pan_rate, tilt_rate))
        return [probe.shot() for _ in range(count)]

    def _probe(self, wet: bool) -> Ultrasound:
        if wet not in self._probes:
            self._probes[wet] = self._probe_of[wet]()
        return self._probes[wet]

    def _mount_now(self) -> Mount:
        advance, roll = self._stance[4:]
        mount, known = self._mount, self._known_mount
        place = mount.advance + advance, mount.roll + roll
        if place != (known.advance, known.roll):
            self._known_mount = replace(mount, advance=place[0], roll=place[1])
        return self._known_mount


class _MicroTool(Mounted):
    """A pen beside the lens.

    ``mount``: place of the head in the pipe; on the axis without it. ``tool``: as designed.
    ``specimen``: seed of a specimen, which differs from the design and is calibrated; the design
    without it.
    """

    def __init__(
        self,
        pipe: Pipe,
        mount: Mount | None = None,
        tool: Tool | None = None,
        *,
        specimen: int | None = None,
    ) -> None:
        super().__init__(mount)
        self.pipe = pipe
        design = tool or Tool()
        self._tool, self.calibration = _specimen(design, specimen)
        self._extension = self._wanted = 0.0
        self.touching = False
        self.touches: list[tuple[float, float]] = []
        self.marks: list[tuple[float, float]] = []

    @property
    def extension(self) -> float:
        """Extension now, in metres."""
        return self._extension

    def extend(self, length: float) -> None:
        """Extend to a length in metres, or until the point touches the wall.

        Raises a `LimitError` if the length is not from 0 to the longest.
        """
        if not 0 <= as_finite("extension of the tool", length) <= self._tool.longest:
            raise LimitError(
                f"extension {length} m is beyond the limits [0, {self._tool.longest:g}] m"
            )
        self._wanted = float(length)

    def _advance(self, seconds: float) -> None:
        """Move the point towards the wanted extension, but never through the wall."""
        super()._advance(seconds)
        if not (self._extension or self._wanted or self.touching):
            return  # withdrawn: the wall does not matter
        most = seconds * RATE
        moved = self._extension + float(np.clip(self._wanted - self._extension, -most, most))
        phi, z, free = self._met()
        was, self.touching = self.touching, moved >= free
        self._extension = min(moved, free)
        if not self.touching or was:
            return
        self.touches.append((phi, z))
        if self._bore_at(phi, z) is None:
            self.marks.append((phi, z))
            dot = Dirt(phi, z, _MARK_RADIUS, _MARK_ALBEDO, softness=0.03e-3, raggedness=0.0)
            self.pipe = replace(self.pipe, dirt=(*self.pipe.dirt, dot))

    def _met(self) -> tuple[float, float, float]:
        """Return phi and z at which the tool meets the wall, and the extension to the contact."""
        try:
            phi, z, length = self._tool.meet(
                self._mount, self._pan, self._tilt, self.pipe.radius
            ).tolist()
        except ParameterError:
            return 0.0, 0.0, 0.0
        bore = self._bore_at(phi, z)
        return phi, z, length + (0.0 if bore is None else bore.depth)

    def _bore_at(self, phi: float, z: float) -> Bore | None:
        for bore in self.pipe.bores:
            off = np.hypot(self.pipe.radius * float(wrapped(phi - bore.phi)), z - bore.z)
            if off < bore.diameter / 2:
                return bore
        return None

    def _place(self) -> tuple[float, float]:
        """Return phi and z at which the tool would touch the wall now. For scoring only."""
        phi, z, _ = self._met()
        return phi, z


def _specimen(design: Tool, specimen: int | None) -> tuple[Tool, Tool]:
    """Return the true tool, and the calibrated one."""
    if specimen is None:
        return design, design
    rng = np.random.default_rng([specimen, 61])
    true = _changed(design, rng, _SPREAD, _TILT)
    return true, _changed(true, rng, _KNOWN, _KNOWN_TILT)


def _changed(tool: Tool, rng: np.random.Generator, spread: float, tilt: float) -> Tool:
    x, y, z = (np.array(tool.offset) + rng.normal(0, spread, 3)).tolist()
    right, down = (np.array(tool.slope) + rng.normal(0, tilt, 2)).tolist()
    return replace(tool, offset=(x, y, z), slope=(right, down))
