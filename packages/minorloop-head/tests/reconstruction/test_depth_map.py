import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.identification.bands import PER_DEVIATION
from minorloop_head.reconstruction.depth_map import (
    CAMERA,
    UNSEEN,
    Patch,
    WaterLine,
    camera_map,
    find_water,
)

PATCH = Patch.around(0.3, 20e-3, size=2e-3)


def test_a_patch_is_centred_and_a_tenth_of_a_millimetre_fine():
    assert PATCH.places[PATCH.rows // 2, PATCH.columns // 2] == pytest.approx((0.3, 20e-3))
    off = PATCH.off(0.3, 20e-3)
    assert np.diff(off[..., 0], axis=1) == pytest.approx(1e-4)
    assert np.diff(off[..., 1], axis=0) == pytest.approx(1e-4)


def test_off_goes_the_short_way_round():
    patch = Patch.around(np.pi, 0.0, size=1e-3)
    assert np.abs(patch.off(-np.pi, 0.0)).max() < 1e-3


def test_the_camera_knows_the_wall_but_not_the_depth_of_a_defect():
    seen = np.ones((PATCH.rows, PATCH.columns), dtype=bool)
    seen[0] = False
    defect = np.zeros(seen.shape)
    defect[5, 5] = 1.0
    wall = camera_map(PATCH, seen, defect)
    assert wall.source[0, 0] == UNSEEN
    assert wall.source[5, 5] == CAMERA
    assert np.isnan(wall.depth[5, 5])
    assert wall.depth[6, 6] == 0.0


@given(st.floats(-8e-3, 8e-3))
def test_the_water_line_is_found_within_its_gap(height):
    phi = np.radians(np.arange(-178.7, 180, 5.0))
    line = find_water(phi, 10e-3 * np.sin(phi) > height, 10e-3)
    assert abs(line.height - height) <= line.sd * np.sqrt(12)
    assert line.wrong == 0
    assert (line.wet(phi, 10e-3) == (10e-3 * np.sin(phi) > height)).all()


@pytest.mark.parametrize("place_sd", [0.0, 0.1e-3, 0.3e-3])
def test_nine_in_ten_levels_are_in_their_band(place_sd):
    rng, inside = np.random.default_rng(1), []
    for height in rng.uniform(-9e-3, 5e-3, 400):
        phi = rng.uniform(-np.pi, np.pi) + 2 * np.pi * np.arange(24) / 24
        heard = 10e-3 * np.sin(phi) + rng.normal(0.0, place_sd) > height
        heard &= rng.random(24) > 0.02  # some are lost on dents
        line = find_water(phi, heard, 10e-3, place_sd=place_sd)
        inside += [abs(line.height - height) < PER_DEVIATION * line.sd] if line.seen else []
    assert len(inside) > 300
    assert 0.86 < np.mean(inside) < 0.94


def test_below_the_axis_the_face_of_the_probe_gives_the_water_line():
    phi = np.radians(np.arange(-180, 180, 5.0))
    line = find_water(phi, 2e-3 * np.sin(phi) > 1.1e-3, 10e-3, face=2e-3)
    assert line.height == pytest.approx(1.1e-3, abs=0.15e-3)


def test_a_lost_echo_does_not_move_the_water_line():
    phi = np.radians(np.arange(-90, 91, 5.0))
    heard = np.sin(phi) > 0.21
    heard[-2] = False
    line = find_water(phi, heard, 10e-3)
    assert line.height == pytest.approx(2.1e-3, abs=0.9e-3)
    assert line.wrong > 0


def test_dents_at_the_line_do_not_move_it():
    phi = np.radians(np.arange(-20, 91, 0.5))
    heard = np.sin(phi) > -0.13
    # The flanks of a dent send most of the beam elsewhere.
    heard[(np.abs(phi) < np.radians(6)) & (np.arange(phi.size) % 3 > 0)] = False
    line = find_water(phi, heard, 10e-3)
    assert line.height == pytest.approx(-1.3e-3, abs=0.1e-3)


def test_a_dry_and_a_full_pipe_have_their_line_at_an_end():
    phi = np.radians(np.arange(-90, 91, 5.0))
    assert find_water(phi, np.ones(phi.size, bool), 10e-3).height == pytest.approx(-10e-3)
    assert find_water(phi, np.zeros(phi.size, bool), 10e-3).height == pytest.approx(10e-3)
    assert np.isnan(find_water([], [], 10e-3).height)


@pytest.mark.parametrize(
    ("height", "words"),
    [(-4e-3, "4.0 ± 0.3 mm (90 %) above the axis"), (2e-3, "2.0 ± 0.3 mm (90 %) below the axis")],
)
def test_the_level_of_the_water_is_above_or_below_the_axis(height, words):
    assert WaterLine(height, 0.2e-3, 0.0).words == words


def test_where_no_surface_was_seen_the_pipe_is_full_or_without_an_echo():
    turns = np.linspace(-np.pi, np.pi, 25)[:-1]
    full, dry = (find_water(turns, np.full(24, wet), 10e-3) for wet in (True, False))
    assert (full.full, full.words) == (True, "no surface: water at every place")
    assert not dry.full
    assert "no echo at any place: the probe is above the water; let in more" in dry.words
    assert find_water([], [], 10e-3).words == "not seen"
    lost = np.ones(24, bool)
    lost[np.argmin(np.sin(turns))] = False  # by a dent at the top
    assert find_water(turns, lost, 10e-3).full
