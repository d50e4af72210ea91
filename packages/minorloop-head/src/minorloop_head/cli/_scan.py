"""``minorloop head scan``: flaws in third-party A-scans."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError
from minorloop.values import parsed

_UNITS = {
    "rate": ("rate", 1e6),
    "start": ("start", 1e-6),
    "step": ("x_step", 1e-3),
    "y_step": ("y_step", 1e-3),
    "low": ("low", 1e6),
    "high": ("high", 1e6),
    "disc": ("disc", 1e-3),
}
"""Keys of ``--given``: the field of a scan, and its unit in SI."""


_Scan = Annotated[
    Path,
    typer.Argument(
        show_default=False, help="A-scans: a MATLAB, HDF5, NDE, NPZ or CSV file, of any origin."
    ),
]
_Out = Annotated[
    Path | None,
    typer.Option(
        help="New or empty folder for findings.csv, findings.json and report.html, with the "
        "B-scan before and after focusing."
    ),
]
_Speeds = Annotated[
    str | None,
    typer.Option(metavar="M/S,...", help="Speeds of sound in the layers from the probe on."),
]
_Thicknesses = Annotated[
    str | None,
    typer.Option(metavar="MM,...", help="Thicknesses of the layers, to be compared."),
]
_Given = Annotated[
    str,
    typer.Option(
        metavar="KEY=VALUE,...",
        help="Values that replace those of the file: sampling rate in MHz; start, the time of "
        "the first sample in us, the pulse being at 0; step between A-scans along x, and "
        "y-step, in mm; low and high, the ends of the band of the pulse in MHz; disc, the "
        "diameter of the probe in mm.",
    ),
]
_Field = Annotated[
    list[str] | None,
    typer.Option(
        metavar="FIELD=NAME",
        help="Name in the file of a field with an unusual name, such as traces=rf or "
        "rate=f_ADC; may be repeated.",
    ),
]


def scan(
    file: _Scan,
    out: _Out = None,
    speeds: _Speeds = None,
    thicknesses: _Thicknesses = None,
    given: _Given = "",
    field: _Field = None,
    as_json: _common.Json = False,
) -> None:
    """Find surfaces and flaws in a third-party scan, line or raster.

    Options replace values of the file. Tilt is measured and compensated. Echoes below surfaces are
    focused through the layers, so that holes are drawn with their true width.
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

    values: dict[str, Any] = _in_si(given)
    for name, text, unit in (("speeds", speeds, 1.0), ("thicknesses", thicknesses, 1e-3)):
        if text is not None:
            form = "numbers, one for each layer"
            values[name] = [unit * v for v in _common.numbers(name, text, range(1, 21), form)]
    names = dict(_pair(each) for each in field or ())
    with _common.working(f"reading {file}") as now:
        recorded = read_scan(file, names=names, **values)
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


def _in_si(text: str) -> dict[str, float]:
    """Return the fields of a scan in SI units by ``--given``."""
    found = {}
    for key, value in parsed(text).options.items():
        if key not in _UNITS:
            raise ParameterError(f"--given has no {key!r}; it has {', '.join(_UNITS)}")
        name, unit = _UNITS[key]
        found[name] = unit * _common.numbers("given", value, (1,), f"a number for {key}")[0]
    return found


def _pair(text: str) -> tuple[str, str]:
    field, equals, name = text.partition("=")
    if not (field and equals and name):
        raise ParameterError(f"--field is {text!r}; give FIELD=NAME, such as traces=rf")
    return field, name
