import json
import re
import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from minorloop import InstrumentError, SafetyError, StoreError
from minorloop.cli._compilation import COMPILES
from minorloop_head.control.head import head_control
from minorloop_head.geometry import Pinhole
from minorloop_head.inspection.identification import kept_view, swept_view
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import (
    CheckedAxis,
    HeadFile,
    read_head,
    save_head,
)
from minorloop_head.sources import Frame
from minorloop_head.twins.head import Head
from scripted_inspection import VIEW as SCRIPTED
from wires import identified, in_a_file, made_up

VIEW = HeadCalibration(lens=Pinhole(), leds=np.zeros((1, 3)))
LATER = (datetime.now(UTC) + timedelta(hours=12)).replace(microsecond=0)
"""After every identification of a test."""
IDENTIFY = "head identify --actuator twin:head --noise 0.05 --inputs bands=2,hold=12 --store runs"


class Swept:
    """A head that counts its sweeps."""

    count = 0

    def survey(self, highest):
        self.count += 1
        return HeadCalibration(lens=Pinhole(), leds=np.zeros((3, 3)), lever=highest * 0.02)


def test_a_sweep_is_carried_out_once_and_not_for_runs_that_began_without(tmp_path):
    head, said = Swept(), []
    assert swept_view(tmp_path, head, 0.3, "H-07", said.append).lever == pytest.approx(0.006)
    assert "turning both axes slowly up and down for 2.4 min" in said[0]
    assert swept_view(tmp_path, head, 0.4, "H-07", said.append).lever == pytest.approx(0.006)
    assert head.count == 1
    with pytest.raises(StoreError, match=r"is of head 'H-07', and the head here is 'H-08'; give"):
        kept_view(tmp_path, "H-08")
    (tmp_path / "camera.json").write_text('{"lever": 1}')
    with pytest.raises(StoreError, match=r"is no calibration of a camera .* begin anew"):
        swept_view(tmp_path, head, 0.4, "H-07", said.append)
    (tmp_path / "camera.json").rename(tmp_path / "pan-loop.sqlite")
    assert swept_view(tmp_path, head, 0.4, "H-07", said.append) is None
    assert "the calibration of the camera is not corrected: the runs" in said[1]


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


def test_head_drive_refuses_what_cannot_be_reached_and_warns_of_what_was_not(run):
    wires = in_a_file(made_up(), made_up(), highest=0.2)
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
    """A head that is identified, its file, and a table of targets."""
    control = head_control("observer", (identified().model,) * 2)
    monkeypatch.setattr(HeadFile, "control", lambda self, **_: control)
    monkeypatch.setattr("minorloop_head.inspection.heads.head_of", lambda *_: control)
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
    assert run(drive)[0] == 0  # a fault that passes
    monkeypatch.setattr(Head, "exchange", lost(60, 80))
    status, out, error = run(f"{drive} --json")
    assert status == 1
    fault, *_ = json.loads(out)["faults"]
    assert (fault["axis"], fault["times"], fault["cooled"]) == ("pan and tilt", 1, True)
    assert fault["began_s"] == pytest.approx(2.4)
    assert error.startswith("warning: pan and tilt, from 2.40 s for ")
    assert "the sensor is lost; the wire cools" in error
    monkeypatch.setattr(Head, "exchange", lost(0, 1000))
    status, out, error = run(drive)
    assert status == 1
    assert "no reading was used, so that no error is known" in out
    assert "nan" not in out
    assert "tilt did not reach target 1, 25 degrees: there was no reading" in error


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
        "the drive ended after 3.0 s, and the record is kept in reached.csv; the head has "
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


SMALL = "--target squares=7x5,side=4"
CALIBRATE = f"head calibrate --head head.json --serial H-07 {SMALL}"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """Folders of pictures from a small camera, and what they should give."""
    from benchmarks.target_pictures import CalibrationScene
    from minorloop_head.twins.camera import LENS
    from minorloop_head.vision.targets import Target

    folder = tmp_path_factory.mktemp("pictures")
    drawn = CalibrationScene(Target("charuco", 7, 5, 4e-3), 1000, LENS.scaled(0.5))
    drawn.lens(folder / "lens", 10)
    rows = drawn.mount(folder / "mount", 3)
    drawn.leds(folder / "leds", 7)
    lines = "".join(f"{name},{pan},{tilt}\n" for name, pan, tilt in rows)
    (folder / "angles.csv").write_text(f"picture,pan [deg],tilt [deg]\n{lines}")
    (folder / "radians.csv").write_text(f"picture,pan [rad],tilt [rad]\n{lines}")
    return folder, drawn.truth


