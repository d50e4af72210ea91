import numpy as np
import pytest

from minorloop.identification import diagnosis
from plane_problems import a_problem


def test_rank_and_condition_are_those_of_unit_columns(monkeypatch):
    matrix = a_problem(4, 200).matrix
    dense = matrix.dense()
    dense /= np.linalg.norm(dense, axis=0)
    expected = np.linalg.svd(dense, compute_uv=False)
    rank, condition = diagnosis.rank_and_condition(matrix)
    assert (rank, condition) == (11, pytest.approx(expected[0] / expected[-1]))
    monkeypatch.setattr(diagnosis, "_MOST_WORK", 0)  # as for a large problem
    rank, condition = diagnosis.rank_and_condition(matrix)
    assert (rank, condition) == (11, pytest.approx(expected[0] / expected[-1], rel=1e-6))


def test_few_samples_have_a_low_rank():
    assert diagnosis.rank_and_condition(a_problem(8, 5).matrix)[0] == 5
