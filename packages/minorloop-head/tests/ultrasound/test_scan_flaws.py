from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks._layered_scans import drawn_block, matched
from minorloop.errors import RecordError
from minorloop_head.ultrasound.recorded_scan import read_scan
from minorloop_head.ultrasound.scan_flaws import scan_flaws


@cache
def block(seed, **how):
    drawn = drawn_block(seed, **how)
    return drawn, scan_flaws(drawn.scan)


@pytest.mark.parametrize(
    ("seed", "how"),
    [(1001, {}), (1019, {}), pytest.param(1101, {"raster": True}, marks=pytest.mark.whole)],
)
def test_drawn_holes_are_found_where_they_are_and_nothing_else(seed, how):
    drawn, found = block(seed, **how)
    errors, missed, false = matched(drawn, found)
    assert (missed, false) == (0, 0)
    assert errors.max(axis=0) == pytest.approx([0, 0], abs=0.5e-3)
    assert found.tilt == pytest.approx(abs(drawn.tilt), abs=np.radians(0.1))
    for one in found.flaws:
        wide = max(one.width, np.nan_to_num(one.length))
        assert wide < 1.2 * drawn.scan.disc
        assert np.isnan(one.size)  # it is a point


def test_thicknesses_of_layers_are_those_that_were_drawn():
    drawn, found = block(1001)
    thick = [layer.thickness for layer in found.layers[1:]]
    assert thick == pytest.approx(drawn.scan.thicknesses[1:], abs=0.3e-3)


def test_a_block_without_holes_has_no_flaws():
    assert scan_flaws(drawn_block(1000, holes=0).scan).flaws == ()


def test_a_repeat_names_the_flaw_that_it_repeats():
    _, found = block(1029)
    assert {one.grade for one in found.repeats} == {"look again"}
    assert any("once more through layer 2" in one.why for one in found.repeats)


def test_a_wide_flaw_has_a_size_and_a_narrow_one_a_bound():
    drawn = drawn_block(1003, holes=0)
    scan, traces = drawn.scan, drawn.scan.traces.copy()
    late = round(1.0e-5 / scan.interval)  # a level reflector under the surface over 15 mm
    at = round((2 * scan.thicknesses[0] / scan.speeds[0] - scan.start) / scan.interval)
    wide = slice(40, 40 + round(15e-3 / scan.steps[0]))
    traces[at + late - 20 : at + late + 20, wide] += 0.5 * traces[at - 20 : at + 20, wide]
    (flaw,) = scan_flaws(replace(scan, traces=traces)).flaws
    assert flaw.size == pytest.approx(15e-3, abs=2e-3)
    assert flaw.depth == pytest.approx(0.5e-5 * scan.speeds[1], rel=0.02)


def test_a_clipped_surface_is_said_with_what_it_leaves_open():
    drawn = drawn_block(1003, front=1200.0, bits=8)
    found = scan_flaws(drawn.scan)
    assert drawn.scan.clipped
    assert "the echo of the first surface is clipped" in found.advice[0]
    assert matched(drawn, found)[1:] == (0, 0)


def test_a_thickness_that_the_echoes_contradict_is_said():
    drawn, found = block(1001)
    wrong = tuple(np.multiply((1.0, 1.1, 1.0), drawn.scan.thicknesses))
    advice = found.advice, scan_flaws(replace(drawn.scan, thicknesses=wrong)).advice
    assert ["mm thick by its echoes" in str(said) for said in advice] == [False, True]


def test_speeds_that_contradict_the_surfaces_are_refused():
    scan = block(1001)[0].scan
    wrong = (scan.speeds[0], 0.5 * scan.speeds[1], scan.speeds[2])
    with pytest.raises(RecordError, match=r"layer 2 is .* mm thick by its echoes .* in the order"):
        scan_flaws(replace(scan, speeds=wrong))


def test_a_layer_that_its_surfaces_hide_is_said():
    thin = drawn_block(1003, holes=0, thick=(0.03, 0.004), speeds=np.array([1480.0, 5900.0]))
    found = scan_flaws(thin.scan)
    assert found.flaws == ()
    assert "the echoes of its surfaces hide all of layer 2" in found.advice


def test_noise_alone_has_no_surface():
    scan = block(1001)[0].scan
    noise = np.random.default_rng(0).normal(size=scan.traces.shape)
    found = scan_flaws(replace(scan, traces=noise))
    assert (found.surfaces.times.size, found.flaws) == (0, ())
    assert np.isnan(found.tilt)
    assert "no echo stands out of the noise" in found.advice[-1]


def test_three_measured_layers_have_their_twelve_targets(shared_data):
    found = scan_flaws(read_scan(measured(shared_data, "LineScan2D_PinsPlexiAluSDH.mat")))
    assert [one.layer for one in found.flaws] == [1] * 4 + [2] * 4 + [3] * 4
    for layer, step in ((1, 5e-3), (2, 6e-3), (3, 10e-3)):
        own = [one for one in found.flaws if one.layer == layer]
        assert np.diff([one.depth for one in own]) == pytest.approx([step] * 3, abs=0.7e-3)
        assert np.diff([one.x for one in own]) == pytest.approx([20e-3] * 3, abs=1.5e-3)
    deep = next(one for one in found.flaws if one.layer == 2 and one.depth > 20e-3)
    assert deep.width <= 4e-3


def test_a_measured_block_is_tilted_by_two_degrees_and_has_a_row_of_holes(shared_data):
    found = scan_flaws(read_scan(measured(shared_data, "CopperBlock_2degtTilt.mat")))
    assert np.degrees(found.tilt) == pytest.approx(2.0, abs=0.3)
    assert len(found.flaws) == 17
    assert {one.layer for one in found.flaws} == {2}
    places = [one.x for one in found.flaws]
    assert np.diff(places) == pytest.approx([np.ptp(places) / 16] * 16, abs=1.5e-3)


def measured(folder, name):
    path = folder / "real" / "scans" / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    return path
