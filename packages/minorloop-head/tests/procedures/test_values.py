"""Laws of every procedure."""

import numpy as np
import pytest

from minorloop_head.procedures.centre import Centring
from minorloop_head.procedures.extract import Acquisition
from minorloop_head.procedures.focus import Focusing
from minorloop_head.procedures.go import Go
from minorloop_head.procedures.mark import Marking
from minorloop_head.procedures.meter import Metering
from minorloop_head.procedures.scan import RasterScan
from minorloop_head.procedures.values import NOTHING, Request, apply_to_tip, passed

from .fakes import CALIBRATION, Loop

PLACE = (0.5, 12e-3)
EVERY = {
    "go": (Go(), Go().begin(place=PLACE, angles=PLACE)),
    "meter": (Metering(calibration=CALIBRATION), Metering(calibration=CALIBRATION).begin()),
    "centre": (Centring(calibration=CALIBRATION), Centring(calibration=CALIBRATION).begin(PLACE)),
    "focus": (Focusing(lens=CALIBRATION.lens), Focusing(lens=CALIBRATION.lens).begin(PLACE, 0.01)),
    "extract": (Acquisition(), Acquisition().begin(2.0)),
    "scan": (RasterScan(calibration=CALIBRATION), RasterScan(calibration=CALIBRATION).begin(PLACE)),
    "mark": (Marking(calibration=CALIBRATION), Marking(calibration=CALIBRATION).begin(PLACE)),
}


@pytest.mark.parametrize("name", EVERY)
def test_a_step_changes_neither_state_nor_configuration(name):
    procedure, state = EVERY[name]
    loop = Loop()
    first, again = (procedure.step(state, loop.reading())[1] for _ in "12")
    for field in ("lights", "exposure", "focus", "water", "frame", "shots"):
        assert getattr(first, field) == getattr(again, field)
    np.testing.assert_array_equal(first.rates, again.rates)


def test_only_what_a_request_names_is_set():
    told = []

    class Tip:
        def __getattr__(self, name):
            return lambda *values: told.append((name, *values))

    apply_to_tip(Tip(), NOTHING)
    assert told == []
    apply_to_tip(Tip(), Request(exposure=(0.01, 2.0), water=False))
    assert told == [("expose", 0.01, 2.0), ("flood", False)]


def test_rounding_of_a_clock_does_not_cost_a_tick():
    assert passed(0.04, 3 * 0.04, 0.08)
    assert not passed(0.04, 0.08, 0.08)
