"""``minorloop identify``: a model from a CSV file."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, RecordError

if TYPE_CHECKING:
    from minorloop.identification import Identification
    from minorloop.identification.adaptive import Adaptive
    from minorloop.lab.records import Record
    from minorloop.modelfile import Provenance

NAME = "identify"
EXAMPLE = (
    'minorloop identify run.csv --input "voltage [V]" --output curvature --lag auto '
    "--holdout 0.3 --save model.json --report report.html"
)
_RANK_LIMIT = 3000
_DISTRUSTED = 1
_DEFAULTS: dict[str, Any] = {"levels": 25, "diagonal": "uniform", "prior": "auto"}


_Data = Annotated[
    Path,
    typer.Argument(
        help="CSV file: one header line, then numbers; or an experiment store, as run makes it.",
        show_default=False,
    ),
]
_Input = Annotated[
    str | None,
    typer.Option(help="Column of the input: voltage, or the whole header, 'voltage [V]'."),
]
_Output = Annotated[
    str | None, typer.Option(help="Column of the output; an empty cell: not measured.")
]
_Levels = Annotated[
    int | None,
    _common.whole_option(
        "Bands between the least and the greatest input, 250 at most; 25, or those of an adaptive "
        "run, if not given."
    ),
]
_Spacing = Annotated[
    str, typer.Option(help="Thresholds: uniform, or adaptive (dense where output is steep).")
]
_Relay = Annotated[str, typer.Option(help="Relays: bipolar (-1, +1) or unipolar (0, 1).")]
_Diagonal = Annotated[
    str | None,
    typer.Option(
        help="Smallest loops: uniform, or reversible (answer at once), as after adaptive runs.",
        show_default="uniform",
    ),
]
_Lag = Annotated[
    str, typer.Option(help="Rows by which the output follows the input, or auto (0 to 20).")
]
_Slope = Annotated[bool, typer.Option("--slope", help="Fit a linear part too.")]
_Signed = Annotated[
    bool, typer.Option("--signed", help="Allow negative weights, for butterfly loops.")
]
_Smoothness = Annotated[str, typer.Option(help="Strength of smoothing, 0 for none, or auto.")]
_Prior = Annotated[
    str | None,
    typer.Option(
        help="gaussian (a prior on the plane, with bands), none, or auto (where samples are few).",
        show_default="auto",
    ),
]
_Noise = Annotated[
    float | None,
    _common.number_option("Standard deviation of a measured output, where known; for the prior."),
]
_Rows = Annotated[
    str | None,
    typer.Option(
        metavar="A:B", help="Rows to use, counted from 0 after the header, B not included."
    ),
]
_Holdout = Annotated[
    float,
    _common.number_option("Share at the end kept from the fit and scored, 0 to 0.9; try 0.3."),
]
_Rank = Annotated[
    bool, typer.Option("--rank", help="Work out the rank of more than 3000 unknowns too.")
]
_Save = Annotated[Path | None, typer.Option(help="Write the model to this file.")]
_Report = Annotated[Path | None, typer.Option(help="Write an HTML report to this file.")]


def run(
    file: _Data,
    input: _Input = None,
    output: _Output = None,
    levels: _Levels = None,
    spacing: _Spacing = "uniform",
    relay: _Relay = "bipolar",
    diagonal: _Diagonal = None,
    lag: _Lag = "0",
    slope: _Slope = False,
    signed: _Signed = False,
    smoothness: _Smoothness = "auto",
    prior: _Prior = None,
    noise: _Noise = None,
    start: _common.Start = "negative",
    rows: _Rows = None,
    holdout: _Holdout = 0.0,
    rank: _Rank = False,
    save: _Save = None,
    report: _Report = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """Identify a hysteresis model from measured data, and say how far to trust it.

    The exit status is 1 where the model is not to be trusted; it is written all the same, with the
    warnings in its file.
    """
    _common.check_outputs([save, report], inputs=[file], force=force)
    options = {
        "levels": levels,
        "spacing": spacing,
        "relay": relay,
        "diagonal": diagonal,
        "slope": slope,
        "signed": signed,
        "smoothness": _number_or_auto("smoothness", smoothness, float),
        "prior": prior,
        "noise": noise,
        "lag": _number_or_auto("lag", lag, int),
        "start": start,
        "holdout": holdout,
    }
    done = _identified(file, input, output, rows, options)
    steps: list[Callable[[], None]] = [partial(_show, done, rank, as_json)]
    # Files first: whoever reads what is printed may go away.
    if report is not None:
        steps.insert(0, partial(_report, done, report, force, as_json))
    if save is not None:
        steps.insert(0, partial(_save, done, save, force, as_json))
    _common.do_all(steps)
    if done.warnings:
        raise typer.Exit(_DISTRUSTED)


@dataclass(frozen=True)
class _Done:
    """What was identified, and from what."""

    record: Record
    result: Identification
    provenance: Provenance
    seconds: float
    notes: tuple[str, ...] = ()
    left_out: tuple[int, ...] = ()
    first: int = 0

    @property
    def advice(self) -> list[str]:
        """What is wrong with the run, then with the model."""
        said = list(dict.fromkeys([*self.notes, *self.result.advice]))
        result = self.result
        if self.first and (result.findings or result.codes or result.suspects):
            said.append(f"samples are counted from row {self.first} of the file here")
        return said

    @property
    def warnings(self) -> tuple[str, ...]:
        """What of it stands in the model file: why the model is not to be trusted."""
        known = self.result.advice
        return (*(note for note in self.notes if note not in known), *self.result.warnings)


def _identified(
    file: Path, input: str | None, output: str | None, rows: str | None, options: dict[str, Any]
) -> _Done:
    from minorloop.identification import identify
    from minorloop.modelfile import Provenance

    with _common.working(f"reading {file.name}") as now:
        record, run_by = _record(file, input, output)
        provenance = Provenance.of(file)
        began = time.perf_counter()
        if run_by is not None:
            now(f"identifying from {len(record)} points of an adaptive run")
            return _of_run(record, run_by, rows, options, provenance)
        part = _common.as_rows(rows, len(record))
        settings: dict[str, Any] = {
            name: _DEFAULTS.get(name) if v is None else v for name, v in options.items()
        }
        now(f"identifying {settings['levels']} bands from {part.stop - part.start} rows")
        result = identify(record.u[part], record.y[part], **settings)
        return _Done(record, result, provenance, time.perf_counter() - began, first=part.start)


def _of_run(
    record: Record,
    chooser: Adaptive,
    rows: str | None,
    options: dict[str, Any],
    provenance: Provenance,
) -> _Done:
    """The model of an adaptive run, as it was designed for; its validation is held out."""
    from minorloop.cli._adaptive import warnings

    if rows is not None or options["holdout"] != 0:
        raise ParameterError(
            "an adaptive run knows which of its holds are held out; leave --rows and --holdout out"
        )
    given = {name: v for name, v in options.items() if v is not None and name != "holdout"}
    if given["smoothness"] != "auto":
        given.setdefault("prior", "auto")
    began = time.perf_counter()
    u, y = record.u.tolist(), record.y.tolist()
    result = chooser.identification(u, y, **given)
    seconds = time.perf_counter() - began
    out = [k for k, role in enumerate(chooser.roles(u, y)) if role == "outlier"]
    notes = tuple(warnings(chooser, u, y))
    return _Done(record, result, provenance, seconds, notes, tuple(out))


def _record(file: Path, input: str | None, output: str | None) -> tuple[Record, Adaptive | None]:
    """The settled points of a store and what chose them, or two columns of a CSV file."""
    from minorloop.cli._adaptive import chooser_of
    from minorloop.lab.records import Record
    from minorloop.lab.store import Store, is_store

    if is_store(file):
        if input is not None or output is not None:
            raise ParameterError(
                f"{file} is an experiment store and knows its input and output; "
                "leave --input and --output out"
            )
        with Store.open(file) as store:
            chose = store.setup.design is not None
            return store.record(), chooser_of(store.setup, store.points()) if chose else None
    if input is None or output is None:
        if not os.path.exists(file):
            raise RecordError(f"{file} does not exist; give a CSV file or an experiment store")
        missing = "--input" if input is None else "--output"
        raise ParameterError(f"{missing} is missing; name a column of {file}")
    record = Record.from_csv(file, input=input, output=output, gaps=True)
    if record.input == record.output:
        raise ParameterError(f"--input and --output are both '{record.input}'; give two columns")
    return record, None


def _save(done: _Done, path: Path, force: bool, as_json: bool) -> None:
    from minorloop import modelfile

    result = done.result
    scores = {
        "nrmse_train": result.nrmse,
        "nrmse_holdout": result.holdout_nrmse,
        "baseline_nrmse": result.baseline_nrmse,
        "kkt": result.kkt,
    }
    source = done.provenance
    modelfile.save(
        result.model,
        path,
        input=done.record.input,
        output=done.record.output,
        lag=result.lag,
        provenance=modelfile.Provenance(data=source.data, sha256=source.sha256, scores=scores),
        warnings=done.warnings,
        force=force,
    )
    if not as_json:
        typer.echo(f"model written to {path}")


def _show(done: _Done, rank: bool, as_json: bool) -> None:
    with _common.working("scoring"):
        figures = _figures(done.result, done.seconds, rank)
        figures["advice"] = done.advice
        figures["warnings"] = list(done.warnings)
        figures["codes"] = [code.sample for code in done.result.codes]
        figures["held_out"] = int(done.result.held_out.sum())
        figures["left_out"] = list(done.left_out)
    if as_json:
        _common.print_json(figures)
    else:
        _print(done, figures)


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
        "prior": "none" if result.posterior is None else "gaussian",
        "band_sd": _band_sd(result),
        "suspects": list(result.suspects),
        "kkt": result.kkt,
        "range": list(result.model.range),
        "seconds": seconds,
    }


def _apart(done: _Done, figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Samples that the model was not shown."""
    rows = [("samples held out", f"{figures['held_out']}")] if figures["held_out"] else []
    if done.left_out:
        rows.append(("knocked, left out", ", ".join(f"hold {k + 1}" for k in done.left_out)))
    return rows