def test_a_head_is_calibrated_from_pictures(run, scene):
    folder, truth = scene
    (folder / "lens" / "junk.png").write_text("no picture")
    first = f"{CALIBRATE} --pictures {folder}/lens --mount {folder}/mount --json"
    status, out, error = run(
        f"{first} --target side=4,on-axis=yes --leds 0,2.5,0;-2.2,-1.2,0 --report report.html"
    )
    assert status == 0
    printed = json.loads(out)["measured"]
    assert all(f"warning: {each}\n" in error for each in json.loads(out)["warnings"])
    assert json.loads(out)["target"] == "a charuco target of 7 by 5 squares (DICT_4X4_50)"
    assert json.loads(out)["left_out"] == {"lens/junk.png": "it cannot be read as an image"}
    assert json.loads(out)["rms_angles_deg"] < 0.2
    true = {
        "focal length fx": truth.lens.focal,
        "focal length fy": truth.lens.focal,
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
    off = np.degrees(printed["principal point v"]["sd"] / truth.lens.focal)
    assert printed["tilt where level"]["sd"] > 0.5 * off  # perspective tells the rest
    report = Path("report.html").read_text()
    assert "ninths of the image" in report
    known = read_head("head.json")
    assert len(known.measured) == len(printed)
    assert known.calibration.lever == pytest.approx(1e-3 * printed["lever"]["value"])
    # Another part of it later: the rest is kept.
    status, out, _ = run(f"{CALIBRATE} --leds {folder}/leds --force --pipe radius=12.5")
    assert status == 0
    assert "LED 3 x" in out
    after = read_head("head.json")
    assert after.calibration.lens == known.calibration.lens
    assert after.calibration.radius == 12.5e-3
    assert np.abs(after.calibration.leds - truth.leds)[:, :2].max() < 0.4e-3
    status, _, _ = run(f"{CALIBRATE} --leds 0,2.5,0 --force")
    assert status == 0
    assert len(read_head("head.json").measured) == len(printed)  # LEDs were entered, not measured


@pytest.mark.whole
def test_a_camera_on_a_robot_is_calibrated_from_poses_of_its_flange(run, refused, scene):
    from minorloop_head.geometry import pan_tilt

    folder, truth = scene
    lines = ["picture,x [mm],y [mm],z [mm],rx [deg],ry [deg],rz [deg]"]
    for row in (folder / "angles.csv").read_text().splitlines()[1:]:
        name, *read = row.split(",")
        link = pan_tilt(*np.radians(np.array(read, dtype=float) - truth.straight))
        turn = np.degrees(Rotation.from_matrix(link).as_rotvec())
        lines.append(",".join([name, "0,0,0", *map(str, turn)]))
    Path("robot.csv").write_text("\n".join(lines))
    save_head(HeadFile(serial="H-07", calibration=HALF, calibrated=LATER), "head.json")
    known = f"{CALIBRATE} --pictures {folder}/lens --mount {folder}/mount --force --json"
    status, out, _ = run(f"{known} --angles robot.csv")
    assert status == 0
    printed = json.loads(out)["measured"]
    for name, value in (
        ("camera on the flange z", 1e3 * truth.mount.lever),
        ("turn of the camera on the flange z", truth.camera_roll),
    ):
        assert abs(printed[name]["value"] - value) < 4 * printed[name]["sd"]
    Path("feet.csv").write_text("\n".join(lines).replace("[mm]", "[ft]"))
    assert "column 'x' of feet.csv is in ft; give it in mm or m" in refused(
        f"{known} --angles feet.csv".replace(" --json", "")
    )


@pytest.fixture(scope="module")
def bad_pictures(scene, tmp_path_factory):
    """A folder of good pictures and of those with something wrong."""
    import cv2

    good, folder = scene[0], tmp_path_factory.mktemp("bad")
    for name in ("few", "cats", "mirrored"):
        (folder / name).mkdir()
    fur = cv2.GaussianBlur(np.random.default_rng(0).normal(128, 900, (240, 320)), (0, 0), 6)
    cv2.imwrite(f"{folder}/cats/cat.png", fur.clip(0, 255).astype(np.uint8))
    for path in sorted((good / "lens").glob("0[0-3].png")):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(f"{folder}/mirrored/{path.name}", image[:, ::-1])
    for number in ("00", "01"):
        shutil.copy(good / "lens" / f"{number}.png", folder / "few")
    cv2.imwrite(f"{folder}/few/dark.png", np.zeros((240, 320), np.uint8))
    for each in ("lens", "mount", "angles.csv", "radians.csv"):
        (folder / each).symlink_to(good / each)
    save_head(HeadFile(serial="H-07", calibration=HALF, calibrated=LATER), folder / "head.json")
    return folder


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--mount mount --angles radians.csv", "column 'pan [rad]' of"),
        ("--mount lens", "the name of 00.png has no angles; rename it, such as pan12.5_tilt-3.png"),
        ("--pictures few", "few: 2 pictures with a target; give 3 or more; 1 is left out: "),
        ("--pictures cats", "no picture of cats shows a target: no markers, chessboard or grid"),
        ("--pictures mirrored", "they are mirrored; take them again"),
    ],
)
def test_bad_pictures_are_refused_in_one_sentence(
    refused, bad_pictures, options, sentence, monkeypatch
):
    monkeypatch.chdir(bad_pictures)
    assert sentence in refused(f"{CALIBRATE} {options} --force")


