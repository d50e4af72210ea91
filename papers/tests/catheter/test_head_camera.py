"""The head by its camera alone: loops on pictures, with good pictures and bad ones."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from minorloop_head.control import head as head_control_module
from minorloop_head.sources import Frame
from minorloop_head.twins.head import Head
from minorloop_head.vision.wall_patches import UNTURNED
from papers.catheter import head_camera
from papers.catheter.head_camera import HOLE, WAIT, Circle, run_circle, seen_control
from papers.catheter.head_loop import constant, run_loop
from papers.catheter.picture_sensor import PictureSensor
from wires import identified_head

SEED = 1001


@pytest.fixture(scope="module")
def control():
    wires, coupling = identified_head(SEED)
    return seen_control("observer", SimpleNamespace(wires=wires, coupling=coupling))


def run(control, target, seconds, disturb=None):
    """A step of pan, or of both, by pictures, and the sensor that took them."""
    used = []

    def camera(head):
        used.append(PictureSensor(head, SEED, disturb=disturb))
        return used[0]

    step = run_loop(
        control,
        constant(*np.atleast_1d(target)),
        seconds,
        specimen=SEED,
        seed=SEED,
        camera=camera,
    )
    return step, used[0]


class Trouble:
    """The lens fouled half way, lights off for 2 s, then pictures of all bad kinds in turn.

    They are late by 0.5 s, every other one is lost or its features have jumped by a sixth of its
    height, a piece of the wall is shown twice, and they are mirrored.
    """

    def __init__(self):
        self.before = []

    def __call__(self, tick, frame):
        self.before = [*self.before, frame][-13:]
        image = frame.image.copy()
        if 100 <= tick < 150:
            image[:, :160] = 70 + image[:, :160] // 40
        elif 200 <= tick < 250:
            image[:] = 0
        elif 270 <= tick < 290:
            return self.before[0]
        elif 300 <= tick < 330 and tick % 2:
            return None
        elif 300 <= tick < 315:
            image[40:] = frame.image[:-40]
        elif 330 <= tick < 340:
            image[150:210, 200:280] = image[60:120, 60:140]
        elif 340 <= tick < 345:
            image = image[:, ::-1].copy()
        return Frame(frame.t, image)


@pytest.mark.whole
def test_a_head_holds_by_its_model_while_it_sees_nothing_and_goes_on(control):
    step, sensor = run(control, 30.0, 14.5, Trouble())
    late = step.t > 7.0
    assert np.abs(step.error[late, 0]).max() < 2.0
    assert abs(step.error[-1, 0]) < 0.8
    why = {each.tick: each.reason for each in sensor.missed}
    for first, end, reason in (
        (200, 250, "the picture is black"),
        (270, 290, "the picture is late"),
        (300, 330, "no picture came"),
        (300, 315, "the picture is torn"),
        (340, 345, "of wall in view agree"),
    ):
        assert any(reason in why.get(tick, "") for tick in range(first, end))
    seen_half, seen_twice = (set(range(*ticks)) - set(why) for ticks in ((100, 150), (330, 340)))
    assert len(seen_half) > 40
    assert len(seen_twice) > 7
    said = [event.text for axis, event in step.log if axis == 0]
    assert "there is no reading; the wire goes by its model" in said
    assert "there are readings again" in said
    assert not any("the wire cools" in text for text in said)
    assert step.violations == 0


@pytest.mark.whole
def test_pictures_that_become_mirrored_in_a_move_stop_the_head_until_they_are_right(control):
    def mirrored(tick, frame):
        bad = 95 <= tick < 160
        return Frame(frame.t, frame.image[:, ::-1].copy()) if bad else frame

    step, sensor = run(control, 40.0, 12.0, mirrored)
    angle = step.truth.angle[:, 0]
    assert 5.0 < angle[94] < 25.0
    assert angle[159] - angle[94] < 3.0
    assert np.isfinite(step.read[165:170]).any()
    assert abs(step.error[-1, 0]) < 1.0
    assert any("of wall in view agree" in each.reason for each in sensor.missed)


@pytest.mark.whole
def test_a_lens_that_was_fouled_in_a_move_is_not_lost_again_once_it_is_clean(control):
    noise = np.random.default_rng(0)
    rough = gaussian_filter(noise.standard_normal((240, 160)), 6.0)
    dirt = 60.0 + 25.0 * rough / rough.std()

    def soiled(tick, frame):
        image = frame.image.copy()
        if 50 <= tick < 100:
            level = dirt + noise.normal(0.0, 1.5, dirt.shape)
            image[:, :160] = np.clip(np.rint(level), 0, 255)
        return Frame(frame.t, image)

    step, sensor = run(control, (40.0, 20.0), 10.0, soiled)
    late = [each for each in sensor.missed if each.tick > 105 and each.reason != "no picture came"]
    # It is seen at once; that it is wall is certain once the head has turned.
    assert all(each.reason.startswith(UNTURNED) and each.tick < 110 for each in late)
    assert np.abs(step.error[-1]).max() < 1.0


@pytest.mark.whole
def test_the_exposure_does_not_swing_when_pictures_are_late():
    greys, before = [], []

    def late_after_dark(tick, frame):
        greys.append(frame.image.mean())
        before.append(frame)
        return Frame(frame.t, 0 * frame.image) if tick < 20 else before[-13:][0]

    sensor = PictureSensor(Head(), SEED, dropped=0.0, disturb=late_after_dark)
    for _ in range(170):
        sensor.exchange(np.zeros(2))
    assert max(greys) > 200.0
    assert greys[-50:] == pytest.approx([95.0] * 50, rel=0.1)


@pytest.mark.whole
def test_a_head_that_never_sees_again_cools(control, monkeypatch):
    monkeypatch.setattr(head_control_module, "PATIENCE", 50)
    wires = tuple(axis.observer.wire for axis in control.axes)
    short = seen_control("observer", SimpleNamespace(wires=wires, coupling=control.coupling))
    dark = lambda tick, frame: frame if tick < 125 else None  # noqa: E731
    step, _ = run(short, 30.0, 9.0, dark)
    assert (step.current[-25:] == 0.0).all()
    assert any("the wire cools" in event.text for _, event in step.log)


@pytest.mark.whole
def test_a_circle_about_a_hole_is_scored_where_the_true_axis_meets_the_wall(control, monkeypatch):
    monkeypatch.setattr(head_camera, "WAIT", 6.0)
    found = run_circle(
        SEED, control, Circle(12.0), lambda head: PictureSensor(head, SEED, bores=(HOLE,))
    )
    assert found.t[0] > 6.0
    assert np.allclose(np.linalg.norm(found.wanted, axis=1), 4.0)
    first = np.linalg.norm(found.reached[0] - found.wanted[0])
    assert first < 1.0
    assert WAIT == 15.0


def test_a_hold_that_lost_the_view_is_repeated_from_the_one_before():
    held, seen = [], iter([0.0, np.nan, 1.0, 2.0, 3.0])

    def hold(u, seconds, pictures, *, follow):
        held.append(float(u[1]))
        return np.full(2, next(seen))

    found = head_camera._settled(
        SimpleNamespace(hold=hold), 1, np.array([0.0, 0.1, 0.2]), follow=True
    )
    assert held == [0.0, 0.1, 0.0, 0.1, 0.2]
    assert found[:, 1].tolist() == [0.0, 2.0, 3.0]
