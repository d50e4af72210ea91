"""An inspection as scripted: four views, three visits and a crack, by a head with a probe."""

import json
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop_head.geometry import Pinhole
from minorloop_head.inspection import InspectedHead, inspect
from minorloop_head.inspection import inspect_pipe as module
from minorloop_head.procedures import inspection, probe_steps, probing
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.inspected_view import InspectedView
from minorloop_head.procedures.pictures import InspectedPicture
from minorloop_head.procedures.ring import Ring
from minorloop_head.procedures.scan import ScannedRaster
from minorloop_head.procedures.values import LogEntry
from minorloop_head.reconstruction.depth_map import WaterLine
from minorloop_head.ultrasound.crack_depth import CrackDepth
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.ultrasound.wall_echoes import Profile
from minorloop_head.vision.cracks import TracedCrack
from minorloop_head.vision.defects import Findings, Hole

LENS = Pinhole(320, 240, 200.0, (159.5, 119.5))
VIEW = HeadCalibration(lens=LENS, leds=np.zeros((3, 3)), length=0.1024)
BEGUN = {"head": "H-07", "calibrated": None, "actuator": "bench:head.toml", "camera": "camera:0"}
TRACE = 0.01 * np.random.default_rng(1).standard_normal(2000)


def hole(phi, z, evidence):
    circle = np.linspace(0.0, 6.0, 9)
    rim = np.stack([phi + 0.05 * np.cos(circle), z + 0.5e-3 * np.sin(circle)], axis=1)
    return Hole(np.array([phi, z]), 1e-3 / 3, evidence, "dark", rim)


def inspected_view(name, **known):
    """A view with a good picture; besides, what is given is known of it."""
    blank = {
        "picture": InspectedPicture(name=name, t=0.0, verdict="good"),
        "image": np.zeros((240, 320), np.uint8),
        **dict.fromkeys(("angles", "joints", "place"), (0.0, 0.0)),
    }
    return InspectedView(**{**blank, **known})


class _Rig(SimpleNamespace):
    """A rig whose clock goes on by a tick with each entry of its log."""

    t = property(lambda self: 0.04 * len(self.log))


class Script:
    """What is taken and scanned, and what a test changes of it.

    ``before`` is called with the name of each view before it is taken.
    """

    def __init__(self, folder):
        self.folder, self.taken, self.made, self.logged = folder, [], [], None
        self.probe, self.travels, self.safe, self.told = True, True, False, []
        self.before = self.look = lambda rig, name: None
        self.crack_depth = CrackDepth("measured", 7e-4, 2e-5)
        self.torn, self.shown = set(), {}

    @contextmanager
    def opened(self, logged):
        def say(what, outcome, *, succeeded=True):
            log.append(LogEntry(0.0, what, outcome, succeeded))
            logged(log[-1])

        log, self.safe, self.logged = [], False, logged
        try:
            yield _Rig(
                control=None,
                calibration=VIEW, travels=self.travels, place=(0.0, 0.0), say=say, log=log,
                compute=lambda work: work(), check_sensors=lambda: None, has_tool=True,
                reading=lambda request: None,
            )  # fmt: skip
        finally:
            self.safe = True

    def run(self, advances=(0.0, 5e-3), *, resume=False, **asked):
        head = InspectedHead(BEGUN, VIEW, self.opened, "" if self.probe else None)
        self.taken.clear()
        self.made.clear()

        def told(text, *, kept=False):
            self.told.append(text)

        return inspect(head, self.folder, advances, resume=resume, told=told, **asked)

    def content(self):
        """What is the same of one that was resumed and one that was not."""
        found = json.loads((self.folder / "findings.json").read_text())
        return {k: value for k, value in found.items() if k not in ("seconds", "resumed", "log")}

    def journal(self):
        return [json.loads(line) for line in self.lines()]

    def lines(self):
        return (self.folder / "journal.jsonl").read_text().splitlines(keepends=True)

    def rewrite(self, lines):
        """Write the journal anew, as one that was cut off has it."""
        texts = (line if isinstance(line, str) else f"{json.dumps(line)}\n" for line in lines)
        (self.folder / "journal.jsonl").write_text("".join(texts))


