"""``minorloop fleet``: identify many specimens at once, on local processes or a cluster."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._identification import (
    LawOption,
    PriorOption,
    RecordOptions,
    RecordReader,
    law_value,
    plane_options,
)
from minorloop.errors import counted

if TYPE_CHECKING:
    from minorloop.fleet.summary import Summary

NAME = "fleet"
EXAMPLE = "minorloop fleet manifest.csv --out fleet --law levels=20 --workers 2"
_SHOWN = 10
"""Most lines of each kind below the table; all are in the summary."""


_Manifest = Annotated[
    Path,
    typer.Argument(
        help="CSV file with columns specimen, file, input, output; and time, curves, groups, sd, "
        "where records have them; one row for each specimen.",
        show_default=False,
    ),
]
_Out = Annotated[
    Path,
    typer.Option(
        help="Folder for the results; give that of a stopped fleet to continue it.",
        show_default=False,
    ),
]
_Input = Annotated[
    str | None, typer.Option(help="Column of the input, where the manifest names none.")
]
_Output = Annotated[
    str | None, typer.Option(help="Column of the output, where the manifest names none.")
]
_Workers = Annotated[
    str | None,
    typer.Option(
        help="Number of local processes, one for each core if not given; or the scheduler of a "
        "Dask cluster, such as tcp://10.0.0.1:8786."
    ),
]
_Limit = Annotated[float, _common.number_option("Time limit of a specimen in seconds, or inf.")]
_Retry = Annotated[
    bool, typer.Option("--retry-failed", help="Try specimens that failed before again.")
]
_Patience = Annotated[float, _common.seconds_option("Seconds to wait for a worker of the cluster.")]


def run(
    manifest: _Manifest,
    out: _Out,
    input: _Input = None,
    output: _Output = None,
    record: RecordOptions = None,
    law: LawOption = None,
    prior: PriorOption = "auto",
    holdout: _common.Holdout = 0.0,
    workers: _Workers = None,
    limit: _Limit = 3600.0,
    retry_failed: _Retry = False,
    patience: _Patience = 60.0,
    as_json: _common.Json = False,
) -> None:
    """Identify every specimen of a manifest; failures are reported, and the rest continues.

    The law is a plane. The exit status is 1 if nothing was identified, and 2 if all workers or the
    scheduler of a cluster are lost; finished specimens are kept.
    """
    from minorloop.fleet import identify_fleet, read_manifest

    others = dict.fromkeys(("curves", "groups", "sd", "rows", "between"))
    reader = RecordReader.of(record, **others)
    settings = {name: value for name, value in reader.settings.items() if value is not None}
    options = plane_options(law_value(law), prior)
    specimens = read_manifest(manifest, input=input, output=output)
    with _common.working(
        f"identifying {counted(len(specimens), 'specimen')}", logged=not as_json
    ) as now:
        summary = identify_fleet(
            specimens,
            out,
            workers=int(workers) if workers and workers.isdecimal() else workers,
            limit=limit,
            retry_failed=retry_failed,
            patience=patience,
            say=_say,
            watch=lambda done, of, last: now(f"{done} of {of} specimens, last {last.specimen}"),
            holdout=holdout,
            **options,
            **settings,
        )
    _common.finish(as_json, summary.plain, partial(_show, summary, out))
    sys.stdout.flush()
    if not summary.identified:
        raise typer.Exit(1)


def _say(sentence: str) -> None:
    """Print a sentence on stderr at once; progress texts may be ten seconds late."""
    print(sentence, file=sys.stderr, flush=True)


def _show(summary: Summary, out: Path) -> None:
    from minorloop.fleet.summary import WORDS

    rows = [
        (figure, *(f"{at[word]:.4g}" for word in WORDS))
        for figure, at in summary.distributions().items()
    ]
    title = f"{len(summary.identified)} of {len(summary.outcomes)} specimens identified"
    if rows:
        headers = "", "least", "quarter", "median", "three quarters", "greatest"
        _common.print_table(headers, rows, title)
    else:
        typer.echo(title)
    remarks = summary.remarks().values()
    for sentence in (one for kind in remarks for one in kind[:_SHOWN]):
        typer.echo(sentence)
    if any(len(kind) > _SHOWN for kind in remarks):
        typer.echo(f"more are in {out / 'summary.json'}")
    typer.echo(f"{'models and results are' if summary.identified else 'the results are'} in {out}")
