"""Readings that observers with longer delays expect better."""

import math

import numpy as np
import pytest

from minorloop_head.control.delays import Delays, DelayWatch
from minorloop_head.control.observer import PowerObserver
from wires import TICK, made_up

OBSERVER = PowerObserver(wire=made_up(), delay=2)


def currents(t):
    """Rises and falls of the current in A, which turn the wire by some ten degrees."""
    return math.sqrt(0.14 if t % 5.0 < 2.5 else 0.04)


def watched(
    later=0.0, *, since=0.0, held=0.0, power=currents, colder=0.0, noise=0.0, lost=0, seconds=16.0
):
    """When readings of the wire of the observer are found to be late, and by how much; or None.

    From ``since`` on they are older by ``later`` seconds, after ``held`` seconds without any; of
    ``lost``, one is missing.
    """
    rng, wire = np.random.default_rng(3), OBSERVER.wire
    watch, state = DelayWatch(observer=OBSERVER), Delays()
    true, angles = wire.begin(), [wire.begin().angle] * 200
    estimate, current = OBSERVER.found(angles[-1], 0.0), 0.0
    for k in range(round(seconds / TICK)):
        true = wire.step(true, current**2, TICK, ambient=colder)
        angles.append(true.angle)
        older = OBSERVER.delay - 1 + (round(later / TICK) if k * TICK >= since else 0)
        reading = angles[-1 - older] + noise * rng.normal()
        if (lost and k % lost == 0) or since <= k * TICK < since + held:
            reading = math.nan
        before, estimate = estimate, OBSERVER.predicted(estimate, current)
        state = watch.step(state, before, current, reading, expected=estimate.expected)
        if state.late:
            return k * TICK, state.late
        estimate = OBSERVER.corrected(estimate, reading)
        current = power(k * TICK)
    return None


@pytest.mark.parametrize("later", [0.48, 0.72, 1.0])
@pytest.mark.parametrize("options", [{}, {"noise": 0.05, "lost": 3}])
def test_late_readings_are_found_with_their_age(later, options):
    when, late = watched(later, **options)
    assert when < 9.0
    assert late == pytest.approx(later + OBSERVER.delay * TICK, abs=0.15)


@pytest.mark.parametrize("since", [6.4, 6.8])
def test_readings_that_were_held_back_in_a_motion_are_found_at_once(since):
    when, late = watched(0.48, since=since, held=0.48, noise=0.02)
    assert since + 0.48 < when < since + 1.5
    assert late == pytest.approx(0.56, abs=0.15)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"since": 6.0, "held": 0.48, "noise": 0.02},
        {"noise": 0.3},
        {"later": 0.08},
        {"later": 0.32},  # a loop comes to rest with them
        {"colder": -0.02},
        {"colder": 0.02, "noise": 0.05, "lost": 3},
        {"later": 0.48, "power": lambda t: 0.05 * t, "seconds": 2.0},  # it never moves
        {"later": 4.0, "seconds": 12.0},
    ],
)
def test_others_are_not_late(options):
    assert watched(**options) is None


def test_readings_that_end_while_observers_are_compared_are_not_late():
    watch, state = DelayWatch(observer=OBSERVER), Delays()
    estimate = OBSERVER.found(0.0, 0.0)
    state = watch.step(state, estimate, 0.1, 5.0, expected=0.0)
    for _ in range(100):
        state = watch.step(state, estimate, 0.1, math.nan, expected=0.0)
        assert state.late == 0.0
    assert state.comparison is None
    assert watch.step(state, estimate, 0.1, 5.0, expected=0.0, steps=300).late == 0.0
