"""Detection of cracks in the report of the inspection study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from minorloop.report import Picture, Table
from papers.catheter.crack_trials import CrackOutcome, CrackSearch, search_cracks
from papers.drawing import new_figure

_WORDS = {"100um": "100 to 200 um", "50um": "50 to 100 um", "30um": "30 to 50 um"}
_SHOWN = 4
"""Most scenes that are drawn of each kind of error, by trial."""


def crack_table(found: Mapping[str, Any]) -> Table:
    """Return a table of recall by width."""
    rows = []
    for name, words in _WORDS.items():
        of = found[f"scenes_{name}"]
        if of:
            low, high = found[f"recall_{name}_interval"]
            share = f"{found[f'recall_{name}']:.1%} ({low:.1%} to {high:.1%})"
            rows.append((words, share, str(of)))
    return Table(("width", "found (95 % interval)", "cracks"), rows)


def crack_words(found: Mapping[str, Any]) -> str:
    """Return sentences on false findings, matching and scans."""
    low, high = found["false_interval"]
    scans = ", ".join(f"{verdict} {count}" for verdict, count in found["verdicts"].items())
    return (
        "Half of the walls have a crack of 30 to 200 um, all have scratches, drawing marks, stains "
        "and dents, and two in five a weld. A crack counts as found if half of the course that is "
        "in view is within 0.2 mm of what was traced; a trace is false if less than half of it is "
        f"within 0.2 mm of the crack. {found['false_per_acquisition']:.3f} traces an acquisition "
        f"were false (95 % interval {low:.3f} to {high:.3f}). Verdicts of the scans across cracks "
        f"that were found: {scans or 'none'}. The other renderer, that of make judge, has no "
        "scenes with cracks: these shares are on scenes of the twin alone."
    )


def crack_pictures(outcomes: Sequence[CrackOutcome]) -> list[Picture]:
    """Draw cracks that were missed, and traces that were false."""
    missed = [one for one in outcomes if one.width > 0 and not one.found]
    false = [one for one in outcomes if one.false]
    pictures = []
    for chosen, words in (
        (missed, "Cracks that were missed: the true course (blue), and all traces (orange)."),
        (false, "Traces that are no crack (orange), and the true course (blue) of a crack."),
    ):
        if chosen:
            widest = sorted(chosen, key=lambda one: -one.width)[:_SHOWN]
            pictures.append(Picture(draw_walls(widest), words))
    return pictures


def draw_walls(outcomes: Sequence[CrackOutcome]) -> Any:
    """Draw the unrolled wall of each scene, with true and traced courses."""
    rows = -(-len(outcomes) // 2)
    figure, axes = new_figure(rows, 2, 2.6 * rows, squeeze=False)
    for one in axes.ravel()[len(outcomes) :]:
        one.set_axis_off()
    for one, outcome in zip(axes.ravel(), outcomes, strict=False):
        search = search_cracks(outcome.seed, outcome.width > 0)
        wall = search.findings.wall
        if wall is not None:
            one.imshow(wall.whole - wall.ground, cmap="gray", vmin=-0.8, vmax=0.5)
        for trace in search.traces:
            one.plot(*_texels(search, trace.places), color="C1", lw=1)
        one.plot(*_texels(search, search.course), ",", color="C0")
        one.set(xticks=[], yticks=[])
        one.set_title(f"scene {outcome.seed}, {1e6 * outcome.width:.0f} um", fontsize=8)
        one.grid(False)
    return figure


def _texels(search: CrackSearch, places: Any) -> Any:
    """Return columns and rows of places (N, 2) on the map of a scene."""
    assert search.findings.wall is not None
    return search.findings.wall.window.texels(places, search.camera.radius).T
