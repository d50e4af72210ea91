import numpy as np
import pytest

from minorloop.head.procedures.scan import RasterScan

from .fakes import CALIBRATION, Loop

CENTRE = (0.5, 12e-3)
SCAN = RasterScan(calibration=CALIBRATION)


def shot_at(loop):
    """Pan and tilt of the requested bursts."""
    return [tuple(request.angles) for request in loop.asked if request.shots]


@pytest.fixture(scope="module")
def scanned():
    loop = Loop()
    return loop, loop.run(SCAN, SCAN.begin(CENTRE, home=((0.0, 0.0), (0.1, 0.0))))


def test_a_scan_visits_every_point_once(scanned):
    loop, state = scanned
    assert len(shot_at(loop)) == len(set(shot_at(loop))) == SCAN.points**2
    assert set(shot_at(loop)) == {tuple(target) for target in state.targets}
    assert len(state.bursts) == SCAN.points**2
    assert state.progress == 1.0


def test_a_burst_is_where_the_head_is(scanned):
    _, state = scanned
    off = [
        np.hypot(*(burst.angles - aim))
        for burst, aim in zip(state.bursts, state.targets, strict=True)
    ]
    known = [each for each in off if np.isfinite(each)]
    assert max(known, default=0.0) < SCAN.aimed


def test_the_pipe_is_flooded_once_the_probe_is_over_the_place(scanned):
    loop, _ = scanned
    wet = [k for k, request in enumerate(loop.asked) if request.water]
    first = next(k for k, request in enumerate(loop.asked) if request.shots)
    assert len(wet) == 1
    assert wet[0] < first


def test_a_scan_goes_home_where_there_is_one(scanned):
    loop, _ = scanned
    assert loop.place == pytest.approx([0.0, 0.0], abs=6e-3)
    assert loop.place[0] == pytest.approx(0.0, abs=1e-4)
    loop = Loop()
    loop.run(SCAN, SCAN.begin(CENTRE))
    assert loop.place[0] == pytest.approx(CENTRE[1], abs=1e-4)


def test_the_raster_is_displaced_by_a_share_of_its_pitch():
    place = (CENTRE[1], CENTRE[0] - 0.3)
    spots = [
        CALIBRATION.probe_at(place).spots(SCAN.targets(CENTRE, place, shift))
        for shift in (0.0, 0.5)
    ]
    moved = (spots[1] - spots[0])[:, :2] * (CALIBRATION.radius, 1.0)
    assert moved == pytest.approx(0.5 * SCAN.pitch)


def test_a_place_out_of_reach_is_not_scanned():
    loop = Loop(place=(0.0, -2.0), stuck=True)
    state = loop.run(SCAN, SCAN.begin(CENTRE, home=((0.0, -2.0), (0.0, 0.0))))
    assert shot_at(loop) == []
    assert not len(state.targets)


def test_the_shorter_way_round_is_taken():
    loop = Loop(place=(CENTRE[1], 3.0))
    loop.run(SCAN, SCAN.begin((-2.5, CENTRE[1])))
    assert loop.place[1] == pytest.approx(2 * np.pi - 2.8, abs=0.01)


def test_a_burst_that_is_never_fired_is_skipped():
    loop = Loop()
    loop.reading = lambda request=None: Loop.reading(loop)  # shots never come
    state = loop.run(SCAN, SCAN.begin(CENTRE))
    assert len(shot_at(loop)) == SCAN.points**2
    assert state.bursts == ()
