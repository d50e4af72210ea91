"""``minorloop head``: identify the wires of a head, and drive it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli.run import carry_out_levels
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.head.procedures.head_file import HeadFile
    from minorloop.lab.actuator import Actuator

NAME = "head"
HELP = "Identify the two wires of a catheter head once, and drive it by the file of it."
app = typer.Typer(help=HELP)

_AGAIN = "continue with the same command"
_File = Annotated[
    Path, typer.Option(show_default=False, help="File of the head, as head identify writes it.")
]


@app.command(
    epilog="Example: minorloop head identify --actuator twin:head --store runs --head head.json"
)
def identify(
    actuator: _common.Address,
    store: Annotated[
        Path, typer.Option(show_default=False, help="Folder of the runs; they are continued.")
    ],
    head: Annotated[
        Path,
        typer.Option(
            show_default=False,
            help="File to write. If it exists, it keeps its calibration, and its wires are "
            "replaced with --force.",
        ),
    ],
    serial: Annotated[
        str | None,
        typer.Option(help="Serial number of the head; only if the actuator does not know it."),
    ] = None,
    highest: Annotated[float, _common.number_option("Largest current, in A.")] = 0.4,
    bands: Annotated[int, _common.whole_option("Bands of the model of each wire.")] = 12,
    hold: Annotated[float, _common.number_option("Longest hold of a current, in s.")] = 40.0,
    specimen: _common.Specimen = None,
    noise: _common.Noise = 0.0,
    seed: _common.Seed = 0,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Measure both wires of a head, identify and check them; the same command continues it."""
    from minorloop.head.procedures.head_file import HeadFile, read_head, save_head
    from minorloop.head.procedures.identify import HeadExcitation, HeadMeasurement, check_head

    before = read_head(head) if head.exists() else None
    replaces = before is not None and before.identified is not None
    _common.check_outputs([head], force=force or not replaces)
    opened = partial(_common.connected, actuator, specimen=specimen, noise=noise)
    with opened(seed=seed) as plant:
        check_head(plant)
        serial = _serial(plant, serial)
    if before is not None:
        replace(before, identified=None).check_fits(serial, head)
    store.mkdir(parents=True, exist_ok=True)
    setup = {"address": actuator, "specimen": specimen, "seed": seed, "options": {"noise": noise}}
    measurement = HeadMeasurement(
        store,
        setup,
        HeadExcitation(highest=highest, bands=bands, hold=hold),
        lambda seed: opened(seed=seed),
        lambda plant, opened: carry_out_levels(plant, opened, None, None, again=_AGAIN),
    )
    found = replace(before or HeadFile(serial=serial), identified=measurement.identified())
    found.check_fits(serial, head)  # old runs may be older than the calibration
    save_head(found, head, force=True)
    _show(found, head, as_json)


def _serial(plant: Actuator, given: str | None) -> str:
    """Return the serial number of a head, by the actuator or as given."""
    known: str | None = getattr(plant, "serial", None)
    if known is None and given is None:
        raise ParameterError("the actuator has no serial number; give one with --serial")
    if known is not None and given is not None and known != given:
        raise ParameterError(f"--serial is {given!r}, and the head here is {known!r}; leave it out")
    return str(known or given)


def _show(found: HeadFile, path: Path, as_json: bool) -> None:
    known = found.identified
    assert known is not None
    errors = {
        axis: {"rms_deg": each.rms, "largest_deg": each.largest}
        for axis, each in zip(("pan", "tilt"), known.check, strict=True)
    }
    lags = [wire.lag for wire in known.wires]
    if as_json:
        content: dict[str, Any] = {"head": str(path), "serial": found.serial, "check": errors}
        _common.print_json(
            {**content, "lag_s": lags, "coupling": known.coupling, "advice": known.advice}
        )
        return
    rows = [
        (axis, f"{lag:.3g}", f"{each['rms_deg']:.2f}", f"{each['largest_deg']:.2f}")
        for (axis, each), lag in zip(errors.items(), lags, strict=True)
    ]
    columns = ("axis", "lag [s]", "check, rms [deg]", "largest [deg]")
    _common.print_table(columns, rows, f"head {found.serial}, checked on random inputs")
    _common.print_advice(known.advice)
    typer.echo(f"kept in {path}; next: minorloop head drive, or minorloop console --head {path}")


@app.command(
    epilog="Example: minorloop head drive targets.csv --head head.json --actuator twin:head"
)
def drive(
    file: _common.DataFile,
    head: _File,
    actuator: _common.Address,
    pan: Annotated[str, typer.Option(help="Column of the wanted pan, in deg.")] = "pan",
    tilt: Annotated[str, typer.Option(help="Column of the wanted tilt, in deg.")] = "tilt",
    hold: Annotated[float, _common.number_option("Seconds for each target.")] = 8.0,
    specimen: _common.Specimen = None,
    noise: _common.Noise = 0.0,
    seed: _common.Seed = 0,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Bring both axes of a head to targets under control, one row after the other."""
    import numpy as np

    from minorloop.head.procedures.head_file import read_head
    from minorloop.head.procedures.identify import check_head
    from minorloop.head.procedures.steer import steer

    _common.check_outputs([save], inputs=[file, head], force=force)
    known = read_head(head)
    columns = [_common.read_column(file, name, "deg") for name in (pan, tilt)]
    with _common.connected(actuator, specimen=specimen, noise=noise, seed=seed) as plant:
        check_head(plant)
        known.check_fits(getattr(plant, "serial", None), head)
        result = steer(plant, known.control(interval=plant.tick), np.column_stack(columns), hold)
    if save is not None:
        table = {"time [s]": result.t}
        for k, axis in enumerate(("pan", "tilt")):
            table |= {f"wanted {axis} [deg]": result.wanted[:, k]}
            table |= {f"{axis} [deg]": result.read[:, k], f"{axis} [A]": result.current[:, k]}
        _common.write_csv(save, table, force=force)
    error = result.reached - result.targets
    if as_json:
        content = {"targets_deg": result.targets, "reached_deg": result.reached}
        _common.print_json({**content, "rms_deg": np.sqrt(np.nanmean(error**2))})
        return
    rows = [
        tuple(f"{value:.2f}" for value in (*wanted, *reached))
        for wanted, reached in zip(result.targets, result.reached, strict=True)
    ]
    columns_shown = ("pan wanted", "tilt wanted", "pan", "tilt")
    _common.print_table(columns_shown, rows, "degrees at the end of each hold")
    typer.echo(f"error {float(np.sqrt(np.nanmean(error**2))):.2f} deg rms")
