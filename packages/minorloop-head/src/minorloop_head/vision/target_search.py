"""Detection of targets in pictures: kind, dictionary and pattern of markers, columns and rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv
from minorloop_head.vision.targets import COUNTS, LARGEST, Target, dots, plane_misfit

_DICTIONARIES = {
    4: ("4X4_1000", "APRILTAG_16h5"),
    5: ("5X5_1000", "ARUCO_ORIGINAL", "APRILTAG_25h9"),
    6: ("6X6_1000", "APRILTAG_36h10", "APRILTAG_36h11", "ARUCO_MIP_36h12"),
    7: ("7X7_1000",),
}
"""Dictionaries of OpenCV by the bits along the side of a marker; smaller ones are beginnings."""
_FEWEST, _AGREE = 4, 0.8
"""Fewest pairs of neighbours in a ChArUco target, and least share of pairs that agree, or of steps
of grey between squares of a chessboard, less steps of the wrong sign."""
_CELL, _CONTRAST = 4, 20.0
"""Pixels along a cell of a rectified marker, and least contrast of its grey levels."""
_SHRUNK = 1000
"""Width in pixels to which pictures are shrunk before chessboards and circles are searched."""
_CORNERS = 12
"""Fewest corners of a chessboard, or circles: any picture may have less."""
_ALIKE = 1.4
"""Largest logarithm of the area of a circle of a grid over the median: perspective changes it."""
_PLANE = 0.15
"""Largest rms distance of the circles from a plane grid, in distances."""


@dataclass(frozen=True, eq=False)
class _Markers:
    """Markers in a picture."""

    numbers: npt.NDArray[np.int64]
    """Shape (N,)."""
    corners: FloatArray
    """Shape (N, 4, 2). Corners of the marker from the upper left one, clockwise, in pixels."""


def search_target(images: Sequence[Image], square: float) -> Target | None:
    """Return the target in pictures; None if there is no known one.

    ``images`` (H, W); ``square``: side of a square or distance of circles, in metres.
    """
    family, markers = _markers(images)
    found = _charuco(family, markers, square) if family else None
    small = [_shrunk(image) for image in images]
    return found or _agreed(small, square, _chessboard) or _agreed(small, square, _grid)


def markers_in(images: Sequence[Image]) -> str:
    """Return the family of markers that pictures show; empty if there is none."""
    return _markers(images)[0]


def _markers(images: Sequence[Image]) -> tuple[str, list[_Markers]]:
    """Return the most frequent family of markers, and its markers in each picture."""
    seen = [_decoded(image) for image in images]
    totals = Counter[str]()
    for each in seen:
        totals.update({name: len(found.numbers) for name, found in each.items()})
    if not totals or totals.most_common(1)[0][1] < _FEWEST:
        return "", []
    family = totals.most_common(1)[0][0]
    return family, [each[family] for each in seen if family in each]


def _decoded(image: Image) -> dict[str, _Markers]:
    """Return the markers of each family whose bits have no error."""
    cv2 = opencv()
    # Quadrangles do not depend on the dictionary, and the smallest takes least time.
    smallest = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_16h5)
    found, _, rejected = cv2.aruco.ArucoDetector(smallest).detectMarkers(image)
    seen: dict[str, list[tuple[int, FloatArray]]] = {}
    for quad in (each.reshape(4, 2) for each in (*found, *rejected)):
        for bits in _DICTIONARIES:
            edge = _CELL * (bits + 2)
            ends = np.array([[0, 0], [edge, 0], [edge, edge], [0, edge]], dtype=np.float32) - 0.5
            plane = cv2.getPerspectiveTransform(quad.astype(np.float32), ends)
            patch = cv2.warpPerspective(image, plane, (edge, edge))
            cells = patch.reshape(bits + 2, _CELL, bits + 2, _CELL)[:, 1:-1, :, 1:-1].mean((1, 3))
            if np.ptp(cells) < _CONTRAST:
                continue
            white = cells > (cells.min() + cells.max()) / 2
            inner = white[1:-1, 1:-1]
            if white.sum() > inner.sum():  # the border is black
                continue
            for family, number, turns in _codes(bits).get(_code(inner), ()):
                # Contours are half a pixel inside, in the outermost pixels of a marker.
                side = np.linalg.norm(np.diff(quad, axis=0), axis=1).mean()
                grown = quad + (quad - quad.mean(axis=0)) / side
                seen.setdefault(family, []).append((number, np.roll(grown, turns, axis=0)))
    return {
        family: _Markers(np.array([n for n, _ in each]), np.array([quad for _, quad in each]))
        for family, each in seen.items()
    }


def _code(bits: npt.NDArray[np.bool_]) -> bytes:
    return bytes(np.packbits(bits))


@cache
def _codes(bits: int) -> dict[bytes, list[tuple[str, int, int]]]:
    """Return families, numbers and quarter turns of markers by their bits."""
    cv2 = opencv()
    found: dict[bytes, list[tuple[str, int, int]]] = {}
    for name in _DICTIONARIES[bits]:
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name}"))
        for number, codes in enumerate(dictionary.bytesList):
            upright = cv2.aruco.Dictionary.getBitsFromByteList(codes[None], bits).astype(bool)
            for turns in range(4):
                code = _code(np.rot90(upright, turns))
                found.setdefault(code, []).append((name.removesuffix("_1000"), number, turns))
    return found


def _charuco(family: str, markers: Sequence[_Markers], square: float) -> Target | None:
    """Return the ChArUco target that fits the places of markers; None if no target fits."""
    best, least = None, _FEWEST - 1
    for columns in range(3, LARGEST + 1):
        for legacy in (False, True):
            good, bad, ratios, last = _neighbours(markers, columns, legacy)
            if good - bad > least and good > _AGREE * (good + bad):
                least = good - bad
                best = (columns, legacy, float(np.median(ratios)), last)
    if best is None:
        return None
    columns, legacy, ratio, last = best
    rows = max(int(_places(np.array([last]), columns, legacy)[0, 1]) + 1, 3)
    rows += rows % 2 if legacy else 0  # the patterns differ where rows are even
    if any(f"{family}_1000" in names for names in _DICTIONARIES.values()):
        family += f"_{next(count for count in COUNTS if 2 * count >= columns * rows - 1)}"
    return Target("charuco", columns, rows, square, ratio, f"DICT_{family}", legacy)


def _places(numbers: npt.NDArray[np.int64], columns: int, legacy: bool) -> npt.NDArray[np.int64]:
    """Return column and row (N, 2) of markers on a ChArUco target; two rows have one a column."""
    pair, rest = np.divmod(numbers, columns)
    first = (columns + legacy) // 2
    lower = rest >= first
    across = 2 * (rest - first * lower) + (lower == legacy)
    return np.stack([across, 2 * pair + lower], axis=-1)


def _neighbours(
    markers: Sequence[_Markers], columns: int, legacy: bool
) -> tuple[int, int, list[float], int]:
    """Return the counts of diagonal neighbours at the places of a target, and at other places.

    Further the sides of markers in squares, and the largest number of a neighbour in its place. A
    pair is judged by the sides of its own marker, which makes distortion and perspective harmless.
    """
    good, bad, last = 0, 0, 0
    ratios: list[float] = []
    for each in markers:
        place = _places(each.numbers, columns, legacy)
        ul, ur, lr, ll = np.moveaxis(each.corners, 1, 0)
        axes = np.stack([ur + lr - ul - ll, ll + lr - ul - ur], axis=-1) / 2
        middle = each.corners.mean(axis=1)
        step = place[None, :] - place[:, None]
        one, other = np.nonzero((np.abs(step) == 1).all(axis=-1))
        off = np.linalg.solve(axes[one], (middle[other] - middle[one])[..., None])[..., 0]
        off *= step[one, other]  # both are 1 over the ratio of marker to square
        agree = (off > 1.0).all(axis=1) & (off < 4.0).all(axis=1)
        agree &= off.max(axis=1) < 1.6 * off.min(axis=1)
        good, bad = good + int(agree.sum()), bad + int((~agree).sum())
        ratios += (1 / off[agree].mean(axis=1)).tolist()
        last = max(last, int(each.numbers[one[agree]].max(initial=0)))
    return good, bad, ratios, last


def _shrunk(image: Image) -> Image:
    factor = _SHRUNK / image.shape[1]
    if factor >= 1:
        return image
    cv2 = opencv()
    small: Image = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return small


def _agreed(
    images: Sequence[Image], square: float, search: Callable[[Image, float], Target | None]
) -> Target | None:
    """Return the target that two pictures agree on, or the largest if most pictures have one."""
    seen = Counter[Target]()
    for image in images:
        found = search(image, square)
        if found is not None:
            seen[found] += 1
            if seen[found] > 1:
                return found
    if 2 * seen.total() < max(len(images), 1):
        return None
    return max(seen, key=lambda each: each.columns * each.rows)


def _chessboard(image: Image, square: float) -> Target | None:
    cv2 = opencv()
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    good, pixels, inner = cv2.findChessboardCornersSBWithMeta(image, (3, 3), flags)
    if not good or inner.size < _CORNERS or max(inner.shape) >= LARGEST:
        return None
    # Grey levels inside of four corners each, in rows and columns.
    corners = pixels.reshape(*inner.shape, 2)
    middles = (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4
    u, v = np.moveaxis(np.rint(middles).astype(int), -1, 0)
    grey, sign = image[v, u].astype(float), (-1.0) ** np.indices(u.shape).sum(axis=0)
    steps = [(np.diff(grey, axis=axis) * np.delete(sign, 0, axis=axis)).ravel() for axis in (0, 1)]
    alternate = np.abs(np.sign(np.concatenate(steps)).mean())  # 1 if each step is opposite
    if alternate < _AGREE:
        return None
    return Target("chessboard", max(inner.shape) + 1, min(inner.shape) + 1, square)


def _grid(image: Image, square: float) -> Target | None:
    """Return the grid of as many circles as there are in a picture."""
    best, least = None, _PLANE
    for picture in (image, 255 - image):
        found = dots(image).detect(picture)
        areas = np.array([dot.size**2 for dot in found])
        alike = np.abs(np.log(areas / np.median(areas))) < _ALIKE if found else areas > 0
        places = np.array([dot.pt for dot in found]).reshape(-1, 2)[alike]
        count = len(places)
        if count < _CORNERS or not _even(places):
            continue
        for kind, columns in product(("circles", "asymmetric-circles"), range(3, count // 3 + 1)):
            if count % columns or max(columns, count // columns) > LARGEST:
                continue
            target = Target(kind, columns, count // columns, square)
            seen = target.find(image, "")
            if isinstance(seen, str):
                continue
            share = plane_misfit(seen.points, seen.pixels) / float(_nearest(seen.pixels).mean())
            if share < least:
                best, least = target, share
    return best


def _nearest(places: FloatArray) -> FloatArray:
    """Return the distance (N,) of each place (N, 2) to the next."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    return np.asarray(np.partition(apart, 1, axis=1)[:, 1])


def _even(places: FloatArray) -> bool:
    """Return whether the distances of places are those of a grid."""
    apart = _nearest(places)
    return bool((np.abs(np.log(apart / np.median(apart))) < 0.5).mean() > _AGREE)
