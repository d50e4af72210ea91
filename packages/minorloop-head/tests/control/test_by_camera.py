"""A head by its camera alone, whose pictures are few, late, and lost when it turns far unseen."""

from dataclasses import replace

import numpy as np
import pytest

from minorloop.errors import ParameterError
from minorloop_head.control.by_camera import AGE, LEAD, camera_control
from minorloop_head.control.readings import ReadingState
from wires import identified

FOUND_AGAIN = 10.0
"""Degrees by which a head may turn between two pictures; a view beyond is lost for good here."""
EVERY = 4


def follow(target, seconds, **options):
    """Return the angles (ticks, 2) of two wires, read from every fourth picture, and their faults.

    The plant is the model of the wires itself: only what is read of it differs.
    """
    wire = identified().model
    control = camera_control("observer", (wire, wire), **options)
    plant, state = [wire.begin()] * 2, control.begin()
    seen, angles, faults = np.zeros(2), [], set()
    for tick in range(round(seconds / 0.04)):
        read = np.full(2, np.nan)
        if tick % EVERY == 0:
            shown = angles[-AGE] if len(angles) >= AGE else np.zeros(2)
            if np.abs(shown - seen).max() < FOUND_AGAIN:
                seen = read = shown
        currents, state = control.step(state, target, read)
        faults |= {axis.fault for axis in state.axes if axis.fault}
        plant = [wire.step(w, u**2, 0.04) for w, u in zip(plant, currents, strict=True)]
        angles.append(np.array([w.angle for w in plant]))
    return np.array(angles), faults


def test_it_arrives_and_stays_with_one_picture_in_four():
    angles, faults = follow((45.0, 20.0), 50.0, lead=LEAD)
    assert faults == set()
    assert angles[-250:] == pytest.approx(np.tile([45.0, 20.0], (250, 1)), abs=0.5)


def test_a_head_that_is_seen_no_more_stops_within_the_lead():
    wire = identified().model
    control = camera_control("observer", (wire, wire), lead=LEAD)
    state, plant = control.begin(), wire.begin()
    seen = plant.angle
    for tick in range(200):
        seen = plant.angle if tick < 25 else seen
        read = seen if tick < 25 else np.nan
        (u, _), state = control.step(state, (45.0, 0.0), (read, 0.0))
        plant = wire.step(plant, u**2, 0.04)
    assert seen < 30.0
    assert plant.angle - seen < LEAD + 0.5


@pytest.mark.parametrize("lead", [0.0, -1.0, float("nan")])
def test_a_lead_that_is_not_positive_is_refused(lead):
    with pytest.raises(ParameterError, match=r"lead is .*; give a number of degrees above 0"):
        camera_control("observer", (identified().model,), lead=lead)


def test_readings_that_are_not_used_do_not_bound_a_target():
    control = camera_control("observer", (identified().model,) * 2, lead=LEAD)
    state = control.begin((40.0, 40.0), (0.3, 0.3))
    known = ReadingState(fault="late", last=44.0)
    late = [replace(each, reading=known) for each in state.axes]
    _, state = control.step(replace(state, axes=tuple(late)), (20.0, 15.0), (44.0, 44.0))
    assert [axis.reference for axis in state.axes] == pytest.approx([20.0, 15.0])
