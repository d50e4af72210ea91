"""Corners of a target as a camera sees them, without pictures."""

import numpy as np
from scipy.spatial.transform import Rotation

from minorloop_head.geometry import Pinhole
from minorloop_head.vision.targets import SeenTarget

LENS = Pinhole(640, 480, 522.0, (317.0, 243.0), -0.12, 0.02)
GRID = 3e-3 * (np.stack(np.meshgrid(np.arange(8), np.arange(6)), axis=-1).reshape(-1, 2) + 1.0)
MIDDLE = 3e-3 * np.array([4.5, 3.5, 0.0])


def held(aim, distance, turn):
    """Rotation and position of a target with its middle at an aim; degrees."""
    rotation = Rotation.from_rotvec(np.radians(turn)).as_matrix()
    return rotation, distance * np.array([*aim, 1.0]) - rotation @ MIDDLE


def seen(name, rotation, position, noise=0.07, seed=0, lens=LENS):
    """The corners that are in the image, with noise in pixels."""
    points = np.column_stack([GRID, np.zeros(len(GRID))]) @ rotation.T + position
    pixels = lens.project(points)
    rng = np.random.default_rng([seed, *map(ord, name)])
    there = ((pixels > 3) & (pixels < [lens.width - 4, lens.height - 4])).all(axis=1)
    return SeenTarget(name, GRID[there], pixels[there] + rng.normal(0, noise, (there.sum(), 2)))


def all_over(count=16, tilt=30.0, seed=1000, noise=0.07, lens=LENS, axis=None):
    """Pictures of a target all over the image, tilted in all directions or about one axis."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(count):
        row, column = divmod(number % 9, 3)
        way = rng.uniform(-np.pi, np.pi)
        turn = [tilt * np.cos(way), tilt * np.sin(way), rng.normal(0, 10)]
        if axis is not None:
            turn = (-1.0) ** number * tilt * np.eye(3)[axis]
        aim = (0.3 * (column - 1), 0.22 * (row - 1))
        place = held(aim, rng.uniform(0.02, 0.03), turn)
        found.append(seen(f"{number}.png", *place, noise, seed, lens))
    return found
