"""Truth of the deviations that the calibration of a lens states, on simulated corners.

Each set has its own camera, target and habits: pixels that are square or not, distortion by the
polynomial of the fit, of a fisheye or a quotient, targets that are bent a little, corners that are
off together in a picture, few pictures or many, in the middle of the image or all over it. The fit
is not told any of this.

::

    python -m benchmarks.lens_sets 0 20          # seeds 0 to 19
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from minorloop.arrays import FloatArray
from minorloop.errors import RecordError
from minorloop_head.vision.targets import SeenTarget

_SIZES = ((640, 480), (720, 576), (1280, 720), (1920, 1080))
_SQUARE = 3e-3
"""Side of a square, in metres."""
_FEWEST = 8
"""Corners of a picture that is kept."""


@dataclass(frozen=True, eq=False)
class LensSet:
    """Corners of simulated pictures, and the camera that took them."""

    seen: list[SeenTarget]
    size: tuple[int, int]
    focals: FloatArray
    """Shape (2,). Along rows and columns, in pixels."""
    centre: FloatArray
    """Shape (2,). In pixels."""
    distort: Callable[[FloatArray], FloatArray]
    """From normalised coordinates (..., 2) to distorted ones."""

    @property
    def truth(self) -> dict[str, float]:
        """Values by the names of results."""
        names = ("focal length fx", "focal length fy", "principal point u", "principal point v")
        return dict(zip(names, (*self.focals.tolist(), *self.centre.tolist()), strict=True))


def draw(seed: int, *, least: int = 5, most: int = 40) -> LensSet:
    """Return a set of a random camera, with so many pictures at least and at most."""
    rng = np.random.default_rng([seed, 77])
    size, focals, centre, distort = _camera(rng)
    width, height = size
    columns, rows = rng.integers(6, 20), rng.integers(5, 14)
    grid = _SQUARE * np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    count, noise = int(rng.integers(least, most)), float(np.exp(rng.uniform(*np.log([0.05, 0.6]))))
    together, tilt = noise * rng.uniform(0.0, 2.0), rng.uniform(15.0, 45.0)
    spread = 0.15 if rng.random() < 0.3 else 0.45
    cut = rng.random() < 0.4
    target = grid - _SQUARE * (np.array([columns, rows]) - 1) / 2
    half = float(np.abs(target).max())
    x, y = target.T / half
    bent = half * np.stack([x * x, x * y, y * y], -1) @ rng.normal(0, 2e-3 * rng.random(), 3)
    seen: list[SeenTarget] = []
    while len(seen) < count:
        way, angle = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(0, tilt))
        turn = Rotation.from_rotvec([angle * np.cos(way), angle * np.sin(way), 0.0])
        turn = turn * Rotation.from_rotvec([0.0, 0.0, rng.normal(0, 0.3)])
        field = np.array([width, height]) / focals
        depth = 2 * half / field.min() / rng.uniform(0.4, 1.6 if cut else 0.9)
        aim = np.array([*(rng.uniform(-spread, spread, 2) * field), 1.0])
        points = turn.apply(np.column_stack([target, bent])) + depth * aim
        if points[:, 2].min() < 0.1 * depth:
            continue
        plain = points[:, :2] / points[:, 2:]
        pixels = distort(plain) * focals + centre
        there = ((pixels > 2) & (pixels < [width - 3, height - 3])).all(axis=1)
        there &= np.hypot(*plain.T) < 0.9 * np.hypot(*field)  # beyond, the lens may fold back
        if there.sum() < max(_FEWEST, 0.3 * len(grid)) or not (cut or there.all()):
            continue
        if min(np.ptp(grid[there], axis=0)) == 0:
            continue
        u, v = (pixels / [width, height] - 0.5).T
        off = 4 * np.stack([u * u, u * v, v * v], -1) @ rng.normal(0, together, (3, 2))
        pixels = pixels + off + rng.normal(0, noise, pixels.shape)
        seen.append(SeenTarget(f"{len(seen)}.png", grid[there], pixels[there]))
    return LensSet(seen, size, focals, centre, distort)


def _camera(
    rng: np.random.Generator,
) -> tuple[tuple[int, int], FloatArray, FloatArray, Callable[[FloatArray], FloatArray]]:
    """Return size, focal lengths, centre and distortion of a random camera that does not fold."""
    while True:
        size = _SIZES[rng.integers(len(_SIZES))]
        focal = size[0] * rng.uniform(0.7, 1.6)
        focals = np.array([focal, focal * (1.0 if rng.random() < 0.5 else rng.uniform(0.9, 1.1))])
        centre = (np.array(size) - 1) / 2 + rng.normal(0, 0.02, 2) * size
        kind = rng.integers(3)
        radial = rng.uniform((-0.35, -0.1, -0.2), (0.1, 0.3, 0.4))
        fish, above, below = rng.uniform((0.3, -0.3, 0.0), (1.0, 0.1, 0.3))
        p1, p2 = rng.normal(0, 0.002, 2) * (rng.random() < 0.7)

        def distort(
            plain: FloatArray,
            kind: int = int(kind),
            radial: FloatArray = radial,
            numbers: tuple[float, ...] = (fish, above, below, p1, p2),
        ) -> FloatArray:
            fish, above, below, p1, p2 = numbers
            x, y = plain[..., 0], plain[..., 1]
            square = x * x + y * y
            if kind == 0:
                scale = 1 + square * (radial[0] + square * (radial[1] + square * radial[2]))
            elif kind == 1:
                reach = np.sqrt(square) + 1e-12
                scale = 1 - fish + fish * np.arctan(reach) / reach
            else:
                scale = (1 + above * square) / (1 + below * square)
            return np.stack(
                [
                    scale * x + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                    scale * y + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
                ],
                axis=-1,
            )

        reach = np.linspace(0.0, 0.9 * float(np.hypot(*(np.array(size) / focals))), 100)
        moved = distort(np.stack([reach, 0 * reach], -1))[:, 0]
        if (np.diff(moved) > 0.1 * np.diff(reach)).all():
            return size, focals, centre, distort


def deviations(seeds: Iterable[int]) -> tuple[dict[str, list[float]], list[str]]:
    """Return differences from the truth in standard deviations, and refusals."""
    from minorloop_head.vision.lens_calibration import fit_lens

    found: dict[str, list[float]] = {}
    refused = []
    for seed in seeds:
        drawn = draw(seed)
        try:
            fit = fit_lens(drawn.seen, drawn.size)
        except RecordError as error:
            refused.append(f"seed {seed}: {error}")
            continue
        for each in fit.measured[:4]:
            off = abs(each.value - drawn.truth[each.name])
            found.setdefault(each.name, []).append(off / each.sd)
    return found, refused


def main(first: int, count: int) -> None:
    """Print the shares of differences within 1, 2 and 3 standard deviations."""
    found, refused = deviations(range(first, first + count))
    print("what, within 1, 2 and 3 standard deviations, largest")
    for name, each in found.items():
        off = np.array(each)
        shares = ", ".join(f"{(off <= most).mean():.1%}" for most in (1, 2, 3))
        print(f"{name}: {shares}, {off.max():.1f} of {off.size}")
    print(*refused, sep="\n")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
