import numpy as np
import pytest

from minorloop_head.control.head import (
    AGE,
    LEAD,
    Unread,
    UnreadWatch,
    camera_control,
    head_control,
)
from minorloop_head.twins.surroundings import Surroundings
from papers.catheter.control.laws import LAWS
from wires import EVERY_LAW, Run, identified, made_up

COUPLING = np.array([[1.0, 0.055], [0.045, 1.0]])


def control(name="observer", **options):
    return head_control(LAWS[name], (identified().model,) * 2, coupling=COUPLING, **options)


@EVERY_LAW
def test_a_flooded_head_is_diagnosed_and_no_longer_heated(name):
    if name == "feedforward":
        pytest.skip("open loop does not try harder when nothing moves")
    run = Run(control(name), (40.0, 0.0), 11.0, surroundings=Surroundings(convection=1000.0))
    at, axis, verdict = run.unreachable[0]
    assert at <= 10.0
    assert axis == 0
    assert verdict.reason == "convection too high"
    assert run.current[-1, 0] == 0.0
    assert [event.cause for axis, event in run.state.log if axis == 0].count("unreachable") == 1


def test_it_begins_at_the_angles_of_the_head():
    wire = made_up()
    head = head_control("observer", (wire, wire), coupling=COUPLING)
    own = np.array([wire.begin(0.1).angle, wire.begin(0.12).angle])
    currents = np.sqrt([0.1, 0.12])
    state = head.begin(COUPLING @ own, currents)
    current, _ = head.step(state, COUPLING @ own, COUPLING @ own)
    np.testing.assert_allclose(current, currents, atol=0.02)


def test_the_other_axis_compensates_a_wire_at_the_end_of_its_stroke():
    """Tilt cannot go below cold to compensate its coupling; pan must not rely on it."""
    law = control("pi")
    _, state = law.step(law.begin(), (40.0, 0.0), np.zeros(2))
    assert state.axes[0].reference == pytest.approx(40.0, abs=0.01)
    _, state = law.step(law.begin(), (40.0, 30.0), np.zeros(2))
    own = np.linalg.solve(COUPLING, [40.0, 30.0])
    assert [axis.reference for axis in state.axes] == pytest.approx(own.tolist())


@EVERY_LAW
@pytest.mark.parametrize(
    "surroundings",
    [
        {"ambient": 90},
        pytest.param({"convection": 20}, marks=pytest.mark.whole),
        pytest.param({"convection": 30, "ambient": 30}, marks=pytest.mark.whole),
        pytest.param({"ambient": 60}, marks=pytest.mark.whole),
    ],
)
def test_no_surroundings_and_no_controller_make_a_wire_too_hot(name, surroundings):
    """At the end of its stroke the angle does not depend on the temperature.

    A wire is hottest after 7 s at the latest, except where the law has an integral.
    """
    seconds = 25.0 if name in ("pi", "feedforward_pi") else 12.0
    run = Run(control(name), (59.0, 59.0), seconds, surroundings=Surroundings(**surroundings))
    assert run.hottest.max() <= 150.0


@pytest.mark.parametrize("odd", [10**400, "x", None, 1j, [1.0, 2.0], object()])
def test_every_step_returns_currents_within_the_limits(odd):
    law = control()
    _, state = law.step(law.begin(), (30.0, 20.0), (0.0, 0.0), t=0.0)
    for arguments in [((odd, 20.0), (0.0, 0.0)), ((30.0, 20.0), (odd, 0.1)), (odd, odd)]:
        current, state = law.step(state, *arguments, t=odd)
        assert np.isfinite(current).all()
    law.begin((odd, 0.0), (0.0, odd))


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


WHERE = np.array([10.0, 20.0])


def after(gaps, watch):
    """The state after steps with so many steps without a reading at each."""
    state = Unread()
    for k, gap in enumerate(gaps):
        state = watch.step(state, gap, WHERE + k)
    return state


def test_a_head_that_is_not_seen_for_long_goes_back_towards_the_cold_one():
    watch, wanted = UnreadWatch(after=3, stays=50), np.array([40.0, 30.0])
    stays, goes = after(range(51), watch), after(range(100), watch)
    assert watch.near(stays, wanted).tolist() == [13.5, 23.5]
    assert (np.abs(goes.kept - 0.5 * stays.kept) < 1.0).all()
    assert watch.near(watch.step(goes, 0, WHERE), wanted).tolist() == [40.0, 30.0]
    skipped = watch.step(stays, 60, WHERE)
    assert skipped.kept == pytest.approx(after(range(61), watch).kept)


def test_a_head_whose_camera_shows_nothing_stays_until_it_can_be_looked_for():
    watch = UnreadWatch(after=3, stays=50)
    state = after(range(10), watch)
    for gap in range(10, 100):
        state = watch.step(state, gap, WHERE, searched=False)
    assert state.kept.tolist() == (WHERE + 3).tolist()
    for gap in range(100, 141):
        state = watch.step(state, gap, WHERE)
    assert state.kept.tolist() == (WHERE + 3).tolist()
    assert watch.step(state, 141, WHERE).kept == pytest.approx(0.985 * (WHERE + 3))
    assert watch.step(state, 0, WHERE).dark == 0


def test_a_head_that_is_not_seen_stops_and_goes_on_when_it_is():
    control = camera_control("observer", (made_up(), made_up()), interval=0.04)
    state, seen, angles = control.begin(), np.zeros(2), []
    for k in range(400):
        lost = 90 <= k < 230
        _, state = control.step(state, [40.0, 0.0], np.full(2, np.nan) if lost else seen)
        seen = np.array([axis.estimate.wire.angle for axis in state.axes])
        angles.append(float(seen[0]))
    assert 5.0 < angles[90] < 30.0
    assert angles[229] < angles[90] + 2.0
    assert angles[-1] == pytest.approx(40.0, abs=1.0)
