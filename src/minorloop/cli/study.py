"""``minorloop study``: reproduce the experiments of a paper on simulated specimens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from minorloop.cli import _common
from minorloop.cli._completion import one_of
from minorloop.errors import MissingExtraError, ParameterError
from minorloop.threads import one_thread

NAME = "study"
EXAMPLE = "minorloop study ipmc --out ipmc --specimens 4"
STUDIES = "minorloop.studies"
_MOST, _MOST_SCENES = 1000, 100_000
"""Largest counts: days of computation, so that more is a typing error."""


def _studies() -> list[str]:
    from minorloop.lab.registry import registered

    return list(registered(STUDIES))


def _study_help() -> str:
    return f"Which one: {', '.join(_studies())}."


class StudyCommand(_common.LateHelp):
    """``minorloop study``; its help lists the studies that exist."""

    late: ClassVar = {"name": _study_help}


COMMAND = StudyCommand


def run(
    name: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help="Which one, such as ipmc, fibre or design.",
            autocompletion=one_of(_studies),
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="New or empty folder for the report.")] = None,
    specimens: Annotated[
        int, _common.whole_option("Specimens; figures are medians over them.")
    ] = 1,
    seed: Annotated[int, _common.whole_option("Seed of the first specimen, 0 or more.")] = 0,
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
        typer.Option(help="For head: only this part, with more cases; unreachable."),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Carry out a whole experiment on simulated specimens, and compare it with its claims.

    One specimen takes fifteen seconds to a minute, for head and inspection two to four minutes.
    """
    module = _module_of(name)
    if not 1 <= specimens <= _MOST:
        raise ParameterError(f"--specimens is {specimens}; give 1 to {_MOST}")
    if seed < 0:
        raise ParameterError(f"--seed is {seed}; give 0 or more")
    counts = {"scenes": scenes, "scans": scans}
    options = _shared_out(name, counts, specimens)
    if only is not None:
        module = _part_of(name, module, only, out)
    if out is not None:
        from minorloop.files import make_folder

        make_folder(out)
        _check_surfaces(name)
    with _common.working(f"specimen 1 of {specimens}") as now:
        study = import_module(module)
        claims = import_module("minorloop.studies.claims")
        with one_thread():
            first = study.run_study(seed, **options)
        work = partial(_figures_of, module, options)
        others = claims.for_each(work, specimens - 1, seed + 1, now) if specimens > 1 else []
        runs = [first.figures(), *others]
        figures = getattr(study, "gather", claims.medians)(runs)
    steps: list[Callable[[], None]] = [partial(_show, study, figures, specimens, seed, as_json)]
    if out is not None:
        steps.insert(0, partial(_report, module, first, figures, runs, out, as_json))
    _common.do_all(steps)


def _check_surfaces(name: str) -> None:
    """Say before a long study that what writes its surfaces is not installed."""
    if name == "inspection" and find_spec("trimesh") is None:
        typer.echo(f"surfaces are not written: {MissingExtraError('trimesh', 'head')}", err=True)


def _module_of(name: str) -> str:
    """Return the module of a study; the module of its report has ``_report`` at the end."""
    from minorloop.lab.registry import registered

    studies = registered(STUDIES)
    if name not in studies:
        raise ParameterError(f"there is no study {name!r}; give one of {', '.join(studies)}")
    return studies[name].value


def _part_of(name: str, module: str, only: str, out: Path | None) -> str:
    """Return the module of a part of a study, which has no report."""
    parts: Mapping[str, str] = getattr(import_module(module), "PARTS", {})
    if only not in parts:
        known = f"give {', '.join(parts)}" if parts else f"{name} has no parts"
        raise ParameterError(f"--only is {only!r}; {known}")
    if out is not None:
        raise ParameterError("a part of a study has no report; leave out --out or --only")
    return parts[only]


def _shared_out(name: str, counts: Mapping[str, int | None], specimens: int) -> dict[str, int]:
    """Return how many scenes and scans each specimen has."""
    shares = {}
    for option, count in counts.items():
        if count is None:
            continue
        if name != "inspection":
            raise ParameterError(f"--{option} is for the study inspection; {name} has none")
        if not 1 <= count <= _MOST_SCENES:
            raise ParameterError(f"--{option} is {count}; give 1 to {_MOST_SCENES}")
        shares[option] = -(-count // specimens)
    return shares


def _figures_of(module: str, options: Mapping[str, int], seed: int) -> dict[str, Any]:
    """Return the figures of one specimen, in a process of its own."""
    found: dict[str, Any] = import_module(module).run_study(seed, **options).figures()
    return found


def _show(study: Any, figures: Mapping[str, Any], specimens: int, seed: int, as_json: bool) -> None:
    if as_json:
        _common.print_json({**figures, "specimens": specimens, "seed": seed})
        return
    claims = import_module("minorloop.studies.claims")
    table = claims.claim_table(study.CLAIMS, figures)
    title = f"{study.TITLE}: {specimens} simulated specimen{'s' if specimens > 1 else ''}"
    if specimens == 1:
        title += "; bounds are for the median of many (--specimens 20)"
    _common.print_table(table.columns, table.rows, title)


def _report(
    module: str,
    first: Any,
    figures: Mapping[str, Any],
    runs: Sequence[Mapping[str, Any]],
    folder: Path,
    as_json: bool,
) -> None:
    path = folder / "report.html"
    page = import_module(f"{module}_report")
    with _common.working("drawing the report"):
        _common.write_report(partial(page.study_report, first, figures, runs), path, force=False)
        beside = page.save_beside(first, folder) if hasattr(page, "save_beside") else []
    if hasattr(page, "save_beside") and not beside:
        typer.echo(page.nothing_found(first.mission), err=True)
    if not as_json:
        typer.echo(f"report written to {path}; open it in a browser")
        for written in beside:
            typer.echo(f"written: {written}")
