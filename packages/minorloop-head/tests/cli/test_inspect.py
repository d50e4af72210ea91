import json
import math
import re
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest

from minorloop_head.geometry import Mount, Pinhole, wall_distance
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import HeadFile, save_head
from minorloop_head.vision.calibrated_camera import CalibratedCamera
from vision.walls import photograph

LENS = Pinhole()
OPTIONS = "--lens 520 --radius 10 --lever 8"


def with_hole(phi, z):
    off = wall_distance(np.stack([phi, z], axis=-1), (0.0, 20e-3), 10e-3)
    return np.where(off < 0.5e-3, 0.0, 0.7 + 0.02 * np.sin(9000 * z))


@pytest.fixture(scope="module")
def image():
    camera = CalibratedCamera(LENS, Mount(lever=8e-3), np.zeros((1, 3)))
    return photograph(math.radians(24.0), 0.0, with_hole, camera=camera)


@pytest.fixture
def pictures(image):
    """A folder with a picture of a hole, and a black one."""
    folder = Path("pictures")
    folder.mkdir()
    cv2.imwrite("pictures/a.png", image)
    cv2.imwrite("pictures/b.png", np.zeros_like(image))
    return folder


@pytest.mark.usefixtures("pictures")
def test_a_folder_gives_a_table_json_marked_pictures_and_a_report(run):
    status, out, error = run(f"inspect pictures {OPTIONS} --pan 24 --out found --json")
    assert status == 0
    assert error == "1 picture inspected\n2 pictures inspected\n"
    printed = json.loads(out)
    assert (printed["pictures"], printed["unusable"]) == (2, {"black": 1})
    (found,) = printed["findings"]
    assert (found["picture"], found["kind"]) == ("a.png", "hole or pit")
    assert found["z [mm]"] == pytest.approx(20.0, abs=0.2)
    assert json.loads(Path("found/findings.json").read_text()) == printed
    unusable = {"picture": "b.png", "verdict": "black"}
    assert printed["unusable pictures"] == [unusable]
    table = Path("found/unusable.csv").read_text().splitlines()
    assert table == ["picture,verdict", "b.png,black"]
    header, row = Path("found/findings.csv").read_text().splitlines()
    assert header.startswith("picture,kind,phi [deg]")
    assert row.startswith("a.png,hole or pit")
    assert [path.name for path in Path("found/pictures").iterdir()] == ["000000.jpg"]
    assert "1 finding in 2 pictures; not usable: black (1)" in Path("found/report.html").read_text()


@pytest.mark.usefixtures("pictures")
def test_a_head_has_the_lens_and_a_file_the_poses(run):
    view = HeadCalibration(lens=LENS, leds=np.zeros((1, 3)), lever=8e-3)
    head = HeadFile(serial="H-07", calibration=view, calibrated=datetime(2026, 1, 1, tzinfo=UTC))
    save_head(head, "head.json")
    # As the sensors read them: 30 degrees along the pipe.
    Path("poses.csv").write_text("pan [deg],tilt [deg],advance [mm]\n54,30,5\n30,30,0\n")
    status, out, _ = run("inspect pictures --head head.json --poses poses.csv")
    assert status == 0
    assert "1 finding in 2 pictures" in out
    numbers = [float(number) for number in re.findall(r"\d+\.\d+", out)]
    assert min(abs(number - 25.0) for number in numbers) < 0.1  # z, moved by the advance
    status, out, _ = run("inspect pictures --head head.json --pan 54 --json")
    (found,) = json.loads(out)["findings"]  # a tilt that is not given is along the pipe
    assert found["z [mm]"] == pytest.approx(20.0, abs=0.2)


@pytest.mark.usefixtures("pictures")
def test_a_wall_that_is_too_far_away_is_said_to_be(run):
    status, out, error = run("inspect pictures/a.png --lens 520 --radius 400")
    assert status == 1
    assert error.startswith("1 picture inspected\n")
    assert "no picture could be searched, so that the wall was not inspected" in error
    assert "0 findings in 1 picture; not usable: no wall in view (1)" in out
    assert "check that --pan" in out


@pytest.mark.usefixtures("pictures")
@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        ("inspect pictures", "give one of --head"),
        ("inspect pictures --lens 520", "give --radius, in mm"),
        ("inspect pictures --lens -5 --radius 10", "focal lengths (-5.0"),
        ("inspect pictures --head small.json", "64 by 48"),
        ("inspect pictures --plate 0", "the size of a pixel is 0.0 m; give a length > 0"),
        ("inspect pictures --plate 0.5 --pan 3", "leave the pose out"),
        ("inspect pictures --head bare.json", "bare.json has no calibration"),
        ("inspect camera:0 --lens 520 --radius 10", "camera:0 is a camera"),
        (f"inspect pictures {OPTIONS} --poses good.csv", "has no columns 'pan [deg]'"),
        (f"inspect pictures {OPTIONS} --pan 400", "--pan is 400 degrees; give -180 to 180"),
        (f"inspect pictures {OPTIONS} --poses far.csv", "tilt of row 2 of far.csv is 300 degrees"),
    ],
)
def test_refuses_in_one_sentence(run, command, sentence):
    small = HeadCalibration(lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=np.zeros((1, 3)))
    when = datetime(2026, 1, 1, tzinfo=UTC)
    save_head(HeadFile(serial="H", calibration=small, calibrated=when), "small.json")
    save_head(HeadFile(serial="H"), "bare.json")
    Path("far.csv").write_text("pan [deg],tilt [deg]\n24,0\n0,300\n")
    status, out, error = run(command)
    assert (status, out) == (2, "")
    assert sentence in error.splitlines()[-1]


@pytest.mark.usefixtures("pictures")
def test_a_command_that_failed_can_be_given_again(run):
    Path("short.csv").write_text("pan [deg],tilt [deg]\n24,0\n")
    command = f"inspect pictures {OPTIONS} --poses short.csv --out found"
    status, out, error = run(command)
    assert (status, out) == (2, "")
    assert "1 row, and there are more pictures" in error.splitlines()[-1]
    Path("short.csv").write_text("pan [deg],tilt [deg]\n24,0\n24,0\n")
    assert run(command)[0] == 0


def test_a_truncated_picture_is_listed_and_the_others_are_searched(run, pictures, image):
    _, png = cv2.imencode(".png", image)
    (pictures / "0.png").write_bytes(png.tobytes()[:200])
    Path("poses.csv").write_text("pan [deg],tilt [deg]\n" + "24,0\n" * 3)
    status, out, _ = run(f"inspect pictures {OPTIONS} --poses poses.csv --json")
    assert status == 0
    printed = json.loads(out)
    assert printed["unusable"] == {"not readable": 1, "black": 1}
    assert [row["picture"] for row in printed["findings"]] == ["a.png"]


@pytest.mark.usefixtures("pictures")
def test_pictures_of_a_plate_are_searched_without_lens_or_pose(run):
    status, out, _ = run("inspect pictures --plate 0.5 --out found --json")
    assert status == 0
    assert json.loads(out)["unusable"] == {"black": 1}
    assert (
        Path("found/findings.csv").read_text().startswith("picture,kind,x [mm],y [mm],width [mm]")
    )
