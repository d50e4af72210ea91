"""Ramps in open loop by the paper's inverse."""

import numpy as np
import pytest

from papers.catheter import head_ramps
from papers.catheter.head_ramps import stepping_inverse
from papers.catheter.head_static import identify_mesh


@pytest.fixture(scope="module")
def figures():
    return head_ramps.ramp_figures(head_ramps.run_ramps(1001))


def test_equal_ramps_become_worse_only_by_the_hypothesis_of_a_body_that_warms(figures):
    assert figures["error_last_ramp_deg"] < 1.0
    assert figures["body"]["error_last_ramp_deg"] > 1.5
    assert figures["body"]["ratio"] > 1.5
    assert figures["body"]["body_K"] > 2


def test_ramps_that_get_faster_become_worse_without_it(figures):
    assert figures["faster"]["ratio"] > 1.5


def test_the_stepping_inverse_passes_each_target_by_less_than_a_step():
    model = identify_mesh(1001).model
    up = np.linspace(1.0, 40.0, 200)
    wanted = np.concatenate([up, up[::-1]])
    u = stepping_inverse(model, wanted, 0.015)
    assert (np.diff(u[:200]) >= 0).all()
    assert (np.diff(u[200:]) <= 0).all()
    over = model.simulate(u) - wanted
    way = np.where(np.arange(400) < 200, 1, -1)
    assert (way[1:] * over[1:] > -1e-9)[np.diff(wanted) != 0].all()
    before = model.simulate(np.clip(u - 0.015 * way, 0.0, 1.2))
    assert np.abs(over[:200]).max() <= np.abs(model.simulate(u) - before)[:200].max() + 1e-9
    assert stepping_inverse(model, np.array([1e3, -1e3]), 0.015).tolist() == [1.2, 0.0]


def test_an_unchanged_target_leaves_the_input():
    model = identify_mesh(1001).model
    wanted = np.repeat([20.0, 35.0, 12.0, 30.0], 5)
    exact = model.invert(wanted).u
    for u, rounding in ((stepping_inverse(model, wanted, 0.015), 0.0), (exact, 1e-15)):
        assert np.ptp(u.reshape(4, 5), axis=1).max() <= rounding
        assert np.abs(np.diff(u[::5])).min() > 0.01
