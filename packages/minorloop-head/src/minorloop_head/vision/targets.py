"""Flat targets for the calibration of a camera: ChArUco and chessboard, and their corners."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv

KINDS = ("charuco", "chessboard")
CELLS = 8
"""Cells along the side of a square of a ChArUco target; a marker with its border has 6."""
_DICTIONARIES = (50, 100, 250, 1000)
"""Numbers of markers of 4 by 4 bits in the dictionaries of OpenCV."""
_FEWEST = 8
"""Corners of a target that are enough for its pose and distortion to be checked."""
_DISTURBED = 0.4
"""Distance in squares within which a reflection may shift a corner."""
_BLURRED = (6.0, 0.01)
"""Largest width of an edge: in pixels, and in widths of the picture if that is more."""
_MISFIT = 0.3
"""Largest rms distance of corners from a plane grid, in squares; distortion gives below 0.15."""

Corners = tuple[npt.NDArray[np.int64], FloatArray]
"""Numbers (N,) of corners, counted by rows, and their pixels (N, 2)."""

NONE, BLURRED, ANOTHER = "no target found", "blurred", "another target"


@dataclass(frozen=True, eq=False)
class SeenTarget:
    """Corners of a target in a picture."""

    name: str
    """Of the picture."""
    points: FloatArray
    """Shape (N, 2). Places on the target, from its upper left corner to the right and down, in
    metres."""
    pixels: FloatArray
    """Shape (N, 2)."""

    def away_from(self, spot: FloatArray) -> SeenTarget:
        """Return the target without the corners that a bright spot (2,) covers or disturbs."""
        apart = np.linalg.norm(self.pixels[1:] - self.pixels[:-1], axis=1)
        far = np.linalg.norm(self.pixels - spot, axis=1) > _DISTURBED * np.median(apart)
        return SeenTarget(self.name, self.points[far], self.pixels[far])


@dataclass(frozen=True)
class Target:
    """A flat target, printed at scale.

    Raises a `ParameterError` if a value is out of its range.
    """

    kind: str = "charuco"
    """``charuco`` (markers of 4 by 4 bits in the white squares, upper left square black) or
    ``chessboard``."""
    columns: int = 9
    rows: int = 7
    """Squares, 4 to 40."""
    square: float = 3e-3
    """Side of a square, in metres."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ParameterError(f"the target is {self.kind!r}; give {' or '.join(KINDS)}")
        if not (4 <= self.columns <= 40 and 4 <= self.rows <= 40):
            raise ParameterError(
                f"a target of {self.columns} by {self.rows} squares; give 4 to 40 each"
            )
        if not 1e-4 <= self.square <= 1.0:
            raise ParameterError(
                f"squares of {1e3 * self.square:g} mm; give the side of one, 0.1 to 1000 mm"
            )

    @property
    def oriented(self) -> bool:
        """Whether the target looks different when it is turned by 180 degrees."""
        return self.kind == "charuco" or (self.columns + self.rows) % 2 == 1

    @property
    def size(self) -> FloatArray:
        """Width and height (2,), in metres."""
        return self.square * np.array([self.columns, self.rows], dtype=np.float64)

    def cells(self) -> npt.NDArray[np.bool_]:
        """Return which cells are white, with `CELLS` along the side of a square."""
        if self.kind == "charuco":
            size = (CELLS * self.columns, CELLS * self.rows)
            image = self._board.generateImage(size, marginSize=0)
            return np.asarray(image) > 0
        squares = np.indices((self.rows, self.columns)).sum(axis=0) % 2 == 1
        return np.kron(squares, np.ones((CELLS, CELLS), dtype=bool))

    def find(self, image: Image, name: str) -> SeenTarget | str:
        """Return the corners in a picture, or why it cannot be used.

        ``image`` (H, W); ``name``: of the picture.

        Returns
        -------
        SeenTarget or str
            `NONE`, `BLURRED`, or `ANOTHER` for a target with other squares.
        """
        found: Corners | str = (
            self._charuco(image) if self.kind == "charuco" else self._chessboard(image)
        )
        if isinstance(found, str):
            return found
        numbers, pixels = found
        inner = self.columns - 1
        if np.ptp(numbers % inner) == 0 or np.ptp(numbers // inner) == 0:
            return NONE  # corners on one line give no plane
        steps: FloatArray = np.stack([numbers % inner, numbers // inner], axis=1).astype(float) + 1
        misfit, spacing = _misfit(steps, pixels)
        if misfit > _MISFIT * spacing:
            return ANOTHER
        if _edge_width(image, pixels, spacing) > max(_BLURRED[0], _BLURRED[1] * image.shape[1]):
            return BLURRED
        return SeenTarget(name, self.square * steps, pixels)

    @cached_property
    def _board(self) -> Any:
        cv2 = opencv()
        markers = self.columns * self.rows // 2
        count = next(count for count in _DICTIONARIES if count >= markers)
        bits = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_4X4_{count}"))
        # Sides in cells, so that places of corners are whole numbers.
        return cv2.aruco.CharucoBoard((self.columns, self.rows), CELLS, CELLS - 2, bits)

    @cached_property
    def _detector(self) -> Any:
        return opencv().aruco.CharucoDetector(self._board)

    def _charuco(self, image: Image) -> Corners | str:
        pixels, numbers, _, markers = self._detector.detectBoard(image)
        unknown = 0 if markers is None else (markers >= self.columns * self.rows // 2).sum()
        if unknown > 2:  # one may be a misreading
            return ANOTHER
        if numbers is None or len(numbers) < _FEWEST:
            # Markers in other places than those of this target give no corners.
            return ANOTHER if markers is not None and len(markers) >= _FEWEST else NONE
        return numbers.reshape(-1).astype(np.int64), pixels.reshape(-1, 2).astype(np.float64)

    def _chessboard(self, image: Image) -> Corners | str:
        cv2 = opencv()
        inner = (self.columns - 1, self.rows - 1)
        good, pixels = cv2.findChessboardCornersSB(image, inner, cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not good:
            return NONE
        corners = pixels.reshape(-1, 2).astype(np.float64)
        if self.oriented and _begins_white(image, corners.reshape(inner[1], inner[0], 2)):
            corners = corners[::-1].copy()
        return np.arange(len(corners)), corners


def _edge_width(image: Image, pixels: FloatArray, spacing: float) -> float:
    """Return the median width of edges at corners, in pixels: contrast over steepest slope.

    Parameters
    ----------
    image : (H, W) array of uint8
    pixels : (N, 2) array
        Corners.
    spacing : float
        Distance between neighbours, in pixels.
    """
    cv2 = opencv()
    half = max(2, int(0.35 * spacing))
    smooth = image.astype(np.float32)
    slopes = np.hypot(
        cv2.Sobel(smooth, cv2.CV_32F, 1, 0, scale=1 / 8),
        cv2.Sobel(smooth, cv2.CV_32F, 0, 1, scale=1 / 8),
    )
    widths = []
    for u, v in np.rint(pixels).astype(int):
        window = np.s_[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1]
        if smooth[window].size == 0:
            continue
        low, high = np.percentile(smooth[window], (5, 95))
        widths.append((high - low) / max(float(np.percentile(slopes[window], 98)), 1e-6))
    return float(np.median(widths))


def _misfit(steps: FloatArray, pixels: FloatArray) -> tuple[float, float]:
    """Return rms distance from a plane grid, and distance between neighbours, both in pixels."""
    plane, _ = opencv().findHomography(steps, pixels)
    if plane is None:
        return np.inf, 1.0
    ends = np.stack([steps + step for step in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))])
    moved = np.concatenate([ends, np.ones_like(ends[..., :1])], axis=-1) @ plane.T
    at = moved[..., :2] / moved[..., 2:]
    spacing = float(np.median(np.linalg.norm(at[1:] - at[0], axis=-1)))
    return float(np.sqrt(((at[0] - pixels) ** 2).sum(axis=-1).mean())), spacing


def _begins_white(image: Image, corners: FloatArray) -> bool:
    """Return whether the square at the first corner is white, as that at the last should be."""

    def outer(corner: FloatArray, along: FloatArray, down: FloatArray) -> float:
        u, v = np.rint(corner - 0.5 * (along - corner) - 0.5 * (down - corner)).astype(int)
        height, width = image.shape
        return float(image[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)])

    first = outer(corners[0, 0], corners[0, 1], corners[1, 0])
    last = outer(corners[-1, -1], corners[-1, -2], corners[-2, -1])
    return first > last
