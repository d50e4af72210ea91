"""What ``minorloop head inspect`` writes: all of it at once, so that nothing measured is lost."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.cli._journal import (
    FINISHED,
    Journal,
    kept_views,
    lost_row,
    missed_row,
    resumed_lines,
    row,
    step_rows,
    view_line,
)
from minorloop.errors import OutputError, ParameterError, SafetyError, counted
from minorloop.files import new_folder, write_atomically

if TYPE_CHECKING:
    from minorloop.cli._inspected_head import InspectedHead
    from minorloop.head.procedures.calibration import HeadCalibration
    from minorloop.head.procedures.inspected_view import InspectedView
    from minorloop.head.procedures.rig import InspectionRig, LogEntry
    from minorloop.report import Report

_VISITS = ("hole", "crack", "device", "camera")
"""Steps whose outcome stays on the terminal: visits of candidates, failures of a device, and what
the camera cannot do."""
_LOST_COLUMNS = ("kind", "phi [deg]", "z [mm]", "evidence", "seen in", "why")
"""Of candidates that were not confirmed."""
_MISSED_COLUMNS = ("view", "verdict", "pan [deg]", "tilt [deg]", "advance [mm]", "roll [deg]")
"""Of directions that were not searched, as lines of sight, with the place of the catheter."""
_COLUMNS = (
    "kind",
    "verdict",
    "phi [deg]",
    "z [mm]",
    "width [mm]",
    "length [mm]",
    "evidence",
    "picture",
)


def carried_out(
    head: InspectedHead, out: Path, advances: Sequence[float], *, resume: bool = False
) -> dict[str, Any]:
    """Inspect the wall, and return the content of ``findings.json``.

    Whatever ends it, the head is made safe, and what was found until then is kept.

    Parameters
    ----------
    head : InspectedHead
    out : path
        New or empty folder.
    advances : sequence of float
        In metres.
    resume : bool
        Whether to go on with the inspection in the folder, which was cut off.
    """
    from minorloop.head.procedures.inspection import inspect_wall

    begun = {**head.begun, "advances [mm]": [round(1e3 * advance, 4) for advance in advances]}
    before = _Before.of(out, begun, head.view) if resume else _Before()
    kept: InspectionFolder | None = None
    opening = _common.working("opening the head", logged=True)
    with nullcontext(out) if resume else new_folder(out) as folder, opening as now:

        def told(entry: LogEntry) -> None:
            now(f"{entry.what}: {entry.outcome}", kept=entry.what.startswith(_VISITS))
            if kept is not None:
                kept.log(entry)

        try:
            with head.opened(told) as rig:
                _check_advances(rig, begun["actuator"], advances)
                kept = InspectionFolder(folder, begun, before, rig.calibration.radius)
                for view in inspect_wall(rig, advances, before.views):
                    kept.add(view)
        except BaseException as error:
            if kept is not None:
                content = kept.end(_reason(error), not isinstance(error, SafetyError))
                typer.echo(f"{summary(content)}; kept in {out}", err=True)
            elif isinstance(error, KeyboardInterrupt):
                typer.echo(
                    f"what was found before is kept in {out}"
                    if resume
                    else "nothing was inspected yet, and nothing is kept",
                    err=True,
                )
            raise
    return kept.end(FINISHED, True)


def _check_advances(rig: InspectionRig, actuator: str, advances: Sequence[float]) -> None:
    """Refuse places that a head does not reach."""
    if not rig.travels and any(advances):
        raise ParameterError(
            f"{actuator} has no catheter, so that it looks round from 0 mm only; leave --advances "
            "out"
        )
    far, length = max(advances), rig.calibration.length
    if length is not None and far > length:
        raise ParameterError(
            f"--advances has {1e3 * far:g}, and the pipe ends at {1e3 * length:g} mm; give less"
        )


@dataclass(frozen=True)
class _Before:
    """What is known of an inspection that was cut off: nothing of a new one.

    Parameters
    ----------
    lines : tuple of dict
        Of its journal.
    views : tuple of InspectedView
        That need not be taken again.
    """

    lines: tuple[dict[str, Any], ...] = ()
    views: tuple[InspectedView, ...] = ()

    @classmethod
    def of(cls, folder: Path, begun: dict[str, Any], view: HeadCalibration | None) -> _Before:
        """Return it by the journal in a folder; refuse one of another inspection."""
        lines = resumed_lines(folder, begun, "inspection")
        return cls(tuple(lines), () if view is None else tuple(kept_views(folder, lines, view)))


class InspectionFolder:
    """A journal, the findings so far, and pictures.

    Parameters
    ----------
    folder : path
        Existing, and empty but for an inspection that was cut off.
    begun : dict
        What is inspected, and by what.
    before : _Before
        What is known of an inspection that was cut off.
    radius : float
        Of the pipe, in metres.
    """

    def __init__(self, folder: Path, begun: dict[str, Any], before: _Before, radius: float) -> None:
        self._folder, self._views, self._radius = folder, list(before.views), radius
        self._marked: list[tuple[str, Any]] = []
        (folder / "pictures").mkdir(exist_ok=bool(before.lines))
        self._journal = Journal(folder, begun, before.lines, views=len(self._views))
        self._content = {**begun, "began": self._journal.began}
        for view in self._views:
            self._mark(view)
        self._write_findings()

    def log(self, entry: LogEntry) -> None:
        """Note a step."""
        self._journal.note(
            "step", step=entry.what, outcome=entry.outcome, succeeded=entry.succeeded
        )

    def add(self, view: InspectedView) -> None:
        """Keep a view: its picture, and the finding if it has one."""
        self._views.append(view)
        self._write_picture(f"{view.picture.name}.png", view.image)
        self._journal.note("view", **view_line(view))
        self._mark(view)
        self._write_findings()

    def _mark(self, view: InspectedView) -> None:
        """Write the picture of a view with its finding marked, if it has one."""
        from minorloop.head.procedures.pictures import annotated

        if view.finding is not None:
            marked = annotated(view.image, view.picture.findings)
            self._write_picture(f"{view.picture.name} marked.jpg", marked)
            self._marked.append((view.picture.name, marked))

    def end(self, why: str, safe: bool) -> dict[str, Any]:
        """Note the end, write the report, and return the content of ``findings.json``.

        Parameters
        ----------
        why : str
            ``finished``, or what ended it.
        safe : bool
            Whether the head has confirmed that it is safe.
        """
        self._content |= {"ended": why, "safe": safe, "seconds": self._journal.seconds()}
        self._journal.note("end", why=why, safe=safe)
        self._write_findings()
        self._journal.close()
        _common.write_report(self._report, self._folder / "report.html", force=True)
        return self._all()

    def _all(self) -> dict[str, Any]:
        from minorloop.head.vision.frame_checks import GOOD

        verdicts = [view.picture.verdict for view in self._views]
        bad = {each: verdicts.count(each) for each in sorted(set(verdicts)) if each != GOOD}
        found = [
            {**row(view), "steps": step_rows(view)}
            for view in self._views
            if view.finding is not None
        ]
        return {
            **self._content,
            "views": len(self._views),
            "unusable": bad,
            "not searched": [
                missed_row(view)
                for view in self._views
                if view.looks_round and view.picture.verdict != GOOD
            ],
            "findings": found,
            "unconfirmed": self._lost(),
        }

    def _lost(self) -> list[dict[str, Any]]:
        """Return what was not confirmed, or not visited yet, as rows."""
        from minorloop.head.procedures.inspection import unvisited

        lost = [view.unconfirmed for view in self._views if view.unconfirmed is not None]
        return [lost_row(each) for each in (*lost, *unvisited(self._views, self._radius))]

    def _write_findings(self) -> None:
        from minorloop.files import table_text
        from minorloop.head.reconstruction.findings import finding_table

        found = [view.finding for view in self._views if view.finding is not None]
        write_atomically(self._folder / "findings.csv", finding_table(found))
        lost = table_text(_LOST_COLUMNS, table(self._lost(), _LOST_COLUMNS))
        write_atomically(self._folder / "unconfirmed.csv", lost)
        text = json.dumps(self._all(), indent=1)
        write_atomically(self._folder / "findings.json", f"{text}\n")

    def _write_picture(self, name: str, picture: Any) -> None:
        from minorloop.head.vision.imaging import opencv

        path = self._folder / "pictures" / name
        whole, data = opencv().imencode(path.suffix, picture)
        if not whole:
            raise OutputError(f"{path} cannot be written; check the disk")
        write_atomically(path, data.tobytes())  # it is on the disk before the journal names it

    def _report(self) -> Report:
        from minorloop.report import Picture, Report, Table

        content = self._all()
        report = Report(f"Inspection by head {content['head']}", summary(content))
        rows = table(content["findings"], _COLUMNS)
        report.add("Findings", table=Table(_COLUMNS, rows))
        if content["unconfirmed"]:
            lost = table(content["unconfirmed"], _LOST_COLUMNS)
            report.add("Not confirmed", table=Table(_LOST_COLUMNS, lost))
        if content["not searched"]:
            missed = table(content["not searched"], _MISSED_COLUMNS)
            report.add("Not searched", table=Table(_MISSED_COLUMNS, missed))
        pictures = [Picture(figure_of(marked), name) for name, marked in self._marked]
        report.add("Pictures of the findings", pictures=pictures)
        return report


def figure_of(marked: Any) -> Any:
    """Return a colour picture of OpenCV as a figure."""
    from matplotlib.figure import Figure

    height, width = marked.shape[:2]
    figure = Figure(figsize=(5.0, 5.0 * height / width))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(marked[..., ::-1])
    axes.set_axis_off()
    return figure


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return " ".join(str(error).split()) or type(error).__name__


def table(rows: Sequence[dict[str, Any]], columns: Sequence[str]) -> list[list[str]]:
    """Return findings, or candidates that were not confirmed, as rows of text."""
    return [[_cell(row[name]) for name in columns] for row in rows]


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(value)
    return "" if value is None else str(value)


def summary(content: dict[str, Any]) -> str:
    """Return what was found in how many views, and how it ended."""
    found, views = counted(len(content["findings"]), "finding"), counted(content["views"], "view")
    bad = ", ".join(f"{verdict} ({count})" for verdict, count in content["unusable"].items())
    share = f"{sum(content['unusable'].values())} of {views} not usable: {bad}"
    missed = "".join(
        f"; not searched: pan {row['pan [deg]']:.1f}, tilt {row['tilt [deg]']:.1f} deg at "
        f"{row['advance [mm]']:.1f} mm"
        for row in content["not searched"]
    )
    less = f"{_not_found(content['unconfirmed'])}{f'; {share}' if bad else ''}{missed}"
    said = f"{found} in {views}{less}; {content['ended']}"
    safe = "is safe, as confirmed" if content["safe"] else "did NOT confirm that it is safe"
    return f"{said}; no depth without a probe; the head {safe}"


def _not_found(unconfirmed: Sequence[dict[str, Any]]) -> str:
    """Return how many candidates were not confirmed, and how many not visited."""
    from minorloop.head.procedures.inspection import NOT_VISITED

    lost = [
        counted(len(row["seen in"]), "view") for row in unconfirmed if row["why"] != NOT_VISITED
    ]
    words = [f"; seen in {each} ({lost.count(each)}), not confirmed" for each in sorted(set(lost))]
    left = len(unconfirmed) - len(lost)
    return "".join([*words, f"; {left} {NOT_VISITED}" if left else ""])


def show(content: dict[str, Any], out: Path) -> None:
    """Print the findings."""
    if content["findings"]:
        _common.print_table(_COLUMNS, table(content["findings"], _COLUMNS))
    if content["unconfirmed"]:
        lost = table(content["unconfirmed"], _LOST_COLUMNS)
        _common.print_table(_LOST_COLUMNS, lost, "not confirmed")
    typer.echo(summary(content))
    typer.echo(f"kept in {out}")
