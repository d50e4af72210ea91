"""Identification of the head at an address, which can be continued in the folder of its runs."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from minorloop.connect import is_simulated
from minorloop.errors import OutputError, ParameterError, StoreError
from minorloop.files import PathLike, check_writable, write_atomically
from minorloop.lab.run import run
from minorloop.values import as_duration
from minorloop_head.inspection.heads import HeadAddress, opened_head
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import HeadFile, read_head, save_head
from minorloop_head.procedures.identify import CarryOut, HeadExcitation, HeadMeasurement, Told
from minorloop_head.procedures.seen_angles import SWEEP_SECONDS

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator
    from minorloop_head.procedures.seen_angles import SeenHead

_USUAL = HeadExcitation()
_SWEPT = "camera.json"
"""Calibration of a camera after the sweep, in the folder of the runs."""


def identify_head(
    address: HeadAddress,
    store: PathLike,
    head: PathLike,
    excitation: HeadExcitation = _USUAL,
    *,
    serial: str | None = None,
    force: bool = False,
    told: Told = lambda said: None,
    carry_out: CarryOut = lambda plant, store: run(plant, store.plan, store),
) -> HeadFile:
    """Measure both wires of a head, identify and check them, and write the file of the head.

    After an interruption the same call continues. It takes some hours with a real head.

    Parameters
    ----------
    address : HeadAddress
    store : path
        Folder of the runs; those in it are continued.
    head : path
        File to write. If it exists, it keeps its calibration.
    excitation : HeadExcitation
        Inputs.
    serial : str, optional
        Serial number of the head, if the actuator does not know it.
    force : bool
        Whether wires in the file are replaced.
    told : callable
        Takes a sentence on each step.
    carry_out : callable
        Carries out the rest of a run.

    Raises
    ------
    OutputError
        If the file of the head cannot be written, or has wires that are not to be replaced.
    ParameterError
        If there is no head at the address, or not that of the file, or its serial number is not
        known.
    StoreError
        If the folder has runs of another head or other inputs.
    SignalError
        If a wire does not move, or its records cannot be used.
    """
    store, head = Path(store), Path(head)
    if store.exists() and not store.is_dir():
        raise OutputError(f"--store is {store}, a file; give the name of a folder")
    before = _file_before(head, serial, force=force)
    view = None if before is None or address.in_pipe else before.calibration

    def numbered(plant: Actuator) -> str:
        number = _serial(plant, serial)
        if before is not None:
            replace(before, identified=None).check_fits(number, head)
        if address.by_camera:
            kept_view(store, number)
        return number

    def connected(seed: int) -> Any:
        return opened_head(replace(address, seed=seed), view, check=numbered, told=told)

    setup = {
        "address": address.actuator,
        "specimen": address.specimen,
        "seed": address.seed,
        "options": {"noise": address.noise},
    }
    simulated = address.in_pipe or is_simulated(address.actuator)
    measurement = HeadMeasurement(store, setup, excitation, connected, carry_out, simulated)
    left = measurement.left()
    try:
        with connected(address.seed) as plant:
            number = numbered(plant)
            begins = _runs_left(left, excitation.hold, told)
            store.mkdir(parents=True, exist_ok=True)
            if address.by_camera:
                view = swept_view(store, plant, excitation.highest, number, told) or view
    except KeyboardInterrupt:
        told(_kept_in(store, seen=address.by_camera))
        raise
    wires = replace(measurement, told=begins).identified()
    found = replace(before or HeadFile(serial=number), identified=wires)
    if found.calibration is not None and not address.in_pipe:
        found = replace(found, calibration=view)
    found.check_fits(number, head)  # old runs may be older than the calibration
    save_head(found, head, force=True)
    return found


def _file_before(head: Path, serial: str | None, *, force: bool) -> HeadFile | None:
    """Return the content of the file of a head, None if there is none; refuse to overwrite wires.

    Errors are as of `identify_head`, whose parameters these are.
    """
    before = read_head(head) if head.exists() else None
    if serial is not None:
        replace(before or HeadFile(serial=serial), identified=None).check_fits(serial, head)
    if before is not None and before.identified is not None and not force:
        raise OutputError(
            f"{head} has wires already; --force replaces them and keeps the calibration of the "
            "camera"
        )
    check_writable(head, force=True)
    return before


def _serial(plant: Actuator, given: str | None) -> str:
    """Return the serial number of a head, by the actuator or as given."""
    known: str | None = getattr(plant, "serial", None)
    if known is None and given is None:
        raise ParameterError("the actuator has no serial number; give one with --serial")
    if known is not None and given is not None and known != given:
        raise ParameterError(f"--serial is {given!r}, and the head here is {known!r}; leave it out")
    return str(known or given)


def _runs_left(left: dict[str, int], hold: float, told: Told) -> Told:
    """Report the longest duration of all runs; return a function that reports the rest at each run.

    ``left``: number of holds that are left of each run, by its name; ``hold``: longest hold, in
    seconds.
    """
    runs, holds, began, left = len(left), sum(left.values()), time.monotonic(), dict(left)
    if left:
        told(
            f"{holds} holds in {runs} runs: at most {as_duration(holds * hold)} of the head's "
            f"time, less where the wires settle sooner than in {hold:g} s"
        )

    def begins(run: str) -> None:
        now = sum(left.values())
        number = runs - len(left) + 1
        said = f"{run}, run {number} of {runs}: {left.pop(run, 0)} holds, of {now} left in all"
        if now < holds:
            seconds = (time.monotonic() - began) * now / (holds - now)
            said += f", in about {as_duration(seconds)} if they go on as so far"
        told(said)

    return begins


def _kept_in(store: Path, *, seen: bool) -> str:
    """Return a sentence on the kept results of an interrupted identification, and how to continue.

    ``seen``: whether a camera measures the angles, so that a sweep precedes the first run. It is
    carried out without a break from the cold head.
    """
    if any(store.glob("*.sqlite")):
        return f"the runs so far are kept in {store}; the same command continues them"
    if (store / _SWEPT).exists():
        return f"only the sweep is kept in {store} so far; the same command continues"
    sweep = f" with the whole sweep of the camera, which takes {as_duration(SWEEP_SECONDS)}"
    anew = "nothing was measured yet, and nothing is kept; the same command begins anew"
    return anew + sweep * seen


def kept_view(store: Path, serial: str) -> HeadCalibration | None:
    """Return the stored calibration of a head after its sweep; None if there is none.

    ``store``: folder of the runs; ``serial``: serial number of the head. Raises a `StoreError` if
    it cannot be read, or is that of another head.
    """
    path = store / _SWEPT
    if not path.exists():
        return None
    try:
        content = msgspec.json.decode(path.read_bytes())
        of = content.pop("serial", serial)  # older files have none
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


def swept_view(
    store: Path, head: SeenHead, highest: float, serial: str, told: Told
) -> HeadCalibration | None:
    """Return the calibration of a head corrected by a sweep, which is kept beside its runs.

    The sweep is carried out once: runs of one folder have the same calibration. Returns None for
    runs that began without a sweep. Raises a `StoreError` as `kept_view` does; a `SignalError` as
    `SeenHead.survey` does.

    ``store``: folder of the runs; ``head``: cold; ``highest``: largest current, in A; ``serial``:
    serial number of the head; ``told``: takes a sentence on the sweep.
    """
    kept = kept_view(store, serial)
    if kept is not None:
        return kept
    if any(store.glob("*.sqlite")):
        told(f"the calibration of the camera is not corrected: the runs in {store} began without")
        return None
    told(
        f"turning both axes slowly up and down for {as_duration(SWEEP_SECONDS)}: the pictures "
        "correct the calibration of the camera"
    )
    view = head.survey(highest)
    write_atomically(store / _SWEPT, msgspec.json.encode({"serial": serial, **view.to_dict()}))
    return view
