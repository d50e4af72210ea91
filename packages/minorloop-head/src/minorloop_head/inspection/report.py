"""The report of ``minorloop head inspect``, for the owner of the pipe."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from minorloop.errors import MinorloopError, OutputError, counted
from minorloop.report import Picture, Report, Table
from minorloop_head.procedures.inspected_wall import SeenWall, draw_wall
from minorloop_head.procedures.inspection import NOT_VISITED
from minorloop_head.procedures.pictures import annotated
from minorloop_head.procedures.sweep_map import draw_c_scan, draw_finding
from minorloop_head.reconstruction.findings import DIGITS

if TYPE_CHECKING:
    from minorloop_head.procedures.inspected_view import InspectedView, Unconfirmed
    from minorloop_head.reconstruction.depth_map import DepthMap, WaterLine
    from minorloop_head.ultrasound.c_scan import CScan

ANGLES = (
    "Angles are counted around the pipe as the camera looks into it: 0 degrees at the right, 90 at "
    "the bottom, 180 at the left, -90 at the top. z is counted along the pipe from where the "
    "advance of the catheter reads 0. All findings are on the inner wall. The number after ± is "
    "one standard deviation."
)
_VERDICT = (
    "Echoes show a confirmed finding. Only the camera shows a probable one, with odds of 20 to 1 "
    "or more or as a line that was traced twice; it may be dirt. Look at the others again. The "
    "verdict is that of the echoes, with the failed steps. A depth counts if it is measured, and "
    "no step failed. The wall left is the calibrated thickness, known to 1.7 %, less the depth."
)
COLUMNS = (
    "no.",
    "grade",
    "kind",
    "angle [deg]",
    "z [mm]",
    "width [mm]",
    "length [mm]",
    "depth [mm]",
    "wall left [mm]",
    "verdict",
)
LOST_COLUMNS = ("kind", "phi [deg]", "z [mm]", "evidence", "seen in", "why")
"""Columns of candidates that were not confirmed."""
_MISSED_COLUMNS = ("view", "verdict", "pan [deg]", "tilt [deg]", "advance [mm]", "roll [deg]")
"""Columns of directions without a search, as lines of sight, with the place of the catheter."""
_BEYOND_COLUMNS = ("view", "why")
"""Columns of directions that the wires do not reach."""
_UNDONE_COLUMNS = ("step", "why")
"""Columns of parts that could not be computed."""
_MOST_ODDS = 1000
_THROUGH = "hole"
"""Kind of a through-hole."""
_DIGITS = DIGITS | {"wall [mm]": 2}
_MEANING = {
    "not scanned": "not scanned: the head has no probe, or the inspection ended before",
    "no water": "the pipe was dry, and the probe needs water",
    "no coupling": "no echo of the wall: the place or the probe is above the water; let in more "
    "water, to above both, and inspect again",
    "no floor echo": "the wall answers, but no floor of the defect does: it may be deeper than the "
    "1.25 mm that are measured",
    "too few echoes": "too few bursts could be used: the head did not arrive, or the camera did "
    "not see how the flow turns it",
}
"""Explanations of verdicts for readers who do not know the probe."""


@dataclass(frozen=True, eq=False)
class Reported:
    """Result of an inspection or a sweep, and its folder."""

    content: dict[str, Any]
    """Content of ``findings.json``; its ``findings`` are rows in degrees and millimetres."""
    folder: Path
    """Folder with ``report.html`` and its files."""

    @property
    def findings(self) -> list[dict[str, Any]]:
        """Rows of the findings, as of `visit_row`, or of `find_rows` of a sweep."""
        return list(self.content["findings"])

    @property
    def report(self) -> Path:
        """The page for the owner of the pipe."""
        return self.folder / "report.html"


def _finding_cells(number: int, row: Mapping[str, Any]) -> list[str]:
    """Return a finding as cells of `COLUMNS`."""
    values = [with_sd(row, name, digits) for name, digits in _DIGITS.items()]
    if row["kind"] == _THROUGH:
        values[-2:] = ["through", "none"]
    return [str(number), row["grade"], str(row["kind"]), *values, str(row["verdict"])]


def with_sd(row: Mapping[str, Any], name: str, digits: int) -> str:
    """Return a value of a finding with its standard deviation, ``-`` if it is not known."""
    what, unit = name.split(" ", 1)
    value, sd = row[name], row[f"{what}_sd {unit}"]
    if value is None:
        return "-"
    return f"{value:.{digits}f}" if sd is None else f"{value:.{digits}f} ±\u00a0{sd:.{digits}f}"


def inspection_report(
    content: Mapping[str, Any],
    *,
    found: Sequence[InspectedView],
    lost: Sequence[Unconfirmed],
    seen: SeenWall | None,
    water: WaterLine | None,
    walls: Mapping[str, DepthMap],
    scans: Mapping[str, CScan],
) -> Report:
    """Return the report of an inspection.

    ``content``: of ``findings.json``; ``found``: views with a finding, in the order of
    ``content["findings"]``; ``seen``: map by the camera; ``walls``: maps of the wall about scanned
    findings, by the name of the view; ``scans``: amplitude and depth of their echoes.
    """
    rows = content["findings"]
    report = Report(f"Inspection by head {content['head']}", summary(content))
    cells = [_finding_cells(number, row) for number, row in enumerate(rows, 1)]
    report.add(
        "Findings",
        text=(ANGLES, _VERDICT) if cells else ANGLES,
        table=Table(COLUMNS, cells) if cells else None,
        notes=() if cells else ("Nothing was found.",),
    )
    if content["least wall [mm]"] is not None:
        report.add(
            "Acceptance",
            text=f"Accepted is a finding under which at least {content['least wall [mm]']:g} mm of "
            "wall are left, by the lower end of the 90 % band.",
            table=Table(("no.", "accepted"), _accepted(rows)),
        )
    if reasons := _without_depth(rows):
        report.add("Depths that are not known, and why", table=Table(("no.", "why"), reasons))
    if content["unconfirmed"]:
        report.add(
            "Not confirmed",
            text="Candidates that another view did not show, or that were not visited. They may "
            "be reflections, dirt, or defects.",
            table=Table(LOST_COLUMNS, table(content["unconfirmed"], LOST_COLUMNS)),
        )
    report.add(
        "What was inspected", text=wall_words(content), table=Table(("", ""), _facts(content))
    )
    for key, title, columns in (
        ("not done", "Not done, and why", _UNDONE_COLUMNS),
        ("not searched", "Not searched", _MISSED_COLUMNS),
        ("out of reach", "Directions out of reach", _BEYOND_COLUMNS),
    ):
        if content[key]:
            report.add(title, table=Table(columns, table(content[key], columns)))
    if seen is not None:
        drawn = draw_wall(seen, found, lost, water)
        report.add(
            "Map of the pipe", pictures=[Picture(drawn, _map_caption(seen, found, lost, water))]
        )
    for number, (row, view) in enumerate(zip(rows, found, strict=True), 1):
        name = view.picture.name
        marked = annotated(view.image, view.picture.findings, number)
        pictures = [Picture(figure_of(marked), f"As the camera saw it: {name}.")]
        if name in scans:
            caption = (
                "C-scan: the echoes about it, seen from the axis; blank without an echo. The "
                "colours are the same in every C-scan."
            )
            pictures.append(Picture(draw_c_scan(scans[name]), caption))
        if name in walls:
            caption = "The wall about it by camera and echoes."
            pictures.append(Picture(draw_finding(walls[name]), caption))
        report.add(f"Finding {number}: {row['kind']}", text=_visit_sentence(row), pictures=pictures)
    steps = [[f"{each['t']:.0f}", each["step"], _outcome(each)] for each in content["log"]]
    if steps:
        report.add("Log", table=Table(("t [s]", "step", "outcome"), steps))
    return report


def _map_caption(
    seen: SeenWall,
    found: Sequence[InspectedView],
    lost: Sequence[Unconfirmed],
    water: WaterLine | None,
) -> str:
    """Return the caption of the map of the pipe, with the marks in it."""
    marks = {
        "light blue was not seen": bool(np.isnan(seen.picture).any()),
        "findings are numbered": bool(found),
        "crosses are candidates that were not confirmed": bool(lost),
        "blue patches were measured by echoes": bool(seen.probed.any()),
        "dashed lines are the level of the water": water is not None and water.seen,
    }
    shown = [words for words, there in marks.items() if there]
    return "; ".join(["The inner wall, unrolled, as the camera saw it", *shown]) + "."


def _facts(content: Mapping[str, Any]) -> list[list[str]]:
    """Return pipe, head and time of an inspection as rows of a table."""
    between = ", without the time between" if content["resumed"] else ""
    known = {
        "began": content["began"],
        "cut off, and resumed at": ", ".join(content["resumed"]),
        "duration": f"{content['seconds']:.0f} s by the clock of the head{between}",
        "ended": content["ended"],
        "pipe": content["pipe"] or "not named; --pipe names it",
        "head": content["head"],
        "calibrated": content["calibrated"] or "no date is known",
        "at": content["actuator"],
        "looked round from": f"{', '.join(f'{z:g}' for z in content['advances [mm]'])} mm",
        "temperature of the water": f"{content['water [C]']:g} C" if "water [C]" in content else "",
        "level of the water": _level(content.get("water [mm above the axis]")),
        "gas": f"{content['gas']}, {content['gas [bar]']:g} bar" if "gas" in content else "",
    }
    return [[name, str(value)] for name, value in known.items() if value]


def wall_words(content: Mapping[str, Any]) -> list[str]:
    """Return sentences on the wall that camera and echoes covered."""
    wall = content.get("wall")
    if wall is None:
        return ["No view could be used, so that no wall was inspected."]
    low, high = wall["z [mm]"]
    first, last = wall["angles [deg]"]
    around = "all round" if last - first >= 360.0 else f"from {first:.0f} to {last:.0f} degrees"
    pipe = f" of the {wall['pipe [mm]']:.0f} mm of pipe" if wall["pipe [mm]"] else ""
    said = [
        f"The camera searched {high - low:.1f} mm{pipe}: the inner wall from z {low:.1f} to "
        f"{high:.1f} mm, {around}, of which {wall['searched']:.0%} is "
        "shown whole and near enough for the smallest hole. "
        "A defect beyond it, or one that the edge of each picture cuts, is not found; --advances "
        "with a place nearer to it shows it whole."
    ]
    if unclear := content.get("lens"):
        said.append(f"{unclear[0].upper()}{unclear[1:]}.")
    if wall["probed"]:
        said.append(
            f"Echoes gave the depth of {wall['probed']:.2%} of it: the places of findings only."
        )
    else:
        said.append("Echoes gave no depth of any part of it.")
    if content["out of reach"]:
        many, each = len(content["out of reach"]), content["out of reach"][0]
        said.append(
            f"The wires did not reach {counted(many, 'direction')} in which to look "
            f"({each['view']}: {each['why']})."
        )
    if content["not done"]:
        said.append(f"Not done: {', '.join(each['step'] for each in content['not done'])}.")
    if "water above the axis [mm]" in content:
        said.append(f"The water stood {content['water level']}.")
    elif "water level" in content:
        said.append(f"The level of the water: {content['water level']}.")
    return said


def _level(given: str | None) -> str:
    """Return the level of the water of a simulated pipe; empty if none was set."""
    if given is None or not given[-1].isdigit():
        return f"{given} pipe" if given else ""
    return f"{given} mm above the axis"


def table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> list[list[str]]:
    """Return rows as text."""
    return [[_cell(row[name]) for name in columns] for row in rows]


def figure_of(marked: Any) -> Any:
    """Return a colour picture of OpenCV as a figure."""
    from matplotlib.figure import Figure

    height, width = marked.shape[:2]
    figure = Figure(figsize=(5.0, 5.0 * height / width))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(marked[..., ::-1])
    axes.set_axis_off()
    return figure


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(value)
    return "" if value is None else str(value)


def _accepted(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the number of each finding, and whether it is accepted."""
    words = {True: "yes", False: "no", None: "not known"}
    return [[str(number), words[row["accepted"]]] for number, row in enumerate(rows, 1)]


