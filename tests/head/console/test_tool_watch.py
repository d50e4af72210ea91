import re
from dataclasses import replace

import numpy as np
import pytest

from console_rig import PIT, DirectCamera, Pilot, request, right, tip, towards, view
from minorloop.head.console import messages
from minorloop.head.console.perception import Perception
from minorloop.head.console.plant import reading_at
from minorloop.head.geometry import wall_distance
from minorloop.head.procedures.mark import tool_pixel

NEAR, AT_PIT = (0.12, -0.9e-3), (0.0, 0.0)


def touch(beside, off=(0.0, 0.0), known=None):
    """The distance that is measured after a touch beside the pit, of a point that was picked some
    pixels off, and where mark and picked point are."""
    known = known or view()
    here = (*known_tool().aim(known.mount_at((0.0, 0.0)), np.add(PIT[:2], beside), known.radius,
                              towards(PIT)[:2]).tolist(), 0.0, 0.0)  # fmt: skip
    camera, events = Perception(tip()[0], known), []

    def ticks(count, what, *commands):
        for n in range(count):
            events.extend(camera.tick(request(here, *(commands if n == 0 else ()))).events)
            if what in [event["what"] for event in events]:
                return

    ticks(30, "found")
    now = reading_at(here)
    pixel = np.add(tool_pixel(view(), known_tool(), now.place, now.angles), off)
    ticks(4, "", ("pick", pixel.tolist()))
    ticks(60, "touched", ("extend", [0.025]))
    assert camera.tick(request(here)).target[3]
    ticks(60, "marked", ("extend", [0.0]))
    (event,) = [each for each in events if each["what"] == "marked"]
    return event["off"], camera._tip.tool, camera._track.home


def known_tool():
    return view().tool


@pytest.mark.parametrize("off", [(0.0, 0.0), (9.0, -6.0)])
def test_a_mark_is_measured_from_the_picked_point_by_the_next_picture(off):
    measured, tool, picked = touch(NEAR, off)
    true = wall_distance(tool.marks[-1], picked, view().radius)
    assert measured == pytest.approx(true, abs=0.03e-3)


def test_a_mark_that_is_not_seen_is_not_measured():
    offset = tuple(np.add(view().tool.offset, (1.2e-3, 0.0, 0.0)).tolist())
    elsewhere = replace(view(), tool=replace(view().tool, offset=offset))
    assert touch(NEAR, known=elsewhere)[0] is None
    measured, tool, _ = touch(AT_PIT)  # on its floor no mark is left
    assert (measured, tool.marks) == (None, [])


def test_a_touch_from_the_console_says_how_far_from_the_picked_point_it_is():
    pilot = Pilot(DirectCamera()).steering(2)
    pilot.until(lambda s: s.seen.spots, pose=right(27.0, -12.0))
    pilot.drive(100, pose=right(27.0, -12.0))
    u, v, *_ = pilot.session.seen.spots[0]
    pilot.order(messages.Pick, u=u + 42.0, v=v)
    pilot.drive(4)
    pilot.mode("TRACK")
    pilot.drive(40)
    pilot.order(messages.Mark)
    pilot.until(lambda s: any(b"touched the wall" in event for event in s.events))
    said = next(event for event in pilot.session.events if b"touched the wall" in event)
    found = re.search(rb"the wall ([\d.]+) mm from the picked point, and is withdrawn", said)
    camera = pilot.camera.perception
    true = wall_distance(camera._tip.tool.marks[-1], camera._track.home, view().radius)
    assert 1e-3 * float(found[1]) == pytest.approx(true, abs=0.03e-3)
