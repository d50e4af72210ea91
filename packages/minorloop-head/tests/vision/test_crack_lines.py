"""Heights of lines under several lights."""

import numpy as np
from scipy import ndimage

from minorloop_head.vision.crack_lines import line_heights

ROWS, COLUMNS = np.mgrid[:90, :120].astype(float)
SEEN = np.ones(ROWS.shape, dtype=bool)


def stack(*levels):
    return np.stack(levels).astype(np.float32)


def dark(off, width=1.2):
    return -np.exp(-0.5 * (off / width) ** 2)


def test_a_line_is_as_high_as_lights_show_it_in_the_mean_whatever_its_direction_and_sign():
    for turn in np.linspace(0, np.pi, 7):
        off = (ROWS - 45) * np.cos(turn) - (COLUMNS - 60) * np.sin(turn)
        (heights, _), (middle, _) = line_heights(stack(dark(off), -0.5 * dark(off), 0 * off), SEEN)
        ((alone,), _) = line_heights(stack(dark(off)), SEEN)
        np.testing.assert_allclose(heights[45, 60], 0.5 * alone[45, 60], rtol=1e-3)
        assert middle[44:47, 59:62].any()
        assert np.median(heights[np.abs(off) > 12]) < 0.05


def test_differences_between_lights_show_a_groove_that_the_colour_of_a_wall_hides():
    off, rng = ROWS - 45, np.random.default_rng(1000)
    colour = ndimage.gaussian_filter(rng.normal(0, 4.0, ROWS.shape), 3)
    groove = 0.3 * off * dark(off)  # one flank bright, the other dark
    (of_maps, of_differences), _ = line_heights(
        stack(colour + groove, colour, colour - groove), SEEN
    )
    near = slice(43, 48), slice(20, 100)
    share = [one[near].max(axis=0).mean() / np.median(one) for one in (of_maps, of_differences)]
    assert share[0] < 2 < 10 < share[1]


def test_an_edge_and_a_spot_are_low():
    off = ROWS - 45
    ((edge,), _) = line_heights(stack(np.where(off > 0, -0.5, 0.0)), SEEN)
    ((spot,), _) = line_heights(stack(dark(np.hypot(off, COLUMNS - 60))), SEEN)
    ((line,), _) = line_heights(stack(dark(off)), SEEN)
    assert edge[30:60, 30:90].max() < 0.3 * 0.5 * line[45, 60]
    assert spot.max() < 0.6 * line[45, 60]


def test_a_line_at_one_edge_of_the_map_is_not_seen_at_the_other():
    level = stack(dark(ROWS - 2))
    ((heights,), _) = line_heights(level, SEEN)
    ((bare,), _) = line_heights(np.zeros_like(level), SEEN)
    assert heights[:8].max() > 0.1
    assert np.abs(heights[-12:] - bare[-12:]).max() < 0.01
