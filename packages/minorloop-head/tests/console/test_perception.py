import math
from functools import cache

import msgspec
import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop.errors import InstrumentError
from minorloop_head.console.perception import Perception
from minorloop_head.procedures.calibration import STRAIGHT
from minorloop_head.procedures.meter import LIMITS


@cache
def there():
    return towards(PIT, 0.8)


@pytest.fixture(scope="module")
def seeing():
    """A camera that has come to rest near the pit, and has searched for defects."""
    camera = Perception(tip()[0], view())
    reports = [camera.tick(request(there(), number=n)) for n in range(40)]
    return camera, reports


def events(reports, what):
    return [event for report in reports for event in report.events if event["what"] == what]


def test_where_the_head_rests_defects_are_searched_once(seeing):
    _, reports = seeing
    (found,) = events(reports, "found")
    assert found["verdict"] == "good"
    pixel = view().camera_at(there()[2:]).pixel(PIT[:2], *there()[:2])
    assert math.dist(reports[-1].spots[0][:2], pixel) < 4.0


def test_a_pick_takes_what_is_known_near_it_and_follows_it(seeing):
    camera, reports = seeing
    u, v, *_ = reports[-1].spots[0]
    camera.tick(request(there(), ("pick", [u + 9.0, v - 6.0])))
    moved = towards(PIT, 0.9)
    for share in np.linspace(0.8, 0.9, 6):
        report = camera.tick(request(towards(PIT, float(share))))
    assert report.target[3]
    pixel = view().camera_at(moved[2:]).pixel(PIT[:2], *moved[:2])
    assert math.dist(report.target[:2], pixel) < 5.0


def test_a_pick_that_is_refused_leaves_no_target_and_names_the_picked_pixel(seeing):
    camera, reports = seeing
    u, v, *_ = reports[-1].spots[0]
    assert camera.tick(request(there(), ("pick", [u, v]))).target is not None
    picked, event = camera.tick(request(there(), ("pick", [2.0, 3.0]))).events
    assert (picked, event["what"]) == ({"what": "picked"}, "unpicked")
    assert event["text"].startswith("pixel (2, 3) was not picked")
    assert "there is no target now: " in event["text"]
    assert camera.tick(request(there())).target is None


def test_while_the_outline_about_a_pick_is_looked_for_there_is_no_target_and_the_last_pick_counts():
    waiting = []

    def later(work):
        waiting.append(work)
        return lambda: None if work in waiting else work()

    camera = Perception(tip()[0], view(), later)
    camera.tick(request(there(), ("pick", [400.0, 400.0])))
    report = camera.tick(request(there(), ("pick", [350.0, 300.0])))
    assert (report.events, report.target, len(waiting)) == ([{"what": "picked"}], None, 2)
    waiting.clear()
    camera.tick(request(there()))
    report = camera.tick(request(there()))
    assert math.dist(report.target[:2], (350.0, 300.0)) < 30.0


def test_a_point_that_is_centred_is_exposed_for_and_the_whole_picture_otherwise():
    """Of wall that the whole picture makes white, nothing can be tracked."""
    camera = Perception(tip()[0], view())
    for n in range(60):
        commands = [("pick", [400.0, 400.0])] if n == 25 else []
        asked = request(there(), *commands, number=n)
        report = camera.tick(msgspec.structs.replace(asked, centring=n >= 35))
        if n in (34, 59):
            u, v = np.round(report.target[:2]).astype(int).tolist()
            about = camera.image[v - 40 : v + 40, u - 40 : u + 40].mean()
            exposed = camera.image.mean() if n == 34 else about
            assert exposed == pytest.approx(LIMITS.grey, abs=10.0)
            assert (about > 1.5 * LIMITS.grey) == (n == 34)


def test_a_scan_that_cannot_be_flooded_or_is_not_on_gives_no_echoes():
    own = tip()[0]

    def fails(on):
        raise InstrumentError("the pump is off")

    own.flood = fails
    camera = Perception(own, view())
    begun = camera.tick(request(there(), ("begin_scan", [1.0, *PIT[:2], PIT[2]])))
    fired = camera.tick(request(there(), ("fire", [0.0, 0.0])))
    assert [each["text"] for each in events([begun, fired], "unscanned")] == [
        "the pump is off",
        "the camera was started anew",
    ]


def test_a_search_that_takes_long_does_not_let_pictures_pile_up():
    camera = Perception(tip()[0], view(), lambda work: lambda: None)  # it never ends
    reports = [camera.tick(request(there(), ("find", []), number=n)) for n in range(60)]
    assert (len(camera._pending), len(camera._queue)) == (1, 4)
    assert "still searched" in events(reports, "notice")[-1]["text"]


def test_the_first_picture_that_is_shown_is_metered():
    """With the gain at which a camera begins, the wall beside a cold head is white."""
    camera, greys, cold = Perception(tip()[0], view()), [], (-STRAIGHT, -STRAIGHT, 0.0, 0.0)
    for n in range(60):
        camera.tick(request(cold, number=n))
        greys += [float(camera.image.mean())] if camera.shown else []
    assert greys[0] < 2.0 * LIMITS.grey
    assert greys[-1] == pytest.approx(LIMITS.grey, rel=0.3)
