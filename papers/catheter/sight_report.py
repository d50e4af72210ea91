"""The part of the head report on what the camera tracks and what the tool marks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.report import Picture, Report, Table
from papers.catheter.sight import SightStudy
from papers.catheter.sight_trials import CLICK, Insertion
from papers.catheter.touch_trials import Touch
from papers.catheter.tracking_trials import WALLS, Followed, tracking_figures
from papers.claims import cell
from papers.drawing import new_figure

_SQUARE = 15.0
"""Half the side of the square in pixels of 640, about that of a hole of 1 mm."""
_CROP = 70
"""Half the side of the pictures of a mark, in pixels of 640."""


def add_sight(report: Report, sight: SightStudy, figures: Mapping[str, Any], seed: int) -> None:
    """Add sections on Fig 14, tracking, picking and touching.

    Parameters
    ----------
    report : Report
    sight : SightStudy
        Of the specimen that is drawn.
    figures : mapping
        Over all specimens.
    seed : int
        Of the specimen that is drawn, for captions.
    """
    fig14, pick, tool = figures["fig14"], figures["pick"], figures["tool"]
    report.add(
        "Fig 14: the hole beside a reflection, and tracked",
        text="A metal pipe of 20 mm with a hole of 1 mm that shows white, and a bead of spatter "
        "beside it that mirrors the lights. Pictures (a) to (c) are taken while the head is "
        "inserted: the square marks the strongest finding of the search under switched lights, "
        f"which is the hole in {100 * fig14['told_apart']:.0f} % of the pictures; the reflection "
        f"was taken for a defect {fig14['reflections_taken']} times. Pictures (d) to (f) are taken "
        "while the head turns as that of an operator does: the tracked point stays within "
        f"{fig14['track_error_px_p95']:.2f} pixels of 320 of the true one (95th percentile). In "
        "the mode TRACK of the console the operator's head moves nothing.",
        pictures=[
            Picture(
                draw_insertion(sight.insertion),
                "Fig 14: (a) to (c) insertion, (d) to (f) tracking. Pictures of the camera, seed "
                f"{seed}; the head turns by sensors at its joints.",
            )
        ],
    )
    tracking = figures["tracking"]
    report.add(
        "Tracking, graded by the truth",
        text=(
            "A hole and pieces of plain wall are followed while the head turns at up to 20 "
            "degrees a second on a base that sways, on walls that are hard to follow. The tracker "
            "compares a patch and eight tiles around it with a view from nearby and lets them "
            "vote for one motion of the head; a patch that does not go with its surroundings is "
            "given up, not followed to a wrong place.",
            f"{_lost_share(tracking)} of the frames of plain wall are given up so. A hole stands "
            "out from the wall and has an outline. A patch of plain wall has only its texture: it "
            "is given up where the texture is blurred or outshone, where it looks alike in "
            "several places, or where it does not move as the tiles around it. On the poor wall "
            "the tracker refuses most points when they are selected. This is the price for few "
            f"wrong places: {tracking['texture_drifted']} of {tracking['texture_points']} pieces "
            "of plain wall were more than 2 pixels of 320 off in some frame that counted as "
            "tracked. For a user this means: select a hole, a pit or another mark that stands "
            "out, rather than plain wall. A point that is given up is reported as not tracked and "
            "looked for in the next pictures; the tracker goes on when it is found. The table is "
            "of the specimen that is drawn, the numbers of this text are of all specimens.",
            f"A click that is off by {CLICK:g} pixels of 640 rms is put on the outline; in the "
            f"end {pick['final_error_px']:.2f} pixels of 320 remain in the worst case, and the "
            f"focus errs by {pick['focus_error_pct']:.1f} % of the distance at most.",
        ),
        table=_walls_table(sight.followed),
        pictures=[
            Picture(draw_followed(sight.followed), f"Errors of the tracked points; seed {seed}.")
        ],
    )
    report.add(
        "The micro-tool",
        text="The tool is beside the lens; the head turns the tool, not the optical axis, to a "
        "place 1.2 mm beside the hole, extends it until it touches, and withdraws it. A tool is "
        "known within 0.03 mm and 0.1 degrees. Distance of "
        "the mark from where it was wanted, 90th percentile in mm: "
        f"{cell(tool['touch_mm_p90'], '.2f')}. "
        f"{100 * tool['within_bound']:.0f} % of the touches are within 0.3 mm. An attempt in which "
        "the tool does not touch the wall counts as outside of it, and its distance as infinite.",
        pictures=[
            Picture(
                draw_touches(sight.touches), f"Before a touch, and the mark after it; seed {seed}."
            )
        ],
    )


def _lost_share(tracking: Mapping[str, Any]) -> str:
    return cell(tracking["texture_lost_fraction"], ".0%")


def _walls_table(followed: tuple[Followed, ...]) -> Table:
    columns = (
        "wall",
        "hole: error, 95th percentile, px of 320",
        "hole: frames lost",
        "plain wall: error, 99th percentile, px of 320",
        "plain wall: frames given up",
        "plain wall: points that drifted",
    )
    rows = []
    for wall, words in WALLS.items():
        own = tracking_figures([each for each in followed if each.wall == wall])
        rows.append(
            (
                words,
                cell(own["true_error_px_p95"], ".2f"),
                cell(own["lost_fraction"], ".0%"),
                cell(own["texture_error_px_p99"], ".2f"),
                cell(own["texture_lost_fraction"], ".0%"),
                f"{own['texture_drifted']} of {own['texture_points']}",
            )
        )
    return Table(columns, rows)


def draw_insertion(insertion: Insertion) -> Any:
    """Draw the six pictures with squares, in the form of the paper."""
    figure, axes = new_figure(2, 3, height=5.4)
    shots = (*insertion.inserted, *insertion.turned)
    for one, shot, name in zip(axes.flat, shots, "abcdef", strict=False):
        one.imshow(shot.image, cmap="gray", vmin=0, vmax=255)
        _square(one, shot.marked)
        one.set_title(f"({name})")
    for one in axes.flat:
        one.set_axis_off()
    return figure


def draw_followed(followed: tuple[Followed, ...]) -> Any:
    """Draw the errors of points while they counted as tracked."""
    figure, axes = new_figure(1, 2, height=3.4, sharey=True)
    for one, hole, title in ((axes[0], True, "holes"), (axes[1], False, "plain wall")):
        for each in followed:
            if each.hole == hole:
                error = np.where(each.tracked, np.maximum(each.error, 1e-2), np.nan)
                one.plot(error, lw=0.8, color=f"C{list(WALLS).index(each.wall)}")
        one.set(xlabel="frame", title=title, yscale="log")
    for k, words in enumerate(WALLS.values()):
        axes[0].plot([], [], color=f"C{k}", label=words)
    axes[0].set_ylabel("off the true point [px of 320]")
    axes[0].legend(frameon=False, ncols=2)
    return figure


def draw_touches(touches: tuple[Touch, ...]) -> Any:
    """Draw the wall before and after each touch."""
    figure, axes = new_figure(2, max(len(touches), 2), height=4.6)
    for column, touch in enumerate(touches):
        for row, image in enumerate((touch.before, touch.after)):
            one = axes[row, column]
            one.imshow(image, cmap="gray", vmin=0, vmax=255)
            if np.isfinite(touch.pixel).all():
                u, v = touch.pixel
                one.set(xlim=(u - _CROP, u + _CROP), ylim=(v + _CROP, v - _CROP))
        axes[0, column].set_title(
            f"{1e3 * touch.off:.2f} mm off"
            if np.isfinite(touch.off)
            else f"no mark:\n{touch.verdict}"
        )
    for one in axes.flat:
        one.set_axis_off()
    return figure


def _square(axes: Any, pixel: FloatArray) -> None:
    if np.isfinite(pixel).all():
        u, v = pixel
        x = u + _SQUARE * np.array([-1, 1, 1, -1, -1])
        axes.plot(x, v + _SQUARE * np.array([-1, -1, 1, 1, -1]), color="C3", lw=1.2)
