"""``minorloop runs``: list experiment stores, show them, and export their points."""

from __future__ import annotations

import math
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from minorloop.cli import _common
from minorloop.cli._measured import sampling
from minorloop.cli._run_progress import said_left, time_left
from minorloop.errors import ParameterError, StoreError
from minorloop.files import table_text
from minorloop.values import as_duration

if TYPE_CHECKING:
    from minorloop.lab.store import Store

NAME = "runs"
EXAMPLE = "minorloop runs export --store runs.sqlite --save points.csv"
_ACTIONS = ("list", "show", "export")
_EVERY = 1.0
"""Seconds between updates of a run that is followed."""


def run(
    action: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="list (one line for each store), show (its points), or export (one row for each "
            "point, or sample of a sine).",
        ),
    ],
    store: Annotated[
        Path,
        typer.Option(
            show_default=False, help="The store that run wrote; for list, also a folder of stores."
        ),
    ],
    save: _common.Save = None,
    follow: Annotated[
        bool, typer.Option("--follow", help="With show: also show new points of a run.")
    ] = False,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """List or show experiment stores, or export their points, also while they are written."""
    if action not in _ACTIONS:
        known = ", ".join(_ACTIONS)
        raise ParameterError(f"there is no action {action!r}; give one of {known}")
    if save is not None and action != "export":
        raise ParameterError(f"--save is for export, not for {action}; leave it out")
    if follow and (action != "show" or as_json):
        raise ParameterError("--follow is for show, without --json; leave it out")
    if action == "list":
        _list(store, as_json)
    elif action == "show":
        if follow:
            _follow(store)
        _show(store, as_json)
    else:
        _export(store, save, force, as_json)


def _list(place: Path, as_json: bool) -> None:
    from minorloop.lab._store_file import is_store
    from minorloop.lab.store import Store, summary

    files = sorted(filter(is_store, place.iterdir())) if place.is_dir() else [place]
    if not files:
        raise StoreError(f"there is no experiment store in {place}; minorloop run writes one")
    found, damaged = [], []
    for file in files:
        try:
            with Store.open(file) as opened:
                found.append({**summary(opened), "running": opened.running})
        except StoreError as error:
            if len(files) == 1:
                raise
            damaged.append(str(error))
    if as_json:
        _common.print_json({"runs": found, "unusable": damaged})
        return
    rows = [
        (
            str(figures["store"]),
            str(figures["actuator"]),
            "nominal" if figures["specimen"] is None else str(figures["specimen"]),
            f"{figures['points']} of {figures['levels']}",
            _state(figures),
        )
        for figures in found
    ]
    _common.print_table(("store", "actuator", "specimen", "points", ""), rows)
    for sentence in damaged:
        typer.echo(sentence)


def _show(file: Path, as_json: bool) -> None:
    from minorloop.lab.store import Store

    with Store.open(file) as opened:
        if as_json:
            sessions = [vars(session).copy() for session in opened.sessions()]
            content = {"sessions": sessions, "columns": opened.columns()}
            _common.print_json({**_figures(opened), **content})
            return
        _print(opened)


def _figures(store: Store) -> dict[str, Any]:
    """Return the summary of a store, the time left, and the hold that would settle.

    The last two help to decide whether to let a run go on, and are NaN if unknown.
    """
    from minorloop.lab.store import summary

    figures, sessions = summary(store), store.sessions()
    left = enough = math.nan
    if store.running and sessions:
        began = datetime.fromisoformat(sessions[-1].began)
        seconds = (datetime.now(UTC) - began).total_seconds()
        left = time_left(store.plan, sessions[-1].first, figures["points"], seconds)
    if 2 * figures["extrapolated"] > figures["points"]:
        from minorloop.lab.run import long_enough

        enough = long_enough(store)
    return {**figures, "running": store.running, "left_s": left, "enough_hold_s": enough}


def _state(figures: dict[str, Any]) -> str:
    if figures["finished"]:
        return "finished"
    return "running" if figures["running"] else "not finished"


def _progress(figures: dict[str, Any]) -> str:
    """Return the progress of a run, and how long a hold should be, as one line."""
    parts = [f"{figures['points']} of {figures['levels']} points", said_left(figures["left_s"])]
    if enough := _enough(figures):
        parts.append(f"{figures['extrapolated']} extrapolated; holds of {enough} would settle")
    return ", ".join(filter(None, parts))


def _enough(figures: dict[str, Any]) -> str:
    seconds = figures["enough_hold_s"]
    return f"about {as_duration(seconds)}" if math.isfinite(seconds) else ""


def _follow(file: Path) -> None:
    """Show new points of a store until no process writes to it any more."""
    from minorloop.lab.store import Store

    before = ""
    while True:
        with Store.open(file) as opened:
            figures = _figures(opened)
        if (line := _progress(figures)) != before:
            typer.echo(line)
            before = line
        if not figures["running"]:
            return
        time.sleep(_EVERY)


def _print(store: Store) -> None:
    figures = _figures(store)
    rows = [
        ("actuator", str(figures["actuator"])),
        ("specimen", "nominal" if figures["specimen"] is None else str(figures["specimen"])),
        ("seed of the noise", str(figures["seed"])),
        ("plan", str(store.plan)),
        ("points", f"{figures['points']} of {figures['levels']}"),
        *((name, str(figures[name])) for name in ("settled", "extrapolated", "unsettled")),
        ("held", as_duration(figures["held_s"])),
        ("state", ", ".join(filter(None, [_state(figures), said_left(figures["left_s"])]))),
    ]
    if enough := _enough(figures):
        rows.append(("holds that would settle", enough))
    if said := sampling(figures):
        rows.append(("sampling", said))
    _common.print_table(("", ""), rows, str(store.path))
    unended = "still running" if figures["running"] else "killed"
    for session in store.sessions():
        end = session.end or unended
        typer.echo(f"{session.began}: {session.mode}, from point {session.first} on; {end}")


def _export(store: Path, save: Path | None, force: bool, as_json: bool) -> None:
    from minorloop.lab.run import measured_sines
    from minorloop.lab.sines import sines_as_log
    from minorloop.lab.store import Store

    _common.check_outputs([save], inputs=[store], force=force)
    with Store.open(store) as opened:
        running, names = opened.running, (opened.setup.input, opened.setup.output)
        sines = opened.plan.sines
        columns: dict[str, Any] = (
            sines_as_log(measured_sines(opened), *names) if sines else opened.columns()
        )
    rows = len(next(iter(columns.values())))
    more = "; the run continues" if running else ""
    said = f"{rows} {'samples' if sines else 'settled points'} written to {{}}{more}"

    def show() -> None:
        if save is None:
            typer.echo(table_text(columns, zip(*columns.values(), strict=True)), nl=False)

    content = {"rows": rows, "columns": columns}
    file = _common.table(save, columns, force, said)
    _common.finish(as_json, lambda: content, show, file)
