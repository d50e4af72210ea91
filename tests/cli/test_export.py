import json
import tomllib
from datetime import UTC, datetime

import numpy as np
import pytest

from minorloop import modelfile
from minorloop.dynamics.heated_wire import HeatedWire
from minorloop.head.control.limits import WireLimits
from minorloop.head.procedures.head_file import HeadFile, IdentifiedWires, save_head
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach

LINE = "export c model.json --out firmware"


def test_c_is_written_and_described(run, tmp_path):
    status, out, err = run(f"{LINE} --float32 --memory 16")
    assert (status, err) == (0, "")
    assert "./selftest" in out
    assert "length [um] against voltage [V]" in out
    assert {file.name for file in (tmp_path / "firmware").iterdir()} == {
        "minorloop.h",
        "minorloop.c",
        "minorloop_selftest.c",
    }
    assert "float" in (tmp_path / "firmware" / "minorloop.h").read_text()


def test_header_and_source_say_why_the_model_is_not_to_be_trusted(run, model, tmp_path):
    words = ["the output is clipped */ " + 12 * "everywhere ", "it lags"]
    modelfile.save(model, "model.json", warnings=words, force=True)
    assert run(LINE)[0] == 0
    for name in ("minorloop.h", "minorloop.c"):
        comment = (tmp_path / "firmware" / name).read_text().split("*/")[0]
        said = " ".join(comment.replace("\n *", " ").split())
        assert "WARNING: this model is not to be trusted: the output is clipped" in said
        assert "everywhere ; it lags" in said
        assert max(map(len, comment.splitlines())) <= 100


def test_figures_as_json(answer):
    found = answer(f"{LINE} --name wing")
    assert found["files"] == ["wing.h", "wing.c", "wing_selftest.c"]
    assert found["memory"] == 32
    assert found["table_bytes"] > 0
    assert found["state_bytes"] > 0
    assert found["drop_error"] > 0
    assert 0 < found["input_error"] < 1e-12


def test_a_linear_part_is_read_from_a_file(run, tmp_path):
    (tmp_path / "lag.json").write_text(
        json.dumps({"numerator": [0.2], "denominator": [1, -0.8], "interval": 0.01, "delay": 0.02})
    )
    assert run(f"{LINE} --linear lag.json --first linear")[0] == 0
    text = (tmp_path / "firmware" / "minorloop.h").read_text()
    assert "a linear part of order 1 before it" in text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[1]", "not an object with a numerator"),
        ('{"numerator": [1]}', "not an object with a numerator"),
        ('{"numerator": [1], "denominator": [1], "gain": 2}', "key 'gain'"),
        ('{"numerator": ["x"], "denominator": [1]}', "numerator"),
        ('{"numerator": [1], "denominator": [1, 0.5]}', "continuous"),
        ('{"numerator": [1], "denominator": [1], "interval": 1, "delay": 1e9}', "at most 100000"),
        ('{"numerator": [1], "denominator": [1], "interval": 1, "delay": true}', "delay True"),
    ],
)
def test_refuses_unusable_linear_parts(refused, tmp_path, content, message):
    (tmp_path / "lag.json").write_text(content)
    assert message in refused(f"{LINE} --linear lag.json")
    assert not (tmp_path / "firmware").exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("export rust model.json --out x", "no export 'rust'; give one of c, board, fmu"),
        ("export c nothing.json --out x", "there is no file nothing.json"),
        ("export c good.csv --out x", "good.csv"),
        (f"{LINE} --memory 2", "memory is 2;"),
        (f"{LINE} --largest -5", "largest is -5 bytes"),
        (f"{LINE} --largest 100", "needs 1955 bytes, 595 of tables"),
        (f"{LINE} --linear nothing.json", "cannot be read"),
        ("export c model.json --out model.json", "is a file"),
        ("export c model.json plays.json --out a", "c takes one model file, and there are 2"),
        (f"{LINE} --rate 3", "--rate does nothing for c"),
        (f"{LINE} --rate 0", "--rate does nothing for c"),
        ("export board model.json --out a --firmware", "--firmware does nothing for board"),
        ("export board model.json --out a --patience 0.001", "patience is 0.001 s"),
        ("export board model.json --out a --interval 0.0105", "interval is 0.0105 s"),
        ("export board model.json --out a --rate -1", "rate limit -1"),
        ("export board plays.json --out a", "has a PrandtlIshlinskii; firmware is written for"),
        ("export board nothing.json --out a", "there is no file nothing.json"),
        (f"{LINE} --interval 3", "--interval does nothing for c"),
        (f"{LINE} --first linear", "--first does nothing without --linear"),
        ("export fmu model.json --out a.fmu --float32", "--float32 does nothing for fmu"),
        ("export fmu model.json --out a.fmu --largest 10", "--largest does nothing for fmu"),
        ("export fmu model.json --out a.fmu --firmware", "--firmware does nothing for fmu"),
        ("export fmu model.json --out a.fmu --no-inverse", "--no-inverse does nothing for fmu"),
        ("export c plays.json --out a --memory 8", "--memory does nothing for a PrandtlIsh"),
    ],
)
def test_refusals(refused, line, message):
    plays = PrandtlIshlinskii([0.0, 0.5], [1.0, 1.0])
    modelfile.save(plays, "plays.json", input="voltage [V]", output="length [um]")
    assert message in refused(line)


