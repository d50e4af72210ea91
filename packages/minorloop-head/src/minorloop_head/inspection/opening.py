"""Heads at an address whose angles are read by sensors of their joints, or from pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from minorloop.connect import opened
from minorloop.errors import ParameterError
from minorloop_head.console.plant import open_plant, open_tip
from minorloop_head.console.settings import is_pipe
from minorloop_head.procedures.head_file import read_head
from minorloop_head.procedures.identify import Told, check_head
from minorloop_head.procedures.steer import check_targets, steer

if TYPE_CHECKING:
    import numpy.typing as npt

    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.steer import SteeredHead, Unfinished

_PATIENCE = 0.08
"""Seconds that a camera may take for a picture: two ticks, in which a current is not changed."""
_TIP_SCALE = 0.5
_EVERY = 4
"""Pictures of the simulated camera: half as wide, and one in four ticks, since each takes time."""
_CAMERA_HELPS = "; for a head whose angles a camera gives, name it with --camera"
_WAITS = "waiting until the head without current stands still: its angles are counted from there"


def drive_head(
    targets: npt.ArrayLike,
    hold: float,
    actuator: str,
    head: Path,
    *,
    camera: str | None = None,
    specimen: int | None = None,
    noise: float = 0.0,
    seed: int = 0,
    told: Told = lambda said: None,
    unfinished: Unfinished = lambda found, safe: None,
) -> SteeredHead:
    """Bring the head at an address to targets, hold each, and leave it safe.

    Parameters and errors are as of `steer`, with the file of the head in ``head``, and as of
    `opened_head`; ``told`` also takes doubts about the models of the wires.
    """
    known, seen = read_head(head), by_camera(actuator, camera, noise)
    control = known.control(by_camera=seen)
    for doubt in () if known.identified is None else known.identified.untrusted:
        told(f"! {doubt}")
    check_targets(control, targets, hold)
    with opened_head(
        actuator,
        camera,
        known.calibration,
        specimen=specimen,
        noise=noise,
        seed=seed,
        cold=control.cold,
        check=lambda plant: known.check_fits(getattr(plant, "serial", None), head),
        told=told,
    ) as plant:
        control = known.control(interval=plant.tick, by_camera=seen)
        return steer(plant, control, targets, hold, unfinished=unfinished)


def by_camera(actuator: str, camera: str | None, noise: float) -> bool:
    """Return whether a camera gives the angles of the head at an address.

    Raises a `ParameterError` if it does, and there is noise of sensors.
    """
    seen = camera is not None or is_pipe(actuator)
    if seen and noise:
        raise ParameterError(
            f"--noise is {noise:g}, and the angles are those of pictures; leave it out"
        )
    return seen


@contextmanager
def opened_head(
    address: str,
    camera: str | None,
    view: HeadCalibration | None,
    *,
    specimen: int | None = None,
    noise: float = 0.0,
    seed: int = 0,
    cold: npt.ArrayLike = (0.0, 0.0),
    check: Callable[[Actuator], object] = lambda plant: None,
    told: Told = lambda said: None,
) -> Iterator[Actuator]:
    """Yield the head at an address, with the angles of its sensors or camera; close it at the end.

    Raises a `ParameterError` if it has neither, there is no calibration, or a camera is given for
    the simulated pipe, which has its own.

    Parameters
    ----------
    address : str
        Of the actuator.
    camera : str, optional
        Address of the camera that gives the angles; none for sensors, and for the simulated pipe.
    view : HeadCalibration, optional
        Of the camera; without it the simulated pipe knows its own.
    specimen, noise, seed : int, float, int
        Of a simulated head.
    cold : (2,) array_like
        Pan and tilt of the cold head in degrees.
    check : callable
        Refuses an actuator before its head waits.
    told : callable
        Takes what is waited for, and warnings.
    """
    if is_pipe(address):
        if camera is not None:
            raise ParameterError(f"{address} has a camera of its own; leave --camera out")
        yield _in_pipe(address, view, specimen, seed, check, cold=cold, waits=lambda: told(_WAITS))
    elif camera is None:
        with opened(address, say=told, specimen=specimen, noise=noise, seed=seed) as plant:
            check_head(plant, seen=_CAMERA_HELPS)
            check(plant)
            yield plant
    else:
        if view is None:
            raise ParameterError(
                "the file of the head has no calibration of the camera; calibrate it with "
                "minorloop head calibrate first"
            )
        from minorloop.lab.drivers.bench import WallClock
        from minorloop_head.procedures.seen_angles import SeenHead
        from minorloop_head.vision.video import LiveCamera

        live = LiveCamera(camera, _PATIENCE)
        try:
            with opened(address, say=told) as plant:
                check(plant)
                if plant.outputs:
                    sensors = ", ".join(str(channel) for channel in plant.outputs)
                    told(
                        f"the camera gives the angles; the sensors of the actuator, {sensors}, are "
                        "not used"
                    )
                yield SeenHead(
                    plant,
                    live.frame,
                    view,
                    clock=WallClock(),
                    cold=cold,
                    waits=lambda: told(_WAITS),
                )
        finally:
            live.close()


def _in_pipe(
    address: str,
    view: HeadCalibration | None,
    specimen: int | None,
    seed: int,
    check: Callable[[Actuator], object],
    **options: Any,
) -> Actuator:
    """Return the simulated head in its pipe, with the angles of its camera."""
    from minorloop_head.procedures.seen_angles import SeenHead
    from minorloop_head.twins.rig import Rig, RigWires, SimulatedTip

    rig = open_plant(address, specimen=specimen, seed=seed)
    assert isinstance(rig, Rig)
    tip, known = open_tip(address, specimen=specimen, seed=seed, scale=_TIP_SCALE)
    assert isinstance(tip, SimulatedTip)
    wires = RigWires(rig, tip)
    plant = cast("Actuator", wires)
    check(plant)
    return SeenHead(plant, wires.frame, view or known, expose=tip.expose, every=_EVERY, **options)
