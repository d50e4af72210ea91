import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from minorloop.head.geometry import Pinhole
from minorloop.head.procedures.calibration import HeadCalibration
from minorloop.head.procedures.head_file import HeadFile, read_head, save_head

VIEW = HeadCalibration(lens=Pinhole(), leds=np.zeros((1, 3)))
LATER = datetime(2226, 1, 1, tzinfo=UTC)
IDENTIFY = "head identify --actuator twin:head --noise 0.05 --bands 2 --hold 12 --store runs"


def test_a_head_is_identified_once_and_driven_by_its_file(run):
    status, out, error = run(f"{IDENTIFY} --head head.json --specimen 1000 --json")
    assert (status, error.count("error")) == (0, 0)
    printed = json.loads(out)
    assert printed["serial"] == "twin-head-1000"
    assert set(printed["check"]) == {"pan", "tilt"}
    Path("angles.csv").write_text("pan [deg],tilt [deg]\n30,25\n")
    drive = "head drive angles.csv --head head.json"
    status, out, _ = run(
        f"{drive} --actuator twin:head --specimen 1000 --save reached.csv --hold 6 --json"
    )
    assert status == 0
    assert json.loads(out)["rms_deg"] < 4.0
    assert Path("reached.csv").read_text().startswith("time [s],wanted pan [deg],pan [deg],pan [A]")
    status, _, error = run(f"{drive} --actuator twin:head --specimen 3")
    assert status == 2
    assert "is of head 'twin-head-1000', and the head here is 'twin-head-3'" in error
    status, _, error = run(f"{IDENTIFY} --head head.json --specimen 1000")
    assert status == 2
    assert "--force" in error
    later = replace(read_head("head.json"), calibration=VIEW, calibrated=LATER)
    save_head(later, "head.json", force=True)
    status, _, error = run(f"{IDENTIFY} --head head.json --specimen 1000 --force")
    assert status == 2
    assert "before its calibration on 2226-01-01 00:00 UTC; identify them again" in error
    pytest.importorskip("starlette", reason="needs starlette and uvicorn: minorloop[head]")
    status, _, error = run("console --port 0 --head head.json")
    assert status == 2
    assert "is of head 'twin-head-1000'" in error


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (f"{IDENTIFY} --head head.json --bands 1", "bands"),
        ("head identify --actuator twin:ipmc --store runs --head head.json", "two currents in A"),
        (f"{IDENTIFY} --head head.json --serial H-07", "--serial is 'H-07'"),
        (f"{IDENTIFY} --head model.json", "not a valid file of a head"),
        ("head drive targets.csv --head none.json --actuator twin:head", "there is no file"),
        (f"{IDENTIFY} --head other.json", "other.json is of head 'H-07'"),
    ],
)
def test_refuses_in_one_sentence(run, command, sentence):
    save_head(HeadFile(serial="H-07"), "other.json")
    status, out, error = run(command)
    assert (status, out) == (2, "")
    assert sentence in error
    assert error.count("\n") == 1
    assert read_head("other.json").identified is None
