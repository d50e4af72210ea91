import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop_head.reconstruction.depth_map import (
    BOTH,
    CAMERA,
    ECHOES,
    UNSEEN,
    DepthMap,
    Patch,
    WaterLine,
)
from minorloop_head.ultrasound.c_scan import CScan
from papers.catheter.sweep_trials import blend, pipe_map

PATCH = Patch(-0.05, 20e-3, 2, 11)  # phi from -0.05 to 0.05 in steps of 0.01


@pytest.fixture(scope="module")
def merged():
    phi = PATCH.places[..., 0]
    heard = phi > -0.015  # the beam reaches above the line
    heard[0, -1] = False
    wall = DepthMap(
        PATCH,
        np.where(heard, 0.2e-3, np.nan),
        np.where(heard, 10e-6, np.inf),
        np.where(heard, ECHOES, UNSEEN).astype(np.uint8),
    )
    water = WaterLine(0.0, 0.1e-3, 0.0)
    scan = CScan(wall, np.where(heard, 1.0, np.nan), ~heard, water, (), (1e-6, 0.03))
    views = [np.where(phi < 0.03, -1.0 + 10 * phi, np.nan), np.full(phi.shape, np.nan)]
    views[0][0, 0] = np.nan
    return pipe_map(scan, views)


def test_each_texel_has_its_source(merged):
    found = merged[0].wall.source[0, [0, 1, 4, 8, -1]].tolist()
    assert found == [UNSEEN, CAMERA, BOTH, ECHOES, UNSEEN]


def test_the_camera_does_not_see_under_water(merged):
    wet = PATCH.places[..., 0] > 1e-6
    assert np.isnan(merged[1][wet]).all()
    assert np.isfinite(merged[1][1, :5]).all()


def test_each_source_has_its_uncertainty(merged):
    sd = merged[0].wall.sd
    assert sd[1, 1] == pytest.approx(0.05e-3)
    assert sd[1, 8] == pytest.approx(10e-6)
    assert sd[1, 4] == pytest.approx((0.05e-3**-2 + 10e-6**-2) ** -0.5)
    assert np.isinf(sd[0, 0])


SMALL = Patch.around(0.3, 20e-3, size=2e-3)


def filled(depth, sd, source):
    shape = (SMALL.rows, SMALL.columns)
    return DepthMap(
        SMALL, np.full(shape, depth), np.full(shape, sd), np.full(shape, source, dtype=np.uint8)
    )


@given(st.floats(0.01, 10), st.floats(0.01, 10))
def test_blending_weighs_by_inverse_variance(a, b):
    both = blend(filled(0.0, a, CAMERA), filled(1.0, b, ECHOES))
    assert both.depth[0, 0] == pytest.approx(a**2 / (a**2 + b**2))
    assert both.sd[0, 0] == pytest.approx(1 / np.hypot(1 / a, 1 / b))
    assert (both.source == BOTH).all()
