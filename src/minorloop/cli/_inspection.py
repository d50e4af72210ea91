"""What ``minorloop head inspect`` writes: all of it at once, so that nothing measured is lost."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError, RecordError, SafetyError, counted

if TYPE_CHECKING:
    from minorloop.head.procedures.inspection import InspectedView, Unconfirmed
    from minorloop.head.procedures.rig import LogEntry
    from minorloop.head.reconstruction.findings import Finding
    from minorloop.report import Report

FINISHED = "finished"
_VISITS = ("hole", "crack", "device", "camera")
"""Steps whose outcome stays on the terminal: visits of candidates, failures of a device, and what
the camera cannot do."""
_LOST_COLUMNS = ("kind", "phi [deg]", "z [mm]", "evidence", "seen in", "why")
"""Of candidates that were not confirmed."""
_COLUMNS = ("kind", "phi [deg]", "z [mm]", "width [mm]", "length [mm]", "evidence", "picture")


def carried_out(
    actuator: str, camera: str, head: Path, out: Path, advances: Sequence[float]
) -> dict[str, Any]:
    """Inspect the wall, and return the content of ``findings.json``.

    Whatever ends it, the head is made safe, and what was found until then is kept.

    Parameters
    ----------
    actuator, camera : str
        Addresses.
    head : path
        File of the head.
    out : path
        New or empty folder.
    advances : sequence of float
        In metres.
    """
    from minorloop.files import new_folder
    from minorloop.head.procedures.head_file import read_head
    from minorloop.head.procedures.inspection import inspect_wall
    from minorloop.head.procedures.rig import rig_at

    serial = read_head(head).serial
    kept: InspectionFolder | None = None
    opening = _common.working("opening the devices", logged=True)
    with new_folder(out) as folder, opening as now:

        def told(entry: LogEntry) -> None:
            now(f"{entry.what}: {entry.outcome}", kept=entry.what.startswith(_VISITS))
            if kept is not None:
                kept.log(entry)

        try:
            with rig_at(actuator, camera, head, told) as rig:
                if not rig.travels and any(advances):
                    raise ParameterError(
                        f"{actuator} has no catheter, so that it looks round from 0 mm only; leave "
                        "--advances out"
                    )
                kept = InspectionFolder(folder, head=serial, actuator=actuator, camera=camera)
                for view in inspect_wall(rig, advances):
                    kept.add(view)
        except BaseException as error:
            if kept is not None:
                content = kept.end(_reason(error), not isinstance(error, SafetyError))
                typer.echo(f"{summary(content)}; kept in {out}", err=True)
            elif isinstance(error, KeyboardInterrupt):
                typer.echo("nothing was inspected yet, and nothing is kept", err=True)
            raise
    return kept.end(FINISHED, True)


class InspectionFolder:
    """A journal, the findings so far, and pictures.

    Parameters
    ----------
    folder : path
        Existing and empty.
    **begun
        What is inspected, and by what.
    """

    def __init__(self, folder: Path, **begun: Any) -> None:
        self._folder, self._began = folder, time.monotonic()
        self._content = {**begun, "began": f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}"}
        self._views: list[InspectedView] = []
        self._marked: list[tuple[str, Any]] = []
        (folder / "pictures").mkdir()
        self._journal = (folder / "journal.jsonl").open("x", encoding="utf-8")
        self._note("begin", **self._content)
        self._write_findings()

    def log(self, entry: LogEntry) -> None:
        """Note a step."""
        self._note("step", step=entry.what, outcome=entry.outcome)

    def add(self, view: InspectedView) -> None:
        """Keep a view: its picture, and the finding if it has one."""
        from minorloop.head.procedures.pictures import annotated

        picture, (advance, roll) = view.picture, view.place
        self._views.append(view)
        self._write_picture(f"{picture.name}.png", view.image)
        self._note(
            "view",
            picture=f"{picture.name}.png",
            verdict=picture.verdict,
            pose={
                **_angles(view.joints),
                "advance [mm]": round(1e3 * advance, 4),
                "roll [deg]": round(math.degrees(roll), 4),
            },
            sight=_angles(view.angles),
            shown=picture.rows(),
            finding=None if view.finding is None else _row(view),
            unconfirmed=None if view.unconfirmed is None else _lost_row(view.unconfirmed),
        )
        if view.finding is not None:
            marked = annotated(view.image, picture.findings)
            self._write_picture(f"{picture.name} marked.jpg", marked)
            self._marked.append((picture.name, marked))
        if view.finding is not None or view.unconfirmed is not None:
            self._write_findings()

    def end(self, why: str, safe: bool) -> dict[str, Any]:
        """Note the end, write the report, and return the content of ``findings.json``.

        Parameters
        ----------
        why : str
            ``finished``, or what ended it.
        safe : bool
            Whether the head has confirmed that it is safe.
        """
        self._content |= {"ended": why, "safe": safe, "seconds": self._seconds()}
        self._note("end", why=why, safe=safe)
        self._write_findings()
        self._journal.close()
        _common.write_report(self._report, self._folder / "report.html", force=False)
        return self._all()

    def _all(self) -> dict[str, Any]:
        verdicts = [view.picture.verdict for view in self._views]
        bad = {each: verdicts.count(each) for each in sorted(set(verdicts)) if each != "good"}
        found = [_row(view) for view in self._views if view.finding is not None]
        return {
            **self._content,
            "views": len(self._views),
            "unusable": bad,
            "findings": found,
            "unconfirmed": self._lost(),
        }

    def _lost(self) -> list[dict[str, Any]]:
        """Return what was not confirmed, as rows."""
        return [_lost_row(view.unconfirmed) for view in self._views if view.unconfirmed is not None]

    def _write_findings(self) -> None:
        from minorloop.files import table_text, write_atomically
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
        if not opencv().imwrite(str(path), picture):
            raise OutputError(f"{path} cannot be written; check the disk")

    def _note(self, what: str, **content: Any) -> None:
        """Add a line to the journal; it is on the disk when this returns."""
        line = {"what": what, "t": self._seconds(), **content}
        self._journal.write(json.dumps(line) + "\n")
        self._journal.flush()
        os.fsync(self._journal.fileno())

    def _seconds(self) -> float:
        return round(time.monotonic() - self._began, 2)

    def _report(self) -> Report:
        from minorloop.report import Picture, Report, Table

        content = self._all()
        report = Report(f"Inspection by head {content['head']}", summary(content))
        rows = table(content["findings"], _COLUMNS)
        report.add("Findings", table=Table(_COLUMNS, rows))
        if content["unconfirmed"]:
            lost = table(content["unconfirmed"], _LOST_COLUMNS)
            report.add("Not confirmed", table=Table(_LOST_COLUMNS, lost))
        pictures = [Picture(figure_of(marked), name) for name, marked in self._marked]
        report.add("Pictures of the findings", pictures=pictures)
        return report


def journal_of(file: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal; one that was not written to its end is left out.

    Raises
    ------
    RecordError
        If it is no journal.
    """
    try:
        *lines, rest = file.read_text(encoding="utf-8").split("\n")
        found = [json.loads(line) for line in lines]
        if rest.endswith("}"):
            found.append(json.loads(rest))
    except (OSError, ValueError):
        found = []
    if not found or not all(isinstance(line, dict) and "what" in line for line in found):
        raise RecordError(f"{file} is not the journal of an inspection; give its journal.jsonl")
    return found


