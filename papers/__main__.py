"""``python -m papers NAME``: the experiments of a paper, carried out on simulated specimens."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.main

from minorloop import cli
from minorloop.cli import _common
from minorloop.errors import MinorloopError, ParameterError, all_done
from minorloop.files import make_folder, write_atomically
from minorloop.lab.signals import ended_by_signals
from papers.claims import claim_table
from papers.harness import Specimens, Study, study_of

STUDIES = {
    "ipmc": "papers.ipmc",
    "fibre": "papers.fibre",
    "design": "papers.design",
    "benchmark": "papers.benchmark",
    "stage": "papers.stage",
    "head": "papers.catheter.head_report",
    "inspection": "papers.catheter.inspection",
}
"""The module of each."""
_MOST, _MOST_SCENES = 1000, 100_000
"""Largest counts: days of computation, so that more is a typing error."""


def run(
    name: Annotated[
        str, typer.Argument(show_default=False, help=f"Which one: {', '.join(STUDIES)}.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="New or empty folder for the report, and its figures as JSON; a part has no "
            "report."
        ),
    ] = None,
    specimens: Annotated[
        int, _common.whole_option("Specimens; figures are medians over them.")
    ] = 1,
    seed: Annotated[int, _common.whole_option("Seed of the first specimen, 0 to 4294967295.")] = 0,
    scenes: Annotated[
        int | None,
        _common.whole_option(
            "For inspection: scenes with a hole, and as many without, and the same of cracks, over "
            "all specimens; 4 for each specimen if not given."
        ),
    ] = None,
    scans: Annotated[
        int | None,
        _common.whole_option(
            "For inspection: pits with a flat floor that are measured, over all specimens; 6 for "
            "each specimen if not given."
        ),
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(
            help="Only this part: integral, rivals (by the camera alone) or unreachable (with "
            "more cases) of head, missions, scans or sweeps of inspection."
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Carry out a whole experiment on simulated specimens, and compare it with its claims.

    A specimen takes fifteen seconds to a minute, for head and inspection three to fifteen minutes.
    stderr has a line for each specimen, and for each part of the first specimen of head and
    inspection. Until the last one is done, unfinished.json in the folder has the figures so far,
    also after an interruption.
    """
    if name not in STUDIES:
        raise ParameterError(f"there is no study {name!r}; give one of {', '.join(STUDIES)}")
    module = STUDIES[name]
    if not 1 <= specimens <= _MOST:
        raise ParameterError(f"--specimens is {specimens}; give 1 to {_MOST}")
    if not 0 <= seed < 2**32:
        raise ParameterError(f"--seed is {seed}; give 0 to {2**32 - 1}")
    study = study_of(module)
    if only is not None:
        if only not in study.parts:
            known = f"give {', '.join(study.parts)}" if study.parts else f"{name} has no parts"
            raise ParameterError(f"--only is {only!r}; {known}")
        module = study.parts[only]
        study = study_of(module)
    options = _shared_out(
        name if only is None else f"--only {only}", study, specimens, scenes=scenes, scans=scans
    )
    if out is not None:
        make_folder(out)
    unfinished = None if out is None else out / "unfinished.json"
    found = Specimens(study, specimens, seed, unfinished, _common.json_text)
    with (
        ended_by_signals(),
        _common.interruptible(found.kept),
        _common.working(f"specimen 1 of {specimens}", logged=True) as now,
    ):
        try:
            found.run(module, options, now)
        except MinorloopError:
            typer.echo(f"! seed {found.next_seed}: {found.kept()}", err=True)
            raise
    shown = {**found.gathered, "specimens": specimens, "seed": seed}
    steps: list[Callable[[], None]] = [partial(_show, study, shown, as_json)]
    if out is not None:
        steps.insert(0, partial(write_atomically, out / "figures.json", _common.json_text(shown)))
        if only is None:
            steps.insert(0, partial(_report, study, found, out, as_json))
    all_done(steps)


def _shared_out(name: str, study: Study, specimens: int, **counts: int | None) -> dict[str, int]:
    """Return the numbers of scenes and scans of each specimen."""
    shares = {}
    for option, count in counts.items():
        if count is None:
            continue
        if option not in study.options:
            raise ParameterError(f"--{option} is not for {name}; leave it out")
        if not 1 <= count <= _MOST_SCENES:
            raise ParameterError(f"--{option} is {count}; give 1 to {_MOST_SCENES}")
        shares[option] = -(-count // specimens)
    return shares


def _show(study: Study, figures: Mapping[str, Any], as_json: bool) -> None:
    if as_json:
        _common.print_json(figures)
        return
    specimens = figures["specimens"]
    table = claim_table(study.claims, figures)
    title = f"{study.title}: {specimens} simulated specimen{'s' if specimens > 1 else ''}"
    if specimens == 1:
        title += "; bounds are for the median of many (--specimens 20)"
    _common.print_table(table.columns, table.rows, title)


def _report(study: Study, found: Specimens, folder: Path, as_json: bool) -> None:
    path = folder / "report.html"
    draw = partial(study.report, found.first, found.gathered, found.runs)
    with _common.working("drawing the report"):
        _common.write_report(draw, path, force=False)
        said = study.beside(found.first, folder) if study.beside is not None else []
    if not as_json:
        for line in (f"report written to {path}; open it in a browser", *said):
            typer.echo(line)


def command() -> Any:
    """Return the command of the parser."""
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(epilog="Example: python -m papers ipmc --out ipmc --specimens 4")(run)
    return typer.main.get_command(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; statuses and errors are those of ``minorloop``."""
    return cli.main(arguments, command, "python -m papers")


if __name__ == "__main__":
    sys.exit(main())
