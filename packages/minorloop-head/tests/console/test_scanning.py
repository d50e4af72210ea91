"""The way of a scan or a sweep; what a pilot sees of it is in `test_session`."""

import math

import numpy as np
import pytest

from console_rig import PIT, control, towards, view
from minorloop_head.console.reports import NumberedFindings, Outgoing
from minorloop_head.console.scanning import Scanning

HOME = (0.1, -0.2, 5e-3, -0.3)


@pytest.fixture
def out():
    return Outgoing()


@pytest.fixture
def scanning(out):
    return Scanning(view(), control(), 0.04, out)


def commands(scanning, out, at, ticks):
    """Commands of ticks in SCAN of a head that is where it is wanted, or stays at a place."""
    position, given = list(at), []
    for _ in range(ticks):
        asked = scanning.tick("SCAN", tuple(position[:2]), tuple(position)).requested
        given += out.commands
        out.commands.clear()
        if asked is None:
            break
        position[:2] = asked[0]
        position[2:] = np.add(position[2:], np.multiply(0.04, asked[1])).tolist()
    return given, position


def test_a_place_beside_the_probe_is_not_reached_and_the_scan_goes_back(scanning, out):
    found = NumberedFindings(view().radius, out)
    hole = {"phi": PIT[0], "z": PIT[1], "diameter": PIT[2], "evidence": 5.0}
    found.extracted(hole, 0.0)
    assert scanning.begin_scan(found.all[0], (0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    asked = []
    for _ in range(2500):  # the catheter is stuck where it is
        stuck = (0.0, 0.0, 0.0, math.radians(-120.0))
        asked.append(scanning.tick("SCAN", (0.0, 0.0), stuck))
        if scanning.scan.stage == "done":
            break
    assert "could not be brought over the finding" in asked[-1].hold
    assert out.commands == []
    assert max(abs(ask.requested[1][0]) for ask in asked[:-1]) <= 8.0e-3


@pytest.mark.parametrize("ticks", [1, 400])
def test_a_sweep_that_is_left_at_any_tick_is_mapped_once_and_its_head_comes_back(
    scanning, out, ticks
):
    assert scanning.begin_sweep(HOME[:2], (*towards(PIT)[:2], *HOME[2:]))
    _, position = commands(scanning, out, HOME, ticks)
    scanning.leave()
    assert [name for name, _ in out.commands] == ["end_sweep"]
    out.commands.clear()
    assert scanning.back_first("HEAD") == "SCAN"
    given, position = commands(scanning, out, position, 2000)
    assert given == []
    assert position == pytest.approx(HOME, abs=6e-3)
