"""What the camera of the head tracks, and what its tool marks, graded by the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.report import Table
from minorloop_head.control.head import HeadControl
from papers.catheter import touch_trials
from papers.catheter.inspection_servo import Scene
from papers.catheter.sight_trials import Insertion, Picked, run_insertion, run_pick, sight_figures
from papers.catheter.touch_trials import Touch, run_touch, touch_figures
from papers.catheter.tracking_trials import WALLS, Followed, run_tracking, tracking_figures
from papers.claims import cell
from papers.drawing import new_figure

_SQUARE = 15.0
"""Half the side of the square in pixels of 640, about that of a hole of 1 mm."""
_CROP = 70
"""Half the side of the pictures of a mark, in pixels of 640."""


@dataclass(frozen=True, eq=False)
class SightStudy:
    """Results of one specimen."""

    followed: tuple[Followed, ...]
    pick: Picked
    insertion: Insertion
    touches: tuple[Touch, ...]


def run_sight(seed: int, control: HeadControl) -> SightStudy:
    """Track, pick, insert and touch with one specimen.

    Parameters
    ----------
    seed : int
    control : HeadControl
        Of the head of this seed.
    """
    return SightStudy(
        followed=tuple(run_tracking(seed)),
        pick=run_pick(Scene(seed)),
        insertion=run_insertion(seed, control),
        touches=tuple(run_touch(seed, k, control) for k in range(touch_trials.TOUCHES)),
    )


def gather_sight(found: Sequence[SightStudy]) -> dict[str, Any]:
    """Return the figures over all points, pictures and touches of several specimens."""
    return {
        "tracking": tracking_figures([one for each in found for one in each.followed]),
        **sight_figures([each.pick for each in found], [each.insertion for each in found]),
        "tool": touch_figures([one for each in found for one in each.touches]),
    }


def walls_table(followed: tuple[Followed, ...]) -> Table:
    """Return the errors of tracked points on each wall."""
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
