"""Flat targets for the calibration of a camera, and their corners."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray
from minorloop.errors import ParameterError
from minorloop_head.vision.calibrated_camera import Image
from minorloop_head.vision.imaging import opencv

KINDS = ("charuco", "chessboard", "circles", "asymmetric-circles")
CELLS = 8
"""Cells along the side of a square of a printed target."""
MARKER = 0.75
"""Side of a marker with its border, in squares, of a printed ChArUco target."""
COUNTS = (50, 100, 250, 1000)
"""Numbers of markers in the dictionaries of OpenCV that have several sizes."""
SMALLEST, LARGEST = 3, 60
"""Columns and rows that a target can have."""
_FEWEST = 6
"""Fewest corners of a target that determine its pose and check the distortion."""
_DISTURBED = 0.4
"""Distance in squares within which a reflection shifts a corner."""
_DOT = (20.0, 0.02)
"""Area of a circle: least number of pixels, and largest share of the picture."""

Corners = tuple[npt.NDArray[np.int64], FloatArray]
"""Numbers (N,) of corners, counted by rows, and their pixels (N, 2)."""

NONE = "no target found"


@dataclass(frozen=True, eq=False)
class SeenTarget:
    """Corners of a target in a picture."""

    name: str
    """Name of the picture."""
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
    """``charuco`` (a chessboard with markers in its white squares), ``chessboard``, ``circles``,
    or ``asymmetric-circles``, in which every other row is shifted by half of the distance."""
    columns: int = 9
    rows: int = 7
    """Squares, or circles as OpenCV counts them: 3 to 60."""
    square: float = 3e-3
    """Side of a square, or distance of circles (in the asymmetric grid, of its rows), in metres."""
    marker: float = MARKER
    """Side of a marker of a ChArUco target, in squares."""
    dictionary: str = ""
    """Name of its dictionary in OpenCV; empty for the smallest of 4 by 4 bits."""
    legacy: bool = False
    """Whether its first square is white though its rows are even, as in OpenCV before 4.6."""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ParameterError(f"the target is {self.kind!r}; give {', '.join(KINDS)}")
        if not (
            min(self.columns, self.rows) >= SMALLEST and max(self.columns, self.rows) <= LARGEST
        ):
            raise ParameterError(
                f"a target of {self.columns} by {self.rows} squares; give {SMALLEST} to "
                f"{LARGEST} each"
            )
        if not 1e-4 <= self.square <= 1.0:
            raise ParameterError(
                f"squares of {1e3 * self.square:g} mm; give the side of one, 0.1 to 1000 mm"
            )

    def __str__(self) -> str:
        """Return a name such as "a charuco target of 9 by 7 squares (DICT_4X4_50)"."""
        what = "circles" if self.kind.endswith("circles") else "squares"
        more = ""
        if self.kind == "charuco":
            more = f" ({self._dictionary}{', pattern before OpenCV 4.6' if self.legacy else ''})"
        article = "an" if self.kind[0] == "a" else "a"
        return f"{article} {self.kind} target of {self.columns} by {self.rows} {what}{more}"

    @property
    def oriented(self) -> bool:
        """Whether the target looks different when it is turned by 180 degrees."""
        if self.kind == "chessboard":
            return (self.columns + self.rows) % 2 == 1
        return self.kind == "charuco" or (self.kind == "asymmetric-circles" and self.rows % 2 == 1)

    @property
    def size(self) -> FloatArray:
        """Width and height (2,), in metres; of circles, with a margin of a distance."""
        sides = {"circles": (1, 1), "asymmetric-circles": (self.columns, 1)}.get(self.kind, (0, 0))
        return self.square * (np.array([self.columns, self.rows], dtype=np.float64) + sides)

    def cells(self) -> npt.NDArray[np.bool_]:
        """Return which cells are white, with `CELLS` along the side of a square.

        Raises a `ParameterError` if it cannot be drawn so.
        """
        if self.kind == "charuco" and self.marker == MARKER:
            size = (CELLS * self.columns, CELLS * self.rows)
            image = self._board.generateImage(size, marginSize=0)
            return np.asarray(image) > 0
        if self.kind != "chessboard":
            raise ParameterError(
                f"{self} is not printed here; print a charuco or chessboard target"
            )
        squares = np.indices((self.rows, self.columns)).sum(axis=0) % 2 == 1
        return np.kron(squares, np.ones((CELLS, CELLS), dtype=bool))

    def find(self, image: Image, name: str) -> SeenTarget | str:
        """Return the corners in a picture, or why it cannot be used: `NONE` without a target.

        ``image`` (H, W); ``name``: of the picture.
        """
        circles = self.kind.endswith("circles")
        search = self._circles if circles else getattr(self, f"_{self.kind}")
        found: Corners | None = search(image)
        if found is None:
            return NONE
        numbers, pixels = found
        inner = self.columns if circles else self.columns - 1
        across, down = numbers % inner, numbers // inner
        if len(numbers) < _FEWEST or np.ptp(across) == 0 or np.ptp(down) == 0:
            return NONE  # corners on one line give no plane
        places = [(across, down)]
        if self.kind == "asymmetric-circles":  # of even rows OpenCV may begin with the second
            rows = product((down, down ^ 1), (0, 1))
            places = [(2 * across + (row + off) % 2, row) for row, off in rows]
        steps = min(
            (np.stack(each, axis=1).astype(float) + 1 for each in places),
            key=lambda each: plane_misfit(each, pixels),
        )
        return SeenTarget(name, self.square * steps, pixels)

    @property
    def _dictionary(self) -> str:
        markers = self.columns * self.rows // 2
        return self.dictionary or f"DICT_4X4_{next(count for count in COUNTS if count >= markers)}"

    @cached_property
    def _board(self) -> Any:
        cv2 = opencv()
        bits = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self._dictionary))
        # Sides in cells, so that places of corners are whole numbers.
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), CELLS, CELLS * self.marker, bits)
        board.setLegacyPattern(self.legacy)
        return board

    @cached_property
    def _detector(self) -> Any:
        return opencv().aruco.CharucoDetector(self._board)

    def _charuco(self, image: Image) -> Corners | None:
        pixels, numbers, _, _ = self._detector.detectBoard(image)
        if numbers is None:
            return None
        return numbers.reshape(-1).astype(np.int64), pixels.reshape(-1, 2).astype(np.float64)

    def _chessboard(self, image: Image) -> Corners | None:
        cv2 = opencv()
        inner = (self.columns - 1, self.rows - 1)
        good, pixels = cv2.findChessboardCornersSB(image, inner, cv2.CALIB_CB_NORMALIZE_IMAGE)
        if not good:
            flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
            good, pixels = cv2.findChessboardCornersSB(image, inner, flags)
        if not good:
            return None
        corners = pixels.reshape(-1, 2).astype(np.float64)
        if self.oriented and _begins_white(image, corners.reshape(inner[1], inner[0], 2)):
            corners = corners[::-1].copy()
        return np.arange(len(corners)), corners

    def _circles(self, image: Image) -> Corners | None:
        cv2 = opencv()
        kind = (
            cv2.CALIB_CB_SYMMETRIC_GRID if self.kind == "circles" else cv2.CALIB_CB_ASYMMETRIC_GRID
        )
        for way, picture in ((0, image), (cv2.CALIB_CB_CLUSTERING, image), (0, 255 - image)):
            good, pixels = cv2.findCirclesGrid(
                picture, (self.columns, self.rows), flags=kind | way, blobDetector=dots(image)
            )
            if good:
                return np.arange(len(pixels)), pixels.reshape(-1, 2).astype(np.float64)
        return None


def plane_misfit(points: FloatArray, pixels: FloatArray) -> float:
    """Return the rms distance in pixels of pixels (N, 2) from a plane with points (N, 2)."""
    plane, _ = opencv().findHomography(points, pixels)
    if plane is None:
        return float("inf")
    off = opencv().perspectiveTransform(points[None], plane)[0] - pixels
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def dots(image: Image) -> Any:
    """Return OpenCV's detector of dark circles for pictures of this size."""
    options = opencv().SimpleBlobDetector_Params()
    options.minArea, options.maxArea = _DOT[0], _DOT[1] * image.size
    options.minDistBetweenBlobs = float(np.sqrt(_DOT[0]))
    return opencv().SimpleBlobDetector_create(options)


def _begins_white(image: Image, corners: FloatArray) -> bool:
    """Return whether the square at the first corner is white, as that at the last should be."""

    def outer(corner: FloatArray, along: FloatArray, down: FloatArray) -> float:
        u, v = np.rint(corner - 0.5 * (along - corner) - 0.5 * (down - corner)).astype(int)
        height, width = image.shape
        return float(image[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)])

    first = outer(corners[0, 0], corners[0, 1], corners[1, 0])
    last = outer(corners[-1, -1], corners[-1, -2], corners[-2, -1])
    return first > last
