"""Readings that are late while their times are current."""

import math

import numpy as np
import pytest

from minorloop_head.control.by_camera import camera_control
from minorloop_head.control.head import head_control
from minorloop_head.control.lateness import Lateness, Stop, StopWatch
from minorloop_head.twins.surroundings import Course, Surroundings
from wires import TICK, Run, identified, identified_head


def test_readings_are_doubted_for_a_while_and_anew_where_they_are_late_again():
    state = Lateness().later(TICK, 0.0)
    assert (state.late, state.doubted) == (0.0, 0.0)
    state = state.later(TICK, 0.5)
    for _ in range(round(20.0 / TICK)):
        state = state.later(TICK, 0.0)
    assert (state.late, state.doubted) == (0.5, pytest.approx(10.0))
    assert state.later(TICK, 0.7) == Lateness().later(TICK, 0.7)
    assert state.later(10.1, 0.0) == Lateness()


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
    """Of some readings, one is missing; or all but one in three."""
    watch = StopWatch(wire=identified().model, delay=2)
    state, angle, lag, told = Stop(), 0.0, round(late / TICK) + 1, []
    power = [0.16 if k < 150 else max(0.16 - 0.004 * (k - 150), 0.06) for k in range(270)]
    for k in range(1, 270):
        angle += 60.0 * (power[max(k - lag, 0)] - 0.06) * TICK
        lost = k % 3 if missing == 1 else k % missing == 0
        state = watch.step(state, math.nan if lost else angle, power[k - 1])
        told.append(state.late)
    assert max(told[:150]) == 0.0
    assert max(told) == pytest.approx(found, abs=0.05)
