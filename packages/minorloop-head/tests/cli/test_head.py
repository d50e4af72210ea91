import base64
import errno
import json
import math
import os
import re
import shutil
import signal
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from minorloop.cli._compilation import COMPILES
from minorloop.cli.run import carry_out_levels
from minorloop.errors import (
    InstrumentError,
    OutputError,
    SafetyError,
    StoreError,
)
from minorloop.lab.actuator import Channel
from minorloop.lab.plan import Plan
from minorloop.lab.records import Record
from minorloop.lab.store import Setup, Store
from minorloop_head.cli import _water
from minorloop_head.cli._camera_angles import kept_view, seen_head, swept_view
from minorloop_head.cli._inspection_report import _map_caption, wall_words
from minorloop_head.cli._journal import Journal, outcomes
from minorloop_head.cli._sweep_journal import burst_line
from minorloop_head.control.head import head_control
from minorloop_head.control.limits import WireLimits
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import (
    CheckedAxis,
    HeadFile,
    IdentifiedWires,
    read_head,
    save_head,
)
from minorloop_head.procedures.identify import HeadMeasurement
from minorloop_head.procedures.rig import InspectionRig, LogEntry
from minorloop_head.reconstruction.depth_map import WaterLine
from minorloop_head.sources import Frame
from minorloop_head.twins import surroundings
from minorloop_head.twins.head import Head
from minorloop_head.ultrasound.echoes import Burst
from minorloop_head.ultrasound.wall_echoes import SweptBurst
from wires import identified, made_up

VIEW = HeadCalibration(lens=Pinhole(), leds=np.zeros((1, 3)))
LATER = (datetime.now(UTC) + timedelta(hours=12)).replace(microsecond=0)
"""After every identification of a test."""
IDENTIFY = "head identify --actuator twin:head --noise 0.05 --bands 2 --hold 12 --store runs"


class Swept:
    """A head that counts its sweeps."""

    count = 0

    def survey(self, highest):
        self.count += 1
        return HeadCalibration(lens=Pinhole(), leds=np.zeros((3, 3)), lever=highest * 0.02)


def test_a_sweep_is_carried_out_once_and_not_for_runs_that_began_without(tmp_path, capsys):
    head = Swept()
    assert swept_view(tmp_path, head, 0.3, "H-07").lever == pytest.approx(0.006)
    assert "turning both axes slowly up and down for 2.4 min" in capsys.readouterr().err
    assert swept_view(tmp_path, head, 0.4, "H-07").lever == pytest.approx(0.006)
    assert head.count == 1
    with pytest.raises(StoreError, match=r"is of head 'H-07', and the head here is 'H-08'; give"):
        kept_view(tmp_path, "H-08")
    (tmp_path / "camera.json").write_text('{"lever": 1}')
    with pytest.raises(StoreError, match=r"is no calibration of a camera .* begin anew"):
        swept_view(tmp_path, head, 0.4, "H-07")
    (tmp_path / "camera.json").rename(tmp_path / "pan-loop.sqlite")
    assert swept_view(tmp_path, head, 0.4, "H-07") is None
    assert "the calibration of the camera is not corrected: the runs" in capsys.readouterr().err


def test_a_head_is_identified_once_and_driven_by_its_file(run):
    status, out, error = run(f"{IDENTIFY} --head head.json --specimen 1000 --json")
    assert (status, error.count("error")) == (1, 0)  # two bands are too few for a good model
    said = [line for line in error.splitlines() if "holds" in line]
    assert said[0].startswith("50 holds in 8 runs: at most 10 min of the head's time, less where")
    assert said[1] == "pan-loop, run 1 of 8: 7 holds, of 50 left in all"
    assert said[8].startswith("tilt-check, run 8 of 8: 5 holds, of 5 left in all, in about ")
    printed = json.loads(out)
    assert printed["serial"] == "twin-head-1000"
    assert set(printed["check"]) == {"pan", "tilt"}
    assert "of its range; do not trust it: give longer holds, or more bands" in printed["advice"][0]
    Path("angles.csv").write_text("pan [deg],tilt [deg]\n30,25\n")
    drive = "head drive angles.csv --head head.json"
    status, out, _ = run(
        f"{drive} --actuator twin:head --specimen 1000 --save reached.csv --hold 14 --json"
    )
    assert status == 0
    assert json.loads(out)["rms_deg"] < 0.2
    assert Path("reached.csv").read_text().startswith("time [s],wanted pan [deg],pan [deg],pan [A]")
    status, _, error = run(f"{drive} --actuator twin:head --specimen 3")
    assert status == 2
    assert "is of head 'twin-head-1000', and the head here is 'twin-head-3'" in error
    status, _, error = run(f"{IDENTIFY} --head head.json --specimen 1000")
    assert status == 2
    assert "head.json has wires already; --force replaces them and keeps the calibration" in error
    assert "another name" not in error
    later = replace(read_head("head.json"), calibration=VIEW, calibrated=LATER)
    save_head(later, "head.json", force=True)
    status, _, error = run(f"{IDENTIFY} --head head.json --specimen 1000 --force")
    assert status == 2
    assert f"before its calibration on {LATER:%Y-%m-%d %H:%M} UTC; identify them again" in error
    status, _, error = run("console --port 0 --head head.json")
    assert status == 2
    assert "is of head 'twin-head-1000'" in error


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (f"{IDENTIFY} --head head.json --bands 1", "bands"),
        ("head identify --actuator twin:ipmc --store runs --head head.json", "two currents in A"),
        (
            "head identify --actuator twin:head --camera camera:0 --store runs --head head.json",
            "no calibration of the camera; calibrate it with minorloop head calibrate first",
        ),
        (f"{IDENTIFY} --head head.json --serial H-07", "--serial is 'H-07'"),
        (f"{IDENTIFY} --head model.json", "not a valid file of a head"),
        ("head drive targets.csv --head none.json --actuator twin:head", "there is no file"),
        (
            "head drive targets.csv --head none.json --actuator twin:head --pan tilt",
            "--pan and --tilt are both 'tilt'",
        ),
        (
            "head identify --actuator twin:head --store other.json --head new.json",
            "--store is other.json, a file; give the name of a folder",
        ),
        (f"{IDENTIFY} --head other.json", "other.json is of head 'H-07'"),
        (
            "head identify --actuator twin:none --store runs --head other.json --serial H-08",
            "other.json is of head 'H-07', and the head here is 'H-08'",
        ),
    ],
)
def test_refuses_in_one_sentence(run, command, sentence):
    save_head(HeadFile(serial="H-07"), "other.json")
    status, out, error = run(command)
    assert (status, out) == (2, "")
    assert sentence in error
    assert error.count("\n") == 1
    assert read_head("other.json").identified is None


def test_head_drive_refuses_what_cannot_be_reached_and_warns_of_what_was_not(run):
    wires = IdentifiedWires(
        on=datetime(2026, 1, 1, tzinfo=UTC),
        wires=(made_up(), made_up()),
        coupling=np.eye(2),
        limits=WireLimits(),
        highest=0.2,
        stores={},
    )
    save_head(HeadFile(serial="twin-head-nominal", identified=wires), "head.json")
    Path("far.csv").write_text("pan [deg],tilt [deg]\n200,30\n")
    drive = "--head head.json --actuator twin:head --hold 20"
    status, out, error = run(f"head drive far.csv {drive}")
    assert (status, out) == (2, "")
    assert "pan of target 1 is 200 degrees, and the wires reach 0.0 to 58.2 degrees" in error
    assert "do not trust it" not in error
    doubted = replace(wires, check=(CheckedAxis(0.1, 0.2), CheckedAxis(9.0, 15.0)))
    save_head(HeadFile(serial="twin-head-nominal", identified=doubted), "doubted.json")
    _, _, error = run(f"head drive far.csv {drive.replace('head.json', 'doubted.json')}")
    assert error.startswith("! tilt: the model is off by 9 degrees rms in the check")
    Path("weak.csv").write_text("pan [deg],tilt [deg]\n50,0\n")
    status, out, error = run(f"head drive weak.csv {drive} --json")
    assert status == 1
    assert [f"warning: {each}" for each in json.loads(out)["unreachable"]] == error.splitlines()
    assert "pan did not reach target 1" in error


@pytest.fixture
def targets(run, monkeypatch):
    """The file of a head that is identified, and a table of targets."""
    control = head_control("observer", (identified().model,) * 2)
    monkeypatch.setattr(HeadFile, "control", lambda self, **_: control)
    save_head(HeadFile(serial="twin-head-nominal"), "head.json")
    Path("angles.csv").write_text("pan [deg],tilt [deg]\n30,25\n")


DRIVE = "head drive angles.csv --head head.json --actuator twin:head"


@pytest.mark.usefixtures("targets")
def test_head_drive_names_faults_and_has_status_1_if_a_wire_cooled(run, monkeypatch):
    drive = f"{DRIVE} --hold 9"
    exchange = Head.exchange

    def lost(first, end):
        count = iter(range(1000))
        gone = set(range(first, end))
        return lambda head, u: exchange(head, u) * (np.nan if next(count) in gone else 1.0)

    monkeypatch.setattr(Head, "exchange", lost(100, 103))
    status, out, error = run(f"{drive} --json")
    assert status == 0
    (fault,) = json.loads(out)["faults"]
    assert (fault["axis"], fault["times"], fault["cooled"]) == ("pan and tilt", 1, False)
    assert (fault["began_s"], fault["lasted_s"]) == pytest.approx((4.0, 0.12))
    assert error.startswith("warning: pan and tilt, from 4.00 s for 0.12 s: there was no reading")
    monkeypatch.setattr(Head, "exchange", lost(60, 80))
    status, out, error = run(f"{drive} --json")
    assert status == 1
    assert json.loads(out)["faults"][0]["cooled"]
    assert "the sensor is lost; the wire cools" in error
    monkeypatch.setattr(Head, "exchange", lost(0, 1000))
    status, out, error = run(drive)
    assert status == 1
    assert "no reading was used, so that no error is known" in out
    assert "nan" not in out
    assert "tilt did not reach target 1, 25 degrees: there was no reading" in error


