import numpy as np
import pytest

from minorloop_head.reconstruction.depth_map import BOTH, CAMERA, ECHOES, UNSEEN, Patch
from minorloop_head.reconstruction.fusion import MeanDepths, fuse, inside_probability, outline_of
from minorloop_head.ultrasound.pits import PitDepth

PATCH = Patch.around(0.0, 20e-3, size=2.4e-3)
PIT = PitDepth("measured", 0.0, 20e-3, 1e-3, 0.5e-3, 20e-6, 30e-6, 8e-6, gain=1.0)
OFF = np.linalg.norm(PATCH.off(0.0, 20e-3), axis=-1)
TRUTH = np.where(OFF < 0.5e-3, 0.5e-3, 0.0)


def heard(truth, sd=10e-6):
    """Traces with footprints of a quarter of a millimetre on a raster."""
    steps = (np.arange(6) - 2.5) * 0.32e-3
    x, y = (g.ravel() for g in np.meshgrid(steps, steps))
    places = PATCH.off(0.0, 20e-3).reshape(-1, 2)
    square = (places[:, 0] - x[:, None]) ** 2 + (places[:, 1] - y[:, None]) ** 2
    footprints = np.exp(-0.5 * square / 0.15e-3**2)
    footprints /= footprints.sum(axis=1, keepdims=True)
    noise = sd * np.random.default_rng(1).standard_normal(36)
    return MeanDepths(footprints @ truth.ravel() + noise, np.full(36, sd), footprints)


def test_the_floor_and_the_wall_are_where_they_should_be():
    wall = fuse(PIT, heard(TRUTH), PATCH)
    assert wall.depth[OFF < 0.35e-3] == pytest.approx(0.5e-3, abs=20e-6)
    assert (np.abs(wall.depth) < 3 * wall.sd)[OFF > 0.75e-3].all()
    assert np.abs(wall.depth[OFF > 0.75e-3]).max() < 30e-6
    assert (wall.source[OFF < 0.8e-3] == BOTH).all()


def test_a_wall_that_was_only_seen_is_not_known_to_micrometres():
    wall = fuse(PIT, heard(TRUTH), PATCH)
    assert (wall.sd[wall.source == CAMERA] >= 40e-6).all()
    assert (wall.sd[OFF > 0.8e-3] >= 10e-6).all()


def test_echoes_show_a_dimple_beside_the_pit():
    dimple = 0.15e-3 * np.exp(-0.5 * (PATCH.off(0.0, 20.9e-3) ** 2).sum(axis=-1) / 0.25e-3**2)
    wall = fuse(PIT, heard(TRUTH + np.where(OFF > 0.5e-3, dimple, 0.0)), PATCH)
    there = np.linalg.norm(PATCH.off(0.0, 20.8e-3), axis=-1) < 0.1e-3
    assert (wall.depth[there] > 0.05e-3).all()


def test_the_rim_is_the_least_sure():
    wall = fuse(PIT, heard(TRUTH), PATCH)
    rim = wall.sd[np.abs(OFF - 0.5e-3) < 0.06e-3]
    assert rim.min() > 3 * wall.sd[OFF < 0.3e-3].max()
    assert np.isfinite(wall.sd).all()


def test_without_a_fitted_depth_the_traces_give_it():
    unsure = PitDepth("too few echoes", 0.0, 20e-3, 1e-3, place_sd=30e-6, diameter_sd=50e-6)
    wall = fuse(unsure, heard(TRUTH), PATCH)
    middle = OFF < 0.25e-3
    assert np.abs(wall.depth - TRUTH)[middle].max() < 0.1e-3
    assert (wall.sd[middle] > fuse(PIT, heard(TRUTH), PATCH).sd[middle]).all()


def test_an_edge_of_the_image_keeps_two_levels_apart():
    unsure = PitDepth("uneven floor", 0.0, 20e-3, 1.6e-3, place_sd=30e-6, diameter_sd=50e-6)
    x = PATCH.off(0.0, 20e-3)[..., 0]
    step = np.where(OFF < 0.8e-3, np.where(x > 0, 0.6e-3, 0.2e-3), 0.0)
    plain = fuse(unsure, heard(step), PATCH)
    guided = fuse(unsure, heard(step), PATCH, image=np.where(x > 0, 1.0, 0.0))
    near = (np.abs(x) < 0.25e-3) & (OFF < 0.5e-3)
    assert np.abs(guided.depth - step)[near].mean() < 0.8 * np.abs(plain.depth - step)[near].mean()


def test_without_echoes_no_depth_is_made_up():
    wall = fuse(PIT, None, PATCH)
    assert np.isnan(wall.depth[OFF < 0.4e-3]).all()
    assert (wall.depth[OFF > 0.7e-3] == 0).all()
    assert (wall.source == CAMERA).all()


def test_the_outline_of_the_image_counts_as_much_as_that_of_the_sonar():
    wide = np.where(OFF < 0.7e-3, 0.99, 0.01)
    inside = inside_probability(PATCH, PIT, wide)
    alone = inside_probability(PATCH, PIT, None)
    ring = (OFF > 0.52e-3) & (OFF < 0.6e-3)
    assert (inside[ring] > alone[ring]).all()


def test_what_neither_has_seen_is_marked():
    x = PATCH.off(0.0, 20e-3)[..., 0]
    image = np.where(x > 0, np.nan, 0.0)
    alone = fuse(PIT, None, PATCH, image=image)
    assert (alone.source == np.where(x > 0, UNSEEN, CAMERA)).all()
    assert np.isnan(alone.depth[x > 0]).all()
    both = fuse(PIT, heard(TRUTH), PATCH, image=image)
    assert (both.source[(x > 0) & (OFF < 0.6e-3)] == ECHOES).all()
    assert both.unseen > 0


def test_the_image_moves_the_outline_of_the_map():
    rng = np.random.default_rng(2)
    wide = np.where(OFF < 0.6e-3, -2.0, 0.0) + 0.05 * rng.standard_normal(OFF.shape)
    inside = outline_of(wide, PATCH, (0.0, 20e-3), 1.1e-3)
    assert ((inside > 0.5) == (OFF < 0.6e-3)).mean() > 0.99
    ring = (OFF > 0.52e-3) & (OFF < 0.58e-3)
    guided = fuse(PIT, heard(TRUTH), PATCH, image=wide, outline=inside)
    assert guided.depth[ring].mean() > 1.2 * fuse(PIT, heard(TRUTH), PATCH).depth[ring].mean()
    faint = outline_of(0.0 * wide, PATCH, (0.0, 20e-3), 1.1e-3)
    assert ((faint > 0.5) == (OFF < 0.55e-3)).all()
