"""Lenses of simulated sets whose cameras the fit is not told, and of real photographs."""

import numpy as np
import pytest

from benchmarks import real_lenses as real
from benchmarks.lens_sets import deviations
from minorloop_head.procedures.calibrate import calibrate_lens
from minorloop_head.procedures.target_pictures import ExpectedTarget, find_target, look_through


@pytest.mark.whole
def test_deviations_contain_what_the_lens_does_not_explain():
    found, refused = deviations(range(1000, 1006))
    assert not refused
    assert np.max(list(found.values())) < 4.0


@pytest.mark.parametrize(
    ("name", "side", "target", "focals"),
    [
        ("viking_left", 3.0, "a chessboard target of 15 by 11 squares", (2001.0, 2012.0)),
        pytest.param(
            "davinci_left",
            5.0,
            "a charuco target of 19 by 26 squares (DICT_4X4_250, pattern before OpenCV 4.6)",
            (834.0, 909.0),
            marks=pytest.mark.whole,
        ),
    ],
)
def test_real_endoscopes_have_the_lens_that_opencv_finds(
    shared_data, tmp_path, name, side, target, focals
):
    folder = shared_data / "real" / name
    if not folder.is_dir():
        pytest.skip(f"needs the photographs in {folder}, which are not here")
    step = 1 if name == "viking_left" else 3
    for path in sorted(folder.iterdir())[::step]:
        (tmp_path / path.name).symlink_to(path)
    pictures = look_through(tmp_path, find_target(tmp_path, ExpectedTarget(1e-3 * side)))
    assert str(pictures.target) == target
    fit = calibrate_lens(pictures)
    for each, value in zip(fit.measured, focals, strict=False):
        assert abs(each.value - value) < 0.005 * value
        assert abs(each.value - value) < 3 * each.sd
    assert fit.rms_left_out < 0.7
    assert real.BOARDS[name] == side
