import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.control.head import head_control
from minorloop_head.geometry import wrapped
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.sweep import NOT_THERE, SHOTS, STUCK, ProbeSweep
from wires import identified

from .fakes import CALIBRATION, Loop

SWEEP = ProbeSweep(calibration=CALIBRATION)
PHI, Z = (0.4, 1.2), (12e-3, 13e-3)


@pytest.fixture(scope="module")
def swept():
    loop = Loop()
    return loop, loop.run(SWEEP.sweep(SWEEP.area(PHI, Z)))


def test_every_burst_that_was_fired_is_kept_with_its_time_and_place(swept):
    loop, state = swept
    asked = [request for request in loop.asked if request.shots]
    assert len(state.bursts) == len(asked)
    assert all(one.burst.fired == SHOTS for one in state.bursts)
    assert (np.diff([one.t for one in state.bursts]) > 0).all()
    assert all(one.burst.verdict == "dropout" for one in state.bursts)  # traces of zeros


def test_the_area_is_covered_by_lines_and_bursts_as_wide_as_the_beam(swept):
    _, state = swept
    spots = np.array([one.spot[:2] for one in state.bursts])
    around, along = np.meshgrid(np.linspace(*PHI, 40), np.linspace(*Z, 20))
    off = np.hypot(
        10e-3 * wrapped(around.ravel()[:, None] - spots[:, 0]), along.ravel()[:, None] - spots[:, 1]
    )
    assert off.min(axis=1).max() < SWEEP.pitch
    assert len(state.bursts) < 1.6 * np.ptp(PHI) * 10e-3 * np.ptp(Z) / SWEEP.pitch**2


def test_the_catheter_never_stops_while_it_fires_and_keeps_its_limits(swept):
    loop, _ = swept
    firing = [request for request in loop.asked if request.shots]
    assert all(request.rates[1] == pytest.approx(SWEEP.rate) for request in firing)
    assert all(request.rates[0] > 0 for request in firing)
    rates = np.array([request.rates for request in loop.asked])
    assert np.abs(rates[:, 1]).max() <= math.radians(60.0)
    assert rates[:, 0].max() <= 20e-3


def test_pan_and_tilt_are_held_where_the_beam_is_square(swept):
    loop, _ = swept
    angles = [request.angles for request in loop.asked if request.angles is not None]
    wanted = RasterScan(calibration=CALIBRATION).perpendicular
    assert angles[-1] == pytest.approx(wanted)
    assert loop.angles == pytest.approx(wanted, abs=math.radians(0.2))


def test_a_catheter_that_sticks_ends_the_sweep():
    loop, area = Loop(), SWEEP.area(PHI, Z)
    loop.run(SWEEP.sweep(area), lambda: setattr(loop, "stuck", area.lines > 0))
    assert (area.trouble, area.lines) == (STUCK, 1)


def test_a_catheter_that_does_not_get_to_the_first_line_ends_the_sweep_before_the_flood():
    loop = Loop(stuck=True)
    state = loop.run(SWEEP.sweep(SWEEP.area(PHI, Z)))
    assert state.trouble == NOT_THERE
    assert not any(request.water for request in loop.asked)


def test_a_sweep_out_of_reach_is_refused():
    control = head_control("observer", (identified().model,) * 2)
    cold = ProbeSweep(calibration=replace(CALIBRATION, temperature=1.0))
    assert "out of reach" in cold.point.out_of_reach(control)
    assert not SWEEP.point.out_of_reach(control)


def test_a_sweep_that_was_cut_off_goes_on_with_its_last_line(swept):
    _, whole = swept
    half = whole.bursts[: len(whole.bursts) // 2]
    state = SWEEP.area(PHI, Z, half)
    assert 0 < state.lines < whole.lines
    last = [one for one in half if one.place[0] >= Z[0] + state.lines * SWEEP.pitch - 1e-4]
    loop = Loop()
    state = loop.run(SWEEP.sweep(state))
    assert state.bursts[: len(half)] == half
    assert state.lines == whole.lines
    anew = np.array([one.place[0] for one in state.bursts[len(half) :]])
    assert abs(anew.min() - last[0].place[0]) < SWEEP.pitch
    assert np.ptp(anew) < 0.7 * np.ptp(Z)
