"""Inspection of a pipe without an operator, which stores each result at once."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from minorloop.errors import MinorloopError, OutputError, ParameterError, SafetyError, counted
from minorloop.files import PathLike, make_folder, table_text, write_atomically
from minorloop_head.inspection.journal import (
    FINISHED,
    NEW,
    Before,
    EndLine,
    Journal,
    Told,
    folder_for,
    go_on,
    plain,
    refusing,
    untold,
)
from minorloop_head.inspection.lines import (
    FARTHEST,
    InspectionLine,
    LostRow,
    PoseRow,
    RingLine,
    ScanLine,
    StepLine,
    ViewLine,
    check_new,
    visit_row,
)
from minorloop_head.inspection.report import (
    LOST_COLUMNS,
    Reported,
    inspection_report,
    summary,
    table,
    written,
)
from minorloop_head.procedures.inspected_view import (
    InspectedView,
    Unconfirmed,
    first_visit,
    lens_words,
)
from minorloop_head.procedures.inspected_wall import SeenWall, c_scan_of, seen_wall, wall_of
from minorloop_head.procedures.inspection import NOT_DONE, inspect_wall, unvisited
from minorloop_head.procedures.pictures import annotated
from minorloop_head.procedures.probing import Kept
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.ring import Ring
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.steps import REFUSED
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import save_mesh
from minorloop_head.reconstruction.findings import finding_table
from minorloop_head.vision.frame_checks import GOOD
from minorloop_head.vision.imaging import opencv

if TYPE_CHECKING:
    from minorloop_head.inspection.heads import InspectedHead
    from minorloop_head.procedures.calibration import HeadCalibration
    from minorloop_head.reconstruction.depth_map import DepthMap

_VISITS = ("hole", "crack", "device", "camera", "lens", "reach", "touch", "measure", "water line")
"""Steps whose outcome stays on the terminal: visits of candidates, results of the probe, failures
of a device, and settings that the camera refuses."""
_MOST_WALL = 0.1  # m, as of a calibration


_Value = TypeVar("_Value")


@dataclass(frozen=True, eq=False)
class Inspection(Reported):
    """Result of an inspection; pictures and models are in its folder too."""

    views: tuple[InspectedView, ...]
    """Views in the order in which they were taken."""
    seen: SeenWall | None
    """Map of the wall by the camera; None without a usable picture."""


def inspect(
    head: InspectedHead,
    out: PathLike,
    advances: Sequence[float] = (0.0,),
    *,
    pipe: str | None = None,
    least_wall: float | None = None,
    resume: bool = False,
    told: Told = untold,
) -> Inspection:
    """Search the wall within reach of a head for holes, pits and cracks, and measure each.

    In every case the head is made safe at the end, and the findings until then are kept in the
    folder: a note on the exception says so.

    Parameters
    ----------
    head : InspectedHead
    out : path
        New or empty folder for journal, findings, report, pictures and models.
    advances : sequence of float
        Places of the catheter in metres from which it looks round; 0 without a catheter.
    pipe : str, optional
        Its identity, for the report.
    least_wall : float, optional
        Least remaining wall in metres under an accepted finding.
    resume : bool
        Whether to continue the interrupted inspection in the folder, from any line of its journal.
    told : callable
        Called with texts on the progress, and ``kept=True`` with texts that matter later.

    Returns
    -------
    Inspection

    Raises
    ------
    ParameterError
        If the head does not reach an advance, or the inspection in the folder is another one or
        finished.
    RecordError
        If a line of the journal has an impossible value.
    OutputError
        If the folder is not empty, or cannot be written.
    InstrumentError
        If a device fails, or the head did not confirm that it is safe (`SafetyError`).
    """
    folder = Path(out)
    begun = {**head.begun, **_begun(advances, pipe, least_wall)}
    before = Before.of(folder, begun, "inspection", InspectionLine) if resume else NEW
    known = _restored(before, head.view)
    kept: _Folder | None = None

    def logged(entry: LogEntry) -> None:
        told(f"{entry.what}: {entry.outcome}", kept=entry.what.startswith(_VISITS))
        if kept is not None:
            kept.log(entry)

    try:
        with folder_for(folder, resume=resume), head.opened(logged) as rig:
            _check_advances(rig, begun["actuator"], advances)
            if before.damaged:
                told(before.set_aside(counted(len(known.views), "view")), kept=True)
            kept = _Folder(folder, begun, before, rig, known, probe=head.unscanned is not None)
            inspect_wall(rig, advances, kept, unscanned=head.unscanned)
    except BaseException as error:
        _note_end(kept, error, folder, resume=resume)
        raise
    try:
        return kept.end(FINISHED, safe=True)
    except OutputError as error:
        error.add_note(go_on(folder))
        raise


def _begun(advances: Sequence[float], pipe: str | None, least_wall: float | None) -> dict[str, Any]:
    """Return the options of an inspection for its journal; refuse impossible ones."""
    for place in advances:
        if not 0.0 <= place <= FARTHEST:
            raise ParameterError(f"--advances has {1e3 * place:g}; give 0 to {1e3 * FARTHEST:g} mm")
    if len(set(advances)) < len(advances):
        raise ParameterError(
            f"--advances is {', '.join(f'{1e3 * each:g}' for each in advances)}; give each place "
            "once, since candidates in two views count more"
        )
    if least_wall is not None and not 0.0 < least_wall <= _MOST_WALL:
        raise ParameterError(
            f"the least remaining wall is {1e3 * least_wall:g} mm; give more than 0, up to "
            f"{1e3 * _MOST_WALL:g} mm"
        )
    return {
        "advances [mm]": [round(1e3 * advance, 4) for advance in advances],
        "pipe": pipe,
        "least wall [mm]": None if least_wall is None else 1e3 * least_wall,
    }


def _note_end(kept: _Folder | None, error: BaseException, folder: Path, *, resume: bool) -> None:
    """End an inspection after an error, and add a note on the kept results to the error."""
    if kept is None:
        if isinstance(error, KeyboardInterrupt):
            nothing = "nothing was inspected yet, and nothing is kept"
            error.add_note(f"earlier findings are kept in {folder}" if resume else nothing)
        return
    why = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, KeyboardInterrupt):
        why = "interrupted"
    try:
        found = kept.end(why, safe=not isinstance(error, SafetyError))
    except OutputError:  # no space for the report either; the first error is raised
        error.add_note(go_on(folder))
    else:
        error.add_note(f"{summary(found.content)}; kept in {folder}")


def _check_advances(rig: InspectionRig, actuator: str, advances: Sequence[float]) -> None:
    """Refuse places that a head cannot reach."""
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


def _restored(before: Before, calibration: HeadCalibration | None) -> Kept:
    """Return the results in the journal of an inspection by a calibrated head.

    It has the newest view of each name. A view without a picture in the folder is left out, to be
    taken again; so is a view with unusable frames, unless another view confirmed its candidate.
    """
    known, traces = Kept(), dict[tuple[str, bytes], str]()
    for where, line in before.each(ViewLine):
        with refusing(where):
            file = before.file.parent / "pictures" / line.picture
            data = np.frombuffer(file.read_bytes() if file.is_file() else b"", np.uint8)
            image = opencv().imdecode(data, opencv().IMREAD_GRAYSCALE) if data.size else None
            known.views.pop(file.stem, None)
            if image is not None and calibration is not None:
                known.add_view(line.restored(image, calibration))
    confirmed = {
        first_visit(name) for name, view in known.views.items() if view.finding is not None
    }
    again = {
        name
        for name, view in known.views.items()
        if view.picture.verdict != GOOD and first_visit(name) not in confirmed
    }
    for name in [*known.views]:
        if not again.isdisjoint((name, first_visit(name))):
            del known.views[name]
    for where, scan in before.each(ScanLine):
        with refusing(where):
            for burst in scan.bursts:
                check_new(traces, (scan.name, burst.trace), where)
            known.add_scan(scan.name, scan.restored(known.scans.get(scan.name)))
    for where, ring in before.each(RingLine):
        with refusing(where):
            known.add_ring(ring.restored())
    return known


class _Folder(Kept):
    """Results of an inspection in a folder: journal, findings so far, and pictures.

    ``folder``: existing, and empty except for an interrupted inspection; ``begun``: the inspected
    pipe and the head; ``before``: journal of an interrupted inspection; ``rig``: the head, whose
    clock is that of the journal; ``known``: results of the interrupted inspection, which are not
    measured again; ``probe``: whether the head has a probe.
    """

    def __init__(
        self,
        folder: Path,
        begun: dict[str, Any],
        before: Before,
        rig: InspectionRig,
        known: Kept,
        *,
        probe: bool,
    ) -> None:
        super().__init__(views=known.views, scans=known.scans, ring=known.ring)
        self._folder, self._calibration = folder, rig.calibration
        steps = (plain(line) for _, line in before.each(StepLine))
        self._log = [{n: step[n] for n in ("t", "step", "outcome", "succeeded")} for step in steps]
        make_folder(folder / "pictures", force=bool(before.lines))
        self._journal = Journal(folder, begun, before, clock=lambda: rig.t, views=len(self.views))
        times = {"began": self._journal.began, "resumed": self._journal.resumed}
        self._content = {**begun, **times, "probe": probe}
        self._undone: dict[str, str] = {}
        for each in self.views.values():
            self._mark(each)
        self._write_findings()

    def log(self, entry: LogEntry) -> None:
        """Note a step."""
        step = {"step": entry.what, "outcome": entry.outcome, "succeeded": entry.succeeded}
        self._log.append({"t": self._journal.note(StepLine, **step).t, **step})

    def add_view(self, view: InspectedView) -> None:
        """Keep a view, its picture and its finding; it replaces an older view of the same name."""
        if view.picture.name not in self.views:
            self._write_picture(f"{view.picture.name}.png", view.image)
        super().add_view(view)
        self._journal.note(ViewLine, **ViewLine.values(view))
        self._mark(view)
        self._write_findings()

    def add_scan(self, name: str, scanned: ScannedRaster) -> None:
        """Keep a scan so far: write its bursts that no line has yet."""
        before = self.scans.get(name, ScannedRaster())
        super().add_scan(name, scanned)
        if not scanned.refused:
            self._journal.note(ScanLine, **ScanLine.values(name, scanned, len(before.bursts)))

    def add_ring(self, ring: Ring) -> None:
        """Keep the sweep round the pipe."""
        super().add_ring(ring)
        self._journal.note(RingLine, profile=ring.profile, water=ring.water)

    def end(self, why: str, *, safe: bool) -> Inspection:
        """Write the report, note the end, and return the inspection.

        An interruption while the report is written leaves the inspection unfinished.

        ``why``: ``finished``, or the cause of its end; ``safe``: whether the head has confirmed
        that it is safe.
        """
        self._content |= {"ended": why, "safe": safe, "seconds": self._journal.seconds()}
        try:
            seen = self._write_results()
            self._journal.note(EndLine, why=why, safe=safe)
        finally:
            self._journal.close()
        return Inspection(self._all(), self._folder, tuple(self.views.values()), seen)

    def _write_results(self) -> SeenWall | None:
        """Write findings, models and the report, and return the map of the wall."""
        found, view, tried = self._with_finding(), self._calibration, self._try_drawing
        scanned = _known({name: self.scan_of(one) for name, one in found.items()})
        walls = _known(
            {n: tried(f"map of {n}", wall_of, found[n], one, view) for n, one in scanned.items()}
        )
        scans = _known(
            {n: tried(f"C-scan of {n}", c_scan_of, one, view) for n, one in scanned.items()}
        )
        every = list(self.views.values())
        seen = tried("map of the pipe", seen_wall, every, view, list(walls.values()))
        water = None if self.ring is None else self.ring.water
        self._content["wall"] = None if seen is None else _wall_row(seen, view)
        if water is not None:
            if water.seen:
                level = [round(-1e3 * water.height, 2), round(1e3 * water.sd, 2)]
                self._content["water above the axis [mm]"] = level
            self._content["water level"] = water.words
        self._content["lens"] = lens_words(every)
        self._write_findings()
        self._write_models(walls)

        def drawn() -> Any:
            return inspection_report(
                self._all(),
                found=list(found.values()),
                lost=self._unconfirmed(),
                seen=seen,
                water=water,
                walls=walls,
                scans=scans,
            )

        written(drawn, self._folder / "report.html")
        return seen

    def _try_drawing(self, what: str, draw: Callable[..., _Value], *given: Any) -> _Value | None:
        """Return a drawing; None if it cannot be drawn, which is noted."""
        try:
            return draw(*given)
        except (MinorloopError, ValueError, ArithmeticError) as error:
            self._undone[what] = f"{NOT_DONE}: {error}"
            return None

    def _with_finding(self) -> dict[str, InspectedView]:
        """Return the views with a finding."""
        return {name: view for name, view in self.views.items() if view.finding is not None}

    def _all(self) -> dict[str, Any]:
        """Return the content of ``findings.json``."""
        views = self.views.values()
        verdicts = [view.picture.verdict for view in views]
        bad = {each: verdicts.count(each) for each in sorted(set(verdicts)) if each != GOOD}
        missed = [view for view in views if view.looks_round and view.picture.verdict != GOOD]
        last = {each["step"]: each["outcome"] for each in self._log}
        beyond = {
            each["step"]: each["outcome"]
            for each in self._log
            if each["step"] in self.views and each["outcome"].startswith(REFUSED)
        }
        rows = {
            "not searched": [
                {
                    "view": view.picture.name,
                    "verdict": view.picture.verdict,
                    **plain(PoseRow.of(view.angles, view.place, 4)),
                }
                for view in missed
            ],
            "out of reach": [{"view": name, "why": why} for name, why in beyond.items()],
            "not done": [
                {"step": step, "why": why.removeprefix(f"{NOT_DONE}: ")}
                for step, why in {**last, **self._undone}.items()
                if why.startswith(NOT_DONE)
            ],
            "findings": [
                visit_row(view, self._calibration.thickness, self._content["least wall [mm]"])
                for view in self._with_finding().values()
            ],
            "unconfirmed": [LostRow.of(each) for each in self._unconfirmed()],
            "log": self._log,
        }
        content = {**self._content, "views": len(self.views), "unusable": bad, **rows}
        whole: dict[str, Any] = plain(content)
        return whole

    def _unconfirmed(self) -> list[Unconfirmed]:
        """Return the candidates that were not confirmed, or not visited yet."""
        views = list(self.views.values())
        lost = [view.unconfirmed for view in views if view.unconfirmed is not None]
        return [*lost, *unvisited(views, self._calibration.radius)]

    def _write_findings(self) -> None:
        content = self._all()
        found = [view.finding for view in self.views.values() if view.finding is not None]
        lost = table_text(LOST_COLUMNS, table(content["unconfirmed"], LOST_COLUMNS))
        for name, text in (
            ("findings.csv", finding_table(found)),
            ("unconfirmed.csv", lost),
            ("findings.json", f"{json.dumps(content, indent=1)}\n"),
        ):
            write_atomically(self._folder / name, text)

    def _write_models(self, walls: dict[str, DepthMap]) -> None:
        """Write the wall about each finding for viewers of PLY and glTF."""
        for name, wall in walls.items():
            make_folder(self._folder / "models", force=True)
            for suffix in ("ply", "glb"):
                save_mesh(wall, self._folder / "models" / f"{name}.{suffix}")

    def _mark(self, view: InspectedView) -> None:
        """Write the picture of a view with its finding marked, if it has one."""
        if view.finding is not None:
            marked = annotated(view.image, view.picture.findings)
            self._write_picture(f"{view.picture.name} marked.jpg", marked)

    def _write_picture(self, name: str, picture: Any) -> None:
        path = self._folder / "pictures" / name
        whole, data = opencv().imencode(path.suffix, picture)
        if not whole:
            raise OutputError(f"{path} cannot be written; check the disk")
        write_atomically(path, data.tobytes())  # the picture is on the disk before its line


def _known(values: Mapping[str, _Value | None]) -> dict[str, _Value]:
    return {name: value for name, value in values.items() if value is not None}


def _wall_row(seen: SeenWall, view: HeadCalibration) -> dict[str, Any]:
    """Return the range of the searched wall, and its shares covered by camera and echoes."""
    return {
        "pipe [mm]": None if view.length is None else round(1e3 * view.length, 2),
        "z [mm]": [round(1e3 * z, 2) for z in seen.along],
        "angles [deg]": [round(math.degrees(phi), 1) for phi in seen.around],
        "searched": round(seen.searched_share, 4),
        "probed": round(seen.probed_share, 6),
    }
