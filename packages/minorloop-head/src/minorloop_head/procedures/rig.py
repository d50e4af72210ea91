"""A loop without an operator: it runs procedures to their end on a plant and a tip.

On devices::

    with rig_at("bench:head.toml", "camera:0", "head.json") as rig:
        rig.run(go(angles=(0.1, 0.0)))

On devices, ticks run in real time, and neither a late picture nor a long computation stops the
control of the wires. If a device fails, the head is made safe. The loop continues if the device
answers again, and ends if it does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.connect import connect
from minorloop.errors import InstrumentError, ModelFileError, SafetyError
from minorloop.files import PathLike
from minorloop.lab.actuator import Actuator
from minorloop.lab.drivers.bench import WallClock
from minorloop.lab.run import left_safe
from minorloop_head.control.head import HeadControl
from minorloop_head.geometry import AXES
from minorloop_head.procedures.actuator_plant import ActuatorPlant, BenchTip, CameraTip
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.digitiser import open_digitiser
from minorloop_head.procedures.head_file import read_head
from minorloop_head.procedures.meter import Light
from minorloop_head.procedures.seen_angles import LONGEST, SeenAngles, unknown_zero, unseen
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.procedures.values import (
    ALL_LIGHTS,
    NOTHING,
    LogEntry,
    Plant,
    Procedure,
    Reading,
    Request,
    Result,
    Tip,
    ToolTip,
    apply_to_tip,
    passed,
)
from minorloop_head.sources import Frame
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.video import LiveCamera, check_camera

Computed = TypeVar("Computed")
_PATIENCE = 0.02
"""Seconds that a tick waits for a picture, half of its duration; the next tick tries again."""
_BLIND = 5.0
"""Seconds without a good picture after which a procedure ends: a lost network camera is opened
again within 4 s."""

_MOST_FAILURES = 5
"""Consecutive failures of a device after which the loop ends: on a busy machine one answer in a
thousand is late, but never two in a row."""
_BY_ITSELF = (
    "its exposure cannot be set from here; set it at the camera, so that little of the wall is "
    "white"
)


class InspectionRig:
    """Plant, tip, control and calibration, with a clock and a log.

    ``control``: of the plant's head.
    ``base``: measures the turn of the base in the pictures that come with bursts, counted from the
    last picture before the pipe is flooded.
    ``sensors``: whether the joints have sensors. Without them the angles are those of the model of
    the wires, and control uses the angles that a procedure estimates from the image.
    ``seen``: reads the angles of joints without sensors from each picture under all lights; call
    ``begin`` first then.
    ``computing``: runs long computations while the loop continues; without it, the clock of the
    loop stands still meanwhile.
    ``told``: called with each entry of the log.

    Notes
    -----
    ``most`` (2,) are the observed largest angles in degrees of joints that stopped before their
    target, infinite where not known; ``light`` is that of the camera.
    """

    def __init__(
        self,
        plant: Plant,
        tip: Tip,
        control: HeadControl,
        calibration: HeadCalibration,
        *,
        base: SeenBase | None = None,
        sensors: bool = True,
        seen: SeenAngles | None = None,
        computing: Executor | None = None,
        told: Callable[[LogEntry], None] = lambda entry: None,
    ) -> None:
        self.plant, self.tip, self.control = plant, tip, control
        self.calibration = calibration
        # Ask only once whether the tip has a tool: the answer takes half of a tick.
        has_tool = calibration.tool is not None and isinstance(tip, ToolTip)
        self._tool = cast(ToolTip, tip) if has_tool else None
        self.log: list[LogEntry] = []
        self.light = Light()
        self.most = np.full(2, np.inf)
        self._base, self._sensors = base, sensors
        self._seen = seen
        self._picture: Image | None = None
        self._computing, self._told = computing, told
        self._ticks = 0
        self._blind_since: float | None = None
        self._lights: tuple[bool, ...] = ALL_LIGHTS
        self._wet = False
        self._failures = 0
        self._state = control.begin()
        self._commanded = -np.asarray(calibration.straight)
        self._read, self._known, self._taken_at = np.zeros(4), np.zeros(4), 0.0
        tip.move_to(plant.stance())

    @property
    def t(self) -> float:
        """Seconds since the rig was created."""
        return self._ticks * self.plant.tick

    @property
    def travels(self) -> bool:
        """Whether a catheter moves the head along the pipe."""
        return bool(getattr(self.plant, "travels", True))

    @property
    def has_tool(self) -> bool:
        """Whether there is a micro-tool, and it is calibrated."""
        return self._tool is not None

    @property
    def place(self) -> FloatArray:
        """(2,) measured advance in metres and roll in radians."""
        return self._known[2:].copy()

    @property
    def angles(self) -> FloatArray:
        """(2,) pan and tilt in radians by the joints, or by the model of the wires."""
        if self._sensors:
            return self.calibration.line_of_sight(self._known[:2])
        return self.calibration.line_of_sight(np.radians(self.control.modelled(self._state)))

    def reading(self, request: Request = NOTHING) -> Reading:
        """Carry out a request on the tip and return the reading, with its frame and its burst.

        Raises an `InstrumentError` if the camera has given no good picture for 5 s, or a device
        fails again and again.
        """
        self._apply(request)
        if not request.frame and self._seen is None:
            self._blind_since = None
        tool = (0.0, False)
        if self._tool is not None:
            tool = self._tool.tool_state()
        image = self._image() if request.frame else None
        return Reading(
            t=self.t,
            angles=self.angles,
            place=self.place,
            base=self._base_turn(image if request.shots else None),
            image=image,
            shots=tuple(self.tip.shots(request.shots)) if request.shots else (),
            fired=request.shots > 0,
            extension=tool[0],
            touching=tool[1],
        )

    def _base_turn(self, image: Image | None) -> FloatArray:
        """Return the turn (2,) of the base; NaN if the picture does not show it, 0 if not measured.

        ``image``: taken now, with a burst.
        """
        if self._base is None or not self._wet:
            return np.zeros(2)
        if image is not None:
            self._base.see(image, self.t)
        return self._base.at(self.t)

    def begin(self) -> None:
        """Wait until a head without sensors is cold and at rest, where its angles are known.

        Raises an `InstrumentError` if it does not, or the camera does not show it.
        """
        while self._seen is not None and not self._seen.known:
            if self.t > LONGEST:
                raise InstrumentError(unknown_zero(self._seen.why))
            self._exchange(np.zeros(4))
            self._ticks += 1
            self._watch(cold=True)

    def run(self, procedure: Procedure[Result], each: Callable[[], None] = lambda: None) -> Result:
        """Run a procedure to its end and return its result.

        If it is interrupted, the tool is withdrawn, the pipe drained, and all lights switched on.

        ``each``: called after every tick.
        """
        try:
            request = next(procedure)
            while True:
                if not request.now:
                    self._tick(request)
                    each()
                request = procedure.send(self.reading(request))
        except StopIteration as end:
            return cast(Result, end.value)
        except BaseException:
            procedure.close()
            self._leave_safe()
            raise

    def _leave_safe(self) -> None:
        """Withdraw the tool, drain the pipe, and switch on all lights, as far as devices answer."""
        with suppress(InstrumentError):
            apply_to_tip(
                self.tip,
                Request(
                    extension=None if self._tool is None else 0.0,
                    lights=None if self._lights == ALL_LIGHTS else ALL_LIGHTS,
                    water=False if self._wet else None,
                ),
            )

    def look(self) -> tuple[Reading, Image]:
        """Return a reading with a picture; the loop runs until there is one.

        Raises an `InstrumentError` as `reading` does.
        """
        while (now := self.reading(Request(frame=True))).image is None:
            self._tick(NOTHING)
        return now, now.image

    def compute(self, work: Callable[[], Computed]) -> Computed:
        """Return the result of a computation; the head holds its position meanwhile."""
        if self._computing is None:
            return work()
        found = self._computing.submit(work)
        while not found.done():
            self._tick(NOTHING)
        return found.result()

    @property
    def trouble(self) -> str:
        """Reason why the wires do not reach their targets; empty if they do."""
        found = zip(AXES, self._state.axes, strict=True)
        each = [f"{name}: {axis.unreachable}" for name, axis in found if axis.unreachable]
        return "; ".join(each)

    def check_sensors(self) -> None:
        """Raise an `InstrumentError` if a sensor failed; its wire cools then."""
        if self._seen is not None and any(axis.fault for axis in self._state.axes):
            raise InstrumentError(unseen(self._seen.why))
        for name, axis in zip(AXES, self._state.axes, strict=True):
            if axis.fault:
                raise InstrumentError(f"the sensor of {name} is {axis.fault}; check it")

    def say(self, what: str, outcome: str, *, succeeded: bool = True) -> None:
        """Add an entry to the log."""
        self.log.append(LogEntry(self.t, what, outcome, succeeded))
        self._told(self.log[-1])

    def _image(self) -> Image | None:
        """Return a picture; None if there is no good one now.

        If angles are read from pictures, it is the picture of the present angles.
        """
        if self._seen is None:
            return self._newest_picture()
        found, self._picture = self._picture, None
        return found

    def _watch(self, *, cold: bool = False) -> None:
        """Take a picture, and read the angles from it if all lights are on."""
        if self._seen is None:
            return
        self._picture = self._newest_picture()
        self._read[:2] = np.nan
        if self._picture is not None and self._lights == ALL_LIGHTS:
            read = self._seen.read(Frame(self._taken_at, self._picture), cold=cold)
            self._read[:2] = np.radians(read)

    def _newest_picture(self) -> Image | None:
        newest = getattr(self.tip, "newest", None)
        if newest is None:
            return self.tip.frame().image
        found: Frame | None = None
        problem: InstrumentError | None = None
        try:
            found = newest()
        except InstrumentError as error:
            problem = error
        if found is not None:
            self._blind_since, self._taken_at = None, found.t
            return found.image
        self._blind_since = self.t if self._blind_since is None else self._blind_since
        if problem is not None and passed(self._blind_since, self.t, _BLIND):
            raise problem
        return None

    def _tick(self, request: Request) -> None:
        """Move head and catheter as requested for one tick."""
        if request.angles is not None:
            self._commanded = request.angles
        read = np.degrees(self._read[:2])
        if not self._sensors:
            sighted = request.sighted
            read = np.full(2, np.nan) if sighted is None else self.calibration.joints(sighted)
        wanted = self.calibration.joints(self._commanded)
        # The readings come from the last exchange, which may have begun late.
        t = self.plant.time
        currents, self._state = self.control.step(self._state, wanted, read, t=t)
        self._read = self._exchange(np.concatenate([currents, request.rates]))
        self._watch()
        self._known = np.where(np.isnan(self._read), self._known, self._read)
        self._ticks += 1
        self.tip.move_to(self.plant.stance())

    def _apply(self, request: Request) -> None:
        """Set lights, exposure, focus and water as requested."""
        if request.lights is not None:
            self._lights, self._picture = request.lights, None
        if self._base is not None:
            self._base.read(self.t, self.angles, self._known[2:].copy())
            if request.water and not self._wet:
                image = self._image()
                if image is not None:
                    self._base.begin(image, self.t)
        self._wet = self._wet if request.water is None else request.water
        self._retry(lambda: apply_to_tip(self.tip, request))

    def _exchange(self, u: FloatArray) -> FloatArray:
        """Return the readings under inputs; NaN after a failure, which has made the head safe."""
        try:
            read = self.plant.exchange(u)
        except InstrumentError as error:
            self._count_failure(error)
            off = (replace(axis, applied=0.0) for axis in self._state.axes)
            self._state = replace(self._state, axes=tuple(off))
            self._retry(lambda: self.tip.switch(self._lights))
            return np.full(4, np.nan)
        self._failures = 0
        return read

    def _retry(self, work: Callable[[], None]) -> None:
        """Repeat a call until it succeeds."""
        while True:
            try:
                return work()
            except InstrumentError as error:
                self._count_failure(error)

    def _count_failure(self, error: InstrumentError) -> None:
        """Log a failure of a device, after which the head is safe; raise it after too many."""
        self._failures += 1
        if isinstance(error, SafetyError) or self._failures > _MOST_FAILURES:
            raise error
        self.say("device", f"{error}; the head was made safe, and it is tried again")


@contextmanager
def rig_at(
    address: str,
    camera: str,
    file: PathLike,
    told: Callable[[LogEntry], None] = lambda entry: None,
    *,
    probe: PathLike | None = None,
) -> Iterator[InspectionRig]:
    """Yield the loop on a real head; make the head safe and close its devices at the end.

    The first picture is taken before the wires are heated.

    Raises a `ParameterError` if an address is not valid, or the plant is no head; a
    `ModelFileError` if the file is not valid, is of another head, lacks wires or calibration, has
    wires that are older than the calibration, or another number of LEDs than the plant; an
    `InstrumentError` if a device is missing, busy, or does not answer, or the camera gives no good
    picture; a `SafetyError` if the head did not confirm at the end that it is safe.

    ``address``: of the plant, as in `minorloop.connect`. ``camera``: as in
    `minorloop_head.vision.video`. ``file``: of the head, with wires and calibration. ``told``: as
    in `InspectionRig`. ``probe``: file of its pulser and digitiser, as of `open_digitiser`; without
    it a procedure that fires raises an `InstrumentError`.
    """
    known = read_head(file)
    view = known.calibration
    if view is None:
        raise ModelFileError(f"{file} has no calibration of the camera; calibrate it first")
    check_camera(camera)
    actuator = _opened(address, told)
    with ExitStack() as ends:
        ends.callback(getattr(actuator, "close", lambda: None))
        pictures = ends.enter_context(closing(LiveCamera(camera, _PATIENCE)))
        computing = ends.enter_context(ThreadPoolExecutor(1))
        ends.enter_context(left_safe(actuator))
        plant = ActuatorPlant(actuator, WallClock())
        known.check_fits(plant.serial, file)
        known.check_lights(plant.leds, file)
        control = known.control(interval=plant.tick, by_camera=not plant.sensors)
        seen = None if plant.sensors else SeenAngles(view, control.cold)
        echoes = probe and ends.enter_context(closing(open_digitiser(probe)))
        tip = CameraTip(BenchTip(plant, echoes or None), pictures, view)
        rig = InspectionRig(plant, tip, control, view, seen=seen, computing=computing, told=told)
        rig.reading(Request(lights=ALL_LIGHTS))
        if not pictures.exposes:
            told(LogEntry(rig.t, "camera", _BY_ITSELF))
        if seen is not None:
            told(LogEntry(rig.t, "camera", "it gives the angles; the head has to be cold first"))
        rig.begin()
        rig.look()
        yield rig


def _opened(address: str, told: Callable[[LogEntry], None]) -> Actuator:
    """Open the plant, once more after a device did not answer; opening makes it safe first."""
    try:
        return connect(address)
    except SafetyError:
        raise
    except InstrumentError as error:
        told(LogEntry(0.0, "device", f"{error}; it is opened once more"))
    return connect(address)
