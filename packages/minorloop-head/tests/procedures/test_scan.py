import re
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.control.head import head_control
from minorloop_head.geometry import REACH
from minorloop_head.procedures.go import go
from minorloop_head.procedures.scan import (
    MOST_OFF,
    NO_COUPLING,
    RasterScan,
    ScannedRaster,
    burst_of,
)
from minorloop_head.sources import Shot
from minorloop_head.twins.catheter import Catheter
from minorloop_head.ultrasound.pits import PITCH
from wires import identified

from .fakes import CALIBRATION, Loop

CENTRE = (0.5, 12e-3)
SCAN = RasterScan(calibration=CALIBRATION)


def shot_at(loop):
    """Pan and tilt of the requested bursts."""
    return [tuple(request.angles) for request in loop.asked if request.shots]


def spots_of(shift, onward=1):
    """Places (N, 2) of the targets about the centre, in metres, for a catheter that rolls."""
    first = SCAN.rolled(CENTRE[0] - 0.08 * onward, (CENTRE[1], 0.0))
    step = onward * PITCH / CALIBRATION.radius
    rows = SCAN.targets(CENTRE, first, shift, onward).reshape(SCAN.points, SCAN.points, 2)
    spots = [
        CALIBRATION.probe_at((first[0], first[1] + n * step)).spots(row)
        for n, row in enumerate(rows)
    ]
    return (np.concatenate(spots)[:, :2] - CENTRE) * (CALIBRATION.radius, 1.0)


@pytest.fixture(scope="module")
def scanned():
    loop = Loop()
    return loop, loop.run(SCAN.scan(ScannedRaster(), CENTRE))


def test_a_scan_visits_every_point_once(scanned):
    loop, state = scanned
    assert len(shot_at(loop)) == len(set(shot_at(loop))) == SCAN.points**2
    assert set(shot_at(loop)) == {tuple(target) for target in state.targets}
    assert len(state.bursts) == SCAN.points**2
    assert state.progress == 1.0


def test_the_pipe_is_flooded_once_the_probe_is_over_the_place(scanned):
    loop, _ = scanned
    wet = [k for k, request in enumerate(loop.asked) if request.water]
    first = next(k for k, request in enumerate(loop.asked) if request.shots)
    assert len(wet) == 1
    assert wet[0] < first


def test_a_place_out_of_reach_is_not_scanned():
    loop = Loop(place=(0.0, -2.0), stuck=True)
    state = loop.run(SCAN.scan(ScannedRaster(), CENTRE))
    assert shot_at(loop) == []
    assert not len(state.targets)


@pytest.mark.parametrize("onward", [1, -1])
def test_the_catheter_rolls_on_from_row_to_row_until_the_raster_is_covered(onward):
    steps = PITCH * (np.arange(SCAN.points) - 0.5 * (SCAN.points - 1))
    spots = spots_of(0.0, onward)
    assert sorted(spots[:, 0]) == pytest.approx(np.repeat(steps, SCAN.points), abs=1e-9)
    assert sorted(spots[:, 1]) == pytest.approx(np.repeat(steps, SCAN.points), abs=1e-9)
    assert onward * (spots[-1, 0] - spots[0, 0]) > 0


def test_a_burst_holds_at_the_reference_although_the_catheter_has_rolled():
    rng = np.random.default_rng(1)
    shots = [Shot(0.0, 1e-3 * rng.standard_normal(2000), 1e-8) for _ in range(4)]
    place, reference = np.array([CENTRE[1], 0.2]), np.array([CENTRE[1], 0.28])
    seen = SCAN.perpendicular + np.array([0.03, -0.01])
    burst = SCAN.burst(shots, seen, seen, place, reference, coupled=True)
    there, here = (
        CALIBRATION.probe_at(at).spots(angles)
        for at, angles in ((reference, burst.angles), (place, seen))
    )
    assert there == pytest.approx(here, abs=1e-9)
    assert abs(burst.angles[1] - seen[1]) > 0.1


class Carried(Loop):
    """A loop with a catheter that sticks and jumps."""

    units = np.array([1e-3, np.radians(1.0)])

    def __init__(self, seed):
        super().__init__()
        self.catheter = Catheter(seed, 0.02, seed)

    def reading(self, request=None):
        fired = request is not None and request.shots > 0
        return replace(super().reading(request), shots=(), fired=fired)

    def tick(self, request):
        super().tick(replace(request, rates=np.zeros(2)))
        self.place = self.units * np.asarray(self.catheter.exchange(request.rates / self.units))


