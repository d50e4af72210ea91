"""Targets that other people print, found out from pictures."""

import cv2
import numpy as np
import pytest

from minorloop_head.procedures.target_pictures import look_through
from minorloop_head.vision.target_search import markers_in, search_target
from minorloop_head.vision.targets import SeenTarget, Target, plane_misfit

SIDE = 60
"""Pixels along a square of a drawn target."""


def drawn(target):
    """A target with a white margin, as OpenCV draws it."""
    columns, rows = target.columns, target.rows
    if target.kind == "charuco":
        bits = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
        board = cv2.aruco.CharucoBoard((columns, rows), 1.0, target.marker, bits)
        board.setLegacyPattern(target.legacy)
        size = (SIDE * columns + 2 * SIDE, SIDE * rows + 2 * SIDE)
        return board.generateImage(size, marginSize=SIDE)
    if target.kind == "chessboard":
        squares = np.indices((rows, columns)).sum(axis=0) % 2 * 255
        paper = np.kron(squares, np.ones((SIDE, SIDE))).astype(np.uint8)
        return np.pad(paper, SIDE, constant_values=255)
    width, height = SIDE * (target.size / target.square + 1)
    paper = np.full((int(height), int(width)), 255, np.uint8)
    for row in range(rows):
        for column in range(columns):
            x = 2 * column + row % 2 if target.kind == "asymmetric-circles" else column
            cv2.circle(paper, (SIDE * (x + 1), SIDE * (row + 1)), SIDE // 3, 0, -1)
    return paper


def pictures(target, count=3, turned=True):
    """Pictures of a target, tilted, some upside down."""
    paper, found = drawn(target), []
    height, width = paper.shape
    ends = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    for seed in range(count):
        rng = np.random.default_rng(seed)
        there = np.array([[60, 40], [580, 50], [560, 440], [80, 430]]) + rng.uniform(
            -30, 30, (4, 2)
        )
        if turned and seed % 2:
            there = np.roll(there, 2, axis=0)
        plane = cv2.getPerspectiveTransform(ends, there.astype(np.float32))
        image = cv2.warpPerspective(paper, plane, (640, 480), flags=cv2.INTER_AREA, borderValue=180)
        found.append(cv2.GaussianBlur(image, (0, 0), 0.8))
    return found


@pytest.mark.parametrize(
    "target",
    [
        Target("charuco", 5, 7, 3e-3, 0.7, "DICT_4X4_50"),
        pytest.param(Target("charuco", 12, 9, 3e-3, 0.8, "DICT_5X5_100"), marks=pytest.mark.whole),
        Target("charuco", 8, 6, 3e-3, 0.5, "DICT_6X6_50", legacy=True),
        pytest.param(
            Target("charuco", 7, 8, 3e-3, 0.8, "DICT_ARUCO_ORIGINAL"), marks=pytest.mark.whole
        ),
        Target("charuco", 5, 8, 3e-3, 0.75, "DICT_APRILTAG_25h9", legacy=True),
        Target("chessboard", 9, 6, 3e-3),
        Target("circles", 9, 6, 3e-3),
        Target("asymmetric-circles", 4, 11, 3e-3),
    ],
    ids=str,
)
def test_a_target_is_found_out_and_all_of_it_is_seen(target):
    shown = pictures(target)
    found = search_target(shown, 3e-3)
    if target.kind == "circles":  # it looks the same after a quarter turn
        assert {found.columns, found.rows} == {target.columns, target.rows}
    else:
        assert str(found) == str(target)
    assert found.marker == pytest.approx(target.marker, abs=0.03)
    inner = 0 if target.kind.endswith("circles") else 1
    for image in shown:
        seen = found.find(image, "a.png")
        assert isinstance(seen, SeenTarget)
        assert len(seen.points) == (target.columns - inner) * (target.rows - inner)
        assert plane_misfit(seen.points, seen.pixels) < 0.5


def test_rows_of_an_even_grid_that_opencv_exchanges_are_put_right():
    target = Target("asymmetric-circles", 4, 10, 3e-3)
    seen = target.find(pictures(target)[0], "a.png")
    assert plane_misfit(seen.points, seen.pixels) < 0.5


def test_part_of_a_charuco_target_tells_the_whole():
    target = Target("charuco", 9, 8, 3e-3, 0.75, "DICT_5X5_50", legacy=True)
    shown = pictures(target, 4)
    for number, image in enumerate(shown):
        image[:, : 240 if number % 2 else 0] = 128
        image[: 0 if number % 2 else 200] = 128
    assert str(search_target(shown, 3e-3)) == str(target)


def test_pictures_of_anything_show_no_target():
    shown = []
    for seed in range(3):
        noise = np.random.default_rng(seed).normal(0, 1, (480, 640))
        fur = cv2.GaussianBlur(noise, (0, 0), 6) + cv2.GaussianBlur(noise[::-1], (0, 0), 2) / 2
        shown.append(((fur - fur.min()) / np.ptp(fur) * 255).astype(np.uint8))
    assert search_target(shown, 3e-3) is None
    assert markers_in(shown) == ""


def test_pictures_of_two_kinds_in_a_folder_are_told_apart(tmp_path):
    charuco = Target("charuco", 7, 5, 4e-3, dictionary="DICT_4X4_50")
    other = Target("chessboard", 9, 6, 4e-3)
    for name, target in (("a", charuco), ("b", other)):
        for n, image in enumerate(pictures(target, turned=False)):
            cv2.imwrite(str(tmp_path / f"{name}{n}.png"), image)
    found = look_through(tmp_path, charuco)
    assert [each.name for each in found.seen] == ["a0.png", "a1.png", "a2.png"]
    assert all("it shows a chessboard" in why for why in found.left_out.values())
