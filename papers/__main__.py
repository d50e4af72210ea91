"""``python -m papers NAME``: the experiments of a paper, carried out on simulated specimens."""

from __future__ import annotations

import inspect
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.main

from minorloop import cli
from minorloop.cli import _common
from minorloop.errors import MinorloopError, ParameterError
from minorloop.files import write_atomically
from minorloop.lab.signals import ended_by_signals
from minorloop.threads import one_thread

STUDIES = {
    "ipmc": "papers.ipmc",
    "fibre": "papers.fibre",
    "design": "papers.design",
    "benchmark": "papers.benchmark",
    "stage": "papers.stage",
    "head": "papers.catheter.head",
    "inspection": "papers.catheter.inspection",
}
"""The module of each; that of its report has ``_report`` at the end of its name."""
_FIGURES, _UNFINISHED = "figures.json", "unfinished.json"
_MOST, _MOST_SCENES = 1000, 100_000
"""Largest counts: days of computation, so that more is a typing error."""


def run(
    name: Annotated[
        str,
        typer.Argument(
            show_default=False,
            help=f"Which one: {', '.join(STUDIES)}.",
        ),
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
        typer.Option(
            help="Only this part: integral, rivals (by the camera alone) or unreachable (with "
            "more cases) of head, missions, scans or sweeps of inspection."
        ),
    ] = None,
    as_json: _common.Json = False,
) -> None:
    """Carry out a whole experiment on simulated specimens, and compare it with its claims.

    One specimen takes fifteen seconds to a minute, for head and inspection three to fifteen
    minutes; stderr has a line for each, and for each part of the first one of these two. Until the
    last is done, unfinished.json in the folder has the figures of those before, also after an
    interruption.
    """
    module = _module_of(name)
    if not 1 <= specimens <= _MOST:
        raise ParameterError(f"--specimens is {specimens}; give 1 to {_MOST}")
    if seed < 0:
        raise ParameterError(f"--seed is {seed}; give 0 or more")
    counts = {"scenes": scenes, "scans": scans}
    options = _shared_out(name, counts, specimens)
    if only is not None:
        module = _part_of(name, module, only, options)
    if out is not None:
        from minorloop.files import make_folder

        make_folder(out)
    found = _Specimens(specimens, seed, out)
    with (
        ended_by_signals(),
        _common.interruptible(found.kept),
        found.failing(),
        _common.working(f"specimen 1 of {specimens}", logged=True) as now,
    ):
        study = import_module(module)
        claims = import_module("papers.claims")
        work = partial(_figures_of, module, options)
        with claims.begun(work, specimens - 1, seed + 1) as others:
            with one_thread():
                began = time.monotonic()
                first = study.run_study(seed, **options, **_telling(study, seed, now))
            found.add(study, first.figures(), time.monotonic() - began, now)
            for figures, seconds in others:
                found.add(study, figures, seconds, now)
    runs, figures = found.runs, found.gathered
    shown = {**figures, "specimens": specimens, "seed": seed}
    steps: list[Callable[[], None]] = [partial(_show, study, shown, as_json)]
    if out is not None:
        steps.insert(0, partial(write_atomically, out / _FIGURES, _common.json_text(shown)))
        if only is None:
            steps.insert(0, partial(_report, module, first, figures, runs, out, as_json))
    _common.do_all(steps)


def _telling(study: Any, seed: int, now: _common.Progress) -> dict[str, Any]:
    """Return the option of a study that says which parts of a specimen are done, if it has one."""
    if "told" not in inspect.signature(study.run_study).parameters:
        return {}
    return {"told": lambda part: now(f"seed {seed}, {part}", kept=True)}


def _module_of(name: str) -> str:
    """Return the module of a study."""
    if name not in STUDIES:
        raise ParameterError(f"there is no study {name!r}; give one of {', '.join(STUDIES)}")
    return STUDIES[name]


def _part_of(name: str, module: str, only: str, options: Mapping[str, int]) -> str:
    """Return the module of a part of a study, which has no report and takes these options."""
    parts: Mapping[str, str] = getattr(import_module(module), "PARTS", {})
    if only not in parts:
        known = f"give {', '.join(parts)}" if parts else f"{name} has no parts"
        raise ParameterError(f"--only is {only!r}; {known}")
    taken = inspect.signature(import_module(parts[only]).run_study).parameters
    for option in options:
        if option not in taken:
            raise ParameterError(f"--{option} is not for --only {only}; leave it out")
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


class _Specimens:
    """Figures of the specimens that are done; those of an unfinished study are kept in its folder.

    Parameters
    ----------
    wanted : int
        Number of specimens.
    seed : int
        Of the first.
    folder : path, optional
        For the figures so far.
    """

    def __init__(self, wanted: int, seed: int, folder: Path | None) -> None:
        self._wanted, self._seed = wanted, seed
        self._file = None if folder is None else folder / _UNFINISHED
        self.runs: list[Mapping[str, Any]] = []
        self.gathered: dict[str, Any] = {}

    def add(
        self, study: Any, figures: Mapping[str, Any], seconds: float, now: _common.Progress
    ) -> None:
        """Add the figures of the next specimen, say how long it took, and write those so far."""
        from papers.claims import medians

        seed = self._seed + len(self.runs)
        self.runs.append(figures)
        self.gathered = getattr(study, "gather", medians)(self.runs)
        done = len(self.runs)
        now(f"specimen {done} of {self._wanted}, seed {seed}: {seconds:.0f} s", kept=True)
        if done < self._wanted:
            self._write()
            now(f"specimen {done + 1} of {self._wanted}")
        elif self._file is not None:
            self._file.unlink(missing_ok=True)

    def _write(self) -> None:
        if self._file is not None:
            begun = {"unfinished": True, "specimens": len(self.runs), "of": self._wanted}
            content = {**self.gathered, **begun, "seed": self._seed}
            write_atomically(self._file, _common.json_text(content))

    @contextmanager
    def failing(self) -> Iterator[None]:
        """Name the specimen that cannot be done, and say what is kept."""
        try:
            yield
        except MinorloopError:
            typer.echo(f"! seed {self._seed + len(self.runs)}: {self.kept()}", err=True)
            raise

    def kept(self) -> str:
        """Return in words what an interruption or an error leaves."""
        done = f"{len(self.runs)} of {self._wanted} specimens are done"
        if not self.runs:
            return f"{done}; nothing is kept"
        if self._file is None:
            return f"{done}; nothing is kept without --out"
        return f"{done}; their figures are in {self._file}"


def _figures_of(module: str, options: Mapping[str, int], seed: int) -> tuple[dict[str, Any], float]:
    """Return the figures of one specimen and how long it took, in a process of its own."""
    study = import_module(module)
    began = time.monotonic()
    found: dict[str, Any] = study.run_study(seed, **options).figures()
    return found, time.monotonic() - began


def _show(study: Any, figures: Mapping[str, Any], as_json: bool) -> None:
    if as_json:
        _common.print_json(figures)
        return
    specimens = figures["specimens"]
    claims = import_module("papers.claims")
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


def command() -> Any:
    """Return the command as the parser has it."""
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(epilog="Example: python -m papers ipmc --out ipmc --specimens 4")(run)
    return typer.main.get_command(app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; statuses and errors are those of ``minorloop``."""
    return cli.main(arguments, command, "python -m papers")


if __name__ == "__main__":
    sys.exit(main())