@pytest.mark.parametrize(
    ("table", "head", "sentence"),
    [
        (
            "empty.csv",
            "head.json",
            "column 'pan [deg]' of empty.csv is empty in row 3; give a number",
        ),
        ("rad.csv", "head.json", "is in rad and a head is driven in deg; give the column in deg"),
        ("head.json", "head.json", "head.json is a head file, not a table; give a CSV"),
        ("good.csv", "good.csv", "good.csv is not a valid file of a head: it is a table"),
        ("good.csv", "none.json", "no file none.json; give one that head identify or head cal"),
    ],
)
def test_head_drive_says_what_a_file_is_and_what_is_needed(run, table, head, sentence):
    save_head(HeadFile(serial="H-07"), "head.json")
    Path("model.json").write_text('{"format": "minorloop model", "version": 1}')
    Path("head.toml").write_text("tick = 0.04\n")
    Path("good.csv").write_text("pan [deg],tilt [deg]\n30,25\n")
    Path("empty.csv").write_text("pan [deg],tilt [deg]\n30,25\n,25\n")
    Path("rad.csv").write_text("pan [rad],tilt [deg]\n0.3,25\n")
    status, out, error = run(f"head drive {table} --head {head} --actuator twin:head")
    assert (status, out) == (2, "")
    assert sentence in error
    assert "--time" not in error
    assert "model" not in error or head == "model.json"
    assert error.count("\n") == 1


@pytest.mark.usefixtures("targets")
def test_a_head_of_another_file_or_folder_is_refused_before_it_waits(run, monkeypatch):
    waited = "minorloop_head.procedures.seen_angles.SeenHead"
    monkeypatch.setattr(waited, lambda *_, **__: pytest.fail("it waited"))
    save_head(HeadFile(serial="H-07"), "head.json", force=True)
    said = "head.json is of head 'H-07', and the head here is 'twin-head-nominal'"
    status, _, error = run("head drive angles.csv --head head.json --actuator twin:pipe")
    assert (status, said in error) == (2, True)
    status, _, error = run(
        "head drive angles.csv --head head.json --actuator twin:pipe --camera camera:0"
    )
    assert (status, "twin:pipe has a camera of its own; leave --camera out" in error) == (2, True)
    identify = "head identify --actuator twin:pipe --specimen 3 --store runs --head new.json"
    status, _, error = run(f"{identify} --noise 0.1")
    assert (status, "the angles are those of pictures; leave it out" in error) == (2, True)
    status, _, error = run(identify.replace("new", "head"))
    assert (status, "and the head here is 'twin-head-3'" in error) == (2, True)
    Path("runs").mkdir()
    Path("runs/camera.json").write_text(json.dumps({"serial": "twin-head-4", **VIEW.to_dict()}))
    status, _, error = run(identify)
    assert (status, "runs/camera.json is of head 'twin-head-4'" in error) == (2, True)


@pytest.mark.usefixtures("targets")
def test_head_drive_checks_its_arguments_before_it_opens_a_device(run, monkeypatch):
    monkeypatch.setattr("minorloop.cli._common.connected", lambda *_, **__: pytest.fail("opened"))
    Path("far.csv").write_text("pan [deg],tilt [deg]\n80,25\n")
    drive = "--head head.json --actuator bench:head.toml"
    for hold in ("0.01", "1e9", "0", "-3"):
        status, _, error = run(f"head drive angles.csv {drive} --hold {hold}")
        assert status == 2
        assert error.endswith(f"hold is {float(hold)} s; give 0.04 to 3600 s\n")
    status, _, error = run(f"head drive far.csv {drive}")
    assert (status, "pan of target 1 is 80 degrees" in error) == (2, True)


@pytest.mark.usefixtures("targets")
@pytest.mark.parametrize(
    ("ends", "status"), [(KeyboardInterrupt(), 130), (InstrumentError("the board is silent"), 2)]
)
def test_head_drive_keeps_and_shows_what_it_measured_until_an_error_or_a_signal(
    run, monkeypatch, ends, status
):
    Path("angles.csv").write_text("pan [deg],tilt [deg]\n30,25\n10,10\n")
    drive = f"{DRIVE} --hold 2"
    exchange, count = Head.exchange, iter(range(1000))

    def failing(head, u):
        if (step := next(count) % 77) == 76:
            raise ends
        return exchange(head, u) * (np.nan if step > 70 else 1.0)

    monkeypatch.setattr(Head, "exchange", failing)
    found, out, error = run(f"{drive} --save reached.csv")
    assert found == status
    assert "degrees, means of the last fifth of each hold, or of the drive in it" in out
    assert ["30.00", "25.00"] in [line.split()[1:4:2] for line in out.splitlines()]
    said = error.splitlines()
    assert said[0] == (
        "the drive ended after 3.0 s, and what was measured is kept in reached.csv; the head has "
        "confirmed that it is safe"
    )
    assert said[1].startswith("warning: pan and tilt, from 2.84 s to the end: the sensor is lost")
    assert said[2] in ("interrupted", "error: the board is silent")
    kept = np.genfromtxt("reached.csv", delimiter=",", names=True)
    assert kept["time_s"].tolist() == pytest.approx((0.04 * np.arange(1, 76)).tolist())
    assert kept["wanted_pan_deg"].tolist() == [30.0] * 50 + [10.0] * 25
    assert np.isfinite(kept["pan_deg"][:70]).all()
    found, out, _ = run(f"{drive} --json")
    shown = json.loads(out)
    assert (found, set(shown)) == (status, {"error", "unfinished"})
    assert shown["unfinished"]["targets_deg"] == [[30.0, 25.0], [10.0, 10.0]]
    assert [each["axis"] for each in shown["unfinished"]["faults"]] == ["pan and tilt"]


@pytest.mark.usefixtures("targets")
def test_an_unfinished_drive_does_not_call_a_head_safe_that_did_not_confirm_it(run, monkeypatch):
    def silent(head):
        raise SafetyError("the board did not confirm")

    monkeypatch.setattr(Head, "safe", silent)
    status, _, error = run(f"{DRIVE} --hold 2")
    assert status == 3
    assert error.splitlines() == [
        "the drive ended after 2.0 s, and nothing is kept without --save",
        "error: the board did not confirm",
    ]


@pytest.mark.parametrize("sensors", [(), (Channel("pan", "deg"), Channel("tilt", "deg"))])
def test_a_camera_beside_sensors_says_that_they_are_not_used(capsys, monkeypatch, sensors):
    @contextmanager
    def connected(address):
        yield SimpleNamespace(outputs=sensors)

    camera = SimpleNamespace(frame=None, close=lambda: None)
    monkeypatch.setattr("minorloop.cli._common.connected", connected)
    monkeypatch.setattr("minorloop_head.vision.video.LiveCamera", lambda *_: camera)
    monkeypatch.setattr("minorloop_head.procedures.seen_angles.SeenHead", lambda *_, **__: None)
    with seen_head("bench:head.toml", "camera:0", VIEW, specimen=None, seed=0):
        said = capsys.readouterr().err
    assert ("the sensors of the actuator, pan [deg], tilt [deg], are not used" in said) == bool(
        sensors
    )