HALF = replace(VIEW, lens=Pinhole(320, 240, 260.0, (159.5, 119.5)))


CALIBRATES = "head calibrate --head head.json --serial H-07"
TAKES = "head photograph --camera camera:0"
INSPECTS = "head inspect --out s1"
BENCH = f"{INSPECTS} --actuator bench:head.toml"
SWEEPS = "head sweep --actuator twin:pipe --along 19,19.5 --out s1"
DRIVES = "head drive angles.csv --head head.json --actuator"
SEES = "head identify --actuator twin:pipe --specimen 3"


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("head identify --actuator twin:ipmc --store runs --head new.json", "two currents in A"),
        (
            "head identify --actuator twin:head --camera camera:0 --store runs --head new.json",
            "no calibration of the camera; calibrate it with minorloop head calibrate first",
        ),
        (f"{IDENTIFY} --head model.json", "not a valid file of a head"),
        (
            "head identify --actuator twin:head --store bare.json --head new.json",
            "--store is bare.json, a file; give the name of a folder",
        ),
        (
            "head identify --actuator twin:none --store runs --head bare.json --serial H-08",
            "bare.json is of head 'H-07', and the head here is 'H-08'",
        ),
        (f"{CALIBRATES} --leds 1,2,3 --serial H-08 --force", "and the head here is 'H-08'"),
        (f"{CALIBRATES} --leds 1,2,300 --force", "0.2 to 50 mm from the lens"),
        (f"{CALIBRATES} --force", "there is nothing to calibrate"),
        (f"{CALIBRATES} --leds 1,2,3 --head new.json", "the lens is not calibrated; give its pic"),
        (f"{CALIBRATES} --print-target target.doc", "end its name in .pdf, .svg, .png"),
        (f"{TAKES} --out new --plan count=0", "count is 0; give 1 to 1000"),
        (f"{TAKES} --out new --exposure 0", "--exposure is 0; give 0.01 to 1000 ms"),
        (f"{TAKES} --out new --exposure 2", "camera:0 does not let its exposure be set from here"),
        (f"{TAKES} --out new --actuator twin:head --plan highest=9", "beyond the limits"),
        (f"{INSPECTS} --actuator twin:pipe --camera camera:0", "twin:pipe has its own camera"),
        (
            f"{INSPECTS} --actuator twin:pipe --advances 0,103",
            "has 103, and the pipe ends at 102",
        ),
        (BENCH, "--actuator bench:head.toml needs --camera, and --head"),
        (
            f"{BENCH} --camera camera:0 --head bare.json --seed 3",
            "are of twin:pipe, and --actuator",
        ),
        (f"{BENCH} --camera camera:0 --head bare.json --resume", "there is no folder s1; give"),
        (f"{DRIVES} twin:pipe", "is of head 'H-07', and the head here is 'twin-head-nominal'"),
        (f"{DRIVES} twin:pipe --camera camera:0", "twin:pipe has its own camera; leave --cam"),
        (f"{DRIVES} bench:head.toml --hold 0.01", "hold is 0.01 s; give 0.04 to 3600 s"),
        (f"{DRIVES} bench:head.toml --hold 1e9", "hold is 1000000000.0 s; give 0.04 to 3600 s"),
        (f"{DRIVES.replace('angles', 'far')} bench:head.toml", "pan of target 1 is 80 degrees"),
        (f"{SEES} --store runs --head new.json --noise 0.1", "those of pictures; leave it out"),
        (f"{SEES} --store runs --head head.json", "and the head here is 'twin-head-3'"),
        (f"{SEES} --store seen --head new.json", "seen/camera.json is of head 'twin-head-4'"),
        (f"{SWEEPS} --actuator bench:head.toml", "is not a head with an ultrasonic probe"),
        (f"{SWEEPS} --along 19,31", "which are 12 mm; give at least 0.48, two widths"),
        (f"{SWEEPS} --around 10,5", "that is -5 degrees; give at least 2.8, two"),
        (f"{SWEEPS} --water dry", "a dry pipe cannot be swept"),
        (f"{SWEEPS} --water 12", "--water is 12; give full, dry, or its height above the axis of"),
    ],
)
@pytest.mark.usefixtures("targets")
def test_a_refusal_is_one_sentence_and_writes_nothing(run, command, sentence, monkeypatch):
    """It comes before a device is opened and before the head waits for its pictures."""
    for where in ("vision.video", "procedures.target_pictures"):
        monkeypatch.setattr(f"minorloop_head.{where}.LiveCamera", Still)
    waited = "minorloop_head.procedures.seen_angles.SeenHead"
    monkeypatch.setattr(waited, lambda *_, **__: pytest.fail("it waited"))
    known = HeadFile(serial="H-07", calibration=VIEW, calibrated=LATER)
    save_head(known, "head.json", force=True)
    save_head(HeadFile(serial="H-07"), "bare.json")
    Path("far.csv").write_text("pan [deg],tilt [deg]\n80,25\n")
    Path("seen").mkdir()
    Path("seen/camera.json").write_text(json.dumps({"serial": "twin-head-4", **VIEW.to_dict()}))
    before = {path: path.read_bytes() for path in Path().iterdir() if path.is_file()}
    status, out, error = run(command)
    *others, last = error.splitlines()
    assert (status, out, others in ([], [COMPILES])) == (2, "", True)
    assert sentence in last
    assert not Path("s1").exists()
    assert {path: path.read_bytes() for path in Path().iterdir() if path.is_file()} == before


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


