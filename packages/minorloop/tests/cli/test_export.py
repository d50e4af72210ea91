import json

import pytest

from minorloop import modelfile
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

LINE = "export c model.json --out firmware"


def line(options):
    return LINE.replace("export c", f"export c:{options}")


def test_c_is_written_and_described(run, tmp_path):
    status, out, err = run(line("float32=yes,memory=16"))
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
    found = answer(line("name=wing"))
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
    assert run(line("linear=lag.json,first=linear"))[0] == 0
    text = (tmp_path / "firmware" / "minorloop.h").read_text()
    assert "a linear part of order 1 before it" in text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not a linear part"),
        ('{"numerator": [1]}', "missing required field `denominator`"),
        ('{"numerator": [1], "denominator": [1], "gain": 2}', "unknown field `gain`"),
        ('{"numerator": [1], "denominator": [1, 0.5]}', "continuous"),
    ],
)
def test_refuses_unusable_linear_parts(refused, tmp_path, content, message):
    (tmp_path / "lag.json").write_text(content)
    assert message in refused(line("linear=lag.json"))
    assert not (tmp_path / "firmware").exists()


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("export rust model.json --out x", "no export 'rust'; give one of c, fmu"),
        (line("largest=-5"), "largest is -5 bytes"),
        (line("largest=100"), "needs 1955 bytes, 595 of tables"),
        (line("linear=nothing.json"), "there is no file"),
        (f"{LINE} --interval 3", "an interval does nothing"),
        (line("first=linear"), "first does nothing without linear"),
        ("export fmu:float32=yes model.json --out a.fmu", "export fmu has no 'float32'"),
        ("export c:memory=8 plays.json --out a", "memory does nothing for a PrandtlIsh"),
    ],
)
def test_refusals(refused, command, message):
    plays = PrandtlIshlinskii([0.0, 0.5], [1.0, 1.0])
    modelfile.save(plays, "plays.json", input="voltage [V]", output="length [um]")
    assert message in refused(command)


def test_force_replaces_files(run, refused, tmp_path):
    assert run(LINE)[0] == 0
    (tmp_path / "firmware" / "main.c").write_text("mine")
    (tmp_path / "firmware" / "minorloop.c").write_text("old")
    assert "is not empty" in refused(LINE)
    assert run(f"{LINE} --force")[0] == 0
    assert (tmp_path / "firmware" / "main.c").read_text() == "mine"
    assert "levels" in (tmp_path / "firmware" / "minorloop.c").read_text()