def _without_depth(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the number of each finding without a depth or with failed steps, and the reason."""
    found = []
    for number, row in enumerate(rows, 1):
        if row["depth [mm]"] is None and row["kind"] != _THROUGH:
            verdict = str(row["verdict"])
            base, bracket, bound = verdict.split(", but failed")[0].partition(" (")
            known = base in _MEANING
            why = f"{_MEANING[base]}{bracket}{bound}" if known else verdict
            found.append([str(number), why])
    return found


def _visit_sentence(row: Mapping[str, Any]) -> str:
    """Return a sentence on the results of the visit of a finding."""
    known = {
        "centred": "centred in the picture",
        "reached": "within reach of the probe",
        "touched": "touched by the tool",
        "scanned": "scanned with echoes of the wall",
    }
    yes = [words for name, words in known.items() if row.get(name)]
    no = [words for name, words in known.items() if row.get(name) is False]
    said = f"It was found{''.join(f', {each}' for each in yes)}."
    said += f" It was not {', not '.join(no)}." if no else ""
    if row["evidence"] is None:
        return f"{said} Its line was traced again from another place."
    return (
        f"{said} By its pictures the odds that it is a hole or a pit are {_odds(row['evidence'])}."
    )


def _odds(evidence: float) -> str:
    """Return odds by their logarithm; they are unknown beyond the number of fitted scenes."""
    if abs(evidence) > math.log(_MOST_ODDS):
        words = f"more than {_MOST_ODDS} to 1"
    else:
        words = f"{math.exp(abs(evidence)):.0f} to 1"
    return words if evidence >= 0 else f"{words} against it"


def _outcome(step: Mapping[str, Any]) -> str:
    return str(step["outcome"]) if step["succeeded"] else f"failed: {step['outcome']}"


def _rejected(unconfirmed: Sequence[Mapping[str, Any]]) -> str:
    """Return the numbers of candidates that were not confirmed, and not visited."""
    lost = [
        counted(len(row["seen in"]), "view") for row in unconfirmed if row["why"] != NOT_VISITED
    ]
    words = [f"; seen in {each} ({lost.count(each)}), not confirmed" for each in sorted(set(lost))]
    left = len(unconfirmed) - len(lost)
    return "".join([*words, f"; {left} {NOT_VISITED}" if left else ""])


def shown_tables(content: Mapping[str, Any]) -> list[tuple[Sequence[str], list[list[str]], str]]:
    """Return columns, cells and titles of the tables for a terminal."""
    found = [_finding_cells(number, row) for number, row in enumerate(content["findings"], 1)]
    lost = table(content["unconfirmed"], LOST_COLUMNS)
    tables = ((COLUMNS, found, ANGLES), (LOST_COLUMNS, lost, "not confirmed"))
    return [each for each in tables if each[1]]


def summary(content: Mapping[str, Any]) -> str:
    """Return the numbers of findings and views, and the end of an inspection, as a sentence."""
    grades = Counter(row["grade"] for row in content["findings"])
    each = ", ".join(f"{count} {grade}" for grade, count in grades.items())
    found = counted(len(content["findings"]), "finding") + (f" ({each})" if each else "")
    views = counted(content["views"], "view")
    bad = ", ".join(f"{verdict} ({count})" for verdict, count in content["unusable"].items())
    share = f"{sum(content['unusable'].values())} of {views} not usable: {bad}"
    missed = "".join(
        f"; not searched: pan {row['pan [deg]']:.1f}, tilt {row['tilt [deg]']:.1f} deg at "
        f"{row['advance [mm]']:.1f} mm"
        for row in content["not searched"]
    )
    less = f"{_rejected(content['unconfirmed'])}{f'; {share}' if bad else ''}{missed}"
    known = [
        row["depth [mm]"] is not None or row["kind"] == _THROUGH for row in content["findings"]
    ]
    depths = f"{sum(known)} of {len(known)} depths known"
    depths = depths if content["probe"] else "no depth without a probe"
    safe = "is safe, as confirmed" if content["safe"] else "did NOT confirm that it is safe"
    return f"{found} in {views}{less}; {content['ended']}; {depths}; the head {safe}"


def written(draw: Callable[[], Report], path: Path) -> None:
    """Draw a report and write it.

    Raises an `OutputError` if it cannot be drawn or written.
    """
    try:
        draw().write(path, force=True)
    except MinorloopError:
        raise
    except Exception as error:
        raise OutputError(f"{path} was not written, the report cannot be drawn: {error}") from error
