import cv2
import numpy as np
import pytest

from minorloop_head.vision.targets import NONE, SeenTarget, Target

CHARUCO, BOARD = Target("charuco", 7, 5, 3e-3), Target("chessboard", 7, 6, 3e-3)
PLANE = np.array([[4.6, 0.4, 30.0], [-0.3, 4.4, 30.0], [0.0006, 0.0004, 1.0]])
"""From cells to pixels: four a cell, tilted."""


def picture(target, plane=PLANE, blur=0.8):
    """A target in perspective, sampled three by three a pixel."""
    cells = np.pad(np.where(target.cells(), 200, 20).astype(np.uint8), 8, constant_values=200)
    fine = np.array([[3.0, 0, 1.0], [0, 3.0, 1.0], [0, 0, 1.0]])  # pixel u is fine 3 u + 1
    cell = np.array([[1.0, 0, -7.5], [0, 1.0, -7.5], [0, 0, 1.0]])  # centre of a padded cell
    size = (3 * 320, 3 * 256)
    large = cv2.warpPerspective(cells, fine @ plane @ cell, size, flags=cv2.INTER_NEAREST)
    small = large.reshape(256, 3, 320, 3).mean(axis=(1, 3)).astype(np.float32)
    return np.rint(cv2.GaussianBlur(small, (0, 0), blur)).astype(np.uint8)


def pixels_of(target, points, plane=PLANE):
    """Where places on the target are in its picture."""
    cells = points / target.square * 8
    moved = np.column_stack([cells, np.ones(len(cells))]) @ plane.T
    return moved[:, :2] / moved[:, 2:]


@pytest.mark.parametrize("target", [CHARUCO, BOARD], ids=lambda target: target.kind)
def test_corners_are_where_they_are(target):
    seen = target.find(picture(target), "a.png")
    assert isinstance(seen, SeenTarget)
    assert len(seen.points) == (target.columns - 1) * (target.rows - 1)
    off = seen.pixels - pixels_of(target, seen.points)
    assert np.sqrt((off**2).mean()) < 0.15


def test_a_chessboard_upside_down_is_seen_so():
    seen = BOARD.find(picture(BOARD)[::-1, ::-1].copy(), "a.png")
    back = np.array([319.0, 255.0]) - seen.pixels
    assert np.abs(back - pixels_of(BOARD, seen.points)).max() < 1.0
    assert not Target("chessboard", 7, 5).oriented


def test_pictures_without_the_target_are_told():
    assert CHARUCO.find(np.full((256, 320), 128, np.uint8), "a.png") == NONE
    assert BOARD.find(picture(CHARUCO), "a.png") == NONE


def test_a_blurred_board_is_found_where_it_is():
    seen = BOARD.find(picture(BOARD, blur=3.5), "a.png")
    assert np.abs(seen.pixels - pixels_of(BOARD, seen.points)).max() < 0.5
