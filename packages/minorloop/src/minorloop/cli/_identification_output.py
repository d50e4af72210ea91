"""What ``identify`` prints and writes."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._identification import Done
from minorloop.errors import counted

if TYPE_CHECKING:
    from minorloop.identification import DynamicIdentification, Identification

_MOST_RANKED = 3000
"""Unknowns up to which the rank is computed without --rank. 3000 take 40 s, and the time grows with
their cube."""


def save_model(done: Done, path: Path, force: bool, as_json: bool) -> None:
    """Write the model file."""
    from minorloop import modelfile

    dynamic = done.dynamic if done.dynamic is not None and done.dynamic.dynamic else None
    modelfile.save(
        done.result if dynamic is None else dynamic,
        path,
        provenance=done.provenance,
        input=done.record.input,
        output=done.record.output,
        warnings=done.found.warnings,
        force=force,
    )
    if not as_json:
        typer.echo(f"model written to {path}")


def show(done: Done, rank: bool, as_json: bool) -> None:
    """Print the scores and the advice, as a table or as JSON."""
    with _common.working("scoring"):
        result = done.result
        figures = _figures(result, done.seconds, rank)
        figures["advice"] = list(done.found.advice)
        figures["warnings"] = list(done.found.warnings)
        figures["chosen"] = list(done.found.chosen)
        figures["codes"] = [code.sample for code in result.codes]
        figures["sd"] = result.of_record.sd
        figures["lag_samples"], figures["lag_s"] = result.lag_of_model, result.lag_seconds or None
        figures["held_out"] = int(result.held_out.sum())
        figures["left_out"] = list(result.of_record.left_out)
        if done.dynamic is not None:
            figures |= _dynamic_figures(done.dynamic)
    if as_json:
        _common.print_json(figures)
    else:
        _print(done, figures)


def _figures(result: Identification, seconds: float, rank: bool) -> dict[str, Any]:
    from minorloop.identification.accuracy import scores_of

    held = result.holdout_accuracy is not None
    known = rank or result.unknowns <= _MOST_RANKED
    return {
        **scores_of(result.accuracy, result.holdout_accuracy),
        "curves": [asdict(curve) for curve in result.curve_accuracy],
        "free_parameters": result.free_parameters,
        "effective_parameters": result.effective_parameters,
        "baseline_nrmse_holdout": result.baseline_nrmse if held else None,
        "baseline_nrmse": result.baseline_nrmse,
        "rmse_train": result.rmse,
        "lag_samples": result.lag,
        "nrmse_groups": result.groups_nrmse,
        "samples": result.samples,
        "skipped": result.skipped,
        "choices": [asdict(choice) for choice in result.choices],
        "jumps": [asdict(jump) for jump in result.jumps],
        "residual": asdict(result.residual),
        "levels": result.model.bands,
        "unknowns": result.unknowns,
        "rank": result.rank if known else None,
        "condition": result.condition if known else None,
        "excited_fraction": result.excited_fraction,
        "smoothness": result.smoothness,
        "prior": "none" if result.posterior is None else "gaussian",
        "ridge": None if result.ridge is None else asdict(result.ridge),
        "band_sd": result.band_sd,
        "suspects": list(result.suspects),
        "kkt": result.kkt,
        "range": list(result.model.range),
        "seconds": seconds,
    }


def _dynamic_figures(found: DynamicIdentification) -> dict[str, Any]:
    """Return the errors of the whole model, and its dynamics."""
    from minorloop.modelfile import plain

    model = found.model
    return {
        **found.scores,
        "dynamics": {
            "first": model.first,
            "ahead": None if model.ahead is None else plain(model.ahead),
            "numerator": model.linear.numerator,
            "denominator": model.linear.denominator,
            "dead_time": model.linear.delay,
            "time_constants": model.linear.time_constants,
            "creep": None if model.creep is None else plain(model.creep),
            "tried": [asdict(one) for one in found.tried],
        },
    }


def _print(done: Done, figures: dict[str, Any]) -> None:
    from minorloop.identification.scores import OF_OPERATOR, curve_table, score_rows

    rank = figures["rank"]
    rows = score_rows(done.result, rank="not computed (--rank)" if rank is None else f"{rank}")
    result = done.result
    if result.lag_seconds:
        lag = f"{counted(result.lag_of_model, 'sample')}, {result.lag_seconds:.4g} s"
        rows = [(name, lag if name == "lag" else value) for name, value in rows]
    if done.dynamic is not None:
        rows = [*done.dynamic.rows, *(row for row in rows if row[0] in OF_OPERATOR)]
    if left_out := result.of_record.left_out:
        rows.append(("outliers left out", ", ".join(f"hold {k + 1}" for k in left_out)))
    rows.append(("standard deviation predicted", f"{figures['band_sd']:.3g}"))
    rows.append(("time", f"{figures['seconds']:.2f} s"))
    record = done.record
    title = f"{record.output} against {record.input}: Preisach, {figures['levels']} bands"
    _common.print_table(("", ""), rows, title)
    if done.result.curve_accuracy:
        _common.print_table(*curve_table(done.result.curve_accuracy))
    for one in () if done.dynamic is None else done.dynamic.tried:
        typer.echo(f"tried {one}")
    for text in done.found.chosen:
        typer.echo(f"chosen {text}")
    _common.print_advice(done.found.advice)
    if done.found.warnings:
        count = len(done.found.warnings)
        which = "the first of these says" if count == 1 else f"the first {count} of these say"
        typer.echo(f"warning: this model is not to be trusted: {which} why", err=True)


def write_report(done: Done, path: Path, force: bool, as_json: bool) -> None:
    """Write the HTML report."""
    from minorloop.report import identification_report

    record = done.record
    draw = partial(
        identification_report,
        done.result,
        dynamic=done.dynamic,
        source=str(done.provenance.data),
        input_label=str(record.input),
        output_label=str(record.output),
        time=done.result.t,
    )
    with _common.working("drawing the report"):
        _common.write_report(draw, path, force=force)
    if not as_json:
        typer.echo(f"report written to {path}; open it in a browser")
