import math

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop.head.control.observer import PowerObserver
from minorloop.head.control.reach import ReachState, ReachWatch
from wires import made_up

RISE = 676.0


def watched(reference, *, ambient=0.0, cooling=1.0, seconds=15.0, blind=False, stuck=False):
    """What a watch says about a cold wire that is heated fully, and when it first did."""
    wire = made_up()
    watch = ReachWatch(wire=wire, cold_resistance=1.0)
    observer = PowerObserver(wire=wire)
    state, estimate, rng = ReachState(), observer.found(), np.random.default_rng(0)
    plant = wire.moved(wire.begin(), ambient / RISE)
    for k in range(round(seconds / 0.04)):
        current = 0.4 if stuck or plant.angle < reference else 0.0
        plant = wire.step(plant, current**2, 0.04, ambient=ambient / RISE, cooling=cooling)
        reading = math.nan if blind else 0.05 * rng.normal() + (0.0 if stuck else plant.angle)
        estimate = observer.update(estimate, current, reading)
        state = watch.step(state, reference, reading, current, estimate)
        if state.verdict is not None:
            return state.verdict, 0.04 * (k + 1)
    return None, math.inf


def test_a_flooded_wire_is_told_within_ten_seconds():
    for cooling in (13.0, 30.0):
        verdict, after = watched(40.0, cooling=cooling)
        assert verdict.reason == "convection too high"
        assert verdict.reach < 5.0
        assert after <= 10.0


def test_an_ambient_that_is_too_cold_is_told_within_ten_seconds():
    verdict, after = watched(55.0, ambient=-40.0)
    assert verdict.reason == "ambient too cold"
    assert after <= 10.0
    assert "unreachable: ambient too cold" in str(verdict)


@pytest.mark.parametrize("reference", [10.0, 30.0, 50.0])
@pytest.mark.parametrize(
    "surroundings", [{}, {"ambient": -10}, {"ambient": 20}, {"cooling": 1.2}, {"cooling": 0.8}]
)
def test_a_wire_that_is_merely_slow_is_never_given_up(reference, surroundings):
    assert watched(reference, seconds=40.0, **surroundings)[0] is None


def test_a_target_beyond_the_stroke_is_told_at_once():
    verdict, after = watched(80.0)
    assert verdict.reason == "beyond the stroke"
    assert after == pytest.approx(0.04)


def test_a_wire_that_should_move_and_does_not_is_told():
    verdict, after = watched(40.0, stuck=True)
    assert verdict.reason in ("no motion", "convection too high")
    assert after <= 10.5


def test_a_verdict_stands_until_the_target_or_time_changes():
    wire = made_up()
    watch = ReachWatch(wire=wire, retry=2.0)
    estimate = PowerObserver(wire=wire).found()
    verdict, _ = watched(40.0, cooling=13.0)
    state = ReachState(verdict=verdict)
    assert watch.step(state, 40.0, 0.0, 0.0, estimate).verdict is verdict
    assert watch.step(state, 45.0, 0.0, 0.0, estimate).verdict is verdict
    assert watch.step(state, verdict.reach - 2.0, 0.0, 0.0, estimate).verdict is None
    for _ in range(52):
        state = watch.step(state, 40.0, 0.0, 0.0, estimate)
    assert state.verdict is None


def test_a_target_below_the_angle_needs_no_trial():
    watch = ReachWatch(wire=made_up())
    estimate = PowerObserver(wire=made_up()).found()
    assert watch.step(ReachState(), 10.0, 20.0, 0.4, estimate).trial is None


@pytest.mark.parametrize(
    "option",
    [{"rise": 0}, {"tolerance": 0}, {"certainty": 0.2}, {"retry": 0}, {"cold_resistance": 0}],
)
def test_bad_options_are_refused(option):
    with pytest.raises(ParameterError):
        ReachWatch(wire=made_up(), **option)
