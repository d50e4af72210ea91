"""``minorloop identify``: a model from a CSV file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError

if TYPE_CHECKING:
    from minorloop.identification import Identification
    from minorloop.lab.records import Record

NAME = "identify"
_RANK_LIMIT = 3000


def run(
    file: Annotated[Path, typer.Argument(help="CSV file with one header line.")],
    input: Annotated[str, typer.Option(help="Column of the input.")],
    output: Annotated[str, typer.Option(help="Column of the output; blank: not measured.")],
    levels: Annotated[int, typer.Option(help="Number of bands.")] = 25,
    spacing: Annotated[str, typer.Option(help="uniform or adaptive thresholds.")] = "uniform",
    relay: Annotated[str, typer.Option(help="bipolar or unipolar relays.")] = "bipolar",
    diagonal: Annotated[str, typer.Option(help="uniform or reversible.")] = "uniform",
    lag: Annotated[str, typer.Option(help="Samples by which output follows; or auto.")] = "0",
    slope: Annotated[bool, typer.Option("--slope", help="Fit a linear part too.")] = False,
    signed: Annotated[bool, typer.Option("--signed", help="Allow negative weights.")] = False,
    smoothness: Annotated[str, typer.Option(help="A strength, 0, or auto.")] = "auto",
    start: Annotated[str, typer.Option(help="negative, positive or demagnetised.")] = "negative",
    rows: Annotated[str | None, typer.Option(help="Rows A:B of the file, B not included.")] = None,
    holdout: Annotated[float, typer.Option(help="Share kept from the fit and scored.")] = 0.0,
    rank: Annotated[
        bool, typer.Option("--rank", help="Work out the rank of large planes.")
    ] = False,
    save: Annotated[Path | None, typer.Option(help="Write the model to this file.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write an HTML report to this file.")] = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Identify a hysteresis model from measured data, and say how far to trust it."""
    _common.check_outputs([save, report], force=force)
    from minorloop.identification import identify
    from minorloop.lab.records import Record

    options = {
        "levels": levels,
        "spacing": spacing,
        "relay": relay,
        "diagonal": diagonal,
        "slope": slope,
        "signed": signed,
        "smoothness": _number_or_auto("smoothness", smoothness, float),
        "lag": _number_or_auto("lag", lag, int),
        "start": start,
        "holdout": holdout,
    }
    with _common.working(f"reading {file.name}") as now:
        record = Record.from_csv(file, input=input, output=output, gaps=True)
        part = _common.as_rows(rows, len(record))
        now(f"identifying {levels} bands from {part.stop - part.start} rows")
        began = time.perf_counter()
        result = identify(record.u[part], record.y[part], **options)
        seconds = time.perf_counter() - began
        now("scoring")
        figures = _figures(result, seconds, rank)
        if save is not None:
            _save(result, save, record, file, figures, force)
        if report is not None:
            _write_report(result, report, record, file, force)
    if as_json:
        _common.print_json(figures)
        return
    _print(result, figures, record)
    for path, what in ((save, "model"), (report, "report")):
        if path is not None:
            typer.echo(f"{what} written to {path}")


def _figures(result: Identification, seconds: float, rank: bool) -> dict[str, Any]:
    held = result.holdout_nrmse is not None
    known = rank or result.unknowns <= _RANK_LIMIT
    return {
        "nrmse_train": result.nrmse,
        "nrmse_holdout": result.holdout_nrmse,
        "baseline_nrmse_holdout": result.baseline_nrmse if held else None,
        "baseline_nrmse": result.baseline_nrmse,
        "rmse_train": result.rmse,
        "lag_samples": result.lag,
        "samples": result.samples,
        "levels": result.model.bands,
        "unknowns": result.unknowns,
        "rank": result.rank if known else None,
        "condition": result.condition if known else None,
        "excited_fraction": result.excited_fraction,
        "smoothness": result.smoothness,
        "kkt": result.kkt,
        "range": list(result.model.range),
        "seconds": seconds,
        "advice": list(result.advice),
    }


def _print(result: Identification, figures: dict[str, Any], record: Record) -> None:
    held = figures["nrmse_holdout"]
    rank = figures["rank"]
    rows = [
        ("error on fitted data", f"{figures['nrmse_train']:.3%} of range"),
        ("error on held-out data", "-" if held is None else f"{held:.3%} of range"),
        ("best delayed polynomial", f"{figures['baseline_nrmse']:.3%} of range"),
        ("lag", f"{figures['lag_samples']} samples"),
        ("samples fitted", f"{figures['samples']}"),
        ("unknowns", f"{figures['unknowns']}"),
        ("rank", "not worked out (--rank)" if rank is None else f"{rank}"),
        ("cells excited", f"{figures['excited_fraction']:.0%}"),
        ("optimality (KKT)", f"{figures['kkt']:.1e}"),
        ("time", f"{figures['seconds']:.2f} s"),
    ]
    title = f"{record.output} against {record.input}: Preisach, {result.model.bands} bands"
    _common.print_table(("", ""), rows, title)
    _common.print_advice(result.advice)


def _save(
    result: Identification,
    path: Path,
    record: Record,
    source: Path,
    figures: dict[str, Any],
    force: bool,
) -> None:
    from minorloop import modelfile

    scores = {
        name: figures[name] for name in ("nrmse_train", "nrmse_holdout", "baseline_nrmse", "kkt")
    }
    modelfile.save(
        result.model,
        path,
        input=record.input,
        output=record.output,
        lag=result.lag,
        provenance=modelfile.Provenance.of(source, scores),
        force=force,
    )


def _write_report(
    result: Identification, path: Path, record: Record, source: Path, force: bool
) -> None:
    from minorloop.report import identification_report

    identification_report(
        result,
        source=source.name,
        input_label=str(record.input),
        output_label=str(record.output),
    ).write(path, force=force)


def _number_or_auto(name: str, text: str, kind: type[int] | type[float]) -> Any:
    if text == "auto":
        return text
    try:
        return kind(text)
    except ValueError:
        number = "a whole number" if kind is int else "a number"
        raise ParameterError(f"--{name} is {text!r}; give auto or {number}") from None
