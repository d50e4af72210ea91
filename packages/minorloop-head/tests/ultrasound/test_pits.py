"""One scan of a pit and one of a hole on the twin, and what can go wrong with them."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe
from minorloop_head.reconstruction.depth_map import Patch
from minorloop_head.reconstruction.findings import finding_of
from minorloop_head.reconstruction.fusion import mean_depths
from minorloop_head.twins.pipe import Bore, Dent, Pipe
from minorloop_head.twins.ultrasound import Ultrasound
from minorloop_head.ultrasound import pits as module
from minorloop_head.ultrasound.field import CalibratedProbe
from minorloop_head.ultrasound.joint_fit import solve_without_floor
from minorloop_head.ultrasound.pits import (
    PITCH,
    POINTS,
    is_through_hole,
    measure_pit,
    raster,
)
from papers.catheter.scan_trials import draw_trial
from papers.catheter.scan_trials import scan as sweep

from .synthetic import fit_of, heard, pit

MOUNT = Mount(advance=20e-3)
PROBE = CalibratedProbe(Probe(), MOUNT)
TRUE = Bore(3e-3, 20.02e-3, 1.1e-3, depth=0.6e-3, floor_tilt=(0.03, 0.02))
CENTRE = (0.0, 20e-3)


def scan(
    bores, seed=1, water=-9.99e-3, dents=(), noise=0.1, points=5, pitch=0.4e-3, temperature=20.0
):
    """A raster with 4 shots a point and a tenth of a degree of sway; a coarse one fits sooner."""
    pipe = Pipe(bores=bores, dents=dents, water=water)
    sonar = Ultrasound(pipe, MOUNT, specimen=5, seed=seed, noise=noise, temperature=temperature)
    rng = np.random.default_rng(seed)
    targets = raster(PROBE, CENTRE, points=points, pitch=pitch)
    return [heard(sonar, one + np.radians(0.1) * rng.standard_normal(2)) for one in targets]


@pytest.fixture(scope="module")
def bursts():
    return scan((TRUE,), points=POINTS, pitch=PITCH)


@pytest.mark.parametrize("assumed", [pytest.param(11.5, marks=pytest.mark.whole), 31.5])
def test_a_speed_of_sound_that_is_off_by_two_percent_makes_no_false_depth(bursts, assumed):
    probe = replace(PROBE, temperature=assumed)
    assert PROBE.speed / probe.speed == pytest.approx(1 + 0.02 * np.sign(20 - assumed), abs=1e-3)
    found = measure_pit(bursts, probe, CENTRE, 1.15e-3)
    assert found.verdict == "measured"
    assert found.depth == pytest.approx(0.6e-3, abs=min(1.645 * found.depth_sd, 8e-6))


def test_a_speed_of_sound_that_is_off_by_more_than_a_pivot_can_be_has_no_depth(bursts):
    found = measure_pit(bursts, replace(PROBE, temperature=70.0), CENTRE, 1.15e-3)
    assert found.verdict == "distances disagree"
    assert np.isnan(found.depth)


@pytest.fixture(scope="module")
def warm():
    return scan((TRUE,), points=POINTS, pitch=PITCH, temperature=30.0)


def test_water_that_warms_during_a_raster_makes_no_false_depth(bursts, warm):
    found = measure_pit(bursts[:18] + warm[18:], PROBE, CENTRE, 1.15e-3)
    assert found.verdict == "distances disagree"
    assert np.isnan(found.depth)


@pytest.mark.parametrize(
    ("verdict", "bores", "options"),
    [
        ("no pit", (), {"seed": 3}),
        ("no coupling", (TRUE,), {"seed": 4, "water": None}),
        (
            "deeper than 1.25 mm",
            (replace(TRUE, depth=1.6e-3, floor_tilt=(0.02, 0.01)),),
            {"seed": 6, "points": 4, "pitch": 0.53e-3},
        ),
        ("no floor echo", (), {"dents": (Dent(2e-3, 20.02e-3, 0.2e-3, 0.3e-3),), "noise": 0.02}),
        pytest.param(
            "no floor echo",
            (replace(TRUE, depth=0.8e-3, floor_tilt=(0.0, 0.0), dish=0.2e-3),),
            {"noise": 0.02},
            marks=pytest.mark.whole,
        ),
    ],
    ids=["mark", "air", "deep", "bead", "dished"],
)
def test_where_no_floor_is_within_range_there_is_no_depth(verdict, bores, options):
    found = measure_pit(scan(bores, **options), PROBE, CENTRE, 1.1e-3)
    assert found.verdict == verdict
    assert np.isnan(found.depth)


@pytest.mark.parametrize("kept", [0, 15])
def test_too_little_of_a_scan_says_so(bursts, kept):
    found = measure_pit(bursts[:kept], PROBE, CENTRE, 1.1e-3)
    assert found.verdict == "too few echoes"
    assert found.bursts == kept


def test_lost_bursts_are_left_out_and_half_a_scan_is_kept_and_marked(bursts):
    lost = [replace(burst, verdict="dropout") for burst in bursts]
    assert measure_pit(lost, PROBE, CENTRE, 1.1e-3).verdict == "dropout"
    found = measure_pit([*bursts[:18], *lost[18:]], PROBE, CENTRE, 1.15e-3)
    assert (found.verdict, found.bursts, found.whole) == ("measured", 18, False)
    assert found.depth == pytest.approx(0.6e-3, abs=max(3 * found.depth_sd, 10e-6))
    assert finding_of(found).verdict == "measured (18 of 36 places)"
    assert measure_pit(bursts[:10], PROBE, CENTRE, 1.15e-3, planned=36).planned == 36


@pytest.mark.parametrize("samples", [900, 1300])
def test_traces_that_end_too_early_are_too_short(bursts, samples):
    cut = [replace(burst, trace=burst.trace[:samples]) for burst in bursts]
    found = measure_pit(cut, PROBE, CENTRE, 1.15e-3)
    assert found.verdict == "too short"
    assert np.isnan(found.depth)
    assert mean_depths(cut, PROBE, Patch.around(*CENTRE, size=1e-3), found) is None


@pytest.mark.whole
def test_a_floor_too_loud_for_a_flat_one_has_no_depth():
    deep = draw_trial(205, bore=Bore(0.0, 0.0, 0.9e-3, 1.5e-3))
    probe, heard = sweep(deep)
    found = measure_pit(heard, probe, deep.centre, deep.diameter)
    assert found.verdict == "deeper than 1.25 mm"
    assert np.isnan(found.depth)


def test_a_missing_part_of_a_raster_gives_a_verdict(bursts):
    found = measure_pit(bursts[8:30], PROBE, CENTRE, 1.45e-3, planned=36)
    assert found.verdict == "part missing"
    assert finding_of(found).verdict == "part missing (22 of 36 places)"
    lost = [replace(burst, verdict="dropout") for burst in bursts]
    lost[8:30] = bursts[8:30]
    assert measure_pit(lost, PROBE, CENTRE, 1.45e-3).verdict == "part missing"
    beside = measure_pit(bursts[:18], PROBE, (0.0, 20.9e-3), 0.8e-3, planned=36)
    assert beside.verdict == "part missing"


def test_bursts_at_one_place_or_beside_the_mouth_give_a_verdict(bursts):
    heap = [replace(burst, angles=bursts[0].angles) for burst in bursts]
    assert measure_pit(heap, PROBE, CENTRE, 1.1e-3).verdict == "all at one place"
    assert measure_pit(bursts, PROBE, (0.3, 20e-3), 1.1e-3).verdict == "raster beside the mouth"


@pytest.mark.parametrize("stuck", [0, pytest.param(9, marks=pytest.mark.whole)])
def test_a_head_that_does_not_follow_its_angles_measures_nothing(bursts, stuck):
    rng, last = np.random.default_rng(1), bursts[stuck]
    again = [
        replace(last, angles=burst.angles, trace=last.trace + rng.normal(0, last.noise, 2048))
        for burst in bursts[stuck:]
    ]
    found = measure_pit(bursts[:stuck] + again, PROBE, CENTRE, 1.1e-3)
    assert found.verdict in ("distances disagree", "no pit")
    assert np.isnan(found.depth)


@pytest.mark.parametrize(("gain", "through"), [(0.0, True), (0.3, False), (1.0, False)])
def test_only_a_mouth_without_a_floor_is_a_through_hole(gain, through):
    fit = fit_of(pit(gain=gain, depth=0.8e-3))
    hole = solve_without_floor(fit, fit.solve(pit(gain=gain, depth=0.8e-3)))
    assert is_through_hole(fit, hole) == through


def test_a_poor_floor_in_a_mouth_that_is_much_wider_than_in_the_image_is_disturbed(monkeypatch):
    monkeypatch.setattr(module, "detect_deep_floor", lambda *_: module.ABSENT)
    wide = pit(size=0.35, gain=0.4)
    fit = fit_of(wide)
    found = module._assessed(fit, fit.solve(wide), ambiguous=False, bursts=[])
    assert found.verdict == "disturbed"
    assert found.diameter_sd > 0.07 * found.diameter
