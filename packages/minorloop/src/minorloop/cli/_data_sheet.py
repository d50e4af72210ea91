"""Models from a data sheet on the command line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.identification.data_sheet import DataSheetModel

_ALLOWED = ("from_loop", "field", "input", "output", "save", "force", "as_json")


@dataclass(frozen=True)
class DataSheet:
    """Coercivity, remanence and saturation of a loop, and its largest input."""

    loop: tuple[float, float, float]
    field: float | None
    input: str
    output: str


def write_model(
    context: typer.Context, sheet: DataSheet, save: Path | None, force: bool, as_json: bool
) -> None:
    """Make the model, write it and print what it is."""
    from minorloop import modelfile
    from minorloop.identification.data_sheet import from_loop

    _refuse_others(context)
    _common.check_outputs([save], inputs=[], force=force)
    with _common.working("drawing ridges with this loop"):
        found = from_loop(*sheet.loop, sheet.field)

    def write() -> None:
        assert save is not None
        modelfile.save(found, save, input=sheet.input, output=sheet.output, force=force)
        if not as_json:
            typer.echo(f"model written to {save}")

    steps: list[Callable[[], None]] = [] if save is None else [write]
    _common.do_all([*steps, partial(_show, found, sheet, as_json)])


def _show(found: DataSheetModel, sheet: DataSheet, as_json: bool) -> None:
    if as_json:
        figures = {"ridges": len(found.ridges), "warnings": found.warnings}
        _common.print_json({**found.scores, **figures, "range": list(found.model.range)})
        return
    title = f"{sheet.output} against {sheet.input}: Preisach, {found.model.bands} bands"
    _common.print_table(("", ""), found.summary(), title)
    _common.print_advice(found.warnings)


def numbers_of(texts: tuple[str, str, str]) -> tuple[float, float, float]:
    """Return the three numbers of ``--from-loop``."""
    try:
        hc, br, bmax = (float(text) for text in texts)
    except ValueError:
        given = " ".join(texts)
        raise ParameterError(f"--from-loop is {given!r}; give three numbers, HC BR BMAX") from None
    return hc, br, bmax


def _refuse_others(context: typer.Context) -> None:
    """Refuse arguments and options about records."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        given = source is not None and source.name == "COMMANDLINE"
        if given and parameter.name not in _ALLOWED:
            what = "a file" if parameter.name == "file" else parameter.opts[0]
            raise ParameterError(f"{what} cannot be combined with --from-loop; leave it out")
