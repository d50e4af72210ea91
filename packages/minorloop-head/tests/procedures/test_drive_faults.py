"""Faults of the readings of a simulated head, as a drive names them."""

import numpy as np
import pytest

from minorloop_head.control.head import UnreadWatch, camera_control, head_control
from minorloop_head.procedures.drive_faults import FaultLog
from minorloop_head.procedures.steer import steer
from minorloop_head.twins.head import Head
from wires import identified

TARGETS = [[30.0, 30.0], [40.0, 20.0]]


class Spoilt(Head):
    """A head whose readings are changed by a function of time; ``why`` says why there are none."""

    why = ""

    def __init__(self, spoil):
        super().__init__(noise=0.05, seed=3)
        self._spoil, self._ticks = spoil, 0

    def exchange(self, u):
        seen, t = np.array(super().exchange(u)), self._ticks * self.tick
        self._ticks += 1
        return self._spoil(t, seen)


def driven(spoil, targets=TARGETS, hold=12.0, why=""):
    control = head_control("observer", (identified().model,) * 2)
    head = Spoilt(spoil)
    head.why = why
    return steer(head, control, targets, hold)


def added(first, end, degrees):
    return lambda t, seen: seen + np.array([degrees, 0.0]) if first <= t < end else seen


def test_good_readings_have_no_faults():
    result = driven(lambda t, seen: seen)
    assert (result.faults, result.missed, result.done) == ((), (), True)


def test_a_fault_that_passes_is_named_with_its_time_and_the_run_is_done():
    result = driven(added(5.0, 8.0, 12.0))
    (fault,) = result.faults
    assert (fault.axis, fault.cooled, fault.over, fault.times) == ("pan", False, True, 1)
    assert fault.began == pytest.approx(5.0, abs=0.1)
    assert 3.0 <= fault.lasted < 4.5
    assert "readings jumped by 12.1 degrees, faster than the wire can move" in fault.what
    assert str(fault).startswith("pan, from 5.00 s for 3.96 s: the sensor is implausible")
    assert result.done


def test_a_run_in_which_a_wire_cooled_is_not_done():
    result = driven(added(2.0, 14.0, 12.0), [[30.0, 30.0]], 24.0)
    doubted, cooled = result.faults
    assert (doubted.cooled, cooled.cooled) == (False, True)
    assert cooled.began == pytest.approx(doubted.began + doubted.lasted)
    assert "readings have contradicted the model for 10 s" in cooled.what
    assert result.missed == ()  # it came back to its target in time
    assert not result.done


def test_lost_readings_are_counted_together_and_both_axes_named_once():
    def dropped(t, seen):
        return seen * np.nan if round(t / 0.04) % 9 == 5 else seen

    result = driven(dropped, [[30.0, 30.0]], 8.0, why="the picture is late")
    (fault,) = result.faults
    assert (fault.axis, fault.times) == ("pan and tilt", 22)
    assert fault.lasted == pytest.approx(22 * 0.04)
    assert fault.what == "there was no reading (the picture is late); the wire went by its model"
    assert str(fault).startswith("pan and tilt, 22 times from 0.20 s, 0.88 s in all: there was no")
    assert result.done


def test_an_axis_that_was_kept_names_the_fault_of_the_other():
    control = head_control("observer", (identified().model,) * 2, unread=UnreadWatch())
    result = steer(Spoilt(added(6.4, 99.0, -14.0)), control, TARGETS, 8.0)
    pan, sentence = result.missed
    assert pan.startswith("pan did not reach target 2, 40 degrees: its readings were not used")
    assert sentence.startswith("tilt did not reach target 2, 20 degrees: it was at 29.4 degrees")
    assert (
        "; the head waited, or went back to where it was read before: pan, from 6.40 s to the end: "
        in sentence
    )
    assert "readings jumped by -14.1 degrees" in sentence
    assert FaultLog(("pan", "tilt"), 0.04).during("tilt", 0.0, 9.0) == ""


@pytest.mark.parametrize("known", [True, False])
def test_late_pictures_are_named_by_their_times_or_what_to_check_is(known):
    """In a move of few swings, from which alone lateness is not found."""
    control = camera_control("observer", (identified().model,) * 2)
    head = Head(noise=0.05, seed=3, delay=0.4)
    head.age = 0.4 if known else 0.02
    result = steer(head, control, [[30.0, 30.0]], 6.0)
    said = (
        "pictures were up to 0.4 s old, and the control is set up for 0.08 s: the head was turned "
        "more slowly; check the camera and its network"
    )
    old = [str(each) for each in result.faults]
    assert old == [f"pan and tilt, 150 times from 0.00 s, 6.00 s in all: {said}"] * known
    check = said if known else "check whether the hold is too short, the pictures come late, a load"
    (missed,) = result.missed
    at = 26.7 if known else 27.1
    assert missed.startswith(f"pan did not reach target 1, 30 degrees: it was at {at} degrees, and")
    assert "tilt did not reach target 1, 30 degrees: it was at" in missed
    assert missed.count(f"at the end of its hold; {check}") == 1
