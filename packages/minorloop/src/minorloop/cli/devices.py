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
EXAMPLE = "minorloop devices bench:bench.toml"
_FILES = ".toml", ".json"
"""Endings of bench files, which may be given without ``bench:``."""
_FAILED = 1
_UNSAFE = 3
OTHERS = "minorloop.devices"
"""Entry points of devices that are no actuators: modules with ``found()``, which yields rows, and
``probed(address)``, which returns a row, or None for an address of another kind."""


@dataclass(frozen=True)
class DeviceRow:
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
            help="Actuators and others to open, make safe and read; what there is without any.",
            autocompletion=one_of(addresses),
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """List what is there; or open actuators and others, make them safe, and read each channel."""
    rows = list(_present()) if not address else [row for each in address for row in _probed(each)]
    if as_json:
        _common.print_json({"devices": [asdict(row) for row in rows]})
    else:
        _common.print_table(
            ("address", "what", "state"), [(row.address, row.what, row.state) for row in rows]
        )
    if any(row.error for row in rows):
        raise typer.Exit(_UNSAFE if any("by hand" in row.state for row in rows) else _FAILED)


def _present() -> Iterator[DeviceRow]:
    """Yield what there is: addresses, drivers with their devices, and devices of other kinds."""
    from minorloop.connect import addresses
    from minorloop.lab.drivers.bench_file import DRIVERS
    from minorloop.registry import loaded, registered

    for each in addresses():
        named = each.startswith("twin:")
        yield DeviceRow(
            each, "actuator", "simulated" if named else "give it with a name to probe it"
        )
    for name, point in sorted(registered(DRIVERS).items()):
        driver = loaded(point, name)
        library, extra = getattr(driver, "NEEDS", (None, None))
        if library is not None and find_spec(library) is None:
            yield DeviceRow(name, "driver", f"pip install 'minorloop[{extra}]' brings {library}")
            continue
        yield DeviceRow(name, "driver", "installed")
        for device in getattr(driver, "found", list)():
            yield DeviceRow(device, f"device for {name}", "there; not opened")
    for name, point in registered(OTHERS).items():
        yield from loaded(point, name).found()


def _probed(address: str) -> Iterator[DeviceRow]:
    """Yield the channels of an actuator, or another device, or why there are none."""
    from minorloop.registry import loaded, registered

    if Path(address).suffix in _FILES and ":" not in address:
        address = f"bench:{address}"
    for name, point in registered(OTHERS).items():
        if (row := loaded(point, name).probed(address)) is not None:
            yield row
            return
    rows: list[DeviceRow] = []
    try:
        with _common.connected(address) as plant:
            rows = list(_channels(address, plant))
            plant.safe()
    except MinorloopError as error:
        said = str(error)
        if isinstance(error, SafetyError) and "by hand" not in said:
            said = f"the actuator may still be on, switch it off by hand: {said}"
        yield DeviceRow(address, "actuator", said, error=True)
        return
    yield from rows


def _channels(address: str, plant: Actuator) -> Iterator[DeviceRow]:
    """Yield the channels of an actuator, at rest."""
    import numpy as np

    plant.safe()
    rest = np.zeros(len(plant.inputs))
    rest[:] = getattr(plant, "rest", [min(max(0.0, c.low), c.high) for c in plant.inputs])
    y = np.atleast_1d(plant.exchange(rest if rest.size > 1 else float(rest[0])))
    serial = getattr(plant, "serial", None)
    if serial is not None:
        yield DeviceRow(address, "serial number", str(serial))
    for channel, value in zip(plant.inputs, rest, strict=True):
        limits = f"{channel.low:g} to {channel.high:g}"
        if np.isfinite(channel.rate):
            limits += f", {channel.rate:g} a second"
        yield DeviceRow(address, f"input {channel}, {limits}", f"safe at {value:g}")
    for channel, value in zip(plant.outputs, y, strict=True):
        yield DeviceRow(address, f"output {channel}", f"reads {value:.6g}")
    for name in getattr(plant, "lines", ()):
        yield DeviceRow(address, f"line {name}", "at rest")