@pytest.mark.parametrize(
    ("seed", "centre", "start", "offset"),
    [
        (1026, (-2.0688, 0.023199), (0.013199, 0.1565), (-0.000132, 3.8e-05)),
        (1116, (2.74, 0.025376), (0.015376, -0.4016), (0.000174, 3.6e-05)),
    ],
)
def test_a_row_that_the_catheter_has_jumped_past_is_come_to_again(seed, centre, start, offset):
    scan = replace(SCAN, calibration=replace(CALIBRATION, offset=offset, roll=0.0))
    loop = Carried(seed)
    loop.run(go(start))
    state = loop.run(scan.scan(ScannedRaster(), centre))
    assert state.again == 1
    assert len(set(shot_at(loop))) == SCAN.points**2


class Swaying(Loop):
    """A loop whose pictures show the base at some bursts only."""

    def reading(self, request):
        return replace(super().reading(request), base=self.turn())

    def turn(self):
        bursts = len(shot_at(self))
        return np.full(2, np.nan) if self.blind(bursts) else np.array([0.01, 0.0])


def test_a_burst_whose_pose_is_not_seen_is_fired_again_and_left_out_if_it_stays_unseen():
    loop = Swaying()
    loop.blind = lambda bursts: bursts == 1
    state = loop.run(SCAN.scan(ScannedRaster(), CENTRE))
    assert len(state.bursts) == SCAN.points**2
    assert len(shot_at(loop)) == SCAN.points**2 + 1
    assert all(request.frame for request in loop.asked if request.shots)
    loop = Swaying()
    loop.blind = lambda bursts: bursts < 40
    state = loop.run(SCAN.scan(ScannedRaster(), CENTRE))
    assert 0 < len(state.bursts) < SCAN.points**2
    assert state.point == SCAN.points**2


def test_a_scan_that_was_cut_off_goes_on_with_its_next_point():
    cut, known, points = ScannedRaster(), {}, 6

    def each():
        if cut.point == points:
            known.update(vars(cut))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Loop().run(SCAN.scan(cut, CENTRE), each)
    after = Loop(place=(0.0, 0.4))
    state = after.run(SCAN.scan(cut, CENTRE))
    assert len(shot_at(after)) == SCAN.points**2 - points
    assert len(state.bursts) == state.point == SCAN.points**2
    assert state.bursts[:points] == known["bursts"]
    assert (state.onward, *state.reference) == (known["onward"], *known["reference"])
    assert [request.water for request in after.asked if request.water is not None] == [True]
    off = (SCAN.points - 1 if state.onward > 0 else 0) - 0.5 * (SCAN.points - 1)
    last = SCAN.rolled(CENTRE[0] + off * PITCH / CALIBRATION.radius, after.place)
    assert after.place[1] == pytest.approx(last[1], abs=0.01)


def control():
    return head_control("observer", (identified().model,) * 2)


def test_what_cold_water_puts_out_of_reach_is_said():
    cold = replace(SCAN, calibration=replace(CALIBRATION, temperature=1.0))
    words = r"out of reach: (pan|tilt) needs 1\d degrees, has 1\d \(\d to \d+\) in water of 1 C"
    assert re.fullmatch(words, cold.out_of_reach(control()))
    assert not SCAN.out_of_reach(control())


def test_one_point_at_a_smaller_reading_of_the_tilt_is_within_reach_in_cold_water():
    head, cold = control(), replace(CALIBRATION, temperature=1.0)
    usual, point = SCAN.in_water(head), RasterScan(calibration=cold, points=1)
    assert usual.tilt == SCAN.tilt
    assert point.out_of_reach(head)
    found = point.in_water(head)
    assert not found.out_of_reach(head)
    assert np.hypot(*found.perpendicular) <= REACH
    spot, before = (
        cold.probe_at((12e-3, 0.2)).spots(each.perpendicular)[0] for each in (found, point)
    )
    assert spot[1:] == pytest.approx(before[1:], abs=0.2e-3)


EAR = CALIBRATION.probe_at((12e-3, 0.2))
AIM = np.array([-0.35, 0.0])


def silent(count=4):
    rng = np.random.default_rng(1)
    return [Shot(1e-3 * k, 1e-3 * rng.standard_normal(2000), 1e-8) for k in range(count)]


def test_a_burst_without_an_echo_reports_no_coupling_until_one_before_it_had_one():
    first = burst_of(silent(), AIM, AIM, EAR, coupled=False)
    later = burst_of(silent(), AIM, AIM, EAR, coupled=True)
    assert (first.verdict, first.used, first.trace.size) == (NO_COUPLING, 0, 0)
    assert (later.verdict, later.used) == ("", 4)
    np.testing.assert_allclose(later.angles, AIM)


def test_a_burst_far_off_its_point_is_refused():
    per_radian = 8e-3
    for share, verdict in ((0.6, ""), (2.0, "off target")):
        off = AIM + np.array([share * MOST_OFF / per_radian, 0.0])
        assert burst_of(silent(), off, AIM, EAR, coupled=True).verdict == verdict
