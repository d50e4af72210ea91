import pytest

from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

MODEL = PrandtlIshlinskii([0.0, 0.5], [1.0, 2.0])


def test_only_push_changes_the_memory():
    tracker = MODEL.track("demagnetised")
    first = tracker.push(2.0)
    assert tracker.peek(1.0) == tracker.peek(1.0) != first
    assert tracker.push(tracker.aim(3.0)) == pytest.approx(3.0)


def test_a_copy_is_independent():
    tracker = MODEL.track("demagnetised")
    copy = tracker.copy()
    copy.push(2.0)
    assert tracker.push(0.1) == MODEL.simulate([0.1], "demagnetised")[0] != copy.push(0.1)
