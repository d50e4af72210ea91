import math
import pickle
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from console_rig import PIT, request, tip, towards, view
from minorloop.errors import ParameterError
from minorloop_head.console import depth_work
from minorloop_head.console.perception import Perception
from minorloop_head.console.sweep import ALONG, AROUND, begin_sweep, cut, swept
from minorloop_head.procedures.sweep import ProbeSweep

HOME = (0.1, -0.2, 5e-3, -0.3)


def test_a_sweep_is_begun_about_the_place_in_the_middle_of_the_picture():
    sweep = begin_sweep(view(), towards(PIT), HOME)
    state = sweep.state
    assert (sweep.home, sweep.stage) == (HOME, "travel")
    assert state.phi == pytest.approx((PIT[0] - AROUND, PIT[0] + AROUND), abs=0.01)
    assert state.z == pytest.approx((PIT[1] - ALONG, PIT[1] + ALONG), abs=0.1e-3)
    assert begin_sweep(view(), (0.0, 0.0, 0.0, 0.0), HOME) is None  # along the pipe
    with pytest.raises(ParameterError, match=r"the end of the pipe at 102\.4 mm"):
        begin_sweep(view(), towards((0.45, 101.5e-3), position=(0.0, 0.0, 85e-3, 0.0)), HOME)


def test_a_sweep_that_is_cut_ends_at_once_and_goes_back():
    begun = begin_sweep(view(), towards(PIT), HOME)
    for sweep, whole in (
        (cut(begun), 0.0),
        (replace(begun, state=replace(begun.state, done=True)), 1.0),
    ):
        after, request = swept(cut(sweep), view(), towards(PIT), (0.0, 0.0), 0.04)
        assert after.stage == "back"
        assert request.commands == (("end_sweep", [whole]),)
        assert request.angles == HOME[:2]
        assert request.rates[0] > 0
        assert request.rates[1] < 0
        position, ticks = list(towards(PIT)), 0
        while after.stage != "done":
            after, request = swept(after, view(), tuple(position), (0.0, 0.0), 0.04)
            position[:2] = request.angles
            position[2:] = np.add(position[2:], np.multiply(0.04, request.rates)).tolist()
            ticks += 1
            assert request.commands == ()
        assert position == pytest.approx(HOME, abs=6e-3)
        assert ticks < 200


def test_the_bursts_of_a_sweep_give_a_map_with_the_pit():
    """Lines over the pit, by the commands of a sweep."""
    camera, sweep = Perception(tip()[0], view()), ProbeSweep(calibration=view())
    z = PIT[1] - 1.1e-3, PIT[1] + 1.1e-3
    phi, (pan, tilt) = (PIT[0] - 0.14, PIT[0] + 0.14), sweep.point.perpendicular
    numbers = count(1, 5)  # of ticks for which no picture is drawn
    reports = [camera.tick(request((pan, tilt, z[0], 0.0), ("fire_on", []), number=1))]
    assert reports[0].events == [{"what": "unscanned", "text": "the camera was started anew"}]
    camera.tick(request((pan, tilt, z[0], 0.0), ("begin_sweep", [*phi, *z]), number=1))
    for advance in np.arange(*z, sweep.pitch):
        for angle in np.arange(*phi, sweep.pitch / view().radius):
            roll = float(sweep.point.rolled(angle, (advance, 0.0))[1])
            here = pan, tilt, float(advance), roll
            camera.tick(request(here, number=next(numbers)))
            camera.tick(request(here, ("fire_on", []), number=next(numbers)))
    camera.tick(request(here, ("end_sweep", [0.0]), number=next(numbers)))
    (job,) = camera.jobs
    *stages, last = depth_work.sweep(**pickle.loads(pickle.dumps(job)))
    assert stages == [{"stage": "mapping the wall"}]
    (find,) = (one for one in last["finds"] if one["kind"] == "pit")
    assert find["phi"] == pytest.approx(PIT[0], abs=0.03)
    assert find["z"] == pytest.approx(PIT[1], abs=0.3e-3)
    assert find["depth"] == pytest.approx(PIT[3], abs=0.03e-3)
    assert last["mapped"] > 0.9
    assert last["whole"] is False
    assert last["files"]["png"].startswith(b"\x89PNG")
    header, *rows = last["files"]["csv"].decode().splitlines()
    assert header == "phi [deg],z [mm],amplitude [1],depth [mm],depth_sd [mm]"
    deepest = max(rows, key=lambda row: float(row.split(",")[3] or 0.0)).split(",")
    assert float(deepest[0]) == pytest.approx(math.degrees(PIT[0]), abs=3.0)
    # One burst has no surface: a map, and nothing in it.
    empty = list(depth_work.sweep(**{**job, "bursts": job["bursts"][:1]}))[-1]
    assert (empty["finds"], empty["mapped"] < 0.1) == ([], True)
    camera.tick(request(here, ("begin_sweep", [*phi, *z]), number=1))
    none = camera.tick(request(here, ("end_sweep", [0.0]), number=1))
    assert "nothing of the sweep was fired" in none.events[0]["text"]
    assert camera.jobs == [job]
