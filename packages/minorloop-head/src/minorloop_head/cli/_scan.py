"""``minorloop head scan``: flaws in A-scans that somebody else recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

_UNITS = {"rate": 1e6, "start": 1e-6, "thicknesses": 1e-3, "disc": 1e-3}


def scan(
    file: Annotated[
        Path,
        typer.Argument(
            show_default=False, help="A-scans: a MATLAB, HDF5, NDE, NPZ or CSV file, of any origin."
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="New or empty folder for findings.csv, findings.json and report.html, with the "
            "B-scan before and after focusing."
        ),
    ] = None,
    speeds: Annotated[
        str | None,
        typer.Option(metavar="M/S,...", help="Speeds of sound in the layers from the probe on."),
    ] = None,
    thicknesses: Annotated[
        str | None,
        typer.Option(metavar="MM,...", help="Thicknesses of the layers, to be compared."),
    ] = None,
    step: Annotated[
        str | None, typer.Option(metavar="MM[,MM]", help="Steps between A-scans along x and y.")
    ] = None,
    rate: Annotated[float | None, _common.number_option("Sampling rate in MHz.")] = None,
    start: Annotated[
        float | None, _common.number_option("Time of the first sample in us, the pulse being at 0.")
    ] = None,
    band: Annotated[
        str | None,
        typer.Option(metavar="MHZ,MHZ", help="Lowest and highest frequency of the pulse."),
    ] = None,
    disc: Annotated[float | None, _common.number_option("Diameter of the disc in mm.")] = None,
    field: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FIELD=NAME",
            help="How the file calls a field whose name is not known, such as traces=rf or "
            "rate=f_ADC; may be repeated.",
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Find surfaces and flaws in a scan that somebody else recorded, line or raster.

    Options replace what the file says. Tilt is found and compensated, and what is below surfaces
    is focused through the layers, so that a hole is drawn as narrow as it is.
    """
    from minorloop_head.inspection.scan_report import (
        COLUMNS,
        keep_scan,
        scan_cells,
        scan_content,
        scan_summary,
    )
    from minorloop_head.ultrasound.recorded_scan import read_scan
    from minorloop_head.ultrasound.scan_flaws import scan_flaws

    values: dict[str, Any] = {"rate": rate, "start": start, "disc": disc}
    some = range(1, 21)
    for name, text in (("speeds", speeds), ("thicknesses", thicknesses)):
        values[name] = text and _common.numbers(name, text, some, "numbers, one for each layer")
    if step is not None:
        steps = _common.numbers("step", step, (1, 2), "one or two numbers in mm")
        values |= {f"{axis}_step": 1e-3 * each for axis, each in zip("xy", steps, strict=False)}
    if band is not None:
        edges = _common.numbers("band", band, (2,), "two numbers in MHz")
        values |= dict(zip(("low", "high"), (1e6 * each for each in edges), strict=True))
    given = {name: value for name, value in values.items() if value is not None}
    for name in _UNITS.keys() & given:
        given[name] = [_UNITS[name] * v for v in given[name]] if name == "thicknesses" else (
            _UNITS[name] * given[name]
        )  # fmt: skip
    names = dict(_pair(each) for each in field or ())
    with _common.working(f"reading {file}") as now:
        recorded = read_scan(file, names=names, **given)
        now("focusing")
        found = scan_flaws(recorded)
        content = scan_content(found, str(file))
        if out is not None:
            content = keep_scan(found, out, str(file))
    if as_json:
        _common.print_json(content)
        return
    if cells := scan_cells(content):
        _common.print_table(COLUMNS, cells)
    typer.echo(scan_summary(content))
    _common.print_advice(content["advice"])
    if out is not None:
        typer.echo(f"kept in {out}")


def _pair(text: str) -> tuple[str, str]:
    field, equals, name = text.partition("=")
    if not (field and equals and name):
        raise ParameterError(f"--field is {text!r}; give FIELD=NAME, such as traces=rf")
    return field, name
