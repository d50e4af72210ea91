"""The head of ``minorloop head inspect``: one of devices, or the simulated one in its pipe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from minorloop.errors import ParameterError
from minorloop_head.cli._water import GivenFilling

if TYPE_CHECKING:
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.head_file import HeadFile
    from minorloop_head.procedures.probing import Probing
    from minorloop_head.procedures.rig import InspectionRig, LogEntry

Told: TypeAlias = "Callable[[LogEntry], None]"


@dataclass(frozen=True)
class InspectedHead:
    """A head that can be opened for an inspection."""

    begun: dict[str, Any]
    """What it is, for the journal: an inspection is resumed with the same head only."""
    view: HeadCalibration | None
    """Of its camera; opening refuses a head without one."""
    opened: Callable[[Told], AbstractContextManager[InspectionRig]]
    """Opens it, given what is told of each step. The head is safe at the end of its context."""
    probing: Probing | None = None
    """Its probe; None on a head without one."""


def inspected_head(
    actuator: str,
    camera: str | None,
    head: Path | None,
    specimen: int | None,
    seed: int,
    water: GivenFilling,
) -> InspectedHead:
    """Return the head at an address.

    Parameters
    ----------
    actuator, camera : str
        Addresses. The simulated pipe has a camera of its own.
    head : path, optional
        File of the head. The simulated one is identified without it.
    specimen, seed : int
        Of the simulated head, and of its noise and its pipe.
    water : GivenFilling
        What fills the simulated pipe.

    Raises
    ------
    ParameterError
        If a device lacks its camera or file, or the simulated pipe is given a camera, or water that
        cannot be.
    """
    from minorloop_head.console.settings import PIPE, is_pipe
    from minorloop_head.procedures.head_file import read_head
    from minorloop_head.procedures.rig import rig_at

    if is_pipe(actuator):
        if camera is not None:
            raise ParameterError(f"{PIPE} has a camera of its own; leave --camera out")
        return _simulated(actuator, head, specimen, seed, water)
    if camera is None or head is None:
        raise ParameterError(
            f"--actuator {actuator} needs --camera, and --head with a file that minorloop head "
            f"identify writes; only {PIPE} needs neither"
        )
    if is_pipe(camera):
        raise ParameterError(f"--camera is {PIPE}; give it as --actuator, without --camera")
    if specimen is not None or seed or water != GivenFilling():
        raise ParameterError(
            f"--specimen, --seed, --water, --temperature, --gas and --pressure are of {PIPE}, and "
            f"--actuator is {actuator}; leave them out"
        )
    known = read_head(head)
    begun = {**_about(known), "actuator": actuator, "camera": camera}
    return InspectedHead(begun, known.calibration, partial(rig_at, actuator, camera, head))


def _about(known: HeadFile) -> dict[str, Any]:
    calibrated = known.calibrated
    return {
        "head": known.serial,
        "calibrated": None if calibrated is None else calibrated.isoformat(),
    }


def _simulated(
    address: str, file: Path | None, specimen: int | None, seed: int, water: GivenFilling
) -> InspectedHead:
    """Return the simulated head in its pipe, as the console has it."""
    from minorloop.lab.signals import ended_by_signals
    from minorloop_head.console.identified_head import head_of
    from minorloop_head.console.plant import head_at, open_plant, open_tip
    from minorloop_head.procedures.head_file import HeadFile
    from minorloop_head.procedures.probing import Probing
    from minorloop_head.procedures.rig import InspectionRig
    from minorloop_head.procedures.seen_base import SeenBase
    from minorloop_head.twins.head import Head

    filling = water.filling()
    known = None if file is None else head_at(address, specimen, file)[0]
    plant = open_plant(address, specimen=specimen, seed=seed, water=filling)
    flow = getattr(plant, "flood", None)
    tip, own = open_tip(address, specimen=specimen, seed=seed, flow=flow, water=filling)
    view = own if known is None or known.calibration is None else known.calibration
    about = _about(HeadFile(serial=Head(specimen).serial) if known is None else known)

    @contextmanager
    def opened(told: Told) -> Iterator[InspectionRig]:
        with ended_by_signals(exiting=True):
            control = (
                head_of(address, specimen) if known is None else known.control(interval=plant.tick)
            )
            try:
                yield InspectionRig(plant, tip, control, view, base=SeenBase(view), told=told)
            finally:
                plant.safe()

    options = {"specimen": specimen, "seed": seed, **water.noted()}
    probing = Probing(refused="no water" if filling.level is None else "")
    return InspectedHead({**about, "actuator": address, **options}, view, opened, probing)
