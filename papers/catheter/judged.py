"""Figures of the hole finder on scenes of another renderer, as ``make judge`` prints them.

The study scores scenes that the twin of the camera draws. The renderer Mitsuba 3 shares no code
with it, and is a tool of development that a study does not run. Its figures are kept here, to be
quoted beside each recall: 200 scenes with a hole and 200 without, seeds 0 to 199. ``make judge``
says where it finds others. Its scenes with cracks and with more marks are not part of them; it has
none in water.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SCENES = 200
"""Scenes with a hole, and without, that the figures are of."""
JUDGE: Mapping[str, Any] = {
    "recall": 0.965,
    "recall_interval": (0.93, 0.98),
    "false_per_acquisition": 0.04,
    "centre_mm_p90": 0.063,
    "size_within_15pct": 0.98,
    "refused": 0,
    "corroded": {"recall": 0.939, "false_per_acquisition": 0.023},
    "bare": {"false_per_acquisition": 0.06},
    "soil": {"recall": 0.889},
}
"""Over all walls, on corroded and on bare ones, and of holes full of soil."""
_DECIMALS = {"size_within_15pct": 2}
"""Of the kept figures; the others have three."""


def outdated(found: Mapping[str, Any]) -> list[str]:
    """Return a line for each kept figure that is another one now.

    What is found has figures under ``all``, and of each kind of wall and of hole under its name.
    """
    parts = {name: each for name, each in JUDGE.items() if isinstance(each, Mapping)}
    return [
        f"{name}.{key} is {found[name][key]:.3f}, and {kept:g} is kept: correct it in "
        "papers.catheter.judged, README.md and docs/head/reference/studies.md"
        for name, each in {"all": JUDGE, **parts}.items()
        for key, kept in each.items()
        if isinstance(kept, float) and round(found[name][key], _DECIMALS.get(key, 3)) != kept
    ]
