"""The probe in an inspection: what it scans, what it keeps, and what it does not repeat."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop_head.inspection.journal import converted, plain
from minorloop_head.inspection.lines import RingLine
from minorloop_head.procedures import probing as module
from minorloop_head.procedures import ring as ring_module
from minorloop_head.procedures.inspected_view import with_finding
from minorloop_head.procedures.probing import Kept, Probing
from minorloop_head.procedures.ring import Ring, ring_sweep
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.values import Reading
from minorloop_head.ultrasound.pits import PitDepth
from scripted_inspection import inspected_view

from .test_probe_steps import HOLE, TRACED, Rig

SAID = "out of reach: pan needs 53 degrees, has 41 (39 to 43) in water of 15 C"


class Told(Kept):
    """What is kept, in the order in which it is."""

    def __init__(self, **known):
        super().__init__(**known)
        self.told = []

    def add_scan(self, name, scanned):
        super().add_scan(name, scanned)
        self.told.append((name, scanned))


class Head(Rig):
    """A rig with a tool, which touches at once."""

    has_tool = True
    control = None

    def check_sensors(self):
        pass


def view_of(shown, name="hole 1"):
    return with_finding(inspected_view(name, seen=(shown,)), 10e-3)


@pytest.fixture
def made(monkeypatch):
    """Shifts of the scans that are made; each pit needs a second one, which measures it."""
    shifts = []

    def scan(rig, place, shift, *, before, told):
        shifts.append(shift)
        for point in range(3):
            told(ScannedRaster(reference=np.zeros(2), point=point, done=False))
        rig.say("scan", "36 of 36 points")
        return ScannedRaster(reference=np.array([20e-3, shift]), point=3)

    def measured(rig, shown, scan):
        scan(rig, (0.3, 20e-3), 0.0)
        scanned = scan(rig, (0.3, 20e-3), 0.5)
        rig.say("measure", "measured")
        sizes = {"diameter": 1.1e-3, "depth": 5e-4, "place_sd": 1e-5, "diameter_sd": 2e-5}
        return PitDepth("measured", 0.31, 20e-3, **sizes, depth_sd=1e-5), scanned

    monkeypatch.setattr(module, "scan", scan)
    monkeypatch.setattr(module, "scanned_pit", measured)
    monkeypatch.setattr(module, "approach", lambda rig, place: None)
    monkeypatch.setattr(module, "touch", lambda rig, hole: rig.say("touch", "touched"))
    return shifts


def test_a_hole_is_touched_scanned_and_its_finding_has_a_depth(made):
    kept = Told()
    found = Probing(Head(), kept).scanned(view_of(HOLE))
    told = kept.told
    assert (found.finding.kind, found.finding.verdict) == ("pit", "measured")
    assert (found.finding.depth, found.finding.depth_sd) == (5e-4, 1e-5)
    assert [step.what for step in found.steps] == ["touch", "scan", "scan", "measure"]
    assert [name for name, _ in told] == ["hole 1"] * 4 + ["hole 1 again"] * 4
    assert [(scanned.point, scanned.done) for _, scanned in told[:4]] == [
        (0, False), (1, False), (2, False), (3, True),
    ]  # fmt: skip
    assert [step.what for step in told[3][1].steps] == ["touch", "scan"]
    assert kept.scan_of(found) is told[7][1]
    assert kept.scan_of(replace(found, probed=PitDepth("disturbed", 0.3, 20e-3))) is told[3][1]


def test_what_the_probe_does_not_reach_is_said_before_travel_and_of_each_finding(made, monkeypatch):
    monkeypatch.setattr(module, "reach_words", lambda rig: (SAID, False))
    rig, kept = Head(), Kept()
    probing = Probing(rig, kept)
    probing.begin()
    assert (rig.log[0].what, rig.log[0].outcome, rig.log[0].succeeded) == ("reach", SAID, False)
    hole = probing.scanned(view_of(HOLE)).finding
    crack = probing.scanned(view_of(TRACED, "crack 1")).finding
    assert (hole.kind, hole.verdict) == ("hole or pit", SAID)
    assert hole.width == HOLE.diameter
    assert np.isnan(hole.depth)
    assert (crack.kind, crack.verdict) == ("crack", SAID)
    assert made == []


@pytest.mark.parametrize(
    ("raster", "point"), [("", ""), (SAID, ""), (SAID, SAID), ("no water", "")]
)
def test_the_pipe_is_swept_round_if_one_point_is_within_reach(monkeypatch, raster, point):
    for name in ("go", "meter"):
        monkeypatch.setattr(module, name, lambda *given, **more: None)
    sweep = SimpleNamespace(perpendicular=np.zeros(2), out_of_reach=lambda control: point)
    monkeypatch.setattr(module, "ring_scan", lambda rig: sweep)
    monkeypatch.setattr(module, "ring_sweep", lambda rig: Ring(None, None))
    rig, kept = Head(), Kept()
    Probing(rig, kept, raster).roll_round(20e-3)
    swept = not point and raster != "no water"
    assert (kept.ring is not None) == swept
    assert [request.water for request in rig.asked] == ([True, False] if swept else [])
    assert [(step.what, step.outcome, step.succeeded) for step in rig.log] == (
        [("water line", SAID, False)] if point else []
    )


def test_a_dry_pipe_is_not_scanned(made):
    rig = Head()
    probing = Probing(rig, Kept(), "no water")
    probing.begin()
    assert rig.log == []
    view = probing.scanned(view_of(HOLE))
    assert view.finding.verdict == "no water"
    assert [(step.what, step.succeeded) for step in view.steps] == [
        ("touch", True),
        ("scan", False),
    ]


class BlindRig(Head):
    """A rig whose camera never shows by how much the base is turned."""

    def reading(self, request):
        return Reading(t=0.0, angles=np.zeros(2), place=np.zeros(2), base=np.full(2, np.nan))


def test_a_sweep_round_the_pipe_without_a_burst_that_can_be_used_says_so(monkeypatch):
    monkeypatch.setattr(ring_module, "go", lambda *given, **more: None)
    monkeypatch.setattr(ring_module, "ring_scan", lambda rig: SimpleNamespace(perpendicular=None))
    rig = BlindRig()
    found = ring_sweep(rig)
    assert (found.profile.detected.size, found.water.words) == (0, "not seen")
    assert "48 more not used: no view of the turn of the base" in rig.log[-1].outcome
    assert not rig.log[-1].succeeded
    values = plain(RingLine(t=0.0, profile=found.profile, water=found.water))
    line = converted(json.loads(json.dumps(values)), RingLine)
    assert line.restored().water.words == "not seen"