def test_pictures_are_named_by_the_angles_of_the_joints_or_by_their_number(
    run, answer, monkeypatch
):
    monkeypatch.setattr("minorloop_head.procedures.target_pictures.LiveCamera", Still)
    take = "head photograph --camera camera:0"
    shown = answer(f"{take} --out mount --actuator twin:head --plan steps=2,hold=20")
    assert shown["pictures"] == 4
    names = sorted(path.name for path in Path("mount").iterdir())
    angles = [tuple(map(float, re.search("pan(.*)_tilt(.*).png", name).groups())) for name in names]
    assert angles[0][0] < 10 < 20 < angles[3][0]
    assert angles[1][1] > angles[0][1] + 10
    status, _, error = run(f"{take} --out lens --plan count=3,every=0")
    assert (status, error.count("hold the target")) == (0, 3)
    assert sorted(path.name for path in Path("lens").iterdir()) == ["00.png", "01.png", "02.png"]
    status, _, error = run(f"{take} --out lens")
    assert (status, "lens" in error, error.count("\n")) == (2, True, 1)


def test_an_inspection_prints_its_tables_and_the_notes_of_an_error(run, script, monkeypatch):
    monkeypatch.setattr(
        "minorloop_head.inspection.heads.rig_at", lambda *given, probe: script.opened(given[-1])
    )
    head = HeadFile(
        serial="H-07", calibration=SCRIPTED, calibrated=datetime(2026, 1, 1, tzinfo=UTC)
    )
    save_head(head, "head.json")
    command = "head inspect --actuator bench:head.toml --camera camera:0 --head head.json --out"
    status, out, error = run(f"{command} found --advances 0,5")
    assert (status, "hole 1: " in error, "not confirmed" in out) == (0, True, True), error
    assert "2 findings (2 probable) in 8 views; seen in 1 view (1)" in out
    assert out.endswith("kept in found\n")
    assert json.loads(Path("found/findings.json").read_text())["head"] == "H-07"
    script.torn = {f"view {k}" for k in (1, 2, 3, 4)}
    status, out, error = run(f"{command} torn --json")
    assert (status, json.loads(out)["unusable"]) == (1, {"torn": 2})
    assert "no view could be searched" in error

    def interrupted(rig, name):
        raise KeyboardInterrupt

    script.before = interrupted
    status, _, error = run(f"{command} cut")
    assert (status, "0 findings in 0 views; interrupted; " in error) == (130, True)
    for places, words in (("-1", "--advances has -1; give 0 to"), ("5,5", "each place once")):
        assert words in run(f"{command} more --advances {places}")[2]


@pytest.mark.usefixtures("targets")
def test_the_simulated_head_inspects_its_pipe_without_a_camera_or_a_file(run, monkeypatch):
    from minorloop_head.procedures import inspection, probing

    monkeypatch.setattr(inspection, "views_of", lambda lens: np.radians([[25.0, 0.0]]))
    monkeypatch.setattr(probing, "touch", lambda rig, hole: rig.say("touch", "touched"))
    command = "head inspect --actuator twin:pipe --water dry --out found --json"
    status, out, error = run(command)
    assert (status, json.loads(out)["safe"]) == (0, True), error
    (row,) = json.loads(out)["findings"]
    assert (row["verdict"], row["depth [mm]"]) == ("no water", None)
    report = Path("found/report.html").read_text()
    assert "<td>level of the water</td><td>dry pipe</td>" in report
    assert "the pipe was dry, and the probe needs water" in report
    assert "90 at the bottom" in report
    file = Path("found/journal.jsonl")
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    wet = command.replace("dry", "3.5")
    assert "was 'dry' and is '3.5' now" in run(f"{wet} --resume")[2]
