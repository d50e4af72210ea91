from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.ultrasound.joint_fit import (
    CENTRE,
    DEPTHS,
    JointFit,
    JointSolution,
    _with_slips,
    bent_fit,
    floor_gains_nothing,
    is_bent,
    moves,
    renewed,
    solve_without_floor,
)
from minorloop_head.ultrasound.pit_model import PitModel
from minorloop_head.ultrasound.pits import measure_pit
from minorloop_head.ultrasound.spectra import spectra_of
from papers.catheter.scan_trials import draw_trial, scan

from .synthetic import fit_of, pit


class TwoDips:
    """A fit whose cost has a dip at 0.6 mm and another half a wave off."""

    def __init__(self, gap):
        self.costs = np.full(DEPTHS.size, 1e3)
        self.costs[np.argmin(np.abs(DEPTHS - 0.6e-3))] = 0.0
        self.costs[np.argmin(np.abs(DEPTHS - 0.66e-3))] = gap

    def sweep(self, unknowns, depths):
        return self.costs

    def solve(self, start, rounds):
        return JointSolution(start, float(np.interp(start[3], DEPTHS, self.costs)))


@pytest.mark.parametrize(("gap", "ambiguous"), [(12.0, True), (-12.0, True), (45.0, False)])
def test_two_depths_that_noise_could_swap_are_ambiguous(gap, ambiguous):
    start = CENTRE.copy()
    best, unsure = _with_slips(TwoDips(gap), JointSolution(start, 0.0))
    assert unsure == ambiguous
    assert best.cost == pytest.approx(min(0.0, gap), abs=1e-6)


@pytest.mark.parametrize(("gain", "nothing"), [(1.0, False), (0.0, True)])
def test_a_floor_gains_nothing_only_where_there_is_none(gain, nothing):
    fit = fit_of(pit(gain=gain))
    hole = solve_without_floor(fit, fit.solve(pit(gain=gain)))
    assert floor_gains_nothing(fit.solve(pit(gain=gain)), hole.cost) == nothing


PITCHED = 1005


@pytest.fixture(scope="module")
def dented():
    return draw_trial(PITCHED, kind="dented", pose="gyroscope")


@pytest.fixture(scope="module")
def dented_scan(dented):
    return scan(dented)


@pytest.fixture(scope="module")
def dented_spectra(dented, dented_scan):
    return spectra_of(dented_scan[1], dented_scan[0], dented.centre)


@pytest.fixture(scope="module")
def unbent(dented, dented_scan, dented_spectra):
    return unbent_fit(dented.diameter / 2, dented, dented_scan, dented_spectra)


def unbent_fit(radius, dented, dented_scan, dented_spectra):
    """A fit about a mouth of this radius in a wall that is not bent."""
    return JointFit(
        PitModel(dented_scan[0], dented_spectra.angles, dented.centre, radius), dented_spectra
    )


@pytest.mark.whole
def test_a_pit_in_a_dent_is_measured_below_the_wall_about_it(dented, dented_scan):
    probe, bursts = dented_scan
    found = measure_pit(bursts, probe, dented.centre, dented.diameter)
    assert found.verdict == "measured"
    assert found.depth == pytest.approx(dented.site.depth, abs=3 * found.depth_sd)
    assert found.depth == pytest.approx(dented.site.depth, abs=20e-6)


def test_the_shape_explains_the_distances(dented, dented_scan, unbent):
    assert is_bent(unbent, 6e-6)
    fit = bent_fit(dented_scan[1], unbent)
    assert fit.range_error < 2e-6
    assert 0 < fit.unknown < 10e-6
    again = renewed(fit, np.array([0.0, 0.0, 0.0, dented.site.depth, 1.0, 0.0, 0.0, 0.0]))
    assert again.unknown < 10e-6


def test_too_few_bursts_beside_a_mouth_give_no_shape(dented, dented_scan, dented_spectra):
    wide = unbent_fit(0.95e-3, dented, dented_scan, dented_spectra)
    assert bent_fit(dented_scan[1], wide) is None


def test_a_head_that_does_not_move_shows_no_wall(dented_scan):
    _, bursts = dented_scan
    rng, one = np.random.default_rng(1), bursts[0]
    still = [
        replace(one, trace=one.trace + rng.normal(0, one.noise, one.trace.size)) for _ in bursts
    ]
    assert moves(bursts)
    assert not moves(still)
    assert not moves([*bursts[:9], *still[9:]])
