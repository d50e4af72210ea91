"""What ``minorloop head inspect`` writes: all of it at once, so that nothing measured is lost."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from minorloop.cli import _common
from minorloop.errors import OutputError, ParameterError, SafetyError, counted
from minorloop.files import make_folder, new_folder, write_atomically
from minorloop_head.cli._inspection_report import (
    ANGLES,
    COLUMNS,
    LOST_COLUMNS,
    THROUGH,
    finding_cells,
    inspection_report,
    not_found,
    table,
    wall_words,
)
from minorloop_head.cli._journal import (
    FINISHED,
    Journal,
    Resumed,
    kept_views,
    lost_row,
    missed_row,
    outcomes,
    row,
    step_rows,
    view_line,
)
from minorloop_head.cli._probe_journal import kept_probing, ring_line, scan_line

if TYPE_CHECKING:
    from minorloop.report import Report
    from minorloop_head.cli._inspection_head import InspectedHead
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.procedures.inspected_view import InspectedView, Unconfirmed
    from minorloop_head.procedures.inspected_wall import SeenWall
    from minorloop_head.procedures.probe_steps import ScannedRaster
    from minorloop_head.procedures.probing import Probing
    from minorloop_head.procedures.rig import InspectionRig, LogEntry
    from minorloop_head.procedures.ring import Ring
    from minorloop_head.reconstruction.depth_map import DepthMap, WaterLine
    from minorloop_head.ultrasound.c_scan import CScan

_VISITS = ("hole", "crack", "device", "camera", "lens", "reach", "touch", "measure", "water line")
"""Steps whose outcome stays on the terminal: visits of candidates, results of the probe, failures
of a device, and what the camera cannot do."""
_STEP = ("t", "step", "outcome", "succeeded")
"""What the results have of a line of the journal."""


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
    from minorloop_head.procedures.inspection import inspect_wall

    begun = {**head.begun, "advances [mm]": [round(1e3 * advance, 4) for advance in advances]}
    before = _Before.of(out, begun, head.view) if resume else _Before()
    probing = head.probing
    if probing is not None:
        kept_probing(out, before.journal.lines, probing)
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
                if before.journal.damaged:
                    views = counted(len(before.views), "view")
                    now(before.journal.set_aside(folder, views), kept=True)
                kept = InspectionFolder(folder, begun, before, rig.calibration, probing)
                for view in inspect_wall(rig, advances, before.views, probing):
                    kept.add(view)
        except BaseException as error:
            if kept is not None:
                _say_end(kept, error, out)
            elif isinstance(error, KeyboardInterrupt):
                typer.echo(
                    f"what was found before is kept in {out}"
                    if resume
                    else "nothing was inspected yet, and nothing is kept",
                    err=True,
                )
            raise
    try:
        return kept.end(FINISHED, True)
    except OutputError:
        typer.echo(_common.go_on(out), err=True)
        raise


def _say_end(kept: InspectionFolder, error: BaseException, out: Path) -> None:
    """End an inspection that an error ended, and say what is kept."""
    try:
        content = kept.end(_reason(error), not isinstance(error, SafetyError))
    except OutputError:  # also the report has no place; the error that came first is told
        typer.echo(_common.go_on(out), err=True)
    else:
        typer.echo(f"{summary(content)}; kept in {out}", err=True)


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
    journal : Resumed
    views : tuple of InspectedView
        That need not be taken again.
    """

    journal: Resumed = field(default_factory=Resumed)
    views: tuple[InspectedView, ...] = ()

    @classmethod
    def of(cls, folder: Path, begun: dict[str, Any], view: HeadCalibration | None) -> _Before:
        """Return it by the journal in a folder; refuse one of another inspection."""
        found = Resumed.of(folder, begun, "inspection")
        views = () if view is None else kept_views(folder, found.lines, view)
        return cls(found, tuple(views))


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
    view : HeadCalibration
        Of the head.
    probing : Probing, optional
        Its probe; the folder keeps what it measures.
    """

    def __init__(
        self,
        folder: Path,
        begun: dict[str, Any],
        before: _Before,
        view: HeadCalibration,
        probing: Probing | None = None,
    ) -> None:
        self._folder, self._view, self._probing = folder, view, probing
        self._views = {each.picture.name: each for each in before.views}
        self._log = [line for line in before.journal.lines if line["what"] == "step"]
        make_folder(folder / "pictures", force=bool(before.journal.lines))
        self._journal = Journal(folder, begun, before.journal.lines, views=len(self._views))
        times = {"began": self._journal.began, "resumed": self._journal.resumed}
        self._content = {**begun, **times, "probe": probing is not None}
        self._bursts: dict[str, int] = {}
        if probing is not None:
            probing.told = self.measured
            self._bursts = {name: len(scanned.bursts) for name, scanned in probing.scans.items()}
        for each in before.views:
            self._mark(each)
        self._write_findings()

    def log(self, entry: LogEntry) -> None:
        """Note a step."""
        step = {"step": entry.what, "outcome": entry.outcome, "succeeded": entry.succeeded}
        self._journal.note("step", **step)
        self._log.append({"t": self._journal.seconds(), **step})

    def add(self, view: InspectedView) -> None:
        """Keep a view, its picture, and the finding if it has one; the newest of a name counts."""
        name = view.picture.name
        if name not in self._views:
            self._write_picture(f"{name}.png", view.image)
        self._views[name] = view
        self._journal.note("view", **view_line(view))
        self._mark(view)
        self._write_findings()

    def measured(self, name: str, new: ScannedRaster | Ring) -> None:
        """Keep a scan of the probe so far, or the sweep round the pipe."""
        from minorloop_head.procedures.probe_steps import ScannedRaster

        if isinstance(new, ScannedRaster):
            self._journal.note("scan", **scan_line(name, new, self._bursts.get(name, 0)))
            self._bursts[name] = len(new.bursts)
        else:
            self._journal.note(name, **ring_line(new))

    def _mark(self, view: InspectedView) -> None:
        """Write the picture of a view with its finding marked, if it has one."""
        from minorloop_head.procedures.pictures import annotated

        if view.finding is not None:
            marked = annotated(view.image, view.picture.findings)
            self._write_picture(f"{view.picture.name} marked.jpg", marked)

    def end(self, why: str, safe: bool) -> dict[str, Any]:
        """Write the report, note the end, and return the content of ``findings.json``.

        An inspection that is cut off while its report is written has not ended yet.

        Parameters
        ----------
        why : str
            ``finished``, or what ended it.
        safe : bool
            Whether the head has confirmed that it is safe.
        """
        self._content |= {"ended": why, "safe": safe, "seconds": self._journal.seconds()}
        try:
            self._write_results()
            self._journal.note("end", why=why, safe=safe)
        finally:
            self._journal.close()
        return self._all()

    def _write_results(self) -> None:
        """Write findings, models and the report."""
        from minorloop_head.procedures.inspected_view import lens_words
        from minorloop_head.procedures.inspected_wall import seen_wall

        walls = self._walls()
        seen = seen_wall(self._views.values(), self._view, list(walls.values()))
        self._content |= {
            "wall": None if seen is None else wall_row(seen, self._view),
            **self._water_row(),
        }
        self._content["lens"] = lens_words(list(self._views.values()))
        self._write_findings()
        self._write_models(walls)
        report = partial(self._report, seen, walls)
        _common.write_report(report, self._folder / "report.html", force=True)

    def _walls(self) -> dict[str, DepthMap]:
        """Return the wall about each finding that was scanned, by the name of its view."""
        from minorloop_head.procedures.inspected_wall import wall_of

        if self._probing is None:
            return {}
        each = {
            name: wall_of(view, self._probing.scan_of(view), self._view)
            for name, view in self._views.items()
            if view.finding is not None
        }
        return {name: wall for name, wall in each.items() if wall is not None}

    def _scans(self) -> dict[str, CScan]:
        """Return the map of the echoes about each finding that was scanned."""
        from minorloop_head.procedures.inspected_wall import c_scan_of

        found = {}
        for name, view in self._views.items():
            scanned = None if self._probing is None else self._probing.scan_of(view)
            scan = None if scanned is None else c_scan_of(scanned, self._view)
            if scan is not None:
                found[name] = scan
        return found

    def _water_row(self) -> dict[str, Any]:
        """Return the level of the water with its standard deviation, if a sweep showed it."""
        water = self._water
        if water is None:
            return {}
        words = {"water level": water.words}
        if not water.seen:
            return words
        values = [round(-1e3 * water.height, 2), round(1e3 * water.sd, 2)]
        return {"water above the axis [mm]": values, **words}

    @property
    def _water(self) -> WaterLine | None:
        ring = None if self._probing is None else self._probing.ring
        return None if ring is None else ring.water

    def _write_models(self, walls: dict[str, DepthMap]) -> None:
        """Write the wall about each finding for viewers of PLY and glTF."""
        from minorloop_head.reconstruction.mesh import save_mesh

        for name, wall in walls.items():
            make_folder(self._folder / "models", force=True)
            for suffix in ("ply", "glb"):
                save_mesh(wall, self._folder / "models" / f"{name}.{suffix}")

    def _all(self) -> dict[str, Any]:
        from minorloop_head.procedures.steps import REFUSED
        from minorloop_head.vision.frame_checks import GOOD

        views = self._views.values()
        verdicts = [view.picture.verdict for view in views]
        bad = {each: verdicts.count(each) for each in sorted(set(verdicts)) if each != GOOD}
        found = [
            {**row(view), **outcomes(view), "steps": step_rows(view.steps)}
            for view in views
            if view.finding is not None
        ]
        beyond = {
            each["step"]: each["outcome"]
            for each in self._log
            if each["step"] in self._views and each["outcome"].startswith(REFUSED)
        }
        return {
            **self._content,
            "views": len(self._views),
            "unusable": bad,
            "not searched": [
                missed_row(view)
                for view in views
                if view.looks_round and view.picture.verdict != GOOD
            ],
            "out of reach": [{"view": name, "why": why} for name, why in beyond.items()],
            "findings": found,
            "unconfirmed": self._lost(),
            "log": [{name: each[name] for name in _STEP} for each in self._log],
        }

    def _lost(self) -> list[dict[str, Any]]:
        """Return `_unconfirmed` as rows."""
        return [lost_row(each) for each in self._unconfirmed()]

    def _unconfirmed(self) -> list[Unconfirmed]:
        """Return what was not confirmed, or not visited yet."""
        from minorloop_head.procedures.inspection import unvisited

        views = list(self._views.values())
        lost = [view.unconfirmed for view in views if view.unconfirmed is not None]
        return [*lost, *unvisited(views, self._view.radius)]

    def _write_findings(self) -> None:
        from minorloop.files import table_text
        from minorloop_head.reconstruction.findings import finding_table

        found = [view.finding for view in self._views.values() if view.finding is not None]
        write_atomically(self._folder / "findings.csv", finding_table(found))
        lost = table_text(LOST_COLUMNS, table(self._lost(), LOST_COLUMNS))
        write_atomically(self._folder / "unconfirmed.csv", lost)
        text = json.dumps(self._all(), indent=1)
        write_atomically(self._folder / "findings.json", f"{text}\n")

    def _write_picture(self, name: str, picture: Any) -> None:
        from minorloop_head.vision.imaging import opencv

        path = self._folder / "pictures" / name
        whole, data = opencv().imencode(path.suffix, picture)
        if not whole:
            raise OutputError(f"{path} cannot be written; check the disk")
        write_atomically(path, data.tobytes())  # it is on the disk before the journal names it

    def _report(self, seen: SeenWall | None, walls: dict[str, DepthMap]) -> Report:
        content = self._all()
        return inspection_report(
            content,
            summary(content),
            found=[view for view in self._views.values() if view.finding is not None],
            lost=self._unconfirmed(),
            seen=seen,
            water=self._water,
            walls=walls,
            scans=self._scans(),
            log=self._log,
        )


def wall_row(seen: SeenWall, view: HeadCalibration) -> dict[str, Any]:
    """Return which wall was seen, and the shares of it that camera and echoes covered."""
    return {
        "pipe [mm]": None if view.length is None else round(1e3 * view.length, 2),
        "z [mm]": [round(1e3 * z, 2) for z in seen.along],
        "angles [deg]": [round(math.degrees(phi), 1) for phi in seen.around],
        "seen": round(seen.seen_share, 4),
        "probed": round(seen.probed_share, 6),
    }


def _reason(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted"
    return " ".join(str(error).split()) or type(error).__name__


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
    less = f"{not_found(content['unconfirmed'])}{f'; {share}' if bad else ''}{missed}"
    said = f"{found} in {views}{less}; {content['ended']}"
    safe = "is safe, as confirmed" if content["safe"] else "did NOT confirm that it is safe"
    return f"{said}; {_depths(content)}; the head {safe}"


def _depths(content: dict[str, Any]) -> str:
    """Return how many depths were measured, or why none can be."""
    if not content["probe"]:
        return "no depth without a probe"
    known = [row["depth [mm]"] is not None or row["kind"] == THROUGH for row in content["findings"]]
    return f"{sum(known)} of {len(known)} depths known"


def show(content: dict[str, Any], out: Path) -> None:
    """Print the findings."""
    if content["findings"]:
        rows = [finding_cells(number, row) for number, row in enumerate(content["findings"], 1)]
        _common.print_table(COLUMNS, rows, ANGLES)
    if content["unconfirmed"]:
        lost = table(content["unconfirmed"], LOST_COLUMNS)
        _common.print_table(LOST_COLUMNS, lost, "not confirmed")
    typer.echo(" ".join(wall_words(content)))
    typer.echo(summary(content))
    typer.echo(f"kept in {out}")
