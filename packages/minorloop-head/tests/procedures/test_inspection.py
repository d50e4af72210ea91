"""An inspection without an operator, of a simulated pipe with a hole, by a head on a bench."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.errors import InstrumentError
from minorloop_head.geometry import Pinhole, wall_distance
from minorloop_head.procedures import inspection
from minorloop_head.procedures.inspected_view import with_finding
from minorloop_head.procedures.inspection import (
    NOT_VISITED,
    ONE_PLACE,
    SEEN_ONCE,
    inspect_wall,
    unvisited,
    views_of,
)
from minorloop_head.procedures.probing import Kept
from minorloop_head.procedures.values import LogEntry
from minorloop_head.twins.camera import Camera
from minorloop_head.twins.pipe import Bore
from minorloop_head.ultrasound.pits import PitDepth
from minorloop_head.vision.defects import Findings
from scripted_inspection import hole, inspected_view

from .fakes import CALIBRATION, MOUNT, PIPE
from .test_rig import Devices, on_bench

PLACE = (-2.2, 20e-3)


@pytest.fixture
def devices():
    """Devices whose camera is in a pipe with a hole."""
    bore = Bore(*PLACE, 1e-3, brightness=0.0, lining=0.08)
    seen = Camera(replace(PIPE, bores=(bore,)), replace(MOUNT, advance=0.0))
    return Devices(seen)


@pytest.fixture
def rig(devices, monkeypatch):
    def at(lens):
        aim = np.array(CALIBRATION.mount_at((0.0, 0.0)).aim((-5.9e-3, -8.1e-3, 20e-3)))
        return np.array([0.8 * aim])

    monkeypatch.setattr(inspection, "views_of", at)
    return on_bench(devices)


def views_by(rig, **kept):
    return [*inspect_wall(rig, **kept).views.values()]


def test_a_hole_is_found_centred_and_measured(rig):
    first, near = views_by(rig)
    assert (first.picture.name, first.picture.verdict) == ("view 1", "good")
    assert [each.kind for each in first.picture.findings] == ["hole or pit"]
    assert first.finding is None
    assert first.image.shape == (480, 640)
    assert (near.finding.kind, near.finding.verdict) == ("hole or pit", "not scanned")
    assert wall_distance((near.finding.phi, near.finding.z), PLACE, 10e-3) < 0.1e-3
    assert near.finding.width == pytest.approx(1e-3, rel=0.12)
    assert np.isnan(near.finding.depth)
    assert np.hypot(*(near.picture.findings[0].pixel - (319.5, 239.5))) < 20.0
    assert [entry.what for entry in rig.log] == ["view 1", "pick", "centre", "hole 1"]
    assert near.steps == tuple(rig.log[1:3])


@pytest.mark.whole
def test_a_hole_that_the_centred_view_does_not_show_is_found_from_another_side(rig, monkeypatch):
    missed = iter([True])
    real = inspection.nearest
    monkeypatch.setattr(
        inspection, "nearest", lambda *given: None if next(missed, False) else real(*given)
    )
    *_, centred, aside = views_by(rig)
    assert (centred.finding, centred.unconfirmed) == (None, None)
    assert aside.picture.name == "hole 1 again"
    assert wall_distance((aside.finding.phi, aside.finding.z), PLACE, 10e-3) < 0.1e-3
    round_about = inspection.views_of(None)
    for other in (*round_about, centred.angles):  # so that it is a view of its own
        assert np.degrees(np.hypot(*np.subtract(aside.angles, other))) > 1.0


def test_what_is_not_centred_and_seen_again_from_the_same_place_only_is_not_confirmed(
    rig, monkeypatch
):
    def off(rig, *_, **__):
        rig.say("centre", "55.6 px from the middle", succeeded=False)

    missed, real = iter([True]), inspection.nearest
    monkeypatch.setattr(inspection, "centre", off)
    monkeypatch.setattr(
        inspection, "nearest", lambda *given: None if next(missed, False) else real(*given)
    )
    *_, aside = views_by(rig)
    assert (aside.picture.name, aside.finding) == ("hole 1 again", None)
    lost = aside.unconfirmed
    assert (lost.kind, lost.seen_in, lost.why) == ("hole or pit", ("view 1",), ONE_PLACE)
    assert lost.evidence == aside.picture.findings[0].evidence
    assert rig.log[-1].outcome == f"{ONE_PLACE}; not confirmed"


@pytest.mark.parametrize(
    ("verdict", "confirmed"), [("measured", True), ("through-hole", True), ("no coupling", False)]
)
def test_echoes_confirm_a_hole_that_was_not_centred(verdict, confirmed):
    class Probed:
        def scanned(self, view):
            return replace(view, probed=PitDepth(verdict, *PLACE))

    said = []
    steps = (LogEntry(0.0, "centre", "55.6 px from the middle", False),)
    view = inspected_view("hole 1 again", seen=(hole(*PLACE, 3.6),), steps=steps)
    rig = SimpleNamespace(say=lambda *words, **_: said.append(words))
    kept = Kept()
    inspection._Visits(rig, kept, Probed())._probe(with_finding(view, 10e-3), ("view 3",))
    (after,) = kept.views.values()
    assert (after.finding is not None) == confirmed
    if not confirmed:
        assert after.unconfirmed.why == f"{ONE_PLACE}: no coupling"
        assert (after.unconfirmed.evidence, after.unconfirmed.seen_in) == (3.6, ("view 3",))


def test_what_is_not_seen_again_is_handed_out_as_not_confirmed(rig, monkeypatch):
    monkeypatch.setattr(inspection, "nearest", lambda *_: None)
    views = views_by(rig)
    assert len(views) == 3
    assert not any(view.finding for view in views)
    lost = views[-1].unconfirmed
    assert [view.unconfirmed for view in views[:-1]] == [None] * 2
    assert (lost.kind, lost.seen_in, lost.why) == ("hole or pit", ("view 1",), "not seen again")
    assert wall_distance((lost.phi, lost.z), PLACE, 10e-3) < 0.1e-3
    assert lost.evidence == views[0].picture.findings[0].evidence
    assert rig.log[-1].outcome == "not seen again; seen in 1 view, not confirmed"
    left = [unvisited(views[:count], 10e-3) for count in (1, 2, 3)]
    assert [[each.why for each in some] for some in left] == [[NOT_VISITED], [SEEN_ONCE], []]
    assert (left[0][0].phi, left[0][0].seen_in) == (lost.phi, ("view 1",))


def test_a_view_that_cannot_be_used_is_taken_once_more_and_a_lost_sensor_ends_it(rig, monkeypatch):
    real, left = inspection.search, iter(range(1))

    def search(rig, frames):
        found = real(rig, frames)
        return Findings((), "frozen") if next(left, None) is not None else found

    def lost():
        raise InstrumentError("the sensor of pan is lost; check it")

    kept, check = Kept(), rig.check_sensors
    monkeypatch.setattr(inspection, "search", search)
    monkeypatch.setattr(rig, "check_sensors", lambda: lost() if kept.views else check())
    with pytest.raises(InstrumentError, match="sensor of pan"):
        inspect_wall(rig, kept=kept)
    ((name, first),) = kept.views.items()
    assert (name, first.picture.verdict) == ("view 1", "good")
    once, then = (entry.outcome for entry in rig.log[:2])
    assert once == "frozen; taken once more"
    assert then.startswith("1 candidate")


def test_a_narrow_picture_needs_more_views():
    wide, narrow = views_of(Pinhole()), views_of(Pinhole(640, 480, 2000.0))
    assert len(wide) == 8
    ring = np.hypot(*narrow.T).round(6)
    half = np.arctan(240 / 2000.0)
    assert np.diff(np.unique(ring)).max() <= 1.5 * half + 1e-6
    assert (ring == ring.max()).sum() * half >= 2 * np.pi * np.sin(ring.max())
