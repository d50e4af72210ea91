"""Judge what is found in pictures, and depths of pits, by light and sound that no twin makes.

    python -m benchmarks.judge render --first 0 --count 200
    python -m benchmarks.judge score --first 0 --count 200
    python -m benchmarks.judge pictures --first 1000 --count 40 --out build/judge/pictures
    python -m benchmarks.judge sound --first 0 --count 3

Each seed gives a scene with a hole, one without, both among marks that resemble holes, and one
with a crack. Rendered scenes are kept in a folder, so that a run that was stopped goes on where it
was. Seeds from 1000 are for development and for fitting.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.judge import scenes
from benchmarks.judge.scenes import Scene
from papers.catheter.detection import JUDGED_SCENES

SAMPLES = 8
"""Paths through a pixel: their noise is then below that of the camera in direct light."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.judge", description=__doc__)
    parser.add_argument("what", choices=("render", "score", "pictures", "sound"))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--contents", nargs="+", choices=scenes.CONTENTS, default=scenes.CONTENTS)
    parser.add_argument("--folder", type=Path, default=Path("build/judge"))
    parser.add_argument("--out", type=Path, default=Path("build/judge/pictures"))
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    seeds = range(asked.first, asked.first + asked.count)
    if asked.what == "render":
        render(seeds, asked.folder, asked.contents)
    elif asked.what == "score":
        report(seeds, asked.folder, asked.json)
    elif asked.what == "sound":
        sound(seeds, asked.folder, asked.json)
    else:
        from benchmarks.judge.pictures import draw_pictures

        draw_pictures(rendered(seeds, asked.folder), asked.out)


def _file(folder: Path, seed: int, content: str) -> Path:
    return folder / f"{seed}-{content}.npz"


def render(seeds: range, folder: Path, contents: Sequence[str]) -> None:
    """Render the scenes that are not in the folder yet."""
    from benchmarks.judge import light

    light.prepare()
    folder.mkdir(parents=True, exist_ok=True)
    todo = [
        (seed, content)
        for seed in seeds
        for content in contents
        if not _file(folder, seed, content).exists()
    ]
    begin = time.monotonic()
    for n, (seed, content) in enumerate(todo, 1):
        found = light.radiance(scenes.draw(seed, content), SAMPLES)
        scale = float(found[:3].sum(axis=0).mean())
        found[:3] /= scale
        part = folder / "part.npz"
        np.savez_compressed(part, radiance=np.minimum(found, 6e4).astype(np.float16))
        part.rename(_file(folder, seed, content))
        each = (time.monotonic() - begin) / n
        left = each * (len(todo) - n) / 60
        print(
            f"{n} of {len(todo)}: seed {seed}, {each:.0f} s each, {left:.0f} min left",
            file=sys.stderr,
        )


def rendered(
    seeds: range, folder: Path, contents: Sequence[str] = scenes.CONTENTS
) -> Iterator[tuple[Scene, np.ndarray]]:
    """Return the scenes of the folder with their radiance."""
    for seed in seeds:
        for content in contents:
            path = _file(folder, seed, content)
            if path.exists():
                with np.load(path) as kept:
                    yield scenes.draw(seed, content), kept["radiance"].astype(np.float32)


def report(seeds: range, folder: Path, as_json: bool) -> None:
    """Score the scenes of the folder, and print the figures by kind of wall and of hole.

    Cracks are searched in all scenes, holes in those that have no crack.
    """
    from benchmarks.judge.score import crack_searched, figures, outdated, tried
    from papers.catheter.crack_trials import crack_figures, outcome_of

    trials, outcomes = [], []
    for scene, radiance in rendered(seeds, folder):
        outcomes.append((scene, outcome_of(scene.seed, crack_searched(scene, radiance))))
        if scene.content != scenes.CRACK:
            trials.append(tried(scene, radiance))
    found = {}
    for prefix, contents in (("", scenes.PLAIN), ("marked ", scenes.WITH_MARKS)):
        some = [trial for trial in trials if trial.scene.content in contents]
        found[f"{prefix}all"] = figures(some)
        for kind in scenes.KINDS:
            found[prefix + kind] = figures([t for t in some if t.scene.kind == kind])
        for inside in scenes.MARKED_INSIDES if prefix else scenes.INSIDES:
            own = [t for t in some if t.scene.hole is not None and t.scene.hole.inside == inside]
            found[prefix + inside] = figures(own)
    cracks = {"all": crack_figures([one for _, one in outcomes])}
    for kind in scenes.KINDS:
        cracks[kind] = crack_figures([one for scene, one in outcomes if scene.kind == kind])
    if as_json:
        print(json.dumps(found | {"cracks": cracks}, indent=2))
        return
    for name, row in found.items():
        if not row["scenes"]:
            continue
        low, high = row["recall_interval"]
        print(
            f"{name:15} {row['scenes']:4} acquisitions, recall {row['recall']:.3f} "
            f"({low:.2f} to {high:.2f}), false {row['false_per_acquisition']:.3f}, centre "
            f"{row['centre_mm_median']:.3f} and {row['centre_mm_p90']:.3f} mm (median, p90), "
            f"size within 15 % {row['size_within_15pct']:.2f}, refused {row['refused']}"
        )
    for name, row in cracks.items():
        classes = "; ".join(
            f"{limit} {row[f'recall_{limit}']:.3f} {_interval(row[f'recall_{limit}_interval'])} of "
            f"{row[f'scenes_{limit}']}"
            for limit in ("100um", "50um", "30um")
        )
        print(
            f"cracks, {name:9} {row['scenes']:4} with one, recall from {classes}; false "
            f"{row['false_per_acquisition']:.3f} {_interval(row['false_interval'])}; width "
            f"{row['width_error_um']:.0f} um off, length {row['length_error_pct']:.0f} % off"
        )
    if seeds == range(JUDGED_SCENES):
        for line in outdated(found):
            print(line, file=sys.stderr)


def _interval(bounds: tuple[float, float] | None) -> str:
    return "(none)" if bounds is None else f"({bounds[0]:.2f} to {bounds[1]:.2f})"


def sound(seeds: range, folder: Path, as_json: bool) -> None:
    """Measure pits of each depth and diameter with the setup of each seed."""
    from benchmarks.judge.pits import DEPTHS, DIAMETERS, figures, measured

    rows, total = {}, []
    for diameter in DIAMETERS:
        for depth in DEPTHS:
            found = [measured(seed, diameter, depth, folder / "pits") for seed in seeds]
            errors = [(pit.depth - depth if pit.measured else None) for pit in found]
            name = f"{1e3 * diameter:.1f} mm wide, {1e3 * depth:.2f} mm deep"
            rows[name] = figures(errors)
            rows[name]["verdicts"] = sorted({pit.verdict for pit in found if not pit.measured})
            print(name, rows[name], file=sys.stderr)
            total += errors
    rows["all"] = figures(total)
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for name, row in rows.items():
        print(
            f"{name:26} bias {row['bias_um']:+6.1f} um, sd {row['sd_um']:5.1f} um, worst "
            f"{row['worst_um']:6.1f} um, measured {row['measured_fraction']:.2f} of {row['scans']}"
        )


if __name__ == "__main__":
    main()
