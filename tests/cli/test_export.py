import json

import pytest

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


def test_figures_as_json(answer):
    found = answer(f"{LINE} --name wing")
    assert found["files"] == ["wing.h", "wing.c", "wing_selftest.c"]
    assert found["memory"] == 32
    assert found["table_bytes"] > 0
    assert found["state_bytes"] > 0
    assert found["drop_error"] > 0


def test_a_linear_part_from_a_file(run, tmp_path):
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
    ],
)
def test_a_linear_part_that_cannot_be_used(refused, tmp_path, content, message):
    (tmp_path / "lag.json").write_text(content)
    assert message in refused(f"{LINE} --linear lag.json")
    assert not (tmp_path / "firmware").exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("export rust model.json --out x", "no export 'rust'; give one of c, fmu"),
        ("export c nothing.json --out x", "there is no file nothing.json"),
        ("export c good.csv --out x", "good.csv"),
        (f"{LINE} --memory 2", "memory is 2 extrema"),
        (f"{LINE} --largest 100", "needs 1955 bytes, 595 of tables"),
        (f"{LINE} --linear nothing.json", "cannot be read"),
        ("export c model.json --out model.json", "is a file"),
    ],
)
def test_refusals(refused, line, message):
    assert message in refused(line)
