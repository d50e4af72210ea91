"""Readings that are late while their times are current."""

import math

import numpy as np
import pytest

from minorloop_head.control import _observer_kernels as kernels
from minorloop_head.control.head import camera_control, head_control
from minorloop_head.control.lateness import Lateness, LatenessWatch
from minorloop_head.control.observer import PowerObserver
from minorloop_head.twins.surroundings import Course, Surroundings
from wires import TICK, Run, identified, identified_head, made_up


def test_a_loop_with_late_readings_stops_swinging_and_says_why():
    wires, coupling = identified_head(1000)
    control = head_control("observer", wires, coupling=coupling)
    run = Run(control, [40.0, 10.0], 30.0, delay=0.5, specimen=1000, seed=1000)
    (said,) = (e for axis, e in run.state.log if (axis, e.cause) == (0, "sensor"))
    assert "they are late, or a load sways the wire; it goes by its model" in said.text
    began = said.step * TICK
    assert began < 25.0
    before, after = (
        np.ptp(run.true[(run.t > first) & (run.t < first + 8.0), 0])
        for first in (began - 8.0, began + 4.0)
    )
    assert after < 0.3 * before
    assert abs(run.error(began + 4.0)[:, 0]).max() < 4.0


@pytest.mark.parametrize("delay", [0.16, pytest.param(0.04, marks=pytest.mark.whole)])
@pytest.mark.parametrize("around", ["still", "cold", "swaying"])
def test_pictures_of_the_usual_age_are_never_late(delay, around):
    surroundings = {
        "still": Surroundings(),
        "cold": Surroundings(ambient=5.0),
        "swaying": Surroundings(load=Course(0.0, amplitude=1e-3, period=2.0)),
    }[around]
    control = camera_control("observer", (identified().model,) * 2)
    moves = lambda t: [(40.0, 20.0), (20.0, 40.0), (30.0, 10.0)][min(int(t / 6.0), 2)]  # noqa: E731
    run = Run(control, moves, 18.0, delay=delay, surroundings=surroundings, specimen=1000)
    assert not [event for _, event in run.state.log if event.cause == "sensor"]


@pytest.mark.parametrize(
    ("missing", "late", "found"),
    [(7, 0.48, 0.48), (2, 0.48, 0.48), (1, 0.48, 0.0), (7, 1.48, 1.48), (7, 2.48, 0.0)],
)
def test_a_stop_tells_how_late_the_readings_are_also_if_some_are_missing(missing, late, found):
    """Of some readings, one is missing; or all but one in three. Late ones are doubted for 30 s."""
    observer = PowerObserver(wire=identified().model, delay=2)
    watch, estimate = LatenessWatch(observer=observer), observer.found()
    state, angle, lag, told = Lateness(), 0.0, round(late / TICK) + 1, []
    power = [0.16 if k < 150 else max(0.16 - 0.004 * (k - 150), 0.06) for k in range(270)]
    for k in range(1, 270):
        angle += 60.0 * (power[max(k - lag, 0)] - 0.06) * TICK
        lost = k % 3 if missing == 1 else k % missing == 0
        read = math.nan if lost else angle
        state = watch.step(state, estimate, math.sqrt(power[k - 1]), read, expected=angle)
        told.append(state.late)
    assert max(told[:150]) == 0.0
    assert max(told) == pytest.approx(found, abs=0.05)
    for seconds, still in ((25.0, found > 0.0), (5.0, False)):
        for _ in range(round(seconds / TICK)):
            state = watch.step(state, estimate, 0.0, math.nan, expected=angle)
        assert (state.late > 0.0) == (state.doubted > 0.0) == still


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
    watch, state = LatenessWatch(observer=OBSERVER), Lateness()
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


@pytest.mark.parametrize(
    ("later", "options"), [(0.48, {"noise": 0.05, "lost": 3}), (0.72, {}), (1.0, {})]
)
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
    watch, state = LatenessWatch(observer=OBSERVER), Lateness()
    estimate = OBSERVER.found(0.0, 0.0)
    state = watch.step(state, estimate, 0.1, 5.0, expected=0.0)
    for _ in range(100):
        state = watch.step(state, estimate, 0.1, math.nan, expected=0.0)
        assert state.late == 0.0
    assert state.comparison is None
    assert watch.step(state, estimate, 0.1, 5.0, expected=0.0, steps=300).late == 0.0


LIMITS = {"seen": 0.5, "moved": 0.9, "slower": 2.0, "back": 0.5}
STEPS, INTERVAL = 4, 0.04


def slowing(readings, count):
    """The same in numpy."""
    known = np.isfinite(readings)
    if known[-count:].mean() < LIMITS["seen"] or np.ptp(readings[known]) < LIMITS["moved"]:
        return np.empty(0)
    at = np.arange(readings.size)
    angle = np.interp(at, at[known], readings[known])
    rate = (angle[STEPS:] - angle[:-STEPS])[-count:] / (STEPS * INTERVAL)
    way, part = (1.0 if angle[-1] >= angle[-count] else -1.0), count // 4
    slower = way * (rate[:part].mean() - rate[-part:].mean())
    fell = slower >= LIMITS["slower"] and (way * rate).min() >= -LIMITS["back"]
    return rate if fell else np.empty(0)


@pytest.mark.parametrize("missing", [0.0, 0.3, 0.7])
def test_a_motion_that_gets_slower_is_found_as_numpy_finds_it(missing):
    rng, found = np.random.default_rng(1000), 0
    for _ in range(400):
        size = int(rng.integers(30, 80))
        count = int(rng.integers(8, size - STEPS))
        lag = rng.uniform(0.2, 2.0)
        t = INTERVAL * np.arange(size) - rng.uniform(0.0, 1.0)
        readings = rng.uniform(-30, 30) * -np.expm1(-np.maximum(t, 0.0) / lag)
        readings += rng.normal(0.0, 0.01, size)
        readings[rng.random(size) < missing] = np.nan
        over = STEPS, STEPS * INTERVAL
        rates = kernels.slowing(
            readings, count, LIMITS["seen"], LIMITS["moved"], over, LIMITS["slower"], LIMITS["back"]
        )
        np.testing.assert_allclose(rates, slowing(readings, count), rtol=1e-9, atol=1e-9)
        found += rates.size > 0
    assert (10 < found < 390) == (missing < 0.5)