SMALL = "--squares 7x5 --side 4"
CALIBRATE = f"head calibrate {SMALL} --head head.json --serial H-07"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Folders of pictures from a small camera, and what they should give."""
    from benchmarks.target_pictures import CalibrationScene
    from minorloop_head.twins.camera import LENS
    from minorloop_head.vision.targets import Target

    folder = tmp_path_factory.mktemp("pictures")
    drawn = CalibrationScene(Target("charuco", 7, 5, 4e-3), 1000, LENS.scaled(0.5))
    drawn.lens(folder / "lens", 12)
    rows = drawn.mount(folder / "mount", 3)
    drawn.leds(folder / "leds", 7)
    lines = "".join(f"{name},{pan},{tilt}\n" for name, pan, tilt in rows)
    (folder / "angles.csv").write_text(f"picture,pan [deg],tilt [deg]\n{lines}")
    (folder / "radians.csv").write_text(f"picture,pan [rad],tilt [rad]\n{lines}")
    return folder, drawn.truth


def test_a_head_is_calibrated_from_pictures(run, scene):
    folder, truth = scene
    (folder / "lens" / "junk.png").write_text("no picture")
    first = f"{CALIBRATE} --pictures {folder}/lens --mount {folder}/mount --on-axis --json"
    status, out, error = run(f"{first} --leds 0,2.5,0;-2.2,-1.2,0 --report report.html")
    assert (status, error) == (0, "")
    printed = json.loads(out)["measured"]
    assert json.loads(out)["left_out"] == {"lens/junk.png": "it cannot be read as an image"}
    assert json.loads(out)["rms_angles_deg"] < 0.2
    true = {
        "focal length": truth.lens.focal,
        "principal point u": truth.lens.centre[0],
        "principal point v": truth.lens.centre[1],
        "pan where straight": truth.straight[0],
        "tilt where level": truth.straight[1],
        "camera roll": truth.camera_roll,
        "lever": 1e3 * truth.mount.lever,
        "roll of the base": np.degrees(truth.mount.roll),
        "pivot right of the axis": 1e3 * truth.mount.offset[0],
    }
    for name, value in true.items():
        each = printed[name]
        assert abs(each["value"] - value) < 3.5 * each["sd"], name
        assert each["unit"] != "deg" or abs(each["value"] - value) < 0.4, name
    off = np.degrees(printed["principal point u"]["sd"] / truth.lens.focal)
    assert printed["pan where straight"]["sd"] > 0.9 * off  # a direction is as vague as its pixel
    report = Path("report.html").read_text()
    assert "ninths of the image" in report
    known = read_head("head.json")
    assert len(known.measured) == len(printed)
    assert known.calibration.lever == pytest.approx(1e-3 * printed["lever"]["value"])
    # Another part of it later: the rest is kept.
    status, out, _ = run(f"{CALIBRATE} --led-pictures {folder}/leds --force --radius 12.5")
    assert status == 0
    assert "LED 3 x" in out
    after = read_head("head.json")
    assert after.calibration.lens == known.calibration.lens
    assert after.calibration.radius == 12.5e-3
    assert np.abs(after.calibration.leds - truth.leds)[:, :2].max() < 0.4e-3
    status, _, _ = run(f"{CALIBRATE} --leds 0,2.5,0 --force")
    assert status == 0
    assert len(read_head("head.json").measured) == len(printed)  # LEDs were entered, not measured


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--mount mount --angles radians.csv", "column 'pan [rad]' of"),
        ("--mount lens", "the name of 00.png has no angles; call it such as pan12.5_tilt-3.png"),
        ("--mount lens --angles angles.csv", "has no row for 00.png"),
        ("--pictures few", "few: 2 pictures with a target; give 8 or more; 1 is left out: "),
        ("--pictures sizes", "8 by 8 pixels"),
        ("--pictures lens --squares 6x6", "show not a charuco of 6 by 6 squares but another"),
        ("--pictures none", "there is no folder"),
    ],
)
def test_bad_pictures_are_refused_in_one_sentence(refused, scene, options, sentence):
    import cv2

    folder, _ = scene
    for name in ("few", "sizes"):
        Path(name).mkdir()
        for number in ("00", "01"):
            shutil.copy(folder / "lens" / f"{number}.png", name)
    cv2.imwrite("few/dark.png", np.zeros((240, 320), np.uint8))
    cv2.imwrite("sizes/small.png", np.zeros((8, 8), np.uint8))
    for each in ("lens", "mount", "angles.csv", "radians.csv"):
        Path(each).symlink_to(folder / each)
    save_head(HeadFile(serial="H-07", calibration=HALF, calibrated=LATER), "head.json")
    assert sentence in refused(f"{CALIBRATE} {options} --force")


HALF = replace(VIEW, lens=Pinhole(320, 240, 260.0, (159.5, 119.5)))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--leds 1,2,3", "head.json exists already"),
        ("--leds 1,2,3 --serial H-08 --force", "is of head 'H-07', and the head here is 'H-08'"),
        ("--leds 1,2 --force", "give x,y,z in mm for each LED"),
        ("--leds 1,2,300 --force", "0.2 to 50 mm from the lens"),
        ("--force", "there is nothing to calibrate"),
        ("--leds 1,2,3 --head new.json", "the lens is not calibrated; give its pictures"),
        ("--leds 1,2,3 --angles a.csv --force", "those of the pictures of --mount"),
        ("--leds 1,2,3 --force --radius 0", "--radius is 0.0; give 0.1 to 1000 mm"),
        ("--leds 1,2,3 --squares 9", "--squares is '9'; give columns and rows such as 9x7"),
        ("--print-target target.doc", "let it end in .pdf, .svg, .png"),
    ],
)
def test_calibrate_refuses_in_one_sentence(refused, options, sentence):
    save_head(HeadFile(serial="H-07", calibration=VIEW, calibrated=LATER), "head.json")
    before = Path("head.json").read_bytes()
    assert sentence in refused(f"head calibrate --head head.json --serial H-07 {options}")
    assert Path("head.json").read_bytes() == before


def test_wires_that_are_older_than_a_calibration_are_named(run):
    wires = IdentifiedWires(
        on=datetime(2026, 1, 1, tzinfo=UTC),
        wires=(made_up(3), made_up(4)),
        coupling=np.eye(2),
        limits=WireLimits(),
        highest=0.4,
        stores={},
    )
    old = HeadFile(serial="H-07", calibration=VIEW, calibrated=LATER, identified=wires)
    save_head(replace(old, calibrated=wires.on), "head.json")
    status, out, _ = run("head calibrate --leds 1,2,3;4,5,6 --head head.json --force")
    assert status == 0
    assert "identify them again" in out
    assert read_head("head.json").calibration.leds.shape == (2, 3)


def test_a_printed_target_has_its_size(run):
    import cv2

    from minorloop_head.vision.targets import SeenTarget, Target

    status, out, _ = run(f"head calibrate --print-target t.png {SMALL}")
    assert (status, "print it at 100 %" in out) == (0, True)
    image = cv2.imread("t.png", cv2.IMREAD_GRAYSCALE)
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    seen = Target("charuco", 7, 5, 4e-3).find(small, "t.png")
    assert isinstance(seen, SeenTarget)
    dots = 300 / 25.4e-3  # in a metre
    sides = np.abs(np.diff(seen.pixels.reshape(4, 6, 2), axis=1)[..., 0]) / dots
    assert np.abs(sides - 4e-3).max() < 0.1e-3


class Still:
    """A camera whose picture is grey; it counts how often it was asked."""

    def __init__(self, address, patience):
        self.closed, self.exposes = False, address == "camera:1"

    def frame(self):
        return Frame(0.0, np.full((4, 6), 90, np.uint8))

    def close(self):
        self.closed = True


def test_pictures_are_named_by_the_angles_of_the_joints(answer, monkeypatch):
    monkeypatch.setattr("minorloop_head.vision.video.LiveCamera", Still)
    take = "head photograph --camera camera:0"
    shown = answer(f"{take} --out mount --actuator twin:head --steps 2 --hold 20")
    assert shown["pictures"] == 4
    names = sorted(path.name for path in Path("mount").iterdir())
    angles = [tuple(map(float, re.search("pan(.*)_tilt(.*).png", name).groups())) for name in names]
    assert angles[0][0] < 10 < 20 < angles[3][0]
    assert angles[1][1] > angles[0][1] + 10


def test_pictures_are_taken_by_hand(run, monkeypatch):
    monkeypatch.setattr("minorloop_head.vision.video.LiveCamera", Still)
    take = "head photograph --camera camera:0"
    status, _, error = run(f"{take} --out lens --count 3 --every 0")
    assert (status, error.count("hold the target")) == (0, 3)
    assert sorted(path.name for path in Path("lens").iterdir()) == ["00.png", "01.png", "02.png"]
    for options, sentence in (
        ("--out lens", "lens"),
        ("--out new --steps 1", "--steps is 1; give 2 to 20"),
        ("--out new --exposure 0", "--exposure is 0; give 0.01 to 1000 ms"),
        ("--out new1 --exposure 2", "camera:0 does not let its exposure be set from here"),
        ("--out new2 --actuator twin:head --highest 9", "beyond the limits"),
        ("--out new3 --actuator twin:ipmc", "two currents in A"),
    ):
        status, _, error = run(f"{take} {options}")
        assert (status, sentence in error, error.count("\n")) == (2, True, 1), error


def test_a_calibration_without_leds_says_what_will_refuse_it():
    from minorloop_head.procedures.calibrate import calibrated_head

    lens = SimpleNamespace(lens=Pinhole(), measured=())
    head, advice = calibrated_head(HeadFile(serial="H-07"), lens=lens)
    assert len(head.calibration.leds) == 1
    assert "give the places of all 3 with --leds" in advice[0]
    advice = calibrated_head(HeadFile(serial="H-07"), lens=lens, leds=np.full((1, 3), 1e-3))[1]
    assert "has 1 LED, and the console and head inspect switch 3" in advice[0]


INSPECT = "head inspect --actuator bench:head.toml --camera camera:0 --head head.json --out found"


@pytest.fixture
def inspected(monkeypatch):
    """An inspection that finds a hole, then calls what a test gives, and the state of the head."""
    from minorloop_head.procedures import inspection, rig
    from minorloop_head.procedures.pictures import InspectedPicture, PictureFinding
    from minorloop_head.reconstruction.findings import outlined

    save_head(HeadFile(serial="H-07"), "head.json")
    state = SimpleNamespace(
        safe=False, travels=False, then=lambda: None, first=[], nothing=False,
        calibration=HeadCalibration(
            lens=Pinhole(320, 240, 200.0, (159.5, 119.5)), leds=np.zeros((3, 3))
        ),
    )  # fmt: skip

    def views(rig, advances, done, probing):
        yield from state.first
        if state.nothing:
            return
        state.told(rig_module.LogEntry(1.0, "pick", "phi -80 deg"))
        state.told(rig_module.LogEntry(1.0, "centre", "1.0 px from the middle"))
        state.told(rig_module.LogEntry(1.0, "hole 1", "1.02 mm wide"))
        square = 100.0 + np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]])
        shown = PictureFinding(
            kind="hole or pit", phi=-1.4, z=20e-3, width=1e-3, length=1e-3, evidence=5.0,
            outline=square,
        )  # fmt: skip
        yield inspection.InspectedView(
            picture=InspectedPicture(name="hole 1", t=1.0, verdict="good", findings=(shown,)),
            image=np.full((240, 320), 90, np.uint8),
            angles=(0.1, 0.2),
            joints=(0.6, 0.7),
            place=(0.0, 0.0),
            finding=outlined(-1.4, 20e-3, 1e-3, "not scanned", radius=10e-3),
            evidence=5.0,
            course=np.array([[-1.4, 20e-3]]),
        )
        state.then()

    @contextmanager
    def opened(actuator, camera, head, told):
        state.told = told
        try:
            yield state
        finally:
            state.safe = True

    rig_module = rig
    monkeypatch.setattr(rig, "rig_at", opened)
    monkeypatch.setattr(inspection, "inspect_wall", views)
    return state


def rewrite(lines):
    """Write the journal anew, as one that was cut off has it."""
    Path("found/journal.jsonl").write_text("".join(f"{json.dumps(one)}\n" for one in lines))


def journal():
    return [json.loads(line) for line in Path("found/journal.jsonl").read_text().splitlines()]


def test_an_inspection_without_an_operator_writes_findings_pictures_and_a_report(run, inspected):
    def look():  # while the inspection goes on
        kinds.extend(line["what"] for line in journal())
        tables.append(Path("found/findings.csv").read_text())

    kinds, tables, inspected.then = [], [], look
    status, out, shown = run(f"{INSPECT} --json")
    assert (status, inspected.safe) == (0, True)
    assert shown.splitlines() == ["pick: phi -80 deg", "hole 1: 1.02 mm wide"]
    assert kinds == ["begin", *["step"] * 3, "view"]
    assert tables[0].splitlines()[1].startswith("1,hole or pit,not scanned,-80.2141")
    printed = json.loads(out)
    assert printed == json.loads(Path("found/findings.json").read_text())
    assert (printed["head"], printed["ended"], printed["safe"]) == ("H-07", "finished", True)
    (row,) = printed["findings"]
    assert (row["z [mm]"], row["depth [mm]"], row["picture"]) == (20.0, None, "hole 1.png")
    names = sorted(path.name for path in Path("found/pictures").iterdir())
    assert names == ["hole 1 marked.jpg", "hole 1.png"]
    page = Path("found/report.html").read_text()
    assert "1 finding in 1 view; finished; no depth without a probe; the head is safe" in page
    assert (journal()[-1]["what"], journal()[-1]["why"]) == ("end", "finished")
    assert "is not empty" in run(INSPECT)[2]


def test_the_pictures_of_an_inspection_are_searched_again_by_its_journal(
    run, inspected, monkeypatch
):
    from minorloop_head.procedures import pictures

    asked = []

    def search(image, view, pose, name, t):
        asked.append((name, pose))
        return pictures.InspectedPicture(name=name, t=t, verdict="good")

    run(INSPECT)
    view = HeadCalibration(lens=Pinhole(320, 240, 200.0, (159.5, 119.5)), leds=np.zeros((3, 3)))
    head = HeadFile(serial="H-07", calibration=view, calibrated=datetime(2026, 1, 1, tzinfo=UTC))
    save_head(head, "head.json", force=True)
    monkeypatch.setattr(pictures, "inspect_picture", search)
    # The last line was cut when the program was killed.
    lines = Path("found/journal.jsonl").read_text().splitlines(keepends=True)
    Path("found/journal.jsonl").write_text("".join(lines[:-1]) + lines[-1][:20])
    again = "inspect found/pictures --poses found/journal.jsonl"
    for known, angle in (
        ("--head head.json", 0.6 - view.straight[0]),
        ("--lens 200 --radius 10", 0.1),
    ):
        asked.clear()
        status, _, error = run(f"{again} {known}")
        assert status == 0, error
        ((name, pose),) = asked
        assert name == "hole 1.png"
        assert pose.pan == pytest.approx(angle, abs=1e-5)
    for text in ("nonsense", '{"what": "begin"}\n', '{"what": "view", "picture": "a"}\n'):
        Path("bad.jsonl").write_text(text)
        status, _, error = run("inspect found/pictures --poses bad.jsonl --head head.json")
        assert (status, "the journal of an inspection" in error) == (2, True), error


@pytest.fixture
def scripted(monkeypatch):
    """An inspection with four views, three visits and a crack, and the names of what it took."""
    from minorloop_head.procedures import inspection, rig
    from minorloop_head.vision.cracks import TracedCrack
    from minorloop_head.vision.defects import Findings, Hole

    view = HeadCalibration(lens=Pinhole(320, 240, 200.0, (159.5, 119.5)), leds=np.zeros((3, 3)))
    head = HeadFile(serial="H-07", calibration=view, calibrated=datetime(2026, 1, 1, tzinfo=UTC))
    save_head(head, "head.json")
    circle = np.linspace(0.0, 6.0, 9)

    def hole(phi, z, evidence):
        rim = np.stack([phi + 0.05 * np.cos(circle), z + 0.5e-3 * np.sin(circle)], axis=1)
        return Hole(np.array([phi, z]), 1e-3 / 3, evidence, "dark", rim)

    course = np.stack([np.linspace(-0.4, 0.1, 9), np.full(9, 22e-3)], axis=1)
    crack = TracedCrack(course, np.linspace(0.1e-3, 0.3e-3, 9), 5e-3, 0.3)
    sure, lost = hole(-1.4, 20e-3, 5.1), hole(1.1, 24e-3, 3.3)
    shown = {"view 1": [sure], "view 3": [hole(-1.401, 20.02e-3, 4.2), lost], "hole 1": [sure]}
    taken, traced = [], {"view 2": (crack,), "crack 1": (crack,)}

    def seen(rig, name):
        taken.append(name)
        found = Findings(tuple(shown.get(name, ())), "good")
        image = np.full((240, 320), 40 + len(name), np.uint8)
        camera = view.camera_at((0.0, 0.0))
        return inspection._Seen(
            name, 1.0, image, found, camera, (0.1, 0.2), (0.61234, 0.7), (1e-3, 0.0)
        )

    @contextmanager
    def opened(actuator, camera, head, told):
        def say(what, outcome, *, succeeded=True):
            log.append(rig_module.LogEntry(0.0, what, outcome, succeeded))
            told(log[-1])

        log = []
        yield SimpleNamespace(
            calibration=view, travels=True, place=(0.0, 0.0), say=say, log=log,
            compute=lambda work: work(), check_sensors=lambda: None, has_tool=True,
            reading=lambda request: None,
        )  # fmt: skip

    rig_module = rig
    monkeypatch.setattr(rig, "rig_at", opened)
    for name in ("_go", "look", "pick", "centre"):
        monkeypatch.setattr(inspection, name, lambda *_, **__: None)
    monkeypatch.setattr(inspection, "_seen", seen)
    monkeypatch.setattr(inspection, "views_of", lambda _: np.zeros((2, 2)))
    monkeypatch.setattr(inspection, "traces_of", lambda *_: traced.get(taken[-1], ()))
    monkeypatch.setattr(inspection, "traced_again", lambda *_: traced.get(taken[-1], ()))
    return taken


def test_an_inspection_that_a_power_cut_ended_is_resumed_from_its_journal(run, scripted):
    def content():
        found = json.loads(Path("found/findings.json").read_text())
        return {k: value for k, value in found.items() if k not in ("seconds", "resumed", "log")}

    command = f"{INSPECT} --advances 0,5"
    assert run(command)[0] == 0
    whole, every = content(), list(scripted)
    assert every[4:] == ["hole 1", "hole 2", "hole 2 again", "crack 1"]
    kinds = [row["kind"] for row in whole["findings"]]
    assert (kinds, len(whole["unconfirmed"])) == (["hole or pit", "crack"], 1)
    lines = Path("found/journal.jsonl").read_text().splitlines(keepends=True)
    views = [number for number, line in enumerate(lines) if '"what": "view"' in line]
    for left, torn in ((0, 9), (3, 200), (6, 0), (8, 5)):
        end = views[left] if left < len(views) else len(lines) - 1
        # The cut is in the next line; what it would have ended with ends in a brace, too.
        piece = lines[end][:torn] if torn < 100 else lines[end][: lines[end].index("}") + 1]
        Path("found/journal.jsonl").write_text("".join(lines[:end]) + piece)
        for name in every[left:]:  # the picture is written before its line
            Path(f"found/pictures/{name}.png").write_bytes(b"torn")
        scripted.clear()
        status, _, error = run(f"{command} --resume")
        assert (status, scripted) == (0, every[left:]), error
        assert content() == whole
        (resumed,) = json.loads(Path("found/findings.json").read_text())["resumed"]
        assert f"cut off, and resumed at</td><td>{resumed}" in Path("found/report.html").read_text()
        again = journal()
        assert [each["what"] for each in again if each["what"] in ("begin", "resume", "end")] == [
            "begin", "resume", "end",
        ]  # fmt: skip
        assert all(each["t"] <= later["t"] for each, later in pairwise(again))
    for options, sentence in (
        ("--advances 0,5 --resume", "is finished"),
        ("--advances 0,4 --resume", "is finished"),
        ("--advances 0,5", "is not empty"),
    ):
        status, _, error = run(f"{INSPECT} {options}")
        assert (status, sentence in error) == (2, True), error
    Path("found/journal.jsonl").write_text("".join(lines[:-1]))
    assert "advances [mm].1 was 5.0 and is 4.0 now" in run(f"{INSPECT} --advances 0,4 --resume")[2]
    # A picture that the disk lost is taken again.
    Path("found/pictures/hole 1.png").unlink()
    scripted.clear()
    assert run(f"{command} --resume")[0] == 0
    kinds = [row["kind"] for row in content()["findings"]]
    assert (scripted, sorted(kinds)) == (["hole 1"], ["crack", "hole or pit"])


def test_a_direction_that_the_wires_did_not_reach_is_in_results_and_report(
    run, scripted, monkeypatch
):
    from minorloop_head.procedures import inspection

    def look(rig, name, angles):
        if name == "view 2":
            rig.say(name, "out of reach: pan needs 55 degrees, has 9", succeeded=False)

    monkeypatch.setattr(inspection, "look", look)
    status, _, error = run(INSPECT)
    assert status == 0, error
    content = json.loads(Path("found/findings.json").read_text())
    why = "out of reach: pan needs 55 degrees, has 9"
    assert content["out of reach"] == [{"view": "view 2", "why": why}]
    steps = [(each["step"], each["succeeded"]) for each in content["log"]]
    assert ("view 2", False) in steps
    assert ("view 1", True) in steps
    report = Path("found/report.html").read_text()
    assert "Directions out of reach" in report
    assert f"(view 2: {why})" in report


def test_a_view_that_could_not_be_used_is_taken_again_by_a_resume(run, scripted, monkeypatch):
    """What it shows then is visited after what was visited before, under a number of its own."""
    from minorloop_head.procedures import inspection
    from minorloop_head.vision.defects import Findings

    def seen(rig, name):
        found = real(rig, name)
        if name in torn:
            return replace(found, found=Findings((), "torn"))
        if name == "view 1":
            (hole,) = found.found.holes
            other = replace(hole, place=np.array([0.2, 21e-3]), evidence=9.9)
            return replace(found, found=Findings((other, hole), "good"))
        if name == "crack 1" and torn:
            raise KeyboardInterrupt
        return found

    def content():
        return json.loads(Path("found/findings.json").read_text())

    real, command, torn = inspection._seen, f"{INSPECT} --advances 0,5", ["view 1", "hole 2 again"]
    monkeypatch.setattr(inspection, "_seen", seen)
    assert run(command)[0] == 130
    assert scripted[4:] == ["hole 1", "hole 2", "hole 2 again", "crack 1"]
    before = content()
    assert [row["verdict"] for row in before["not searched"]] == ["torn"]
    assert before["unusable"] == {"torn": 2}
    torn.clear()
    scripted.clear()
    assert run(f"{command} --resume")[0] == 0
    assert scripted == ["view 1", "hole 2 again", "hole 3", "hole 3 again", "crack 1"]
    after = content()
    assert (after["unusable"], after["not searched"]) == ({}, [])
    assert [row["kind"] for row in after["findings"]] == ["hole or pit", "crack"]
    assert after["findings"][0] == before["findings"][0]
    assert [row["seen in"] for row in after["unconfirmed"]] == [["view 3"], ["view 1"]]
    assert {row["why"] for row in after["unconfirmed"]} == {"not seen again"}


NOT_VISITED = "seen, not visited"


def test_what_was_seen_and_not_visited_is_listed_when_an_inspection_is_interrupted(
    run, scripted, monkeypatch
):
    """Also after a resume, and until each candidate is visited from both sides."""
    from minorloop_head.procedures import inspection

    def cut_before(left):
        def seen(rig, name):
            if len(scripted) == left:
                raise KeyboardInterrupt
            return real(rig, name)

        monkeypatch.setattr(inspection, "_seen", seen)
        scripted.clear()

    def listed():
        rows = json.loads(Path("found/findings.json").read_text())["unconfirmed"]
        return [(row["kind"], row["seen in"], row["why"]) for row in rows]

    real, command = inspection._seen, f"{INSPECT} --advances 0,5"
    sure = ("hole or pit", ["view 1", "view 3"], NOT_VISITED)
    lost = ("hole or pit", ["view 3"], NOT_VISITED)
    crack = ("crack", ["view 2"], NOT_VISITED)
    cut_before(1)
    status, _, error = run(command)
    assert (status, listed()) == (130, [("hole or pit", ["view 1"], NOT_VISITED)])
    assert "0 findings in 1 view; 1 seen, not visited; interrupted" in error
    cut_before(3)
    assert run(f"{command} --resume")[0] == 130
    assert listed() == [sure, lost, crack]
    row = Path("found/unconfirmed.csv").read_text().splitlines()[1]
    assert row == 'hole or pit,-80.2141,20.0,5.1,"view 1, view 3","seen, not visited"'
    assert NOT_VISITED in Path("found/report.html").read_text()
    cut_before(2)
    assert (
        "1 finding in 6 views; seen in 1 view (1), not confirmed; 1 seen, not visited"
        in run(f"{command} --resume")[2]
    )
    once = "not seen again, not looked at once more"
    assert listed() == [("hole or pit", ["view 3"], once), crack]
    cut_before(9)
    assert run(f"{command} --resume")[0] == 0
    assert listed() == [("hole or pit", ["view 3"], "not seen again")]


def test_a_finding_says_that_its_centring_failed_also_after_a_resume(run, scripted, monkeypatch):
    from minorloop_head.procedures import inspection

    def off(rig, *_, **__):
        rig.say("centre", "28.5 px from the middle of 640 by 480", succeeded=False)

    monkeypatch.setattr(inspection, "centre", off)
    command, said = f"{INSPECT} --advances 0,5", "not scanned, but failed: centre"
    status, out, _ = run(command)
    assert (status, "verdict" in out) == (0, True)
    content = json.loads(Path("found/findings.json").read_text())
    assert [row["verdict"] for row in content["findings"]] == [said, said]
    step = {"step": "centre", "outcome": "28.5 px from the middle of 640 by 480"}
    assert content["findings"][0]["steps"] == [step | {"succeeded": False}]
    assert content["unconfirmed"][0]["why"] == "not seen again; failed: centre"
    assert said in Path("found/findings.csv").read_text()
    assert said in Path("found/report.html").read_text()
    (hole, _) = [line for line in journal() if line.get("step") == "centre"][:2]
    assert hole["succeeded"] is False
    rewrite(journal()[:-1])
    assert run(f"{command} --resume")[0] == 0
    again = json.loads(Path("found/findings.json").read_text())
    assert again["findings"] == content["findings"]


def looked_round(verdict="good", name="view 1", **more):
    from minorloop_head.procedures.inspected_view import InspectedView
    from minorloop_head.procedures.pictures import InspectedPicture

    picture = InspectedPicture(name=name, t=0.0, verdict=verdict)
    image = np.zeros((240, 320), np.uint8)
    return InspectedView(
        picture=picture, image=image, angles=(0.1, 0.2), joints=(0.6, 0.7), place=(0.0, 0.0), **more
    )


def test_an_inspection_without_a_picture_that_can_be_searched_has_status_1(run, inspected):
    inspected.first, inspected.nothing = (
        [looked_round("black"), looked_round("torn", "view 2")],
        True,
    )
    status, out, error = run(INSPECT)
    assert status == 1
    assert "0 findings in 2 views; 2 of 2 views not usable: black (1), torn (1); not" in out
    assert "no view could be searched" in error


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--actuator twin:pipe --camera camera:0", "twin:pipe has a camera of its own; leave"),
        ("--actuator twin:pipe --advances 0,103", "--advances has 103, and the pipe ends at 102.4"),
        ("--actuator bench:head.toml", "--actuator bench:head.toml needs --camera, and --head"),
        (
            "--actuator bench:head.toml --camera camera:0 --seed 3",
            "are of twin:pipe, and --actuator is bench:head.toml",
        ),
        ("--actuator bench:head.toml --camera twin:pipe", "give it as --actuator, without"),
        ("--actuator bench:head.toml --camera camera:0 --resume", "there is no folder s1; give"),
    ],
)
def test_an_inspection_refuses_what_it_cannot_open_in_one_sentence(run, options, sentence):
    file = "" if "twin:pipe --" in options else "--head head.json"
    save_head(HeadFile(serial="H-07"), "head.json")
    status, _, error = run(f"head inspect {options} {file} --out s1")
    *before, last = error.splitlines()
    assert (status, before in ([], [COMPILES])) == (2, True)
    assert sentence in last
    assert not Path("s1").exists()


def test_an_inspection_that_was_begun_with_a_calibration_is_not_resumed_without(run):
    calibrated = datetime(2026, 3, 1, tzinfo=UTC)
    about = {"head": "twin-head-nominal", "calibrated": calibrated.isoformat()}
    Path("s1").mkdir()
    Path("s1/journal.jsonl").write_text(json.dumps({"what": "begin", "t": 0.0, **about}) + "\n")
    status, _, error = run("head inspect --actuator twin:pipe --out s1 --resume")
    assert status == 2
    assert f"calibrated was '{calibrated.isoformat()}' and is left out now" in error


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (InstrumentError("the camera gives no picture"), 2, "the head is safe, as confirmed"),
        (SafetyError("the source may still be on"), 3, "did NOT confirm that it is safe"),
        (KeyboardInterrupt(), 130, "interrupted; no depth"),
    ],
)
def test_an_inspection_that_ends_early_keeps_what_it_found(run, inspected, error, status, said):
    def fail():
        raise error

    inspected.then = fail
    found, _, shown = run(INSPECT)
    assert (found, inspected.safe) == (status, True)
    assert said in shown
    assert len(Path("found/findings.csv").read_text().splitlines()) == 2
    assert journal()[-1]["safe"] == (status != 3)
    assert Path("found/report.html").exists()


@pytest.fixture
def full_disk(monkeypatch):
    """Fill the disk: what is written from then on does not reach it."""

    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    return lambda: monkeypatch.setattr("os.fsync", full)


def test_a_full_disk_ends_an_inspection_in_one_sentence(run, inspected, full_disk, monkeypatch):
    def fill():
        full_disk()
        inspected.told(LogEntry(2.0, "pick", "phi 3 deg"))

    inspected.then = fill
    status, _, error = run(INSPECT)
    assert (status, inspected.safe) == (2, True)
    assert error.splitlines()[-2:] == [
        "what was measured before is kept in found; the same command with --resume goes on from "
        "there",
        "error: found/journal.jsonl cannot be written: No space left on device; free some space "
        "there",
    ]
    assert [line["what"] for line in journal()] == ["begin", *["step"] * 3, "view"]
    assert Path("found/pictures/hole 1.png").exists()


def test_a_disk_that_is_full_for_the_report_leaves_an_inspection_to_be_resumed(
    run, inspected, full_disk
):
    inspected.then = full_disk
    status, _, error = run(INSPECT)
    assert (status, inspected.safe) == (2, True)
    assert "with --resume goes on from there" in error
    assert "No space left on device; free some space there" in error
    assert journal()[-1]["what"] == "view"


def test_an_interruption_before_the_first_view_says_that_nothing_is_kept(
    run, inspected, monkeypatch
):
    from minorloop_head.procedures import rig

    def wait_for_the_cold_head(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(rig, "rig_at", wait_for_the_cold_head)
    status, _, error = run(INSPECT)
    assert status == 130
    assert error == "nothing was inspected yet, and nothing is kept\ninterrupted\n"
    assert not Path("found").exists()


@pytest.mark.usefixtures("targets")
@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (
            None,
            "nothing was measured yet, and nothing is kept; the same command begins anew with the "
            "whole sweep of the camera, which takes 2.4 min\n",
        ),
        ("camera.json", "the sweep is kept in runs, and nothing else yet; the same command goes"),
    ],
)
def test_an_interruption_of_sweep_or_cooling_says_what_is_kept(run, monkeypatch, kept, said):
    def wait_for_the_cold_head(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("minorloop_head.cli._camera_angles.seen_head", wait_for_the_cold_head)
    monkeypatch.setattr(HeadMeasurement, "left", lambda self: {})
    Path("runs").mkdir()
    if kept is not None:
        (Path("runs") / kept).touch()
    status, _, error = run("head identify --actuator twin:pipe --store runs --head new.json")
    assert status == 130
    assert error.startswith(said)
    status, _, error = run("head drive angles.csv --head head.json --actuator twin:pipe")
    assert status == 130
    assert error.startswith("the drive has not begun, and nothing is kept")


@pytest.mark.usefixtures("laid_out")
def test_the_simulated_head_inspects_its_pipe_without_a_camera_or_a_file(run, monkeypatch):
    from minorloop_head.procedures import inspection, probing

    monkeypatch.setattr(inspection, "views_of", lambda lens: np.radians([[25.0, 0.0]]))
    monkeypatch.setattr(probing, "touch", lambda rig, hole: rig.say("touch", "touched"))
    command = "head inspect --actuator twin:pipe --water dry --out found --json"
    status, out, error = run(command)
    assert (status, json.loads(out)["safe"]) == (0, True), error
    (row,) = json.loads(out)["findings"]
    assert row["phi [deg]"] == pytest.approx(math.degrees(0.45), abs=1.0)
    assert row["z [mm]"] == pytest.approx(20.0, abs=0.3)
    assert row["width [mm]"] == pytest.approx(1.0, abs=0.1)
    assert (row["verdict"], row["depth [mm]"]) == ("no water", None)
    steps = ("found", "centred", "reached", "touched", "scanned")
    assert [row[name] for name in steps] == [True, True, None, True, False]
    wall = json.loads(out)["wall"]
    assert 12.0 < wall["z [mm]"][0] < 20.0 < wall["z [mm]"][1] < 30.0
    assert wall["angles [deg]"][0] < math.degrees(0.45) < wall["angles [deg]"][1]
    assert wall["seen"] > wall["probed"] == 0.0
    report = Path("found/report.html").read_text()
    assert "<td>level of the water</td><td>dry pipe</td>" in report
    assert "the pipe was dry, and the probe needs water" in report
    assert "90 at the bottom" in report
    rewrite(journal()[:-1])
    assert "seed was 0 and is 1 now" in run(f"{command} --resume --seed 1")[2]
    wet = command.replace("dry", "3.5")
    assert "was 'dry' and is '3.5' now" in run(f"{wet} --resume")[2]


@pytest.fixture
def probed(scripted, monkeypatch):
    """An inspection as scripted by a head with a probe, and the scans that it makes."""
    from minorloop_head.cli import _inspection_head as _inspected_head
    from minorloop_head.procedures import probe_steps, probing, ring
    from minorloop_head.ultrasound.crack_depth import CrackDepth
    from minorloop_head.ultrasound.pits import PitDepth
    from minorloop_head.ultrasound.profile import Profile

    made, trace = [], 0.01 * np.random.default_rng(1).standard_normal(2000)

    def scan(rig, place, shift, *, before, told):
        found = before or probe_steps.ScannedRaster(reference=np.array([place[1], 0.1]), done=False)
        for point in range(found.point, 2):
            made.append((round(place[1], 3), shift, point))
            burst = Burst(trace, 1e-8, np.array([shift, -0.27 - point]), 4, 4, 0.005)
            found = replace(found, bursts=(*found.bursts, burst), point=point + 1)
            told(found)
        rig.say("scan", "36 of 36 points")
        return replace(found, done=True)

    def pit(bursts, probe, place, diameter):
        """One that needs a second scan."""
        assert [burst.angles[1] for burst in bursts] == [-0.27, -1.27]
        verdict = "measured" if bursts[0].angles[0] else "disturbed"
        sizes = {"diameter": diameter, "place_sd": 1e-5, "diameter_sd": 2e-5}
        return PitDepth(verdict, *place, depth=5e-4, depth_sd=1e-5, **sizes)

    def ringed(rig):
        made.append("ring")
        spots = np.array([[0.1, 20e-3], [0.2, 20e-3]])
        detected = np.array([True, False])
        profile = Profile(spots, np.array([1e-5, np.nan]), np.ones(2), detected, np.zeros(2))
        return ring.Ring(profile, WaterLine(-4e-3, 2e-4, 0.0))

    def head(*given):
        plain = real(*given)
        return replace(plain, probing=probing.Probing())

    real = _inspected_head.inspected_head
    monkeypatch.setattr(_inspected_head, "inspected_head", head)
    monkeypatch.setattr(probing, "scan", scan)
    monkeypatch.setattr(probing, "reach_words", lambda rig: ("within reach", True))
    monkeypatch.setattr(probing, "ring_sweep", ringed)
    for name in ("go", "meter", "approach"):
        monkeypatch.setattr(probing, name, lambda *given, **more: None)
    monkeypatch.setattr(probing, "touch", lambda rig, hole: rig.say("touch", "touched"))
    monkeypatch.setattr(probe_steps, "measure_pit", pit)
    monkeypatch.setattr(
        probe_steps, "crack_depth", lambda *given: CrackDepth("measured", 7e-4, 2e-5)
    )
    return made


@pytest.mark.usefixtures("laid_out")
def test_scans_that_a_power_cut_ended_are_resumed_from_the_journal(
    run, scripted, probed, monkeypatch
):
    def content():
        found = json.loads(Path("found/findings.json").read_text())
        return {k: value for k, value in found.items() if k not in ("seconds", "resumed", "log")}

    command = f"{INSPECT} --advances 0,5"
    status, out, error = run(command)
    assert status == 0, error
    whole, every = content(), list(probed)
    points = [
        (z, shift, n) for z, shift in ((0.02, 0.0), (0.02, 0.5), (0.022, 0.0)) for n in (0, 1)
    ]
    assert every == [*points, "ring"]
    assert [row["depth [mm]"] for row in whole["findings"]] == [0.5, 0.7]
    assert [row["touched"] for row in whole["findings"]] == [True, None]
    assert whole["water above the axis [mm]"] == [4.0, 0.2]
    assert "2 of 2 depths known" in out
    steps = [step["step"] for step in whole["findings"][0]["steps"]]
    assert steps == ["touch", "scan", "measure", "scan", "measure again"]
    assert "C-scan" in Path("found/report.html").read_text()
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)
    lines = Path("found/journal.jsonl").read_text().splitlines(keepends=True)
    marks = [n for n, line in enumerate(lines) if '"what": "scan"' in line or '"ring"' in line]
    assert len(marks) == 10
    for cut, left in ((1, 1), (4, 3), (9, 6)):
        mark = marks[cut]
        # It is cut in the line of a point, which is then fired again, and none before it.
        Path("found/journal.jsonl").write_text("".join(lines[:mark]) + lines[mark][:90])
        scripted.clear()
        probed[:] = every[:left]
        status, _, error = run(f"{command} --resume")
        assert (status, probed) == (0, every), error
        assert content() == whole


def test_a_place_without_an_echo_is_not_scanned_and_not_known_to_be_within_reach():
    def steps(*each):
        said = tuple(LogEntry(0.0, what, "", succeeded) for what, succeeded in each)
        return outcomes(SimpleNamespace(steps=said, finding=None))

    silent = steps(("scan", True), ("modality", False))
    assert (silent["scanned"], silent["reached"]) == (False, None)
    heard = steps(("scan", True), ("modality", True))
    assert (heard["scanned"], heard["reached"]) == (True, True)


def test_the_caption_of_a_map_has_its_marks_only():
    seen = SimpleNamespace(seen_share=1.0, probed=np.zeros((2, 2), bool))
    assert _map_caption(seen, [], [], None) == ("The inner wall, unrolled, as the camera saw it.")
    line = WaterLine(1e-3, 1e-4, 0.0)
    shown = _map_caption(seen, [object()], [], line)
    assert shown.endswith("saw it; findings are numbered; dashed lines are the level of the water.")


def test_the_report_says_what_the_edge_cuts_how_high_the_water_was_and_that_pictures_are_blurred():
    wall = {"z [mm]": [13.0, 22.0], "angles [deg]": [-180.0, 180.0], "seen": 0.9, "probed": 0.0}
    wall["pipe [mm]"] = 102.0
    content = {"wall": wall, "lens": "pictures are x", "views": 8, "out of reach": []}
    water = {"water above the axis [mm]": [4.0, 0.2], "water level": "4.0 mm above the axis"}
    said = " ".join(wall_words(content | water))
    assert said.startswith("The camera searched 9.0 mm of the 102 mm of pipe: the inner wall from")
    assert "or one that the edge of each picture cuts, is not found; --advances" in said
    assert "Pictures are x." in said
    assert said.endswith("The water stood 4.0 mm above the axis.")
    full = {"water level": "no surface: water at every place"}
    beyond = {"out of reach": [{"view": "view 1", "why": "out of reach: pan needs 55"}]}
    said = wall_words(content | full | beyond)
    assert said[-2].startswith("The wires did not reach 1 direction in which to look (view 1: out")
    assert said[-1] == "The level of the water: no surface: water at every place."


def test_a_crack_of_one_view_without_an_echo_is_not_confirmed(run, probed, monkeypatch):
    from minorloop_head.procedures import probe_steps
    from minorloop_head.ultrasound.crack_depth import CrackDepth

    silent = CrackDepth("no floor echo")
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)
    monkeypatch.setattr(probe_steps, "crack_depth", lambda *given: silent)
    command = f"{INSPECT} --advances 0,5"
    assert run(command)[0] == 0
    content = json.loads(Path("found/findings.json").read_text())
    assert [row["kind"] for row in content["findings"]] == ["pit"]
    whys = {row["kind"]: row["why"] for row in content["unconfirmed"]}
    assert whys["crack"].endswith("and no echo of its depth: no floor echo")
    rewrite(journal()[:-1])
    probed.clear()
    assert run(f"{command} --resume")[0] == 0
    again = json.loads(Path("found/findings.json").read_text())
    assert (probed, again["unconfirmed"]) == ([], content["unconfirmed"])


def test_a_journal_with_an_impossible_scan_is_refused(run, probed, monkeypatch):
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)
    command = f"{INSPECT} --advances 0,5"
    assert run(command)[0] == 0
    lines = journal()[:-1]
    number = next(n for n, line in enumerate(lines) if line["what"] == "scan")
    burst = lines[number]["bursts"][0]
    for change, words in (
        ({"noise": -1.0}, "has -1.0 as 'noise', which must be 0 to 1"),
        ({"shots": [16, 8]}, "has [16, 8] as 'shots', which must be no more used than fired"),
        ({"trace": "AAA"}, "is not the whole line of a scan"),
    ):
        lines[number]["bursts"][0] = burst | change
        rewrite(lines)
        status, _, error = run(f"{command} --resume")
        assert status == 2
        assert f"line {number + 1} of found/journal.jsonl {words}" in " ".join(error.split())
    lines[number]["bursts"] = [burst, burst]
    rewrite(lines)
    assert "repeats the burst of line" in run(f"{command} --resume")[2]


def changed(line, names, value):
    """A line with another value at the end of the way of names."""
    line = json.loads(json.dumps(line))
    within = line
    for name in names[:-1]:
        within = within[name]
    within[names[-1]] = value
    return line


@pytest.mark.parametrize(
    ("names", "value", "words"),
    [
        (("pose", "pan [deg]"), 400.0, "has 400.0 as 'pan [deg]', which must be -180 to 180"),
        (("seen", 0, "diameter"), -1e-3, "has -0.001 as 'diameter', which must be 0 to 0.02"),
        (("seen", 0, "rim", 1), [9.0, 0.0], "has [9.0, 0.0] as 'rim'"),
        (("probed", "depth"), 9.5e-3, "has 0.0095 as 'depth', which must be 0 to 0.002"),
        (("picture",), "../../other.png", "has '../../other.png' as 'picture'"),
        (("sight",), None, "is not the whole line of a view"),
    ],
)
def test_the_line_of_a_view_with_an_impossible_value_is_refused(
    run, probed, monkeypatch, names, value, words
):
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)
    command = f"{INSPECT} --advances 0,5"
    assert run(command)[0] == 0
    lines = journal()[:-1]
    number = next(n for n, line in enumerate(lines) if line.get("probed"))
    lines[number] = changed(lines[number], names, value)
    rewrite(lines)
    status, _, error = run(f"{command} --resume")
    assert status == 2
    assert f"line {number + 1} of found/journal.jsonl {words}" in " ".join(error.split())
    assert "delete this line and all lines after it" in " ".join(error.split())


def test_what_is_before_a_damaged_line_of_an_inspection_is_kept_and_the_rest_is_measured_again(
    run, scripted, monkeypatch
):
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)
    command = f"{INSPECT} --advances 0,5"
    assert run(command)[0] == 0
    whole, file = json.loads(Path("found/findings.json").read_text()), Path("found/journal.jsonl")
    lines = file.read_text().splitlines()[:-1]
    cut = [n for n, line in enumerate(lines) if json.loads(line)["what"] == "view"][2]
    damaged = "\n".join([*lines[:cut], lines[cut][:90], *lines[cut + 1 :], ""])
    file.write_text(damaged)
    scripted.clear()
    status, _, error = run(f"{command} --resume")
    assert status == 0, error
    said = " ".join(error.split())
    assert f"line {cut + 1} of {file} is damaged; what is kept before it: 2 views" in said
    assert Path("found/journal.damaged.jsonl").read_text() == damaged
    assert scripted[0] == "view 3"
    again = json.loads(Path("found/findings.json").read_text())
    assert again["findings"] == whole["findings"]


def test_a_second_program_does_not_write_into_the_folder_of_an_inspection(tmp_path):
    first = Journal(tmp_path, {})
    with pytest.raises(OutputError, match="another program writes to"):
        Journal(tmp_path, {})
    first.close()
    Journal(tmp_path, {}).close()


def test_an_inspection_refuses_advances_without_a_catheter(run, inspected):
    status, _, error = run(f"{INSPECT} --advances 0,5")
    assert status == 2
    assert "bench:head.toml has no catheter" in error
    assert not Path("found").exists()
    assert "--advances has -1; give 0 to" in run(f"{INSPECT} --advances -1")[2]
    assert "--advances is 5,5; give each place once" in run(f"{INSPECT} --advances 5,5")[2]


def test_a_run_that_is_continued_says_what_it_repeats_and_how_to_go_on(tmp_path, capsys):
    plan = Plan([0.0, 0.1, 0.2], 1.0, sample_interval=0.1, input="current [A]")
    setup = Setup(address="twin:wire", input="current [A]", output="angle [deg]")

    class Ended:
        tick, description = 0.1, None
        inputs, outputs = (Channel("current", "A", 0.0, 0.4),), (Channel("angle", "deg"),)
        left = 1

        def apply(self, u, duration, interval):
            if self.left == 0:
                raise KeyboardInterrupt
            self.left -= 1
            t = 0.1 * np.arange(1.0, 11.0)
            names = ["current [A]"], ["angle [deg]"]
            return Record(np.full(10, float(u)), np.ones(10), t, *names)

        def safe(self):
            """Do nothing."""

    with Store.create(tmp_path / "a.sqlite", plan, setup) as store:
        for _ in range(2):
            with pytest.raises(KeyboardInterrupt):
                carry_out_levels(Ended(), store, None, again="continue with the same command")
    said = capsys.readouterr().err
    safe = "the actuator has confirmed that it is safe"
    assert said.count(f"1 of 3 levels are kept; {safe}; continue with the same command") == 2
    assert said.count("0 A  repeated for 0.2 s, as it was measured before") == 1


SWEEP = "head sweep --actuator twin:pipe --along 19,19.5 --out swept"


@pytest.fixture
def identified_at_once(monkeypatch):
    """A head whose wires are known."""
    control = head_control("observer", (identified().model,) * 2)
    monkeypatch.setattr("minorloop_head.console.identified_head.head_of", lambda *_: control)


def test_a_sweep_needs_a_probe_and_a_part_of_the_wall(run, identified_at_once, tmp_path):
    assert tuple(surroundings.GASES) == _water.GASES
    for options, words in (
        ("--actuator bench:head.toml", "is not a head with an ultrasonic probe"),
        (
            "--actuator twin:ipmc",
            "twin:ipmc is not a head with an ultrasonic probe; give twin:pipe",
        ),
        ("--along 19,31", "which are 12 mm; give at least 0.48, two widths"),
        ("--along 101,103", "up to the end of the pipe at 102.4 mm"),
        ("--around 10,5", "that is -5 degrees; give at least 2.8, two"),
        ("--around 10,11", "from 10 to 11 degrees around the pipe, that is 1 degree; give"),
        ("--water dry", "a dry pipe cannot be swept"),
        ("--water 12", "--water is 12; give full, dry, or its height above the axis of the pipe"),
        ("--temperature 4", "--temperature is 4; give 5 to 60 degrees Celsius"),
        ("--gas neon", "--gas is 'neon'; give one of air, nitrogen, argon, helium, forced gas"),
        ("--pressure 0", "--pressure is 0; give 0.01 to 100 bar"),
    ):
        status, _, error = run(f"{SWEEP} {options}")
        assert (status, words in error) == (2, True), error
    assert not (tmp_path / "swept").exists()


@pytest.fixture
def unreported(monkeypatch):
    """No report is written, where only its journal is looked at."""
    monkeypatch.setattr("minorloop.cli._common.write_report", lambda *given, **more: None)


@pytest.fixture
def signals_as_before():
    """A command that a signal ends ignores later ones, as its process exits."""
    before = {each: signal.getsignal(each) for each in signal.valid_signals() if each < 30}
    yield
    for each, handler in before.items():
        if handler is not None and signal.getsignal(each) is not handler:
            signal.signal(each, handler)


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.usefixtures("identified_at_once", "signals_as_before")
def test_an_interrupted_sweep_is_kept(run, monkeypatch, tmp_path, ending):
    def interrupted(rig, procedure, state, told):
        told(replace(state, stage="line", progress=0.25))
        signal.raise_signal(ending)

    monkeypatch.setattr(InspectionRig, "run", interrupted)
    status, _, error = run(SWEEP)
    assert status == 130
    assert "0 finds in 0 bursts on 0 lines; interrupted; kept in swept" in error
    kept = {each.name for each in (tmp_path / "swept").iterdir()}
    assert kept == {"journal.jsonl", "findings.csv", "findings.json", "report.html"}
    content = json.loads((tmp_path / "swept" / "findings.json").read_text())
    (first, *_) = Path("swept/journal.jsonl").read_text().splitlines()
    assert content.pop("began") == json.loads(first)["began"]
    assert content == {
        "actuator": "twin:pipe",
        "head": Head().serial,
        "specimen": None,
        "seed": 0,
        "around [deg]": [0.0, 180.0],
        "along [mm]": [19.0, 19.5],
        "water [mm above the axis]": "full",
        "water [C]": 20.0,
        "gas": "air",
        "gas [bar]": 1.01325,
        "ended": "interrupted",
        "bursts": 0,
        "lines": 0,
        "mapped": 0.0,
        "water line below the axis [mm]": None,
        "water level": "not seen",
        "findings": [],
    }
    page = Path("swept/report.html").read_text()
    assert all(words in page for words in (Head().serial, "0 to 180 degrees", "20 C", "began"))


@pytest.mark.usefixtures("laid_out")
def test_a_sweep_that_a_power_cut_ended_is_resumed_from_its_journal(run, identified_at_once):
    """The pit of the pipe is on both sides of the cut."""
    sweep = "head sweep --actuator twin:pipe --around 20,32 --along 19.3,20.5 --out"

    def bursts(lines):
        return [each["trace"] for each in map(json.loads, lines) if each["what"] == "burst"]

    assert run(f"{sweep} whole")[0] == 0
    lines = Path("whole/journal.jsonl").read_text().splitlines()
    Path("cut").mkdir()
    half = len(lines) // 2
    Path("cut/journal.jsonl").write_text("\n".join([*lines[:half], lines[half][:300]]))
    status, _, error = run(f"{sweep} cut --resume")
    assert status == 0, error
    again = Path("cut/journal.jsonl").read_text().splitlines()
    assert again[:half] == lines[:half]
    assert len(bursts(again[half:])) < 0.75 * len(bursts(lines))
    assert [json.loads(again[k])["what"] for k in (0, half, -1)] == ["begin", "resume", "end"]
    whole, cut = (
        json.loads(Path(f"{name}/findings.json").read_text()) for name in ("whole", "cut")
    )
    assert (cut["bursts"], cut["ended"]) == (len(bursts(again)), "finished")
    assert cut["lines"] == whole["lines"]
    assert min(cut["mapped"], whole["mapped"]) > 0.9
    assert whole["water line below the axis [mm]"] is None  # all of it is under water
    (one,), (other,) = whole["findings"], cut["findings"]
    assert one["find"] == other["find"] == "pit"
    assert other["depth [mm]"] == pytest.approx(one["depth [mm]"], abs=0.02)
    assert other["z [mm]"] == pytest.approx(one["z [mm]"], abs=0.15)
    assert "the sweep in cut is finished" in run(f"{sweep} cut --resume")[2]
    Path("cut/journal.jsonl").write_text("\n".join(lines[:half]))
    assert "along [mm].0 was 19.3 and is 19.0 now" in run(f"{sweep} cut --along 19,20 --resume")[2]
    Path("cut/journal.jsonl").write_text("\n".join([lines[0], '{"what": "burst", "t": 1}']))
    assert "line 2 of cut/journal.jsonl is not the whole" in run(f"{sweep} cut --resume")[2]


SWEPT = f"{SWEEP} --specimen 1000 --seed 1000"


def made_up_journal(bursts=3, **changes):
    """Write the journal of a sweep that was cut off, with changes of its second burst."""
    begun = {
        "actuator": "twin:pipe",
        "specimen": 1000,
        "seed": 1000,
        "around [deg]": [0.0, 180.0],
        "along [mm]": [19.0, 19.5],
        "water [mm above the axis]": "full",
        "water [C]": 20.0,
        "gas": "air",
        "gas [bar]": 1.01325,
    }
    trace = 0.01 * np.random.default_rng(1000).standard_normal(2000)
    burst = Burst(trace, 1e-8, np.array([-0.35, -0.27]), 4, 4, 0.005)
    lines = [{"what": "begin", "t": 0.0, **begun, "began": "2026-01-01T00:00:00Z"}]
    for n in range(bursts):
        phi = 0.1 + 0.02 * n
        spot = np.array([phi, 19.1e-3, 8e-3])
        one = SweptBurst(10.0 + n, np.array([19.2e-3, phi - 3.0]), spot, burst)
        lines.append({"what": "burst", "t": 1.0 + n, **burst_line(one)})
    lines[2].update(changes)
    file = Path("swept/journal.jsonl")
    file.parent.mkdir()
    file.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    return file


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"interval": 0.0}, "has 0.0 as 'interval', which must be 1e-09 to 5e-08"),
        (
            {"spot": [1e300, 0, 0]},
            "has [1e+300, 0, 0] as 'spot', which must be -6.283 to 6.283 and",
        ),
        ({"angles": [math.nan, 0.0]}, "has [nan, 0.0] as 'angles'"),
        ({"fired": 10**400}, "has 1000000"),
        ({"shots": [True, 4]}, "has [True, 4] as 'shots'"),
        ({"shots": [16, 8]}, "has [16, 8] as 'shots', which must be no more used than fired"),
        ({"verdict": None}, "has the verdict None"),
        ({"trace": base64.b64encode(bytes(24)).decode()}, "has a trace of 3 samples"),
        ({"trace": base64.b64encode(np.full(2000, 7.0)).decode()}, "has the sample 7 in its"),
        ({"trace": "AAA"}, "is not the whole line of a burst"),
    ],
)
@pytest.mark.usefixtures("identified_at_once")
def test_a_journal_with_an_impossible_value_is_refused_before_a_shot(
    run, monkeypatch, changes, words
):
    monkeypatch.setattr(InspectionRig, "run", lambda *_: pytest.fail("the sweep began"))
    file = made_up_journal(**changes)
    before = file.read_bytes()
    status, _, error = run(f"{SWEPT} --resume")
    assert status == 2
    assert f"line 3 of {file} {words}" in " ".join(error.split())
    assert "delete this line and all lines after it" in " ".join(error.split())
    assert file.read_bytes() == before
    assert [each.name for each in file.parent.iterdir()] == [file.name]


@pytest.mark.usefixtures("identified_at_once")
def test_a_burst_that_is_twice_in_a_journal_is_refused(run):
    file = made_up_journal()
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:3], lines[2], *lines[3:], ""]))
    said = " ".join(run(f"{SWEPT} --resume")[2].split())
    assert f"line 4 of {file} repeats the burst of line 3 of {file}; delete this line" in said


@pytest.mark.usefixtures("identified_at_once", "unreported")
def test_the_same_height_of_the_water_in_other_digits_resumes_a_sweep(run, monkeypatch):
    monkeypatch.setattr(InspectionRig, "run", ended_at_once)
    file = made_up_journal()
    file.write_text(file.read_text().replace('"full"', '"5"'))
    status, _, error = run(f"{SWEPT} --resume --water 5.0")
    assert status == 0, error


def ended_at_once(rig, procedure, state, told):
    """Run no sweep, and end it as one whose catheter is stuck."""
    return replace(state, trouble="stopped by the test", done=True)


@pytest.mark.usefixtures("identified_at_once")
def test_a_full_disk_ends_a_sweep_in_one_sentence_once_the_head_is_safe(
    run, monkeypatch, full_disk
):
    """What was fired before is kept."""
    from minorloop_head.twins.rig import Rig

    def swept(rig, procedure, state, told):
        full_disk()
        told(replace(state, bursts=(*state.bursts, state.bursts[-1])))

    safe = []
    monkeypatch.setattr(Rig, "safe", lambda _: safe.append(True))
    monkeypatch.setattr(InspectionRig, "run", swept)
    file = made_up_journal()
    status, _, error = run(f"{SWEPT} --resume")
    assert (status, safe) == (2, [True])
    assert error.splitlines()[-2:] == [
        "what was measured before is kept in swept; the same command with --resume goes on from "
        "there",
        f"error: {file} cannot be written: No space left on device; free some space there",
    ]
    lines = [json.loads(line)["what"] for line in file.read_text().splitlines()]
    assert lines == ["begin", *["burst"] * 3, "resume"]


@pytest.mark.usefixtures("identified_at_once", "unreported")
def test_what_is_before_a_damaged_line_of_a_journal_is_kept_and_the_rest_is_fired_again(
    run, monkeypatch
):
    monkeypatch.setattr(InspectionRig, "run", lambda *given: told_once(*given))

    def told_once(rig, procedure, state, told):
        told(state)
        return ended_at_once(rig, procedure, state, told)

    file = made_up_journal(5)
    lines = file.read_bytes().split(b"\n")
    for piece in (lines[3][:300], b"\xff" + lines[3], b"\0" * 400, b"12", b"", b"[" * 10**5):
        damaged = b"\n".join([*lines[:3], piece, *lines[4:]])
        file.write_bytes(damaged)
        status, _, error = run(f"{SWEPT} --resume")
        assert status == 0, error
        said = " ".join(error.split())
        assert f"line 4 of {file} is damaged; what is kept before it: 2 bursts" in said
        copies = sorted(file.parent.glob("journal.damaged*.jsonl"))
        assert copies[0].read_bytes() == damaged
        assert str(copies[0]) in said
        again = file.read_bytes().split(b"\n")
        assert again[:3] == lines[:3]
        assert [json.loads(each)["what"] for each in again[3:-1]] == ["resume", "end"]
        copies[0].unlink()
    file.write_bytes(b"\n".join([b"{", *lines[1:]]))
    assert "is not the journal" in run(f"{SWEPT} --resume")[2]


@pytest.mark.usefixtures("identified_at_once", "unreported")
def test_a_second_damaged_journal_is_kept_beside_the_first(run, monkeypatch):
    monkeypatch.setattr(InspectionRig, "run", ended_at_once)
    file = made_up_journal()
    for copy in ("journal.damaged.jsonl", "journal.damaged1.jsonl"):
        damaged = b"\n".join([*file.read_bytes().split(b"\n")[:2], b"{", b""])
        file.write_bytes(damaged)
        run(f"{SWEPT} --resume")
        assert (file.parent / copy).read_bytes() == damaged


@pytest.mark.usefixtures("identified_at_once", "unreported")
def test_a_burst_without_a_trace_is_resumed(run, monkeypatch):
    """Its numbers are not known, as `average` returns it."""
    monkeypatch.setattr(InspectionRig, "run", ended_at_once)
    nothing = {"interval": 0.0, "noise": math.nan, "angles": [math.nan] * 2, "trace": ""}
    made_up_journal(verdict="dropout", spot=[math.nan] * 3, **nothing)
    status, output, error = run(f"{SWEPT} --resume")
    assert status == 0, error
    assert "in 3 bursts" in output
