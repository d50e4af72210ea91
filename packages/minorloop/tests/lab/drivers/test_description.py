import pytest

from minorloop.errors import ParameterError
from minorloop.lab.drivers.description import read_description, relevant


def test_a_file_is_toml_or_json_by_its_name(tmp_path):
    (tmp_path / "a.toml").write_text("tick = 0.04\n[devices.board]\nresource = 'x'\n")
    (tmp_path / "a.json").write_text('{"tick": 0.04, "devices": {"board": {"resource": "x"}}}')
    assert read_description(tmp_path / "a.toml") == read_description(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("a.toml", "tick = ", "does not describe a bench"),
        ("a.toml", b"\xff\xfe", "does not describe a bench"),
        ("a.json", "[]", "it has list, not a table"),
        ("a.json", " " * 1_000_001, "is larger than 1000000 bytes"),
        ("none.toml", None, "cannot be read: No such file"),
    ],
)
def test_files_that_describe_nothing(tmp_path, name, text, sentence):
    if text is not None:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ParameterError, match=sentence):
        read_description(tmp_path / name)


def test_what_no_reading_depends_on_is_left_out():
    values = {
        "tick": 1,
        "timeout": 2,
        "devices": {"a": {"baud": 3, "on": 4}},
        "of": [{"done": 1}],
    }
    assert relevant(values) == {"tick": 1, "devices": {"a": {"on": 4}}, "of": [{}]}
