"""``minorloop export``: a model as C, or as a co-simulation unit."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ModelFileError, ParameterError

if TYPE_CHECKING:
    from minorloop.dynamics.linear import Linear
    from minorloop.export.c99 import CSource
    from minorloop.modelfile import ModelFile

NAME = "export"
EXAMPLE = "minorloop export c model.json --out firmware --float32 --memory 32"
_TARGETS = ("c", "fmu")
_LARGEST = 2**20
"""Bytes of the largest file of a linear part."""
_FOR_C = "Options of export c"
_LINEAR_KEYS = {"numerator", "denominator", "interval", "delay"}


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
    if target not in _TARGETS:
        raise ParameterError(f"there is no export {target!r}; give one of {', '.join(_TARGETS)}")
    for_c = {
        "--float32": float32,
        "--largest": largest,
        "--firmware": firmware,
        "--no-inverse": no_inverse,
    }
    for option, value in for_c.items():
        if target == "fmu" and value:
            raise ParameterError(f"{option} does nothing for fmu; leave it out")
    if first is not None and linear is None:
        raise ParameterError("--first does nothing without --linear; leave it out")
    from minorloop import modelfile
    from minorloop.operators.after_effect import AfterEffect
    from minorloop.operators.preisach import Preisach

    known = modelfile.read(model)
    _common.print_warnings(known.warnings)
    operator = known.operator  # refuses what has none
    if memory is not None and not isinstance(operator, Preisach):
        raise ParameterError(
            f"--memory does nothing for a {type(operator).__name__}, whose memory has a "
            "fixed size; leave it out"
        )
    part, order = _dynamics(known, model, linear, first, interval)
    timed = isinstance(known.model, AfterEffect)
    if interval is not None and part is None and target == "c" and not timed:
        raise ParameterError("--interval does nothing for c without dynamics; leave it out")
    options: dict[str, Any] = {
        "name": name,
        "first": order,
        "linear": part,
        "input": str(known.input),
        "output": str(known.output),
    }
    if memory is not None:
        options["memory"] = memory
    if target == "fmu":
        _write_unit(known, model, out, options, interval, force, as_json)
        return
    from minorloop.export.c99 import export_c

    if timed:
        options["interval"] = interval
    with _common.working("writing C"):
        code = export_c(
            known.model if timed else known.operator,
            out,
            **options,
            force=force,
            float32=float32,
            inverse=not no_inverse,
            largest=largest,
            firmware=firmware,
            warnings=known.warnings,
        )
    _show(code, out, known, as_json)


def _write_unit(
    known: ModelFile,
    model: Path,
    out: Path,
    options: dict[str, Any],
    interval: float | None,
    force: bool,
    as_json: bool,
) -> None:
    from minorloop.export.fmu import export_fmu

    _common.check_outputs([out], inputs=[model], force=force)
    with _common.working("compiling the unit"):
        unit = export_fmu(known.operator, out, **options, interval=interval, force=force)  # type: ignore[arg-type]
    if as_json:
        _common.print_json({"file": str(out), "bytes": out.stat().st_size, "platforms": unit})
        return
    typer.echo(f"co-simulation unit for {', '.join(unit)} written to {out}")
    _say_what_is_missing(known, "unit")


def _show(code: CSource, out: Path, known: ModelFile, as_json: bool) -> None:
    figures = {
        "folder": str(out),
        "files": list(code.files),
        "table_bytes": code.table_bytes,
        "state_bytes": code.state_bytes,
        "memory": code.memory,
        "drop_error": code.drop_error,
        "input_error": code.input_error,
    }
    if as_json:
        _common.print_json(figures)
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


def _dynamics(
    known: ModelFile, path: Path, linear: Path | None, first: str | None, interval: float | None
) -> tuple[Linear | None, str]:
    """Return the sampled linear part of the model or of a file, and what comes first."""
    from minorloop.dynamics.cascade import Cascade

    if not isinstance(known.model, Cascade):
        return (None if linear is None else _linear(linear)), first or "operator"
    if linear is not None:
        raise ParameterError(f"{path} has dynamics of its own; leave --linear out")
    if interval is None:
        raise ParameterError(
            f"{path} has dynamics; give the seconds between samples with --interval"
        )
    if known.model.ahead is not None:
        raise ParameterError(
            f"{path} has dynamics on both sides of the operator, which exports do not carry; "
            "identify with --dynamics operator or --dynamics linear"
        )
    return known.model.sampled(interval).linear, known.model.first


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


def _linear(path: Path) -> Linear:
    """Return the linear part that a file describes."""
    from minorloop.dynamics.linear import Linear

    try:
        if path.stat().st_size > _LARGEST:
            raise ModelFileError(f"{path} is larger than {_LARGEST} bytes; give a linear part")
        content = json.loads(path.read_text())
    except OSError as error:
        raise ModelFileError(f"{path} cannot be read: {error.strerror}") from None
    except ModelFileError:
        raise
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path} is not JSON: {error}") from None
    if not isinstance(content, dict) or not {"numerator", "denominator"} <= set(content):
        raise ModelFileError(f"{path} is not an object with a numerator and a denominator")
    strange = sorted(set(content) - _LINEAR_KEYS)
    if strange:
        raise ModelFileError(
            f"{path} has the key {strange[0]!r}; allowed are {', '.join(sorted(_LINEAR_KEYS))}"
        )
    for key in ("interval", "delay"):
        if isinstance(content.get(key), bool):
            raise ModelFileError(f"{path} has the {key} {content[key]}; give a number of seconds")
    return Linear(**content)
