import numpy as np

from minorloop.identification.after_effect_result import isolated_long


def found(*parts):
    return np.flatnonzero(isolated_long(np.concatenate([np.atleast_1d(p) for p in parts]))).tolist()


def test_two_rates_have_no_gaps():
    assert found(np.full(50, 0.1), np.full(500, 0.001), np.full(4, 0.1), np.full(9, 0.001)) == []


def test_gaps_are_found_at_each_rate():
    slow, fast = np.full(10, 1.0), np.full(30, 0.01)
    assert found(slow, 9.0, slow, fast, 0.1, fast) == [10, 51]
    assert found(fast, 0.1, fast[:1], 0.1, fast, slow, 7.0) == [30, 32, 73]
    assert found(fast, 30.0, slow) == [30]
    assert found(7.0, slow) == [0]


def test_scattered_intervals_are_none():
    assert found(np.random.default_rng(1000).uniform(0.5, 1.5, 1000)) == []
    assert found([3.0]) == []
    assert found([1.0, 6.0]) == [1]
