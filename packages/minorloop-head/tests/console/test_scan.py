import math
from dataclasses import replace

import numpy as np
import pytest

from console_rig import PIT, view
from minorloop_head.console.scan import begin_scan, scanned
from minorloop_head.console.units import to_si


def scan_of(position):
    return begin_scan(1, PIT[:2], PIT[2], view(), position)


def test_a_place_beside_the_probe_is_not_reached_and_the_scan_goes_back():
    scan = scan_of((0.0, 0.0, 0.0, 0.0))
    asked, shots = [], 0
    for _ in range(2500):  # the catheter is stuck where it is
        scan, ask = scanned(scan, view(), (0.0, 0.0, 0.0, math.radians(-120.0)), (0.0, 0.0), 0.04)
        asked.append(ask)
        shots += sum(name == "fire" for name, _ in ask.commands)
        if scan.stage == "done":
            break
    assert scan.stage == "done"
    assert shots == 0
    assert max(abs(ask.rates[0]) for ask in asked) <= 8.0e-3


def test_the_head_stays_at_a_point_until_its_echoes_are_there():
    here, targets = to_si((1.0, 2.0, 0.0, 0.0)), np.radians([(1.0, 2.0), (5.0, 6.0)])
    scan = scan_of(here)
    scan = replace(scan, state=replace(scan.state, stage="points", targets=targets))
    commands = []
    for _ in range(40):  # 1.6 s: the camera process is late
        scan, ask = scanned(scan, view(), here, here[:2], 0.04)
        commands += ask.commands
        assert ask.angles == pytest.approx(here[:2])
    assert commands == [("fire", [pytest.approx(here[0]), pytest.approx(here[1])])]
    scan, _ = scanned(replace(scan, fired=True), view(), here, here[:2], 0.04)
    assert (scan.state.point, scan.state.requested, scan.state.progress) == (1, False, 0.5)


def test_a_scan_that_gives_up_on_a_row_is_finished_with_what_was_fired():
    stuck, targets = to_si((0.0, 0.0, 0.0, -120.0)), np.radians([(1.0, 2.0)] * 36)
    scan = scan_of(stuck)
    scan = replace(scan, state=replace(scan.state, stage="roll", targets=targets, point=6))
    commands = []
    while scan.stage != "done":  # the roll of the catheter is stuck
        scan, ask = scanned(scan, view(), stuck, stuck[:2], 0.04)
        commands += ask.commands
    assert commands == [("finish_scan", [])]
