"""``minorloop devices``: what can be measured and driven here, and whether it answers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._completion import addresses, one_of
from minorloop.errors import MinorloopError, SafetyError

if TYPE_CHECKING:
    from minorloop.lab.actuator import Actuator

NAME = "devices"
EXAMPLE = "minorloop devices bench:head.toml"
_CAMERAS = "/dev/video*"
_FILES = ".toml", ".json"
"""Endings of bench files, which may be given without ``bench:``."""
_FAILED = 1
_UNSAFE = 3
_FIRST_PICTURE = 5.0
"""Seconds in which a camera must give its first picture."""


@dataclass(frozen=True)
class _Row:
    """A line of the table."""

    address: str
    what: str
    state: str
    error: bool = False


def run(
    address: Annotated[
        list[str] | None,
        typer.Argument(
            show_default=False,
            help="Actuators and cameras to open, make safe and read; what there is without any.",
            autocompletion=one_of(addresses),
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """List what is there; or open actuators and cameras, make them safe, and read each channel."""
    rows = list(_present()) if not address else [row for each in address for row in _probed(each)]
    if as_json:
        _common.print_json({"devices": [asdict(row) for row in rows]})
    else:
        _common.print_table(
            ("address", "what", "state"), [(row.address, row.what, row.state) for row in rows]
        )
    if any(row.error for row in rows):
        raise typer.Exit(_UNSAFE if any("by hand" in row.state for row in rows) else _FAILED)


def _present() -> Iterator[_Row]:
    """Yield what there is: addresses, drivers with their devices, and cameras."""
    from minorloop.connect import addresses
    from minorloop.lab.drivers.bench_file import DRIVERS
    from minorloop.lab.registry import loaded, registered

    for each in addresses():
        named = each.startswith("twin:")
        yield _Row(each, "actuator", "simulated" if named else "give it with a name to probe it")
    yield _Row(
        "twin:pipe", "head with camera and probe, for minorloop head and console", "simulated"
    )
    for name, point in sorted(registered(DRIVERS).items()):
        driver = loaded(point, name)
        library, extra = getattr(driver, "NEEDS", (None, None))
        if library is not None and find_spec(library) is None:
            yield _Row(name, "driver", f"pip install 'minorloop[{extra}]' brings {library}")
            continue
        yield _Row(name, "driver", "installed")
        for device in getattr(driver, "found", list)():
            yield _Row(device, f"device for {name}", "there; not opened")
    for path in sorted(Path("/").glob(_CAMERAS.lstrip("/"))):
        yield _Row(f"camera:{path}", "camera", "there; not opened")


def _probed(address: str) -> Iterator[_Row]:
    """Yield the channels of an actuator, or the picture of a camera, or why there are none."""
    if Path(address).suffix in _FILES and ":" not in address:
        address = f"bench:{address}"
    if address.startswith("camera:") or Path(address).exists():
        yield _camera(address)
        return
    rows: list[_Row] = []
    try:
        with _common.connected(address) as plant:
            rows = list(_channels(address, plant))
            plant.safe()
    except MinorloopError as error:
        said = str(error)
        if isinstance(error, SafetyError) and "by hand" not in said:
            said = f"the actuator may still be on, switch it off by hand: {said}"
        yield _Row(address, "actuator", said, error=True)
        return
    yield from rows


def _channels(address: str, plant: Actuator) -> Iterator[_Row]:
    """Yield the channels of an actuator, at rest."""
    import numpy as np

    plant.safe()
    rest = np.zeros(len(plant.inputs))
    rest[:] = getattr(plant, "rest", [min(max(0.0, c.low), c.high) for c in plant.inputs])
    y = np.atleast_1d(plant.exchange(rest if rest.size > 1 else float(rest[0])))
    serial = getattr(plant, "serial", None)
    if serial is not None:
        yield _Row(address, "serial number", str(serial))
    for channel, value in zip(plant.inputs, rest, strict=True):
        limits = f"{channel.low:g} to {channel.high:g}"
        if np.isfinite(channel.rate):
            limits += f", {channel.rate:g} a second"
        yield _Row(address, f"input {channel}, {limits}", f"safe at {value:g}")
    for channel, value in zip(plant.outputs, y, strict=True):
        yield _Row(address, f"output {channel}", f"reads {value:.6g}")
    for name in getattr(plant, "lines", ()):
        yield _Row(address, f"line {name}", "at rest")


def _camera(address: str) -> _Row:
    """Return the size of a picture of a camera, a video or a folder, or why there is none."""
    from minorloop.head.vision.video import LiveCamera

    try:
        camera = LiveCamera(address, patience=_FIRST_PICTURE)
        try:
            height, width = camera.frame().image.shape
            timed = "by the camera" if camera.timed_by_camera else "when they arrive"
        finally:
            camera.close()
    except MinorloopError as error:
        return _Row(address, "camera", str(error), error=True)
    return _Row(address, "camera", f"pictures of {width} by {height} pixels, timed {timed}")
