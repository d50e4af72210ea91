"""Steps with the probe: which scans are made, and what they give."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from minorloop_head.procedures import probe_steps
from minorloop_head.procedures.probe_steps import scanned_crack, scanned_pit
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.values import LogEntry
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Hole

from .fakes import CALIBRATION

HOLE = Hole(np.array([0.3, 20e-3]), 1e-3, 5.0, "dark", np.zeros((8, 2)))
COURSE = np.stack([np.linspace(0.0, 0.2, 20), np.full(20, 20e-3)], axis=1)
TRACED = TracedCrack(COURSE, np.linspace(0.1e-3, 0.3e-3, 20), 2e-3, 0.5)


def burst(verdict=""):
    return Burst(np.zeros(9), 1e-8, np.zeros(2), 16, 16, 0.01, verdict)


@dataclass
class Rig:
    """A rig that scans nothing: requests and steps are kept."""

    log: list = field(default_factory=list)
    asked: list = field(default_factory=list)
    calibration = CALIBRATION
    place = np.zeros(2)

    def say(self, what, outcome, *, succeeded=True):
        self.log.append(LogEntry(0.0, what, outcome, succeeded))

    def compute(self, work):
        return work()

    def reading(self, request):
        self.asked.append(request)


class Scanner:
    """Scans that give these bursts, or are refused; their places and shifts are kept."""

    def __init__(self, bursts=(), refused=""):
        self.bursts, self.refused, self.made = tuple(bursts), refused, []

    def __call__(self, rig, place, shift):
        self.made.append((place, shift))
        return ScannedRaster(reference=np.zeros(2), bursts=self.bursts, refused=self.refused)


@pytest.mark.parametrize("first", ["disturbed", "no floor echo", "distances disagree"])
def test_a_scan_that_gives_no_depth_is_repeated_beside_the_first(monkeypatch, first):
    verdicts, rig, scanner = [first, "measured"], Rig(), Scanner()
    monkeypatch.setattr(
        probe_steps, "measure_pit", lambda *given: PitDepth(verdicts.pop(0), 0.3, 20e-3)
    )
    pit, scanned = scanned_pit(rig, HOLE, scanner)
    assert [shift for _, shift in scanner.made] == [0.0, 0.5]
    assert pit.measured
    assert scanned.reference is not None
    steps = [(step.what, step.succeeded) for step in rig.log]
    assert steps == [("measure", False), ("measure again", True)]


def test_what_is_out_of_reach_has_no_depth():
    scanner = Scanner(refused="out of reach: pan needs 53 degrees")
    pit, scanned = scanned_pit(Rig(), HOLE, scanner)
    assert (pit.verdict, scanned.refused) == ("out of reach", scanner.refused)
    assert scanned_crack(Rig(), TRACED, scanner)[0] == CrackDepth("out of reach")


def test_a_crack_is_scanned_where_it_is_widest_and_the_pipe_is_drained(monkeypatch):
    monkeypatch.setattr(probe_steps, "crack_depth", lambda *given: CrackDepth("measured", 5e-4))
    rig, scanner = Rig(), Scanner([burst()])
    found, _ = scanned_crack(rig, TRACED, scanner)
    (((phi, z), _),) = scanner.made
    assert phi > 0.15
    assert z == pytest.approx(20e-3)
    assert [request.water for request in rig.asked] == [False]
    assert found.depth == 5e-4
    assert rig.log[-1].outcome == "measured, 0.50 mm deep"


def test_a_crack_above_the_water_has_no_depth():
    rig, scanner = Rig(), Scanner([burst("no coupling")] * 3)
    assert scanned_crack(rig, TRACED, scanner)[0].verdict == "no coupling"
    assert not rig.log[-1].succeeded
