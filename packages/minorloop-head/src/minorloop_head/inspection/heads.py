"""Heads at an address: of real devices, or simulated in a pipe."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from minorloop.connect import opened
from minorloop.errors import ParameterError
from minorloop.lab.signals import ended_by_signals
from minorloop_head.console.identified_head import head_of
from minorloop_head.console.plant import FULL_PIPE, flowing_water, head_at, open_plant, open_tip
from minorloop_head.console.settings import PIPE, is_pipe
from minorloop_head.procedures.head_file import HeadFile, read_head
from minorloop_head.procedures.identify import Told, check_head
from minorloop_head.procedures.rig import InspectionRig, rig_at
from minorloop_head.procedures.seen_base import SeenBase
from minorloop_head.procedures.steer import check_targets, steer
from minorloop_head.procedures.values import LogEntry
from minorloop_head.twins.surroundings import GASES

if TYPE_CHECKING:
    import numpy.typing as npt

    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.steer import SteeredHead, Unfinished
    from minorloop_head.twins.surroundings import Filling


_Logged: TypeAlias = Callable[[LogEntry], None]
_HIGHEST = 9.9
"""Largest height of the water above or below the axis of the pipe, in mm, whose radius is 10 mm."""
_RANGES = {"temperature": (5.0, 60.0, "degrees Celsius"), "pressure": (0.01, 100.0, "bar")}
_PASCAL = 1e5


@dataclass(frozen=True)
class Water:
    """Filling of the simulated pipe."""

    level: str = "full"
    """Height of the water above the axis in mm, -9.9 to 9.9; or ``full``, or ``dry``."""
    temperature: float = 20.0
    """Temperature of the water, 5 to 60 degrees Celsius."""
    gas: str = "air"
    """Above the water, and in the drained pipe: one of `GASES`."""
    pressure: float = 1.01325
    """Pressure of the gas, 0.01 to 100 bar."""

    def filling(self) -> Filling:
        """Return the filling of the simulated pipe; a dry pipe has no level.

        Raises a `ParameterError` if a value is out of its range, or there is no such gas.
        """
        for name, (low, high, unit) in _RANGES.items():
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and low <= value <= high):
                raise ParameterError(
                    f"{name} of --water is {value}; give {low:g} to {high:g} {unit}"
                )
        if self.gas not in GASES:
            raise ParameterError(f"gas of --water is {self.gas!r}; give one of {', '.join(GASES)}")
        known = {"full": FULL_PIPE, "dry": None}
        level = known[self.level] if self.level in known else -1e-3 * self._height()
        water = flowing_water(level, self.temperature)
        return replace(water, gas=self.gas, pressure=_PASCAL * self.pressure)

    def noted(self) -> dict[str, Any]:
        """Return the filling for a journal, with the level in one form."""
        given = self.level in ("full", "dry")
        return {
            "water [mm above the axis]": self.level if given else f"{self._height() + 0.0:g}",
            "water [C]": self.temperature,
            "gas": self.gas,
            "gas [bar]": self.pressure,
        }

    def _height(self) -> float:
        """Return the height of the water in mm above the axis."""
        try:
            height = float(self.level)
        except ValueError:
            height = math.nan
        if not abs(height) <= _HIGHEST:
            raise ParameterError(
                f"--water is {self.level}; give full, dry, or its height above the axis of the "
                f"pipe, {-_HIGHEST:g} to {_HIGHEST:g} mm"
            )
        return height


@dataclass(frozen=True)
class InspectedHead:
    """A head that can be opened for an inspection or a sweep."""

    begun: dict[str, Any]
    """Description for the journal: an inspection is resumed with the same head only."""
    view: HeadCalibration | None
    """Calibration of its camera; opening refuses a head without one."""
    opened: Callable[[_Logged], AbstractContextManager[InspectionRig]]
    """Opens it, given a function that reports steps. The head is safe at the end of the context."""
    unscanned: str | None = None
    """Reason why its probe scans nothing, as of `Probing`; None on a head without a probe."""


def inspected_head(
    actuator: str,
    camera: str | None = None,
    head: Path | None = None,
    *,
    specimen: int | None = None,
    seed: int = 0,
    water: Water = Water(),
    probe: Path | None = None,
) -> InspectedHead:
    """Return the head at an address, for `inspect`.

    Parameters
    ----------
    actuator, camera : str
        Addresses. The simulated pipe has its own camera.
    head : path, optional
        File of the head. The simulated one is identified without it.
    specimen, seed : int
        Of the simulated head, and of its noise and its pipe.
    water : Water
        What fills the simulated pipe.
    probe : path, optional
        File of the pulser and digitiser of a head of devices.

    Raises
    ------
    ParameterError
        If a device lacks its camera or file, or the simulated pipe is given a camera, a probe or
        impossible water.
    """
    if is_pipe(actuator):
        if camera is not None:
            raise ParameterError(f"{PIPE} has its own camera; leave --camera out")
        if probe is not None:
            raise ParameterError(f"{PIPE} has its own probe; leave --probe out")
        known = None if head is None else head_at(actuator, specimen, head)[0]
        about = _about(HeadFile(serial=_serial(specimen)) if known is None else known)
        return _simulated(actuator, specimen, seed, water, about, known, turned=True)
    if camera is None or head is None:
        raise ParameterError(
            f"--actuator {actuator} needs --camera, and --head with a file that minorloop head "
            f"identify writes; only {PIPE} needs neither"
        )
    if is_pipe(camera):
        raise ParameterError(f"--camera is {PIPE}; give it as --actuator, without --camera")
    if specimen is not None or seed or water != Water():
        raise ParameterError(
            f"--specimen, --seed and --water are of {PIPE}, and --actuator is {actuator}; leave "
            "them out"
        )
    known = read_head(head)
    begun = {**_about(known), "actuator": actuator, "camera": camera}
    if probe is not None:
        begun["probe"] = str(probe)
    opened = partial(rig_at, actuator, camera, head, probe=probe)
    return InspectedHead(begun, known.calibration, opened, None if probe is None else "")


def swept_head(
    actuator: str, *, specimen: int | None = None, seed: int = 0, water: Water = Water()
) -> InspectedHead:
    """Return the head at an address, for `sweep`; parameters as of `inspected_head`.

    Raises
    ------
    ParameterError
        If it has no probe, the pipe is dry, or its water cannot be.
    """
    if not is_pipe(actuator):
        raise ParameterError(
            f"the actuator {actuator} is not a head with an ultrasonic probe; give {PIPE}, the "
            "only address that has one"
        )
    if water.filling().level is None:
        raise ParameterError("a dry pipe cannot be swept; give --water a height, or leave it out")
    return _simulated(actuator, specimen, seed, water, {"head": _serial(specimen)})


def _about(known: HeadFile) -> dict[str, Any]:
    calibrated = known.calibrated
    return {
        "head": known.serial,
        "calibrated": None if calibrated is None else calibrated.isoformat(),
    }


def _serial(specimen: int | None) -> str:
    """Return the serial number of the simulated head."""
    from minorloop_head.twins.head import Head

    return Head(specimen).serial


def _simulated(
    address: str,
    specimen: int | None,
    seed: int,
    water: Water,
    about: dict[str, Any],
    known: HeadFile | None = None,
    *,
    turned: bool = False,
) -> InspectedHead:
    """Return the simulated head in its pipe; it sees its base if the flow has ``turned`` that."""
    filling = water.filling()
    plant = open_plant(address, specimen=specimen, seed=seed, water=filling)
    flow = getattr(plant, "flood", None)
    tip, own = open_tip(address, specimen=specimen, seed=seed, flow=flow, water=filling)
    view = own if known is None or known.calibration is None else known.calibration

    @contextmanager
    def opened(told: _Logged) -> Iterator[InspectionRig]:
        with ended_by_signals(exiting=True):
            control = (
                head_of(address, specimen) if known is None else known.control(interval=plant.tick)
            )
            base = SeenBase(view) if turned else None
            try:
                yield InspectionRig(plant, tip, control, view, base=base, told=told)
            finally:
                plant.safe()

    begun = {**about, "actuator": address, "specimen": specimen, "seed": seed, **water.noted()}
    return InspectedHead(begun, view, opened, "no water" if filling.level is None else "")


_PATIENCE = 0.08
"""Longest time in seconds for a picture: two ticks, in which a current does not change."""
_TIP_SCALE = 0.5
_EVERY = 4
"""Pictures of the simulated camera: of half width, one in four ticks, since each takes time."""
_CAMERA_HELPS = "; for a head whose angles a camera gives, name it with --camera"
_WAITS = "waiting until the head without current stands still: its angles are counted from there"


@dataclass(frozen=True)
class HeadAddress:
    """Address of a head that is identified or driven.

    Raises a `ParameterError` if a camera is given for the simulated pipe, which has its own, or
    noise of sensors for a head whose angles a camera gives.
    """

    actuator: str
    """Address of its currents, and of its sensors if there is no camera."""
    camera: str | None = None
    """Address of the camera that gives its angles; none for sensors, and for the simulated pipe."""
    specimen: int | None = None
    noise: float = 0.0
    seed: int = 0
    """Of a simulated head; noise of its sensors in degrees."""

    def __post_init__(self) -> None:
        if self.in_pipe and self.camera is not None:
            raise ParameterError(f"{self.actuator} has its own camera; leave --camera out")
        if self.by_camera and self.noise:
            raise ParameterError(
                f"--noise is {self.noise:g}, and the angles are those of pictures; leave it out"
            )

    @property
    def in_pipe(self) -> bool:
        """Whether it is the simulated head in its pipe."""
        return is_pipe(self.actuator)

    @property
    def by_camera(self) -> bool:
        """Whether a camera gives the angles of the head."""
        return self.camera is not None or self.in_pipe


def drive_head(
    targets: npt.ArrayLike,
    hold: float,
    address: HeadAddress,
    head: Path,
    *,
    told: Told = lambda said: None,
    unfinished: Unfinished = lambda found, safe: None,
) -> SteeredHead:
    """Bring the head at an address to targets, hold each, and leave it safe.

    Parameters and errors are as of `steer`, with the file of the head in ``head``, and as of
    `opened_head`; ``told`` also receives doubts about the models of the wires.
    """
    known = read_head(head)
    control = known.control(by_camera=address.by_camera)
    for doubt in () if known.identified is None else known.identified.untrusted:
        told(f"! {doubt}")
    check_targets(control, targets, hold)
    with opened_head(
        address,
        known.calibration,
        cold=control.cold,
        check=lambda plant: known.check_fits(getattr(plant, "serial", None), head),
        told=told,
    ) as plant:
        control = known.control(interval=plant.tick, by_camera=address.by_camera)
        return steer(plant, control, targets, hold, unfinished=unfinished)


@contextmanager
def opened_head(
    address: HeadAddress,
    view: HeadCalibration | None,
    *,
    cold: npt.ArrayLike = (0.0, 0.0),
    check: Callable[[Actuator], object] = lambda plant: None,
    told: Told = lambda said: None,
) -> Iterator[Actuator]:
    """Yield the head at an address, with the angles of its sensors or camera; close it at the end.

    Raises a `ParameterError` if it has neither, or there is no calibration.

    Parameters
    ----------
    address : HeadAddress
    view : HeadCalibration, optional
        Of the camera; without it the simulated pipe knows its own.
    cold : (2,) array_like
        Pan and tilt of the cold head in degrees.
    check : callable
        Refuses an actuator before its head waits.
    told : callable
        Called with the reason of each wait, and with warnings.
    """
    if address.in_pipe:
        yield _in_pipe(address, view, check, cold=cold, waits=lambda: told(_WAITS))
    elif address.camera is None:
        simulated = {name: getattr(address, name) for name in ("specimen", "noise", "seed")}
        with opened(address.actuator, say=told, **simulated) as plant:
            check_head(plant, seen=_CAMERA_HELPS)
            check(plant)
            yield plant
    elif view is None:
        raise ParameterError(
            "the file of the head has no calibration of the camera; calibrate it with "
            "minorloop head calibrate first"
        )
    else:
        from minorloop.lab.drivers.bench import WallClock
        from minorloop_head.procedures.seen_angles import SeenHead
        from minorloop_head.vision.video import LiveCamera

        with (
            closing(LiveCamera(address.camera, _PATIENCE)) as live,
            opened(address.actuator, say=told) as plant,
        ):
            check(plant)
            if plant.outputs:
                sensors = ", ".join(str(channel) for channel in plant.outputs)
                told(
                    f"the camera gives the angles; the sensors of the actuator, {sensors}, are "
                    "not used"
                )
            clock, waits = WallClock(), partial(told, _WAITS)
            yield SeenHead(plant, live.frame, view, clock=clock, cold=cold, waits=waits)


def _in_pipe(
    address: HeadAddress,
    view: HeadCalibration | None,
    check: Callable[[Actuator], object],
    **options: Any,
) -> Actuator:
    """Return the simulated head in its pipe, with the angles of its camera."""
    from minorloop_head.procedures.seen_angles import SeenHead
    from minorloop_head.twins.rig import Rig, RigWires, SimulatedTip

    where, specimen, seed = address.actuator, address.specimen, address.seed
    rig = open_plant(where, specimen=specimen, seed=seed)
    assert isinstance(rig, Rig)
    tip, known = open_tip(where, specimen=specimen, seed=seed, scale=_TIP_SCALE)
    assert isinstance(tip, SimulatedTip)
    wires = RigWires(rig, tip)
    plant = cast("Actuator", wires)
    check(plant)
    return SeenHead(plant, wires.frame, view or known, expose=tip.expose, every=_EVERY, **options)
