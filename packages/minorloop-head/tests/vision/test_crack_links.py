"""Joining the parts of a crack."""

import numpy as np
import pytest

from minorloop_head.vision.crack_links import cut_at_crossings, followed, joined


def line(start, stop, count=30):
    return np.linspace(start, stop, count)


def length(course):
    return np.hypot(*np.diff(course, axis=0).T).sum()


@pytest.mark.parametrize("turned", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1)])
def test_parts_that_continue_each_other_become_one_course_whatever_their_direction(turned):
    parts = [line((0, 0), (0, 30)), line((2, 40), (6, 70)), line((6, 75), (0, 110))]
    parts = [part[::-1] if turn else part for part, turn in zip(parts, turned, strict=True)]
    (whole,) = joined(parts)
    ends = sorted(map(tuple, (whole[0], whole[-1])))
    assert ends == [(0.0, 0.0), (0.0, 110.0)]
    assert length(whole) == pytest.approx(112, abs=2)
    assert np.hypot(*np.diff(whole, axis=0).T).max() < 2


SEEN, MARGIN = np.ones((40, 120), dtype=bool), np.zeros((40, 120), dtype=bool)


def dark(*points, height=0.8):
    heights = np.zeros((40, 120), dtype=np.float32)
    for y, x in points:
        heights[int(np.rint(y)), int(np.rint(x))] = height
    return heights


def test_ends_go_on_while_the_line_is_dark_and_not_off_the_map():
    heights = np.zeros((40, 120), dtype=np.float32)
    heights[10, 15:45], heights[10, 12:15], heights[10, 45:50] = 0.8, 0.5, 0.2
    (found,) = followed([line((10, 20), (10, 40), 21)], heights, 0.1, SEEN, MARGIN)
    assert sorted((found[0, 1], found[-1, 1])) == pytest.approx([12, 44])
    heights[10] = 0.8
    (whole,) = followed([line((10, 5), (10, 112), 108)], heights, 0.1, SEEN, MARGIN)
    assert sorted((whole[0, 1], whole[-1, 1])) == pytest.approx([0, 119])


def test_an_end_goes_on_through_the_margin_of_the_view_and_not_along_it():
    heights, seen, margin = np.zeros((40, 120), dtype=np.float32), SEEN.copy(), MARGIN.copy()
    heights[10, 10:50], margin[:, 50:55], seen[:, 55:] = 0.8, True, False
    course = [line((10, 15), (10, 47), 33)]
    (short,) = followed(course, heights, 0.1, seen, MARGIN)
    (long,) = followed(course, heights, 0.1, seen, margin)
    assert short[:, 1].max() == pytest.approx(49)
    assert long[:, 1].max() == pytest.approx(54)
    assert np.ptp(long[:, 0]) < 1


def test_parts_of_one_line_become_one_course_however_far_apart():
    heights = dark(*((20, x) for x in range(5, 115)))
    parts = [line((20, 5), (20, 25), 21), line((20, 100), (20, 60), 41)]
    (whole,) = joined(followed(parts, heights, 0.1, SEEN, MARGIN))
    assert length(whole) == pytest.approx(110, abs=4)


def test_courses_are_cut_where_they_cross_and_where_one_ends_on_another():
    along = np.arange(100.0)
    first = np.stack([np.full(100, 50.0), along], axis=1)
    second = np.stack([along, np.full(100, 40.0)], axis=1)
    branch = np.stack([np.arange(56.0, 90.0), np.full(34, 80.0)], axis=1)
    parts = cut_at_crossings([first, second, branch])
    assert len(parts) == 6
    assert all(np.hypot(*(part - [50.0, 40.0]).T).min() > 4 for part in parts)
    assert len(cut_at_crossings([first])) == 1
    corner = np.concatenate([first, np.stack([50.0 - along[1:60], np.full(59, 99.0)], axis=1)])
    assert [len(part) for part in cut_at_crossings([corner])] == [95, 55]
