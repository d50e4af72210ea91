from dataclasses import replace

import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop_head.console.mark import (
    marking,
    reaches,
    servoed,
)
from minorloop_head.console.perception import Perception
from minorloop_head.console.plant import reading_at
from minorloop_head.geometry import wall_distance
from minorloop_head.procedures import mark as touches
from minorloop_head.procedures.mark import tool_pixel

NEAR = (0.12, -0.9e-3)


class Touching:
    """A camera whose tool is turned to a place beside the pit, and what it reports."""

    def __init__(self, beside=NEAR, off=(0.0, 0.0), known=None):
        tool, place = view().tool, np.add(PIT[:2], beside)
        angles = tool.aim(view().mount_at((0.0, 0.0)), place, view().radius, towards(PIT)[:2])
        self.here = (*angles.tolist(), 0.0, 0.0)
        self.camera, self.events = Perception(tip()[0], known or view()), []
        self.tool = self.camera._tip.tool
        self.ticks(30, "found")
        now = reading_at(self.here)
        pixel = np.add(tool_pixel(view(), tool, now.place, now.angles), off)
        self.ticks(4, "", ("pick", pixel.tolist()))

    def ticks(self, count, what, *commands, until=lambda tool: False):
        """Ticks until something was reported, or a condition on the tool is met."""
        for n in range(count):
            given = commands if n == 0 else ()
            self.events += self.camera.tick(request(self.here, *given)).events
            if what in [event["what"] for event in self.events] or until(self.tool):
                return

    def marked(self):
        """What is reported of a touch."""
        self.ticks(300, "marked", ("mark", []))
        (event,) = [each for each in self.events if each["what"] == "marked"]
        return event


def test_a_mark_is_measured_from_the_picked_point_by_the_next_picture():
    touch = Touching(off=(9.0, -6.0))
    picked = touch.camera._track.home
    touch.camera._marking = replace(marking(view()), close=60.0)
    event = touch.marked()
    true = wall_distance(touch.tool.marks[-1], picked, view().radius)
    assert (event["verdict"], event["off"]) == (touches.TOUCHED, pytest.approx(true, abs=0.03e-3))
    assert touch.events[-2:] == [{"what": "touched"}, event]
    assert touch.tool.extension == 0.0


def test_a_touch_that_is_ended_withdraws_the_tool_and_reports_nothing():
    touch = Touching()
    touch.camera._marking = replace(marking(view()), close=60.0)
    for command in ("end_mark", "pick"):
        touch.ticks(40, "", ("mark", []), until=lambda tool: tool.extension > 5e-3)
        assert touch.tool.extension > 5e-3
        touch.ticks(1, "", ("pick", [320.0, 240.0]) if command == "pick" else (command, []))
        touch.ticks(1, "", ("end_mark", []))  # as the loop does after a pick
        touch.ticks(60, "marked", until=lambda tool: tool.extension == 0.0)
        touch.ticks(3, "marked")
        assert touch.tool.extension == 0.0
        assert not [each for each in touch.events if each["what"] in ("touched", "marked")]


def test_a_point_is_servoed_to_where_the_tool_meets_it_and_may_be_out_of_reach():
    here = reading_at(towards(PIT))
    pixel = tuple(tool_pixel(view(), view().tool, here.place, here.angles).tolist())
    assert servoed(view(), pixel, here) == pytest.approx(view().lens.centre)
    assert reaches(view(), pixel, here)
    short = replace(view(), tool=replace(view().tool, longest=5e-3))
    assert not reaches(short, pixel, here)
    assert not reaches(view(), (0.0, 0.0), reading_at((0.5, 0.0, 0.0, 0.0)))
    assert not reaches(view(), (np.nan, 0.0), here)
