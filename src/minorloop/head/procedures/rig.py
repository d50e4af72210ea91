"""A loop without an operator: it runs procedures to their end on a plant and a tip.

On devices::

    with rig_at("bench:head.toml", "camera:0", "head.json") as rig:
        rig.run(Go(), Go().begin(angles=(0.1, 0.0)))
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.connect import connect
from minorloop.errors import ModelFileError
from minorloop.files import PathLike
from minorloop.head.control.head import HeadControl
from minorloop.head.procedures.actuator_plant import ActuatorPlant, BenchTip
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.camera_tip import CameraTip
from minorloop.head.procedures.head_file import read_head
from minorloop.head.procedures.values import (
    NOTHING,
    Plant,
    Procedure,
    Reading,
    Request,
    State,
    Tip,
    ToolTip,
    apply_to_tip,
)
from minorloop.head.vision.video import LiveCamera
from minorloop.lab.drivers.parts import WallClock
from minorloop.lab.run import left_safe


@dataclass(frozen=True)
class LogEntry:
    """Entry of a log: the time in seconds, the action, and its result."""

    t: float
    what: str
    outcome: str


class InspectionRig:
    """Plant, tip, control and calibration, with a clock and a log.

    Parameters
    ----------
    plant : Plant
    tip : Tip
    control : HeadControl
        Of the plant's head.
    calibration : HeadCalibration
    gyroscope : callable, optional
        Returns the pan and tilt (2,) by which the base of the head is turned, in radians.
    sensors : bool
        Whether the joints have sensors. Without them the angles are those of the model of the
        wires, and control uses the angles that a procedure estimates from the image.
    """

    def __init__(
        self,
        plant: Plant,
        tip: Tip,
        control: HeadControl,
        calibration: HeadCalibration,
        *,
        gyroscope: Callable[[], FloatArray] | None = None,
        sensors: bool = True,
    ) -> None:
        self.plant, self.tip, self.control = plant, tip, control
        self.calibration = calibration
        self.log: list[LogEntry] = []
        self.gain = 1.0
        self._gyroscope, self._sensors = gyroscope, sensors
        self._ticks = 0
        self._state = control.begin()
        self._commanded = -np.asarray(calibration.straight)
        self._read = self._known = np.zeros(4)
        tip.move_to(plant.stance())

    @property
    def t(self) -> float:
        """Seconds since the rig was created."""
        return self._ticks * self.plant.tick

    @property
    def place(self) -> FloatArray:
        """(2,) advance in metres and roll in radians as measured."""
        return self._known[2:].copy()

    @property
    def angles(self) -> FloatArray:
        """(2,) pan and tilt in radians by the joints, or by the model of the wires."""
        if self._sensors:
            return self.calibration.line_of_sight(self._known[:2])
        own = np.array([axis.estimate.wire.angle for axis in self._state.axes])
        return self.calibration.line_of_sight(np.radians(np.asarray(self.control.coupling) @ own))

    def reading(self, request: Request = NOTHING) -> Reading:
        """Carry out a request on the tip and return the reading, with its frame and its burst."""
        apply_to_tip(self.tip, request)
        tool = (0.0, False)
        if self.calibration.tool is not None and isinstance(self.tip, ToolTip):
            tool = self.tip.tool_state()
        return Reading(
            t=self.t,
            angles=self.angles,
            place=self.place,
            base=np.zeros(2) if self._gyroscope is None else self._gyroscope(),
            image=self.tip.frame().image if request.frame else None,
            shots=tuple(self.tip.shots(request.shots)) if request.shots else (),
            fired=request.shots > 0,
            extension=tool[0],
            touching=tool[1],
        )

    def run(
        self, procedure: Procedure[State], state: State, each: Callable[[State], None] | None = None
    ) -> State:
        """Run a procedure to its end and return its last state.

        Parameters
        ----------
        procedure : Procedure
        state : State
            From its ``begin``.
        each : callable, optional
            Called with the state after every tick.
        """
        request = NOTHING
        while True:
            state, request = procedure.step(state, self.reading(request))
            if state.done:
                apply_to_tip(self.tip, request)
                return state
            self._tick(request)
            if each is not None:
                each(state)

    def say(self, what: str, outcome: str) -> None:
        """Add an entry to the log."""
        self.log.append(LogEntry(self.t, what, outcome))

    def _tick(self, request: Request) -> None:
        """Move head and catheter as requested for one tick."""
        if request.angles is not None:
            self._commanded = request.angles
        read = np.degrees(self._read[:2])
        if not self._sensors:
            sighted = request.sighted
            read = np.full(2, np.nan) if sighted is None else self.calibration.joints(sighted)
        wanted = self.calibration.joints(self._commanded)
        currents, self._state = self.control.step(self._state, wanted, read)
        self._read = self.plant.exchange(np.concatenate([currents, request.rates]))
        self._known = np.where(np.isnan(self._read), self._known, self._read)
        self._ticks += 1
        self.tip.move_to(self.plant.stance())


@contextmanager
def rig_at(address: str, camera: str, file: PathLike) -> Iterator[InspectionRig]:
    """Yield the loop on a head of devices; make it safe and close them at the end.

    It has no probe: a procedure that fires raises an `InstrumentError`.

    Parameters
    ----------
    address : str
        Of the plant, as in `minorloop.connect`.
    camera : str
        As in `minorloop.head.vision.video`.
    file : str or path
        Of the head, with wires and calibration.

    Raises
    ------
    ParameterError
        If an address is not valid, or the plant is no head.
    ModelFileError
        If the file is not valid, is of another head, lacks wires or calibration, has wires that
        are older than the calibration, or another number of LEDs than the plant.
    InstrumentError
        If a device is missing, busy, or does not answer.
    """
    known = read_head(file)
    view = known.calibration
    if view is None:
        raise ModelFileError(f"{file} has no calibration of the camera; calibrate it first")
    actuator = connect(address)
    with ExitStack() as ends:
        ends.callback(getattr(actuator, "close", lambda: None))
        ends.enter_context(left_safe(actuator))
        plant = ActuatorPlant(actuator, WallClock())
        known.check_fits(plant.serial, file)
        known.check_lights(plant.leds, file)
        control = known.control(interval=plant.tick)
        pictures = ends.enter_context(closing(LiveCamera(camera)))
        yield InspectionRig(plant, CameraTip(BenchTip(plant), pictures, view), control, view)
