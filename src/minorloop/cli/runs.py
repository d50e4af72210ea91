"""``minorloop runs``: list experiment stores, show them, and export their points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from minorloop.cli import _common
from minorloop.cli._braille import scatter
from minorloop.cli._completion import one_of
from minorloop.cli.run import sampling, summary
from minorloop.errors import ParameterError, StoreError
from minorloop.files import table_text
from minorloop.lab.durations import as_duration

if TYPE_CHECKING:
    from minorloop.lab.store import Store

NAME = "runs"
EXAMPLE = "minorloop runs export --store runs.sqlite --save points.csv"
_ACTIONS = ("list", "show", "export")


def run(
    action: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="list (one line for each store), show (its points), or export (one row for each "
            "point).",
            autocompletion=one_of(_ACTIONS),
        ),
    ],
    store: Annotated[
        Path,
        typer.Option(
            show_default=False, help="The store that run wrote; for list, also a folder of stores."
        ),
    ],
    save: _common.Save = None,
    force: _common.Force = False,
    as_json: _common.Json = False,
) -> None:
    """List or show experiment stores, or export their settled points."""
    if action not in _ACTIONS:
        known = ", ".join(_ACTIONS)
        raise ParameterError(f"there is no action {action!r}; give one of {known}")
    if save is not None and action != "export":
        raise ParameterError(f"--save is for export, not for {action}; leave it out")
    if action == "list":
        _list(store, as_json)
    elif action == "show":
        _show(store, as_json)
    else:
        _export(store, save, force, as_json)


def _list(place: Path, as_json: bool) -> None:
    from minorloop.lab.store import Store, is_store

    files = sorted(filter(is_store, place.iterdir())) if place.is_dir() else [place]
    if not files:
        raise StoreError(f"there is no experiment store in {place}; minorloop run writes one")
    found, damaged = [], []
    for file in files:
        try:
            with Store.open(file) as opened:
                found.append(summary(opened))
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
            "finished" if figures["finished"] else "not finished",
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
            _common.print_json(
                {**summary(opened), "sessions": sessions, "columns": opened.columns()}
            )
            return
        _print(opened)


def _print(store: Store) -> None:
    figures = summary(store)
    rows = [
        ("actuator", str(figures["actuator"])),
        ("specimen", "nominal" if figures["specimen"] is None else str(figures["specimen"])),
        ("seed of the noise", str(figures["seed"])),
        ("plan", str(store.plan)),
        ("points", f"{figures['points']} of {figures['levels']}"),
        *((name, str(figures[name])) for name in ("settled", "extrapolated", "unsettled")),
        ("held", as_duration(figures["held_s"])),
    ]
    if said := sampling(figures):
        rows.append(("sampling", said))
    _common.print_table(("", ""), rows, str(store.path))
    for session in store.sessions():
        end = session.end or "killed, or still running"
        typer.echo(f"{session.began}: {session.mode}, from point {session.first} on; {end}")
    points, (u, y) = store.points(), store.outputs
    if points:
        typer.echo(f"\n{y} against {u}")
        for line in scatter([([p.input for p in points], [p.value for p in points])], 60, 14):
            typer.echo(line)


def _export(file: Path, save: Path | None, force: bool, as_json: bool) -> None:
    from minorloop.lab.store import Store

    _common.check_outputs([save], inputs=[file], force=force)
    with Store.open(file) as opened:
        columns = opened.columns()
    rows = len(columns["index"])
    if save is not None:
        _common.write_csv(save, columns, force=force)
    if as_json:
        _common.print_json({"rows": rows, "columns": columns})
    elif save is not None:
        typer.echo(f"{rows} settled points written to {save}")
    else:
        typer.echo(table_text(columns, zip(*columns.values(), strict=True)), nl=False)
