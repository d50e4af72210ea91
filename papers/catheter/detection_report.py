"""Detection of holes and cracks in the report of the inspection study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from minorloop.report import Table
from minorloop_head.vision.defects import DITHER, LEAST_EVIDENCE, SINGLE, SWITCHED, Hole
from papers.catheter.crack_trials import CrackOutcome, CrackSearch, search_cracks
from papers.catheter.detection import SceneOutcome, Search, recall_curve, search_scene
from papers.drawing import new_figure

_WORDS = {SWITCHED: "three lights and none", SINGLE: "one frame", DITHER: "five turns of 2 degrees"}
_CRACKS = {"100um": "100 to 200 um", "50um": "50 to 100 um", "30um": "30 to 50 um"}
_WALLS_SHOWN = 4
"""Most walls with cracks that are drawn of each kind of error, by trial."""
_REQUIRED = (0.05, 0.98)
"""Required: most false findings in an acquisition, and least recall."""
_LEAST_SHOWN = 3e-3
"""Left end of the logarithmic axis of false findings, which cannot show 0; by trial."""
_SHOWN = 6
"""Most scenes that are drawn of each kind of error, by trial."""
_HALF = 75
"""Half the side of a drawn cutout in pixels: 3 mm, within which a glint is, 20 mm away."""
_LIGHTS = ("first light", "second light", "third light", "all lights")
_FRAMES = (0, 1, 2, 4)
"""Drawn frames of an acquisition, and their lights; the one without light is left out."""


def limits(outcomes: Sequence[SceneOutcome]) -> str:
    """Return a sentence or two on the limits of detection."""
    own = [each for each in outcomes if each.mode == SWITCHED]
    missed = [each for each in own if each.hole and not each.found]
    dark = sum(each.inside == "dark" for each in missed)
    unseen = sum(not np.isfinite(each.evidence) for each in missed)
    false = sum(each.false for each in own)
    holes = sum(each.hole for each in own)
    words = f"None of {holes} holes was missed. "
    if missed:
        words = (
            f"Missed were {len(missed)} of {holes} holes, {dark} of them dark and {unseen} without "
            "any outline at their place. What limits it is a dark hole in the shadow of a dent, "
            "where noise hides an edge that part of the lights do not reach, and a white one "
            "hardly brighter than the wall. "
        )
    words += f"There were {false} false findings in {len(own)} acquisitions"
    if false:
        words += (
            "; such are round spots of dirt, which images alone cannot tell from a hole, and "
            "beads, whose foot is a circle under every light"
        )
    return f"{words}."


def draw_curve(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw recall against false findings for each kind of acquisition."""
    figure, axes = new_figure(height=3.8)
    styles = dict(zip(_WORDS, (("-", 2.6), ("--", 1.8), (":", 1.8)), strict=True))
    for mode, words in _WORDS.items():
        own = [each for each in outcomes if each.mode == mode]
        if not any(each.hole for each in own):
            continue
        false, recall = recall_curve(own)
        (line,) = axes.step(
            np.maximum(false, _LEAST_SHOWN),
            recall,
            where="post",
            label=words,
            ls=styles[mode][0],
            lw=styles[mode][1],
        )
        at = sum(each.false for each in own) / len(own)
        hits = float(np.mean([each.found for each in own if each.hole]))
        axes.plot(max(at, _LEAST_SHOWN), hits, "o", color=line.get_color())
    most, least = _REQUIRED
    axes.plot([_LEAST_SHOWN, most, most], [least, least, 1.0], color="0.3", lw=1, ls="--")
    axes.set(xscale="log", xlim=(_LEAST_SHOWN, 2.0), ylim=(0.5, 1.03))
    axes.set(xlabel=f"false findings an acquisition ({_LEAST_SHOWN:g} or fewer at the left)")
    axes.set(ylabel="share of the holes that are found")
    axes.legend(frameon=False, loc="lower right")
    return figure


def draw_missed(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw holes that were missed; None if there is none."""
    own = [each for each in outcomes if each.mode == SWITCHED and each.hole and not each.found]
    return draw_scenes([_missed(each) for each in own[:_SHOWN]]) if own else None


def draw_false(outcomes: Sequence[SceneOutcome]) -> Any:
    """Draw findings that were none; None if there is none."""
    own = [each for each in outcomes if each.mode == SWITCHED and each.false]
    return draw_scenes([_false(each) for each in own[:_SHOWN]]) if own else None


def draw_scenes(shown: Sequence[tuple[str, Search, Hole | None]]) -> Any:
    """Draw a row for each scene and a column for each light, about the finding."""
    figure, axes = new_figure(len(shown), len(_FRAMES), 2.35 * len(shown), squeeze=False)
    for row, (words, search, hole) in zip(axes, shown, strict=True):
        rim = None if hole is None else search.rim(hole)
        true = search.true_rim() if search.view.hole is not None else None
        about = true if rim is None else rim
        middle = np.zeros(2) if about is None else about.mean(axis=0)
        for one, frame, light in zip(row, _FRAMES, _LIGHTS, strict=True):
            root = np.sqrt(search.frames[frame].image, dtype=np.float32)  # shadows are seen so
            one.imshow(root, cmap="gray", vmin=0, vmax=16)
            for line, colour in ((true, "C0"), (rim, "C1")):
                if line is not None:
                    one.plot(*np.vstack([line, line[:1]]).T, color=colour, lw=0.8)
            one.set(xlim=(middle[0] - _HALF, middle[0] + _HALF), xticks=[], yticks=[])
            one.set(ylim=(middle[1] + _HALF, middle[1] - _HALF))
            one.grid(False)
            one.set_title(light, fontsize=8)
        row[0].set_ylabel(words, fontsize=8)
    return figure


def _missed(outcome: SceneOutcome) -> tuple[str, Search, Hole | None]:
    """Return a scene, and the outline with the most evidence at its hole."""
    (search,) = search_scene(outcome.seed, True)
    near = [hole for hole in search.holes if hole.evidence == outcome.evidence]
    return f"scene {outcome.seed}\n{outcome.inside}", search, near[0] if near else None


def _false(outcome: SceneOutcome) -> tuple[str, Search, Hole | None]:
    """Return a scene, and its strongest false finding."""
    (search,) = search_scene(outcome.seed, outcome.hole)
    most = max(value for value in outcome.alarms if value >= LEAST_EVIDENCE[SWITCHED])
    hole = next((hole for hole in search.holes if hole.evidence == most), None)
    return f"scene {outcome.seed}\nevidence {most:+.1f}", search, hole


def crack_table(found: Mapping[str, Any]) -> Table:
    """Return a table of recall by width."""
    rows = []
    for name, words in _CRACKS.items():
        of = found[f"scenes_{name}"]
        if of:
            low, high = found[f"recall_{name}_interval"]
            share = f"{found[f'recall_{name}']:.1%} ({low:.1%} to {high:.1%})"
            rows.append((words, share, str(of)))
    return Table(("width", "found (95 % interval)", "cracks"), rows)


def verdict_words(found: Mapping[str, Any]) -> str:
    """Return the verdicts of scans across cracks as a list."""
    return ", ".join(f"{verdict} {count}" for verdict, count in found["verdicts"].items()) or "none"


def draw_walls(outcomes: Sequence[CrackOutcome]) -> Any:
    """Draw the unrolled wall of the widest cracks, with true and traced courses; None of none."""
    if not outcomes:
        return None
    outcomes = sorted(outcomes, key=lambda one: -one.width)[:_WALLS_SHOWN]
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
