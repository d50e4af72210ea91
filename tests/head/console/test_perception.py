import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop.head.console import depth_work
from minorloop.head.console.camera_protocol import CameraRequest
from minorloop.head.console.perception import Perception
from minorloop.head.console.plant import reading_of
from minorloop.head.console.scan import begin_scan, scanned
from minorloop.head.console.scan_echoes import ScanEchoes
from minorloop.head.console.wall_image import STEP, WallImage
from minorloop.head.procedures.scan import RasterScan
from minorloop.head.reconstruction.depth_map import Patch
from minorloop.head.reconstruction.fusion import fuse
from minorloop.head.ultrasound.pits import PitDepth
from seats import PIT, tip, view


def look(where, *wishes, number=0):
    """A tick of a loop whose sensors tell the truth."""
    pan, tilt, advance, roll = where
    stance = (math.radians(pan), math.radians(tilt), 0.0, 0.0, 1e-3 * advance, math.radians(roll))
    return CameraRequest(
        number=number, t=0.04 * number, where=where, stance=stance, wishes=list(wishes)
    )


def towards(place, share=1.0, where=(0.0, 0.0, 0.0, 0.0)):
    """Where the head looks some way towards phi and z."""
    point = (10e-3 * math.cos(place[0]), 10e-3 * math.sin(place[0]), place[1])
    pan, tilt = np.degrees(view().mount(where).aim(point)) * share
    return (float(pan), float(tilt), *where[2:])


THERE = towards(PIT, 0.8)


@pytest.fixture(scope="module")
def seeing():
    """Eyes that have come to rest near the pit, and have looked for defects."""
    eyes = Perception(tip()[0], view())
    told = [eyes.tick(look(THERE, number=n)) for n in range(40)]
    return eyes, told


def events(told, what):
    return [event for seen in told for event in seen.events if event["what"] == what]


def test_where_the_head_rests_defects_are_looked_for_once(seeing):
    _, told = seeing
    (found,) = events(told, "found")
    assert found["verdict"] == "good"
    pixel = view().eye(THERE).pixel(PIT[:2], *np.radians(THERE[:2]))
    assert math.dist(told[-1].spots[0][:2], pixel) < 4.0


def test_a_pick_takes_what_is_known_near_it_and_follows_it(seeing):
    eyes, told = seeing
    u, v, *_ = told[-1].spots[0]
    eyes.tick(look(THERE, ("pick", [u + 9.0, v - 6.0])))
    moved = towards(PIT, 0.9)
    for share in np.linspace(0.8, 0.9, 6):
        seen = eyes.tick(look(towards(PIT, float(share))))
    assert seen.target[3]
    pixel = view().eye(moved).pixel(PIT[:2], *np.radians(moved[:2]))
    assert math.dist(seen.target[:2], pixel) < 5.0


def test_other_lights_are_not_shown_and_the_target_stays(seeing):
    eyes, told = seeing
    u, v, *_ = told[-1].spots[0]
    eyes.tick(look(THERE, ("pick", [u, v])))
    lit = float(eyes.image.mean())
    seen = [eyes.tick(look(THERE, ("extract", [])))]
    for _ in range(6):
        assert eyes.image.mean() == pytest.approx(lit, rel=0.2)
        seen.append(eyes.tick(look(THERE)))
    assert all(each.target[3] for each in seen)
    (extracted,) = events(seen, "extracted")
    assert extracted["hole"]["diameter"] == pytest.approx(PIT[2], rel=0.2)


@pytest.mark.parametrize("pixel", [(1.0, 1.0), (639.0, 479.0)])
def test_what_cannot_be_done_is_said(seeing, pixel):
    eyes, _ = seeing
    told = [eyes.tick(look(THERE, ("pick", list(pixel)), ("heard", []), ("focus", [9.0])))]
    assert len(events(told, "notice")) == 3


def test_nothing_round_is_not_measured():
    eyes = Perception(tip()[0], view())
    for n in range(30):
        eyes.tick(look(towards((PIT[0] + 2.0, PIT[1]), 0.6), number=n))
    away = towards((PIT[0] + 2.0, PIT[1]), 0.6)
    told = [eyes.tick(look(away, ("pick", [330.0, 200.0])))]
    told += [eyes.tick(look(away, *wish)) for wish in ((("extract", []),), *((),) * 6)]
    assert [event["hole"] for event in events(told, "extracted")] == [None]


def scan_of(where):
    return begin_scan(1, PIT[:2], PIT[2], view(), where)


def test_a_place_beside_the_probe_is_not_reached_and_the_scan_goes_back():
    scan = scan_of((0.0, 0.0, 0.0, 0.0))
    asked, shots = [], 0
    for _ in range(2500):  # the catheter is stuck where it is
        scan, ask = scanned(scan, view(), (0.0, 0.0, 0.0, -120.0), (0.0, 0.0), 0.04)
        asked.append(ask)
        shots += sum(name == "shoot" for name, _ in ask.wishes)
        if scan.stage == "done":
            break
    assert scan.stage == "done"
    assert shots == 0
    assert max(abs(ask.rates[0]) for ask in asked) <= 8.0