def figure_of(marked: Any) -> Any:
    """Return a colour picture of OpenCV as a figure."""
    from matplotlib.figure import Figure

    height, width = marked.shape[:2]
    figure = Figure(figsize=(5.0, 5.0 * height / width))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(marked[..., ::-1])
    axes.set_axis_off()
    return figure


def _angles(pair: tuple[float, float]) -> dict[str, float]:
    """Return pan and tilt in degrees."""
    return {
        f"{name} [deg]": round(math.degrees(angle), 4)
        for name, angle in zip(("pan", "tilt"), pair, strict=True)
    }


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return " ".join(str(error).split()) or type(error).__name__


def _row(view: InspectedView) -> dict[str, Any]:
    """Return a finding in degrees and millimetres, null where unknown."""
    found: Finding | None = view.finding
    assert found is not None
    row: dict[str, Any] = {}
    for name, value in asdict(found).items():
        if isinstance(value, str):
            row[name] = value
            continue
        angle = name.startswith("phi")
        shown = math.degrees(value) if angle else 1e3 * value
        row[f"{name} [{'deg' if angle else 'mm'}]"] = (
            round(shown, 4) if math.isfinite(value) else None
        )
    row["evidence"] = None if math.isnan(view.evidence) else round(view.evidence, 1)
    row["picture"] = f"{view.picture.name}.png"
    row["course"] = None if view.course is None else view.course.round(6).tolist()
    return row


def _lost_row(lost: Unconfirmed) -> dict[str, Any]:
    """Return a candidate that was not confirmed in degrees and millimetres."""
    return {
        "kind": lost.kind,
        "phi [deg]": round(math.degrees(lost.phi), 4),
        "z [mm]": round(1e3 * lost.z, 4),
        "evidence": None if math.isnan(lost.evidence) else round(lost.evidence, 1),
        "seen in": list(lost.seen_in),
        "why": lost.why,
    }


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
    lost = [counted(len(row["seen in"]), "view") for row in content["unconfirmed"]]
    more = "".join(
        f"; seen in {each} ({lost.count(each)}), not confirmed" for each in sorted(set(lost))
    )
    said = f"{found} in {views}{more}{f'; {share}' if bad else ''}; {content['ended']}"
    safe = "is safe, as confirmed" if content["safe"] else "did NOT confirm that it is safe"
    return f"{said}; no depth without a probe; the head {safe}"


def show(content: dict[str, Any], out: Path) -> None:
    """Print the findings."""
    if content["findings"]:
        _common.print_table(_COLUMNS, table(content["findings"], _COLUMNS))
    if content["unconfirmed"]:
        lost = table(content["unconfirmed"], _LOST_COLUMNS)
        _common.print_table(_LOST_COLUMNS, lost, "not confirmed")
    typer.echo(summary(content))
    typer.echo(f"kept in {out}")
