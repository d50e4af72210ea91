"""``minorloop export``: a model as C, or as a co-simulation unit."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError
from minorloop.values import called, parsed

if TYPE_CHECKING:
    from minorloop.export.c99 import CSource
    from minorloop.modelfile import ModelFile

NAME = "export"
EXAMPLE = "minorloop export c:float32=yes,memory=32 model.json --out firmware"


_Target = Annotated[
    str,
    typer.Argument(
        show_default=False,
        help="c, or fmu (FMI 2.0); with options as c:KEY=VALUE,... Of both: name (prefix of "
        "every name, minorloop), memory (extrema of the input that are remembered, 32; at "
        "least 6), linear (JSON file of a linear part: numerator, denominator, in descending "
        "powers of z, interval and delay, in seconds) and first (operator or linear). Of c: "
        "float32=yes (single precision), inverse=no, largest (most bytes of tables and one "
        "state), firmware=yes (a sketch of it).",
    ),
]
_Interval = Annotated[
    float | None,
    _common.seconds_option(
        "Seconds between calls of a model with dynamics; for fmu also the step recommended to "
        "simulators."
    ),
]


def run(
    target: _Target,
    model: _common.ModelFile,
    out: Annotated[
        Path, typer.Option(help="The folder for C, or the .fmu file.", show_default=False)
    ],
    interval: _Interval = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Write a model as C99, without allocation or libraries, or as an FMU."""
    value = parsed(target)
    options: dict[str, Any] = dict(value.options)
    _common.check_word("export", value.kind, ("c", "fmu"))
    from minorloop import modelfile
    from minorloop.operators.preisach import Preisach

    known = modelfile.read(model)
    _common.print_warnings(known.warnings)
    operator = known.operator  # refuses what has none
    if "memory" in options and not isinstance(operator, Preisach):
        raise ParameterError(
            f"memory does nothing for a {type(operator).__name__}, whose memory has a fixed size; "
            "leave it out"
        )
    linear, first = options.pop("linear", None), options.pop("first", "")
    if linear is not None:
        known = known.with_linear(linear, first or "operator")
    elif first:
        raise ParameterError("first does nothing without linear; leave it out")
    if value.kind == "c":
        from minorloop.export.c99 import source

        with _common.working("writing C"):
            code = called(source, "export c", options, model=known, interval=interval)
            code.write(out, force=force)
        _common.finish(as_json, partial(_figures, code, out), partial(_show, code, out, known))
        return
    from minorloop.export.fmu import export_fmu

    _common.check_outputs([out], inputs=[model], force=force)
    others: dict[str, Any] = {"model": known, "path": out, "interval": interval, "force": force}
    named = {"input": known.input, "output": known.output}
    with _common.working("compiling the unit"):
        unit = called(export_fmu, "export fmu", options, **others, **named)
    content = {"file": str(out), "bytes": out.stat().st_size, "platforms": unit}
    said = f"co-simulation unit for {', '.join(unit)} written to {out}"
    _common.finish(as_json, lambda: content, lambda: typer.echo(said))
    if not as_json:
        for sentence in known.left_out("unit"):
            typer.echo(sentence)


def _figures(code: CSource, out: Path) -> dict[str, Any]:
    names = ("table_bytes", "state_bytes", "memory", "drop_error", "input_error")
    figures = {name: getattr(code, name) for name in names}
    return {"folder": str(out), "files": list(code.files), **figures}


def _show(code: CSource, out: Path, known: ModelFile) -> None:
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
    for sentence in known.left_out("C"):
        typer.echo(sentence)
    test = next(name for name in code.files if name.endswith("_selftest.c"))
    source = test.replace("_selftest", "")
    typer.echo(f"next: cd {out} && cc -std=c99 {source} {test} -lm -o selftest && ./selftest")
