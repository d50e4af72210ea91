"""Laws of every procedure."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from minorloop_head.geometry import Tool
from minorloop_head.procedures.centre import Centred, Centring
from minorloop_head.procedures.focus import focus
from minorloop_head.procedures.go import go
from minorloop_head.procedures.mark import Marking, Touch
from minorloop_head.procedures.meter import Light, acquisition, meter
from minorloop_head.procedures.rig import InspectionRig
from minorloop_head.procedures.scan import RasterScan, ScannedRaster
from minorloop_head.procedures.sweep import ProbeSweep
from minorloop_head.procedures.values import (
    ALL_LIGHTS,
    NOTHING,
    Request,
    Running,
    apply_to_tip,
    passed,
)
from minorloop_head.sources import Shot

from .fakes import CALIBRATION, Loop
from .test_rig import Control, Plant, Tip

PLACE = np.array([0.5, 12e-3])
SCAN, SWEEP = RasterScan(calibration=CALIBRATION), ProbeSweep(calibration=CALIBRATION)


def everything():
    """Request all that has to be undone."""
    while True:
        yield Request(extension=5e-3, water=True, lights=(True, False, False))


EVERY = {
    "go": lambda: go(PLACE, PLACE),
    "meter": lambda: meter(CALIBRATION, Light()),
    "centre": lambda: Centring(calibration=CALIBRATION).centre(Centred(place=PLACE)),
    "focus": lambda: focus(CALIBRATION.lens, PLACE, 0.01),
    "extract": lambda: acquisition(2.0),
    "scan": lambda: SCAN.scan(ScannedRaster(), tuple(PLACE)),
    "sweep": lambda: SWEEP.sweep(SWEEP.area((0.4, 1.2), (12e-3, 13e-3))),
    "mark": lambda: Marking(calibration=CALIBRATED).touch(Touch(place=PLACE), Light()),
    "everything": everything,
}
CALIBRATED = replace(CALIBRATION, tool=Tool())


class Whole(Tip):
    """A tip with a tool, whose shots are silent."""

    def tool_state(self):
        return 0.0, False

    def shots(self, count):
        return [Shot(0.0, np.zeros(2000), 1e-8)] * count


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=10, deadline=None)
@given(cut=st.integers(1, 600))
def test_a_procedure_that_is_cut_off_at_any_tick_leaves_the_rig_safe(name, cut):
    rig, ticks = InspectionRig(Plant(), Whole(), Control(), CALIBRATED), iter(range(1, cut))

    def each():
        if next(ticks, None) is None:
            raise KeyboardInterrupt

    procedure = EVERY[name]()
    try:
        rig.run(procedure, each)
    except KeyboardInterrupt:
        told = {what: values for what, *values in rig.tip.told}
        assert told.get("extend", [0.0]) == [0.0]
        assert told.get("flood", [False]) == [False]
        assert told.get("switch", [ALL_LIGHTS]) == [ALL_LIGHTS]
    assert procedure.gi_frame is None


@pytest.mark.parametrize("name", EVERY)
@settings(max_examples=10, deadline=None)
@given(cut=st.integers(0, 300))
def test_a_procedure_that_a_loop_closes_at_any_tick_leaves_all_safe_once(name, cut):
    loop, asked, safe, request = Loop(), [], Request(extension=0.0), NOTHING
    procedure = EVERY[name]()
    running = Running(procedure, asked.append, safe)
    for _ in range(cut):
        request = running.advance(loop.reading(request))
        if running.done:
            break
        loop.tick(request)
    ended = running.done
    for _ in "12":
        running.close()
    assert [each is safe for each in asked].count(True) == (not ended)
    assert ended or asked[-1] is safe
    assert procedure.gi_frame is None


def test_only_what_a_request_names_is_set():
    tip = Tip()
    apply_to_tip(tip, NOTHING)
    assert tip.told == []
    apply_to_tip(tip, Request(exposure=(0.01, 2.0), water=False))
    assert tip.told == [("expose", 0.01, 2.0), ("flood", False)]


def test_rounding_of_a_clock_does_not_cost_a_tick():
    assert passed(0.04, 3 * 0.04, 0.08)
    assert not passed(0.04, 0.08, 0.08)
