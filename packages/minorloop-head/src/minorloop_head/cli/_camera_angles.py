"""The head of ``head identify`` and ``head drive`` whose angles are read from pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, cast

import msgspec
import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, StoreError
from minorloop.files import write_atomically
from minorloop.values import as_duration
from minorloop_head.console.settings import is_pipe

if TYPE_CHECKING:
    import numpy.typing as npt

    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.seen_angles import SeenHead

_SWEPT = "camera.json"
"""Calibration of a camera after the sweep, in the folder of the runs."""
_PATIENCE = 0.08
"""Seconds that a camera may take for a picture: two ticks, in which a current is not changed."""
_TIP_SCALE = 0.5
_EVERY = 4
"""Pictures of the simulated camera: half as wide, and one in four ticks, since each takes time."""


def kept_in(store: Path, *, seen: bool) -> str:
    """Return what the folder of an identification keeps before its first run, or between two.

    ``seen``: whether a camera gives the angles, so that there is a sweep before the first run.
    """
    if any(store.glob("*.sqlite")):
        return f"what was measured is kept in {store}; the same command continues it"
    if (store / _SWEPT).exists():
        return f"the sweep is kept in {store}, and nothing else yet; the same command goes on"
    anew = "nothing was measured yet, and nothing is kept; the same command begins anew"
    return anew + _whole_sweep() * seen


def _whole_sweep() -> str:
    """Return how long a sweep takes, which is carried out in one go from the cold head."""
    from minorloop_head.procedures.seen_angles import SWEEP_SECONDS

    return f" with the whole sweep of the camera, which takes {as_duration(SWEEP_SECONDS)}"


def kept_view(store: Path, serial: str) -> HeadCalibration | None:
    """Return the calibration of a head after its sweep, as it is kept; None if there is none.

    ``store``: folder of the runs; ``serial``: serial number of the head. Raises a `StoreError` if
    it cannot be read, or is that of another head.
    """
    from minorloop_head.procedures.calibration import HeadCalibration

    path = store / _SWEPT
    if not path.exists():
        return None
    try:
        content = msgspec.json.decode(path.read_bytes())
        of = content.pop("serial", serial)  # earlier versions wrote none
        view = HeadCalibration.from_dict(content)
    except (ValueError, AttributeError) as error:
        raise StoreError(
            f"{path} is no calibration of a camera ({error}); remove the folder to begin anew"
        ) from error
    if of != serial:
        raise StoreError(
            f"{path} is of head {of!r}, and the head here is {serial!r}; give --store the folder "
            "of this head, or a new one"
        )
    return view


def swept_view(store: Path, head: SeenHead, highest: float, serial: str) -> HeadCalibration | None:
    """Return the calibration of a head corrected by a sweep, which is kept beside its runs.

    The sweep is carried out once: runs of one folder have the same calibration. Returns None for
    runs that began without a sweep.

    Raises a `StoreError` as `kept_view` does; a `SignalError` as `SeenHead.survey` does.

    Parameters
    ----------
    store : Path
        Folder of the runs.
    head : SeenHead
        Cold.
    highest : float
        Largest current, in A.
    serial : str
        Serial number of the head.
    """
    from minorloop_head.procedures.seen_angles import SWEEP_SECONDS

    kept = kept_view(store, serial)
    if kept is not None:
        return kept
    if any(store.glob("*.sqlite")):
        typer.echo(
            f"the calibration of the camera is not corrected: the runs in {store} began without",
            err=True,
        )
        return None
    typer.echo(
        f"turning both axes slowly up and down for {as_duration(SWEEP_SECONDS)}: the pictures "
        "correct the calibration of the camera",
        err=True,
    )
    view = head.survey(highest)
    write_atomically(store / _SWEPT, msgspec.json.encode({"serial": serial, **view.to_dict()}))
    return view


@contextmanager
def seen_head(
    address: str,
    camera: str | None,
    view: HeadCalibration | None,
    *,
    specimen: int | None,
    seed: int,
    cold: npt.ArrayLike = (0.0, 0.0),
    check: Callable[[Actuator], object] = lambda plant: None,
) -> Iterator[SeenHead]:
    """Yield the head at an address with the angles of its camera; close both at the end.

    Raises a `ParameterError` if there is no calibration, no camera, or one for the simulated pipe,
    which has its own.

    Parameters
    ----------
    address : str
        Of the actuator.
    camera : str, optional
        Address of its camera; none for the simulated pipe, which has one.
    view : HeadCalibration, optional
        Of the camera; without it the simulated pipe knows its own.
    specimen, seed : int
        Of a simulated head.
    cold : (2,) array_like
        Pan and tilt of the cold head in degrees.
    check : callable
        Refuses an actuator before its head waits.
    """
    from minorloop_head.procedures.seen_angles import SeenHead

    if is_pipe(address):
        if camera is not None:
            raise ParameterError(f"{address} has a camera of its own; leave --camera out")
        from minorloop_head.console.plant import open_plant, open_tip
        from minorloop_head.twins.rig import Rig, RigWires, SimulatedTip

        rig = open_plant(address, specimen=specimen, seed=seed)
        assert isinstance(rig, Rig)
        tip, known = open_tip(address, specimen=specimen, seed=seed, scale=_TIP_SCALE)
        assert isinstance(tip, SimulatedTip)
        wires = RigWires(rig, tip)
        plant = cast("Actuator", wires)
        check(plant)
        yield SeenHead(
            plant,
            wires.frame,
            view or known,
            expose=tip.expose,
            every=_EVERY,
            cold=cold,
            waits=_say_waiting,
        )
        return
    if camera is None:
        raise ParameterError("give the address of the camera with --camera, such as camera:0")
    if view is None:
        raise ParameterError(
            "the file of the head has no calibration of the camera; calibrate it with minorloop "
            "head calibrate first"
        )
    from minorloop.lab.drivers.bench import WallClock
    from minorloop_head.vision.video import LiveCamera

    live = LiveCamera(camera, _PATIENCE)
    try:
        with _common.connected(address) as plant:
            check(plant)
            _say_unused(plant)
            yield SeenHead(
                plant, live.frame, view, clock=WallClock(), cold=cold, waits=_say_waiting
            )
    finally:
        live.close()


def _say_unused(plant: Actuator) -> None:
    """Say that sensors of an actuator are not used beside the camera, if it has any."""
    if plant.outputs:
        sensors = ", ".join(str(channel) for channel in plant.outputs)
        typer.echo(
            f"the camera gives the angles; the sensors of the actuator, {sensors}, are not used",
            err=True,
        )


def _say_waiting() -> None:
    typer.echo(
        "waiting until the head without current stands still: its angles are counted from there",
        err=True,
    )
