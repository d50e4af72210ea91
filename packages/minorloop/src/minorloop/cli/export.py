"""``minorloop export``: a model as C, or as a co-simulation unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.export.c99 import CSource
    from minorloop.modelfile import ModelFile

NAME = "export"
EXAMPLE = "minorloop export c model.json --out firmware --float32 --memory 32"
_FOR_C = "Options of export c"


def run(
    target: Annotated[
        str,
        typer.Argument(help="What to write: c, or fmu (FMI 2.0).", show_default=False),
    ],
    model: _common.ModelFile,
    out: Annotated[
        Path, typer.Option(help="The folder for C, or the .fmu file.", show_default=False)
    ],
    name: Annotated[
        str, typer.Option(help="Name of the files, and prefix of every name in the C.")
    ] = "minorloop",
    float32: Annotated[
        bool, typer.Option("--float32", help="Compute in single precision.", rich_help_panel=_FOR_C)
    ] = False,
    memory: Annotated[
        int | None,
        _common.whole_option(
            "Extrema of the input that the C can remember, at least 6; 32 if not given."
        ),
    ] = None,
    largest: Annotated[
        int | None,
        _common.whole_option("Most bytes of tables and one state.", panel=_FOR_C),
    ] = None,
    no_inverse: Annotated[
        bool,
        typer.Option("--no-inverse", help="Omit the inverse.", rich_help_panel=_FOR_C),
    ] = False,
    linear: Annotated[
        Path | None,
        typer.Option(
            help="JSON file of a sampled linear part: numerator, denominator (in descending "
            "powers of z), interval and delay (in seconds)."
        ),
    ] = None,
    first: Annotated[
        str | None,
        typer.Option(help="Which comes first, with --linear: operator or linear."),
    ] = None,
    firmware: Annotated[
        bool,
        typer.Option("--firmware", help="Add a sketch of firmware.", rich_help_panel=_FOR_C),
    ] = False,
    interval: Annotated[
        float | None,
        _common.seconds_option(
            "Seconds between calls of a model with dynamics; for fmu also the step recommended to "
            "simulators."
        ),
    ] = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Write a model as C99, without allocation or libraries, or as an FMU."""
    _common.check_word("export", target, ("c", "fmu"))
    if first is not None and linear is None:
        raise ParameterError("--first does nothing without --linear; leave it out")
    from minorloop import modelfile
    from minorloop.operators.preisach import Preisach

    known = modelfile.read(model)
    _common.print_warnings(known.warnings)
    operator = known.operator  # refuses what has none
    if memory is not None and not isinstance(operator, Preisach):
        raise ParameterError(
            f"--memory does nothing for a {type(operator).__name__}, whose memory has a "
            "fixed size; leave it out"
        )
    if linear is not None:
        known = _with_linear(known, model, linear, first or "operator")
    options: dict[str, Any] = {"name": name, "interval": interval, "force": force}
    options |= {} if memory is None else {"memory": memory}
    for_c = {
        "float32": float32,
        "largest": largest,
        "firmware": firmware,
        "inverse": not no_inverse,
    }
    if target == "c":
        from minorloop.export.c99 import export_c

        with _common.working("writing C"):
            code = export_c(known, out, **{**options, **for_c})
        _show(code, out, known, as_json)
        return
    from minorloop.export.fmu import export_fmu

    given = {"float32": float32, "largest": largest, "firmware": firmware, "no-inverse": no_inverse}
    _common.refuse_given({each: value or None for each, value in given.items()}, "is not for fmu")
    _common.check_outputs([out], inputs=[model], force=force)
    with _common.working("compiling the unit"):
        unit = export_fmu(known, out, **options)
    if as_json:
        _common.print_json({"file": str(out), "bytes": out.stat().st_size, "platforms": unit})
        return
    typer.echo(f"co-simulation unit for {', '.join(unit)} written to {out}")
    _say_what_is_missing(known, "unit")


def _show(code: CSource, out: Path, known: ModelFile, as_json: bool) -> None:
    names = ("table_bytes", "state_bytes", "memory", "drop_error", "input_error")
    figures = {name: getattr(code, name) for name in names}
    if as_json:
        _common.print_json({"folder": str(out), "files": list(code.files), **figures})
        return
    rows = [
        ("files", ", ".join(code.files)),
        ("constant tables", f"{code.table_bytes} bytes"),
        ("one state", f"{code.state_bytes} bytes"),
        ("extrema remembered", f"{code.memory}"),
        (
            "error of dropping one pair, at most",
            f"{code.drop_error:.3g} {known.output.unit}".rstrip(),
        ),
    ]
    if code.input_error:
        rows.append(("error of rounding an input, at most", f"{code.input_error:.2g} of the range"))
    _common.print_table(("", ""), rows, f"{known.output} against {known.input}, written to {out}")
    _say_what_is_missing(known, "C")
    test = next(name for name in code.files if name.endswith("_selftest.c"))
    source = test.replace("_selftest", "")
    typer.echo(f"next: cd {out} && cc -std=c99 {source} {test} -lm -o selftest && ./selftest")


def _say_what_is_missing(known: ModelFile, what: str) -> None:
    """Print what of the model an export does not carry."""
    from minorloop.dynamics.cascade import Cascade
    from minorloop.operators.after_effect import AfterEffect

    if known.lag:
        typer.echo(
            f"the output follows the model by {known.lag} samples; this lag is not in the {what}"
        )
    if isinstance(known.model, AfterEffect) and what != "C":
        typer.echo(
            f"the output changes with time; this is not in the {what}, which settles at once"
        )
    if isinstance(known.model, Cascade) and known.model.creep is not None:
        typer.echo(f"the output creeps after the model; this creep is not in the {what}")


def _with_linear(known: ModelFile, path: Path, file: Path, first: Any) -> ModelFile:
    """Return a model with the linear part of a file."""
    from minorloop.dynamics.cascade import Cascade
    from minorloop.modelfile import read_linear

    operator: Any = known.operator
    if isinstance(known.model, Cascade):
        raise ParameterError(f"{path} has dynamics of its own; leave --linear out")
    return replace(known, model=Cascade(operator, read_linear(file), first))
