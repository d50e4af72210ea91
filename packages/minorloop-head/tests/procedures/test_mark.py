from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from minorloop_head.geometry import Tool, wall_distance
from minorloop_head.procedures.centre import CONE
from minorloop_head.procedures.mark import (
    BEYOND,
    NO_TOOL,
    TOUCHED,
    Marking,
    Touch,
    aim_at,
)
from minorloop_head.procedures.meter import Light
from minorloop_head.procedures.values import Request
from minorloop_head.twins.pipe import Bore
from minorloop_head.twins.rig import SimulatedTip

from .fakes import CALIBRATION, MOUNT, PIPE, Loop, eye

PLACE, CATHETER = (0.5, 24e-3), (1e-3, 0.0)
CALIBRATED = replace(CALIBRATION, tool=Tool())
BESIDE, EDGE = (0.0, -1.2e-3), (-7e-3, 5e-3)


def test_an_aim_looks_at_its_place_or_stops_at_the_cone():
    pan, tilt = aim_at(CALIBRATION, PLACE, CATHETER)
    assert eye().place(eye().lens.centre, pan, tilt) == pytest.approx(PLACE, abs=1e-9)
    near = aim_at(CALIBRATION, (0.5, 5e-3), CATHETER)
    assert np.hypot(*near) == pytest.approx(CONE.half)


class Bench(Loop):
    """A head that follows at once, with the tip of the twin; ``blind`` frames are black."""

    def __init__(self, blind=()):
        super().__init__(place=CATHETER, share=0.5)
        hole = Bore(*PLACE, 1e-3)
        pipe = replace(PIPE, bores=(hole,))
        self.tip, self.blind, self.ticks = (
            SimulatedTip(pipe, mount=replace(MOUNT, advance=0)),
            blind,
            0,
        )

    def reading(self, request=None):
        request = request or Request()
        self.ticks += 1
        reading = super().reading(replace(request, frame=False))
        self.tip.move_to((*self.angles, 0.0, 0.0, *self.place))
        for name, send in (("lights", self.tip.switch), ("focus", self.tip.focus_at),
                           ("extension", self.tip.extend)):  # fmt: skip
            if getattr(request, name) is not None:
                send(getattr(request, name))
        if request.exposure is not None:
            self.tip.expose(*request.exposure)
        image = self.tip.frame().image if request.frame else None
        if image is not None and self.ticks in self.blind:
            image = np.zeros_like(image)
        extension, touching = self.tip.tool_state()
        return replace(reading, image=image, extension=extension, touching=touching)


@cache
def touched(blind=(), beside=BESIDE):
    bench, light = Bench(blind), Light()
    touch = Touch(place=np.array(PLACE), beside=np.array(beside))
    found = bench.run(Marking(calibration=CALIBRATED).touch(touch, light))
    assert light.gain != 1.0
    return bench, found


@pytest.mark.parametrize("beside", [BESIDE, EDGE])
def test_the_tool_and_not_the_axis_is_turned_to_a_place_and_leaves_a_mark(beside):
    """At the edge, the picture shows the outline and not the whole patch: one beside it is tracked.

    Else the patch about the outline is tracked.
    """
    bench, state = touched(beside=beside)
    assert (state.verdict, state.outlined) == (TOUCHED, True)
    assert (wall_distance(state.tracked, state.place, 10e-3) > 1e-3) == (beside == EDGE)
    wanted = PLACE + beside / np.array([10e-3, 1.0])
    assert wall_distance(bench.tip.tool.marks[-1], wanted, 10e-3) < 0.1e-3
    assert wall_distance(state.touch, wanted, 10e-3) < 0.1e-3
    axis = eye().place(eye().lens.centre, *bench.angles)
    assert wall_distance(axis, wanted, 10e-3) > 1e-3
    assert bench.tip.tool.extension == 0.0


def test_it_waits_while_it_sees_nothing_and_goes_on_when_it_sees_again():
    first = touched()[0].ticks
    blind = tuple(range(first - 60, first - 40))
    bench, state = touched(blind)
    assert state.verdict == TOUCHED
    assert bench.ticks > first
    assert len(bench.tip.tool.marks) == 1


def test_a_place_out_of_reach_and_a_head_without_a_tool_are_said():
    loop = Loop(place=CATHETER)
    marking = Marking(calibration=CALIBRATED)
    assert marking.angles((0.5, 8e-3), CATHETER) is None
    assert marking.angles(PLACE, CATHETER) is not None
    beyond, bare = Touch(place=np.array((0.5, 8e-3))), Marking(calibration=CALIBRATION)
    assert loop.run(marking.touch(beyond, Light())).verdict == BEYOND
    assert loop.run(bare.touch(Touch(place=np.array(PLACE)), Light())).verdict == NO_TOOL