def test_force_replaces_files(run, refused, tmp_path):
    assert run(LINE)[0] == 0
    (tmp_path / "firmware" / "main.c").write_text("mine")
    (tmp_path / "firmware" / "minorloop.c").write_text("old")
    assert "is not empty" in refused(LINE)
    assert run(f"{LINE} --force")[0] == 0
    assert (tmp_path / "firmware" / "main.c").read_text() == "mine"
    assert "levels" in (tmp_path / "firmware" / "minorloop.c").read_text()


def test_firmware_is_written_for_an_axis_of_each_model_file(answer, tmp_path):
    found = answer("export board model.json model.json --out firmware --rate 5")
    assert {"control.c", "axis0.c", "axis1.c", "Makefile", "README.md"} <= set(found["files"])
    bench = tomllib.loads((tmp_path / "firmware" / "bench.toml").read_text())
    assert [source["name"] for source in bench["sources"]] == ["voltage 1", "voltage 2"]
    assert [source["rate"] for source in bench["sources"]] == [5.0, 5.0]
    assert [sensor["of"] for sensor in bench["sensors"]] == ["voltage 1", "voltage 2"]


def test_firmware_of_a_head_has_its_limits_and_its_lines(run, refused, tmp_path):
    wire = HeatedWire(Preisach([0.0, 0.08, 0.16], [[1, 0], [2, 1]], relay="unipolar"), 4.0, 0.01)
    known = IdentifiedWires(
        on=datetime(2026, 1, 31, tzinfo=UTC),
        wires=(wire, wire),
        coupling=np.array([[1.0, 0.07], [0.06, 1.0]]),
        limits=WireLimits(hottest=60.0),
        highest=0.4,
        stores={},
    )
    save_head(HeadFile(serial="H-07", identified=known), "head.json")
    status, out, _ = run("export board head.json --out firmware")
    assert (status, "make -C firmware" in out) == (0, True)
    bench = tomllib.loads((tmp_path / "firmware" / "bench.toml").read_text())
    assert (bench["serial"], len(bench["lines"])) == ("H-07", 4)
    for source in bench["sources"]:  # no hotter than 60 degrees, with the margin of the limits
        assert source["high"] == pytest.approx(np.sqrt(40 / (1.15 * 676)))
    save_head(HeadFile(serial="H-07"), "empty.json")
    assert "has no identified wires" in refused("export board empty.json --out a")
