"""Faults of the readings of a simulated head, as a drive names them."""

import numpy as np
import pytest

from minorloop_head.control.head import LEAD, UnreadWatch, camera_control, head_control
from minorloop_head.procedures.drive_faults import FaultLog
from minorloop_head.procedures.steer import steer
from minorloop_head.twins.head import Head
from wires import identified, made_up

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


class Late(Head):
    """A head whose ticks take four times as long from 2 s on, and seven times from 3 s on."""

    time = 0.0

    def __init__(self, twice):
        super().__init__(noise=0.05, seed=3)
        self._twice = twice

    def exchange(self, u):
        seen = super().exchange(u)
        longer = 4 if 2.0 < self.time < 2.2 else 7 if self._twice and 3.0 < self.time < 4.5 else 1
        self.time += self.tick * longer
        return seen


def driven(spoil, targets=TARGETS, hold=12.0, why=""):
    control = head_control("observer", (identified().model,) * 2)
    head = Spoilt(spoil)
    head.why = why
    return steer(head, control, targets, hold)


def added(first, end, degrees):
    return lambda t, seen: seen + np.array([degrees, 0.0]) if first <= t < end else seen


def lost(first, end):
    return lambda t, seen: np.where([first <= t < end, False], np.nan, seen)


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


def test_faults_that_both_axes_have_at_the_same_time_are_one():
    result = driven(lambda t, seen: np.where([t >= 20.0, t >= 20.0], np.nan, seen))
    (missed,) = result.missed
    assert missed.endswith(
        "at the end of its hold; pan and tilt, from 20.00 s to the end: the sensor is lost; the "
        "wire cools"
    )
    result = driven(lambda t, seen: np.where([t >= 15.0, t >= 20.0], np.nan, seen))
    assert [each.axis for each in result.faults] == ["pan", "tilt"]


def test_readings_that_were_refused_are_not_called_missing():
    why = (
        "the view that was found again has not turned with the head yet, and 8 of 16 patches agree"
    )
    (fault,) = driven(lost(5.0, 5.1), [[30.0, 30.0]], 9.0, why=why).faults
    assert fault.what == f"readings were not used, because {why}; the wire went by its model"


def test_all_late_steps_are_one_warning_with_their_number_and_it_is_the_last():
    control = head_control("observer", (made_up(), made_up()))
    result = steer(Late(twice=True), control, [[30.0, 30.0]], 6.0)
    (late,) = (each for each in result.faults if each.late)
    assert late.times == 8
    assert late.lasted == pytest.approx(2 * 0.12 + 6 * 0.24)
    assert result.warnings[-1] == "8 steps were late, by up to 0.24 s"
    assert sum("late" in each for each in result.warnings) == 1


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


def test_pictures_that_are_late_by_their_content_alone_are_named_within_a_row():
    control = camera_control("observer", (identified().model,) * 2, lead=LEAD)
    head = Head(noise=0.02, seed=3, delay=0.56)
    head.age = 0.04
    late = steer(head, control, [[40.0, 20.0]], 8.0).faults
    assert all("readings show where the wire was 0." in each.what for each in late)
    assert late[0].began < 6.5
