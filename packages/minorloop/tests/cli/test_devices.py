import json
import shlex
from pathlib import Path

import pytest

from board_process import commands, simulated_board


def test_what_is_there_is_listed_without_opening_it(run, monkeypatch):
    monkeypatch.setattr("minorloop.devices.find_spec", lambda name: None)
    status, out, _ = run("devices --json")
    rows = {row["address"]: row for row in json.loads(out)["devices"]}
    assert status == 0
    assert rows["twin:ipmc"]["state"] == "simulated"
    assert rows["bench:NAME"]["what"] == "actuator"
    assert rows["modbus"]["state"] == "pip install 'minorloop[modbus]' brings pymodbus"


def test_devices_that_drivers_find_are_listed(run, monkeypatch):
    pytest.importorskip("serial", reason="needs pyserial: minorloop[instruments]")
    for driver in ("serial_board", "visa", "labjack", "daqmx"):
        monkeypatch.setattr(f"minorloop.lab.drivers.{driver}.found", lambda: ["thing 7"])
    status, out, _ = run("devices")
    assert status == 0
    assert "thing 7" in out
    assert "device for serial" in out


def test_actuators_are_made_safe_and_read(run, tmp_path):
    pytest.importorskip("pyvisa_py", reason="needs pyvisa-py: minorloop[instruments]")
    with simulated_board(tmp_path) as (address, _):
        status, out, _ = run(f"devices {shlex.quote(address)} twin:fibre --json")
        said = commands(tmp_path)
    rows = [(row["what"], row["state"]) for row in json.loads(out)["devices"]]
    assert status == 0
    assert rows[0] == ("serial number", "S-01")
    assert ("input x voltage [V], 0 to 100, 2500 a second", "safe at 0") in rows
    assert ("line valve", "at rest") in rows
    assert rows[3][0] == "output x [um]"
    # An actuator that was moved before does not come back all the way to 0.
    assert float(rows[3][1].removeprefix("reads ")) == pytest.approx(0.4, abs=0.2)
    assert said.index(["SAFE"]) < said.index(["GET"])
    assert ["SAFE"] in said[-5:]


def test_what_does_not_answer_is_a_row_and_exit_status_1(run, tmp_path):
    Path("bench.toml").write_text((tmp_path / "none").as_posix())
    status, out, error = run("devices bench:none.toml twin:fibre twin:nothing --json")
    rows = [row for row in json.loads(out)["devices"] if row["error"]]
    assert status == 1
    assert error == ""
    assert [row["address"] for row in rows] == ["bench:none.toml", "twin:nothing"]
    assert "cannot be read" in rows[0]["state"]
