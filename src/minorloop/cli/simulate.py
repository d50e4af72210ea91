"""``minorloop simulate``: outputs for the inputs in a CSV file."""

from __future__ import annotations

from math import isnan
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.errors import ParameterError, are, counted

NAME = "simulate"
EXAMPLE = "minorloop simulate model.json inputs.csv --input voltage --save predicted.csv"


if TYPE_CHECKING:
    from minorloop.arrays import FloatArray
    from minorloop.dynamics.oscillator import Oscillator
    from minorloop.lab.timebase import TimeCheck
    from minorloop.modelfile import ModelFile


def run(
    model: _common.ModelFile,
    file: _common.DataFile,
    input: Annotated[
        str | None,
        typer.Option(
            help="Column of the input, in the unit of the model.",
            show_default="the name that it has in the model",
        ),
    ] = None,
    time: _common.Time = None,
    start: _common.Start = "negative",
    between: Annotated[
        str | None,
        typer.Option(
            help="Force of an oscillator between rows: band, straight or held.",
            show_default="band",
            autocompletion=one_of(("band", "straight", "held")),
        ),
    ] = None,
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Predict the output for the inputs in a file, lag and dynamics included."""
    _common.check_outputs([save], inputs=[model, file], force=force)
    from numpy import nanmax, nanmin

    from minorloop import modelfile
    from minorloop.dynamics.oscillator import Oscillator

    with _common.working(f"reading {file.name}") as now:
        known = modelfile.read(model)
        column = known.input.name if input is None else input
        u = _common.read_column(file, column, known.input.unit)
        now(f"simulating {u.size} samples")
        times, check = _common.times_of(known, file, time)
        if isinstance(known.model, Oscillator):
            y = _vibrating(known.model, times, u, start, between)
            notes = [] if check is None else list(check.notes)
        elif between is not None:
            raise ParameterError(
                f"--between is for oscillators, and {model} has a model of kind {known.kind!r}; "
                "leave it out"
            )
        else:
            y, notes = _across_gaps(known, times, u, start, check)
        if known.lag_seconds and not times:
            notes.append(
                f"the lag of {known.lag_seconds:.4g} s counts as {counted(known.lag, 'row')}, "
                "as in the record of the model; --time takes it in seconds"
            )
        if save is not None:
            now(f"writing {save.name}")
            output = str(known.output)
            cells = ["" if isnan(value) else value for value in y.tolist()]
            header = output if known.output != known.input else f"predicted {output}"
            _common.write_csv(save, {**times, str(known.input): u, header: cells}, force=force)
    if not isinstance(known.model, Oscillator):
        _warn_beyond(known, u)
    _common.print_warnings(known.warnings)
    least, greatest = nanmin(y), nanmax(y)
    if as_json:
        outputs = {} if save is not None else {"y": y}
        found = {"samples": y.size, "least": least, "greatest": greatest}
        said = {"notes": notes} if notes else {}
        _common.print_json({**found, **outputs, **said})
        return
    for note in notes:
        typer.echo(f"note: {note}", err=True)
    unit = f" {known.output.unit}" if known.output.unit else ""
    typer.echo(
        f"{counted(y.size, 'sample')} of {known.output.name}, {least:.6g} to {greatest:.6g}{unit}"
    )
    if save is not None:
        typer.echo(f"written to {save}")
    else:
        typer.echo("nothing was written; --save FILE writes inputs and outputs")


def _vibrating(
    model: Oscillator,
    times: dict[str, FloatArray],
    u: FloatArray,
    start: str,
    between: str | None,
) -> FloatArray:
    """Return the displacements of an oscillator, which is at rest before."""
    if start != "negative":
        raise ParameterError(
            f"--start is {start!r}, and an oscillator begins at rest; leave it out"
        )
    t = next(iter(times.values()))
    return model.simulate(t, u, between=between or "band")  # type: ignore[arg-type]


def _simulated(
    known: ModelFile, times: dict[str, FloatArray], u: FloatArray, start: Any
) -> FloatArray:
    """Return the outputs; the first input of dynamics has been applied for long."""
    from numpy import interp

    from minorloop.dynamics.cascade import Cascade
    from minorloop.identification.baseline import delayed
    from minorloop.operators.after_effect import AfterEffect

    if isinstance(known.model, Cascade | AfterEffect):
        return known.model.simulate(next(iter(times.values())), u, start)
    y = known.model.simulate(u, start)
    if times and known.lag_seconds:
        t = next(iter(times.values()))
        return interp(t - known.lag_seconds, t, y)
    return delayed(y, known.lag)


def _across_gaps(
    known: ModelFile,
    times: dict[str, FloatArray],
    u: FloatArray,
    start: Any,
    check: TimeCheck | None,
) -> tuple[FloatArray, list[str]]:
    """Return the outputs, NaN where a gap leaves the memory unknown, and what is to be said.

    The input also passes the extremes that are known to lie in gaps.
    """
    from numpy import arange, delete, nan, where

    from minorloop.lab.gaps import bridged, known_memory, with_lost_rows
    from minorloop.operators.polynomial import Polynomial

    check = None if check is None else with_lost_rows(check, u)
    if check is None or not check.gaps.size or isinstance(known.operator, Polynomial):
        notes = [] if check is None else list(check.notes)
        return _simulated(known, times, u, start), notes
    gaps = bridged(check.t, u, check.gaps)
    t, inputs, added = gaps.inserted(check.t, u)
    y = _simulated(known, dict.fromkeys(times, t), inputs, start)
    y = delete(y, added + arange(added.size))
    unknown = ~known_memory(u, gaps.unknown, gaps)
    if not unknown.any():
        return y, list(check.notes)
    count = int(unknown.sum())
    said = (
        f"{counted(count, 'output')} {are(count)} left empty, because the input may have turned in "
        "a gap, and the memory is unknown after it"
    )
    return where(unknown, nan, y), [*check.notes, said]


def _warn_beyond(known: ModelFile, u: FloatArray) -> None:
    """Say on stderr how many inputs saturate the relays."""
    levels = getattr(known.operator, "levels", None)
    if levels is None:
        return
    beyond = int(((u < levels[0]) | (u > levels[-1])).sum())
    if beyond:
        typer.echo(
            f"note: {beyond} inputs lie beyond the levels of the model "
            f"[{levels[0]:g}, {levels[-1]:g}], where its relays are saturated",
            err=True,
        )
