"""``minorloop fleet``: identify many specimens at once, on local processes or a cluster."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.errors import ParameterError, counted

if TYPE_CHECKING:
    from minorloop.fleet.summary import Summary

NAME = "fleet"
EXAMPLE = "minorloop fleet identify manifest.csv --out fleet --levels 20 --workers 2"
_SHOWN = 10
"""Most lines of each kind below the table; all are in the summary."""


def run(
    what: Annotated[str, typer.Argument(help="What to do: identify.", show_default=False)],
    manifest: Annotated[
        Path,
        typer.Argument(
            help="CSV file with columns specimen, file, input, output; and time, curves, groups, "
            "sd, where records have them; one row for each specimen.",
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            help="Folder for the results; that of a stopped fleet continues it.",
            show_default=False,
        ),
    ],
    input: Annotated[
        str | None, typer.Option(help="Column of the input, where the manifest names none.")
    ] = None,
    output: Annotated[
        str | None, typer.Option(help="Column of the output, where the manifest names none.")
    ] = None,
    levels: _common.Levels = None,
    relay: _common.Relay = "bipolar",
    diagonal: _common.Diagonal = None,
    lag: _common.Lag = None,
    slope: _common.Slope = None,
    smoothness: _common.Smoothness = "auto",
    prior: _common.Prior = "auto",
    start: _common.Start = "negative",
    holdout: _common.Holdout = 0.0,
    workers: Annotated[
        int | None, _common.whole_option("Local processes; one for each core if not given.")
    ] = None,
    address: Annotated[
        str | None, typer.Option(help="Scheduler of a Dask cluster, such as tcp://10.0.0.1:8786.")
    ] = None,
    limit: Annotated[
        float,
        _common.number_option("Time limit of a specimen in seconds, or inf."),
    ] = 3600.0,
    retry_failed: Annotated[
        bool,
        typer.Option("--retry-failed", help="Try specimens that failed before again."),
    ] = False,
    patience: Annotated[
        float,
        _common.seconds_option("Seconds to wait for a worker of the cluster or for its scheduler."),
    ] = 60.0,
    as_json: _common.Json = False,
) -> None:
    """Identify every specimen of a manifest; failures are reported, and the rest continues.

    The exit status is 1 if nothing was identified, and 2 if all workers or the scheduler of a
    cluster are lost; finished specimens are kept.
    """
    if what != "identify":
        raise ParameterError(f"there is no action {what!r}; give identify")
    from minorloop.fleet import identify_fleet, read_manifest

    specimens = read_manifest(manifest, input=input, output=output)
    options: dict[str, Any] = {"relay": relay, "prior": prior, "start": start, "holdout": holdout}
    options["smoothness"] = _common.number_or_auto("smoothness", smoothness, float)
    given = {"levels": levels, "diagonal": diagonal, "lag": _common.as_lag(lag), "slope": slope}
    options |= {name: value for name, value in given.items() if value is not None}
    with _common.working(
        f"identifying {counted(len(specimens), 'specimen')}", logged=not as_json
    ) as now:
        summary = identify_fleet(
            specimens,
            out,
            workers=workers,
            address=address,
            limit=limit,
            retry_failed=retry_failed,
            patience=patience,
            say=_say,
            watch=lambda done, of, last: now(f"{done} of {of} specimens, last {last.specimen}"),
            **options,
        )
    if as_json:
        _common.print_json(summary.plain())
    else:
        _show(summary, out)
    sys.stdout.flush()
    if not summary.identified:
        raise typer.Exit(1)


def _say(sentence: str) -> None:
    """Print a sentence on stderr at once; progress may wait for ten seconds."""
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
