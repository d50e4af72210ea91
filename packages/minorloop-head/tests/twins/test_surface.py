"""The unrolled surface of a pipe."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.twins.pipe import Bore, Dent, Dirt, Finish, Pipe, Weld
from minorloop_head.twins.surface import COLUMNS, lay_out, with_dirt

SMOOTH = Finish(brush=1e-9, streak=1e-9, stain=1e-9)


def finest(pipe):
    """(rows, columns, 4) of the finest level, without its border."""
    surface = lay_out(pipe)
    first, rows, columns = surface.shapes[0]
    whole = surface.texels[first : first + (rows + 1) * (columns + 1)]
    return whole.reshape(rows + 1, columns + 1, 4), surface


def test_each_level_is_half_as_fine_and_has_the_same_mean():
    pipe = Pipe(length=20e-3, dirt=(Dirt(0.0, 10e-3, 2e-3, 0.5),))
    surface = lay_out(pipe)
    means = []
    for first, rows, columns in surface.shapes:
        level = surface.texels[first : first + (rows + 1) * (columns + 1)]
        means.append(level.reshape(rows + 1, columns + 1, 4)[:rows, :columns].mean(axis=(0, 1)))
    assert [columns for _, _, columns in surface.shapes] == [COLUMNS >> n for n in range(4)]
    np.testing.assert_allclose(means, np.tile(means[0], (4, 1)), atol=1e-4)


def test_the_surface_of_the_last_pipes_is_kept_and_bores_do_not_change_it():
    pipe = Pipe(length=10e-3)
    surface = lay_out(pipe)
    marked = replace(pipe, dirt=(Dirt(0.0, 5e-3, 1e-3, 0.5),))
    assert not np.array_equal(lay_out(marked).texels, surface.texels)
    assert lay_out(replace(pipe, bores=(Bore(0.0, 5e-3, 1e-3),), water=0.0)) is surface
    assert lay_out(replace(pipe, dirt=[*marked.dirt])) is lay_out(marked)


@pytest.mark.parametrize("z", [0.1e-3, 5.03e-3, 9.97e-3, 12e-3, 30e-3])
def test_more_dirt_is_drawn_as_if_it_had_been_there_from_the_start(z):
    pipe = Pipe.draw(1000, length=10e-3)
    patch = Dirt(0.02, z, 0.4e-3, 0.5, seed=4)
    before, whole = lay_out(pipe), lay_out(replace(pipe, dirt=(*pipe.dirt, patch)))
    kept, more = before.texels.copy(), with_dirt(before, pipe, patch)
    np.testing.assert_allclose(more.texels, whole.texels, atol=1e-5)
    np.testing.assert_array_equal(before.texels, kept)  # it is shared
    assert np.array_equal(more.texels, kept) == (z > 11e-3)


def test_the_map_wraps_around_the_pipe():
    level, _ = finest(Pipe(length=10e-3, dirt=(Dirt(0.0, 5e-3, 1e-3, 0.5),)))
    np.testing.assert_array_equal(level[:, -1], level[:, 0])
    assert level[100, 0, 0] == pytest.approx(level[100, -3, 0], rel=0.5)


def test_a_dent_slopes_down_to_its_middle_from_all_sides():
    level, surface = finest(
        Pipe(length=10e-3, finish=SMOOTH, dents=(Dent(1.0, 5e-3, 5e-4, -1e-4),))
    )
    around, along = level[..., 1], level[..., 2]
    i, j = round(5e-3 / surface.size[1]), round(10e-3 / surface.size[0])
    assert around[i, j + 6] > 0.05
    assert around[i, j - 6] < -0.05
    assert along[i + 6, j] > 0.05
    steepest = 0.607 * 1e-4 / 5e-4
    assert np.abs(around).max() == pytest.approx(steepest, rel=0.02)


def test_a_weld_slopes_down_to_both_toes_and_has_valleys_at_its_pitch():
    bead = Weld(2.0, 5e-3, 0.0, 8e-3, 2e-3, height=0.1e-3, pitch=0.5e-3, ripple=0.2)
    level, surface = finest(Pipe(length=10e-3, finish=SMOOTH, welds=(bead,)))
    row, side = round(5e-3 / surface.size[1]), round(0.9e-3 / surface.size[1])
    columns = slice(*(round((20e-3 + x) / surface.size[0]) for x in (-2e-3, 2e-3)))
    around = level[row, columns, 1]
    assert np.ptp(around) == pytest.approx(0.4, rel=0.2)
    valleys = np.flatnonzero((around[:-1] < -0.1) & (around[1:] > 0.1))
    assert np.diff(valleys).mean() * surface.size[0] == pytest.approx(0.5e-3, rel=0.05)
    assert level[row - side, columns, 2].mean() == pytest.approx(0.18, rel=0.1)
    assert level[row + side, columns, 2].mean() == pytest.approx(-0.18, rel=0.1)