def _banded(figures: dict[str, Any]) -> list[tuple[str, str]]:
    if figures["band_sd"] is None:
        return []
    return [("standard deviation predicted", f"{figures['band_sd']:.3g}")]


def _band_sd(result: Identification) -> float | None:
    """Standard deviation of the outputs of the record, on average, as the prior has it."""
    if result.posterior is None:
        return None
    return float(result.predict(result.u, bands=0.9).sd.mean())


def _print(done: _Done, figures: dict[str, Any]) -> None:
    from minorloop.identification.baseline import percent

    held = figures["nrmse_holdout"]
    rank = figures["rank"]
    rows = [
        ("error on fitted data", f"{percent(figures['nrmse_train'])} of range"),
        ("error on held-out data", "-" if held is None else f"{percent(held)} of range"),
        ("best delayed polynomial", f"{percent(figures['baseline_nrmse'])} of range"),
        ("lag", f"{figures['lag_samples']} samples"),
        ("samples fitted", f"{figures['samples']}"),
        *_apart(done, figures),
        ("unknowns", f"{figures['unknowns']}"),
        ("rank", "not worked out (--rank)" if rank is None else f"{rank}"),
        ("cells excited", f"{figures['excited_fraction']:.0%}"),
        *_banded(figures),
        ("optimality (KKT)", f"{figures['kkt']:.1e}"),
        ("time", f"{figures['seconds']:.2f} s"),
    ]
    record = done.record
    title = f"{record.output} against {record.input}: Preisach, {figures['levels']} bands"
    _common.print_table(("", ""), rows, title)
    _common.print_advice(done.advice)
    if done.warnings:
        count = len(done.warnings)
        which = "the first of these says" if count == 1 else f"the first {count} of these say"
        typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)


def _report(done: _Done, path: Path, force: bool, as_json: bool) -> None:
    from minorloop.report import identification_report

    draw = partial(
        identification_report,
        done.result,
        source=str(done.provenance.data),
        input_label=str(done.record.input),
        output_label=str(done.record.output),
    )
    with _common.working("drawing the report"):
        _common.write_report(draw, path, force=force)
    if not as_json:
        typer.echo(f"report written to {path}; open it in a browser")


def _number_or_auto(name: str, text: str, kind: type[int] | type[float]) -> Any:
    if text == "auto":
        return text
    try:
        return kind(text)
    except ValueError:
        number = "a whole number" if kind is int else "a number"
        raise ParameterError(f"--{name} is {text!r}; give auto or {number}") from None
