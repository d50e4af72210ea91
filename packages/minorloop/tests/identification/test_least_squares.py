import numpy as np
import pytest
from scipy.optimize import lsq_linear

from benchmarks import optima, staircases
from minorloop.errors import ParameterError
from minorloop.identification import least_squares
from minorloop.identification.least_squares import neighbour_differences
from plane_problems import a_problem


def smoothed(problem, strength):
    """The same with the penalty as rows of a dense problem."""
    spec, dense = problem.matrix.spec, problem.matrix.dense()
    root = neighbour_differences(spec).toarray() * np.sqrt(strength * len(problem.y)) * spec.bands
    lower = np.zeros(spec.unknowns)
    lower[spec.cells] = -np.inf
    stacked = np.vstack([dense, root])
    target = np.concatenate([problem.y, np.zeros(len(root))])
    return lsq_linear(stacked, target, (lower, np.inf), tol=1e-14, method="bvls").x


@pytest.mark.parametrize("strength", [1e-6, 1e-3])
def test_smoothness_is_the_documented_penalty(strength):
    problem = a_problem(5, 100)
    np.testing.assert_allclose(problem.fit(strength).x, smoothed(problem, strength), atol=1e-6)


def test_the_strength_is_chosen_on_contiguous_segments():
    held = least_squares.held_out_segments(1000)
    assert 0.15 < held.mean() < 0.25
    assert np.count_nonzero(np.diff(held.astype(int)) == 1) == 5
    noisy = a_problem(12, 60, noise=0.1).fit("auto")
    assert noisy.smoothness > 0


@pytest.mark.parametrize("strength", [-1.0, np.nan, np.inf, "some", None, True])
def test_refuses_what_is_no_strength(strength):
    with pytest.raises(ParameterError, match="smoothness"):
        a_problem().fit(strength)


@pytest.mark.parametrize("seed", [82, 123, 227, 463])
def test_near_singular_signed_fits_reach_the_objective_of_dense_least_squares(seed):
    problem, smoothness = optima.a_problem(seed)
    fit = problem.fit(smoothness)
    assert fit.converged
    assert optima.excess(problem, smoothness, fit) <= optima.CLOSE


@pytest.mark.parametrize("bands", [4, 10, 20])
def test_a_staircase_without_noise_gives_the_weights_to_ten_digits(bands):
    assert max(staircases.error(bands, seed) for seed in range(3)) <= staircases.CLOSE


def test_a_guess_divides_the_weights_of_a_coarser_plane():
    problem, coarse = a_problem(13, 500), a_problem(13, 500).coarser()
    within = problem.matrix.spec.sums(coarse.matrix.spec)
    used = []
    for strength in (0.0, 1e-4):
        guess = least_squares._System(problem, np.ones(500))._coarse_guess(strength)
        sums = np.bincount(within, guess)
        np.testing.assert_allclose(sums, coarse.fit(strength).x, atol=1e-9 * sums.max())
        used.append(np.count_nonzero(guess) / np.count_nonzero(sums))
    assert used[0] < 0.75 * used[1]