@pytest.fixture
def script(tmp_path, monkeypatch, without_pictures):
    found = Script(tmp_path / "found")
    course = np.stack([np.linspace(-0.4, 0.1, 9), np.full(9, 22e-3)], axis=1)
    crack = TracedCrack(course, np.linspace(0.1e-3, 0.3e-3, 9), 5e-3, 0.3)
    sure, lost = hole(-1.4, 20e-3, 5.1), hole(1.1, 24e-3, 3.3)
    found.shown |= {"view 1": [sure], "view 3": [hole(-1.401, 20.02e-3, 4.2), lost]}
    found.shown["hole 1"] = [sure]
    traced = {"view 2": (crack,), "crack 1": (crack,)}

    def seen(rig, name):
        found.before(rig, name)
        found.taken.append(name)
        torn = name in found.torn
        shown = Findings(
            () if torn else tuple(found.shown.get(name, ())), "torn" if torn else "good"
        )
        blank = inspected_view(
            name, picture=InspectedPicture(name=name, t=1.0, verdict=shown.verdict),
            image=np.full((240, 320), 40 + len(name), np.uint8),
            angles=(0.1, 0.2), joints=(0.61234, 0.7), place=(1e-3, 0.0),
        )  # fmt: skip
        return inspection._Seen(blank, shown, VIEW.camera_at((0.0, 0.0)))

    def scan(rig, place, shift, *, before, told):
        part = before or ScannedRaster(reference=np.array([place[1], 0.1]), done=False)
        for point in range(part.point, 2):
            found.made.append((round(place[1], 3), shift, point))
            burst = Burst(
                TRACE + 1e-6 * len(found.made), 1e-8, np.array([shift, -0.27 - point]), 4, 4, 0.005
            )
            part = replace(part, bursts=(*part.bursts, burst), point=point + 1)
            told(part)
        rig.say("scan", "36 of 36 points")
        return replace(part, done=True)

    def pit(bursts, probe, place, diameter):
        """One that needs a second scan."""
        assert [burst.angles[1] for burst in bursts] == [-0.27, -1.27]
        verdict = "measured" if bursts[0].angles[0] else "disturbed"
        sizes = {"diameter": diameter, "place_sd": 1e-5, "diameter_sd": 2e-5}
        return PitDepth(verdict, *place, depth=5e-4, depth_sd=1e-5, **sizes)

    def ringed(rig):
        found.made.append("ring")
        spots = np.array([[0.1, 20e-3], [0.2, 20e-3]])
        profile = Profile(spots, np.array([1e-5, np.nan]), np.ones(2))
        return Ring(profile, WaterLine(-4e-3, 2e-4, 0.0))

    def fake(where, **parts):
        for name, part in parts.items():
            monkeypatch.setattr(where, name, part)

    def nothing(*_, **__):
        return None

    def again(*_):
        name = found.taken[-1]
        return () if name in found.torn else traced.get(name, ())

    fake(inspection, _go=nothing, pick=nothing, centre=nothing, _seen=seen, traces_of=again)
    fake(inspection, views_of=lambda _: np.zeros((2, 2)), traced_again=again)
    fake(inspection, look=lambda rig, name, angles: found.look(rig, name))
    fake(probing, go=nothing, meter=nothing, approach=nothing, scan=scan, ring_sweep=ringed)
    point = SimpleNamespace(perpendicular=np.zeros(2), out_of_reach=lambda control: "")
    fake(probing, ring_scan=lambda rig: point)
    fake(probing, touch=lambda rig, hole: rig.say("touch", "touched"))
    fake(probing, reach_words=lambda rig: ("within reach", True))
    fake(probe_steps, measure_pit=pit, crack_depth=lambda *_: found.crack_depth)
    return found


@pytest.fixture
def unreported(monkeypatch):
    """No report is written, where only journal and findings are looked at."""
    monkeypatch.setattr(module, "written", lambda *given: None)


@pytest.fixture
def full_disk(monkeypatch):
    """Fill the disk: what is written from then on does not reach it."""

    def full(*_):
        raise OSError(28, "No space left on device")

    return lambda *_: monkeypatch.setattr("os.fsync", full)
