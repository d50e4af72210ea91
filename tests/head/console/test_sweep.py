import math
import pickle
from itertools import count

import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop.head.console import depth_work
from minorloop.head.console.perception import Perception
from minorloop.head.console.sweep import ALONG, AROUND, begin_sweep
from minorloop.head.procedures.sweep import ProbeSweep


def test_a_sweep_is_begun_about_the_place_in_the_middle_of_the_picture():
    state = begin_sweep(view(), towards(PIT)).state
    assert state.phi == pytest.approx((PIT[0] - AROUND, PIT[0] + AROUND), abs=0.01)
    assert state.z == pytest.approx((PIT[1] - ALONG, PIT[1] + ALONG), abs=0.1e-3)
    assert begin_sweep(view(), (0.0, 0.0, 0.0, 0.0)) is None  # along the pipe


def test_the_bursts_of_a_sweep_give_a_map_with_the_pit():
    """Lines over the pit, by the commands of a sweep."""
    camera, sweep = Perception(tip()[0], view()), ProbeSweep(calibration=view())
    z = PIT[1] - 1.1e-3, PIT[1] + 1.1e-3
    pan, tilt = sweep.point.perpendicular
    numbers = count(1, 5)  # of ticks for which no picture is drawn
    reports = [camera.tick(request((pan, tilt, z[0], 0.0), ("fire_on", []), number=1))]
    assert reports[0].events == [{"what": "unscanned", "text": "the camera was started anew"}]
    camera.tick(request((pan, tilt, z[0], 0.0), ("begin_sweep", list(z)), number=1))
    for advance in np.arange(*z, sweep.pitch):
        for phi in PIT[0] + np.arange(-0.14, 0.14, sweep.pitch / view().radius):
            roll = float(sweep.point.rolled(phi, (advance, 0.0))[1])
            here = pan, tilt, float(advance), roll
            camera.tick(request(here, number=next(numbers)))
            camera.tick(request(here, ("fire_on", []), number=next(numbers)))
    camera.tick(request(here, ("end_sweep", []), number=next(numbers)))
    (job,) = camera.jobs
    *stages, last = depth_work.sweep(**pickle.loads(pickle.dumps(job)))
    assert stages == [{"stage": "mapping the wall"}]
    (find,) = (one for one in last["finds"] if one["kind"] == "pit")
    assert find["phi"] == pytest.approx(PIT[0], abs=0.03)
    assert find["z"] == pytest.approx(PIT[1], abs=0.3e-3)
    assert find["depth"] == pytest.approx(PIT[3], abs=0.03e-3)
    assert last["files"]["png"].startswith(b"\x89PNG")
    header, *rows = last["files"]["csv"].decode().splitlines()
    assert header == "phi [deg],z [mm],amplitude [1],depth [mm],depth_sd [mm]"
    deepest = max(rows, key=lambda row: float(row.split(",")[3] or 0.0)).split(",")
    assert float(deepest[0]) == pytest.approx(math.degrees(PIT[0]), abs=3.0)
    # One burst has no surface: a map, and nothing in it.
    empty = list(depth_work.sweep(**{**job, "bursts": job["bursts"][:1]}))[-1]
    assert empty["finds"] == []
