import numpy as np
import pytest

from minorloop_head.ultrasound.joint_fit import (
    CENTRE,
    DEPTHS,
    JointSolution,
    _with_slips,
    best_fit,
    floor_gains_nothing,
    solve_without_floor,
)

from .synthetic import fit_of, pit


@pytest.fixture(scope="module")
def fit():
    return fit_of(pit(around=40e-6, size=0.05, depth=0.63e-3, tilt_along=0.02))


def test_the_fit_finds_the_pit_of_its_own_echoes(fit):
    found = fit.solve(pit(depth=0.62e-3)).unknowns
    assert found[3] == pytest.approx(0.63e-3, abs=2e-6)
    assert found[0] == pytest.approx(40e-6, abs=10e-6)
    assert found[4] == pytest.approx(1.0, abs=0.05)


def test_a_sweep_dips_at_the_true_depth(fit):
    depths = np.arange(0.5e-3, 0.8e-3, 0.01e-3)
    assert depths[np.argmin(fit.sweep(pit(around=40e-6), depths))] == pytest.approx(
        0.63e-3, abs=0.011e-3
    )


def test_distances_that_follow_the_angles_have_no_range_error(fit):
    assert fit.range_error < 1e-6


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


def test_a_start_a_whole_wave_off_finds_the_depth():
    found = best_fit(fit_of(pit(depth=0.6e-3)), pit(depth=0.667e-3))
    assert found.unknowns[3] == pytest.approx(0.6e-3, abs=3e-6)


@pytest.mark.parametrize(("gain", "nothing"), [(1.0, False), (0.0, True)])
def test_a_floor_gains_nothing_only_where_there_is_none(gain, nothing):
    fit = fit_of(pit(gain=gain))
    hole = solve_without_floor(fit, fit.solve(pit(gain=gain)))
    assert floor_gains_nothing(fit.solve(pit(gain=gain)), hole.cost) == nothing