def test_the_head_stays_at_a_point_until_its_echoes_are_there():
    where, targets = (1.0, 2.0, 0.0, 0.0), np.radians([(1.0, 2.0), (5.0, 6.0)])
    scan = scan_of(where)
    scan = replace(scan, state=replace(scan.state, stage="points", targets=targets))
    wishes = []
    for _ in range(40):  # 1.6 s: the eyes are late
        scan, ask = scanned(scan, view(), where, where[:2], 0.04)
        wishes += ask.wishes
        assert ask.angles == pytest.approx((1.0, 2.0))
    assert wishes == [("shoot", [pytest.approx(1.0), pytest.approx(2.0)])]
    scan, _ = scanned(replace(scan, heard=True), view(), where, where[:2], 0.04)
    assert (scan.state.point, scan.state.fired, scan.progress) == (1, False, 0.5)


def sounded(flooded):
    """Echoes of a raster over the pit, with the head where it is wanted."""
    where = (0.0, 0.0, 1e3 * PIT[1], math.degrees(PIT[0]))
    probe, known = tip()
    probe.flood(flooded)
    sounding = ScanEchoes(known, 1, PIT[:2], PIT[2])
    place = reading_of(where).place
    for pan, tilt in np.degrees(RasterScan(calibration=known).targets(PIT[:2], place)).tolist():
        here = (pan, tilt, *where[2:])
        probe.stand(look(here).stance)
        sounding.add(probe, here, (math.radians(pan), math.radians(tilt)))
    return list(depth_work.depth(**sounding.job(where)))


def test_the_echoes_of_a_scan_give_depth_map_and_mesh():
    *stages, last = sounded(True)
    assert len(stages) == 2
    told = last["told"]
    assert told["verdict"] == "measured"
    assert told["depth"] == pytest.approx(PIT[3], abs=4 * told["depth_sd"])
    grid = np.array(told["patch"]["depth"], dtype=float)
    assert np.nanmax(grid) == pytest.approx(1e3 * PIT[3], abs=0.05)
    assert abs(np.nanmedian(grid)) < 0.02
    assert last["meshes"]["ply"].startswith(b"ply")
    assert last["meshes"]["glb"].startswith(b"glTF")


def test_no_depth_is_made_up_where_there_is_no_floor():
    patch = Patch.around(*PIT[:2], size=0.2e-3)
    pit = PitDepth("through-hole", *PIT[:2], diameter=PIT[2])
    told = depth_work._told(pit, fuse(pit, None, patch))["patch"]
    assert len(told["through"]) > 5
    assert all(told["depth"][i][j] is None for i, j in told["through"])
    known = [depth for row in told["depth"] for depth in row if depth is not None]
    assert max(known, default=0.0) == 0.0


def test_a_dry_pipe_gives_no_depth_and_says_why():
    *_, last = sounded(False)
    assert last["told"]["depth"] is None
    assert last["told"]["verdict"] not in ("measured", "")


def test_the_pit_is_on_the_map_where_it_is_on_the_wall(seeing):
    eyes, _ = seeing
    for roll in (0.0, 35.0):
        where = towards(PIT, 0.8, (0.0, 0.0, 2.0, roll))
        for _ in range(30):
            eyes.tick(look(where))
        wall = WallImage(view(), 0.1)
        wall.paint(eyes.image, where)
        row, column = round(PIT[1] / STEP - 0.5), round(PIT[0] / (2 * math.pi) * wall.grey.shape[1])
        part = wall.grey[row - 8 : row + 9, column - 8 : column + 9].astype(float)
        darkest = np.unravel_index(part.argmin(), part.shape)
        assert math.dist(darkest, (8, 8)) <= 3
        assert part.min() > 0  # all of it was seen
        assert part.min() < 0.6 * np.median(part)


def test_a_worse_view_does_not_replace_a_better_one(seeing):
    eyes, _ = seeing
    wall = WallImage(view(), 0.1)
    wall.paint(eyes.image, towards(PIT, 0.8, (0.0, 0.0, 2.0, 0.0)))
    before = wall.grey[70:90].copy()
    wall.paint(np.zeros_like(eyes.image), (0.0, 0.0, -15.0, 0.0))
    seen = before > 0
    np.testing.assert_array_equal(wall.grey[70:90][seen], before[seen])


def test_the_window_goes_along_and_stays_on_the_map():
    wall = WallImage(view(), 0.3)
    for advance in (-50.0, 0.0, 80.0, 1e4):
        grey, first, last = wall.window(advance)
        assert grey.shape[0] == round((last - first) / (1e3 * STEP))
        assert first >= 0
        assert last <= 300
    assert len(wall.seen) == 1


def test_beyond_the_end_nothing_is_painted(seeing):
    wall = WallImage(view(), 0.1)
    wall.paint(seeing[0].image, (0.0, 0.0, 500.0, 0.0))
    assert not wall.grey.any()
