import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop import OutputError, ParameterError, RecordError, files
from minorloop.files import (
    check_name,
    check_writable,
    first_difference,
    kind_of_file,
    make_folder,
    printable,
    table_text,
    unquoted,
    write_atomically,
)


def test_an_existing_file_is_replaced_only_by_force(tmp_path):
    file = tmp_path / "kept.csv"
    file.write_text("kept")
    with pytest.raises(OutputError, match=r"kept\.csv exists already; .* force"):
        check_writable(file)
    assert check_writable(str(file), force=True) == file
    assert file.read_text() == "kept"


@pytest.mark.parametrize(
    ("path", "complaint"),
    [
        ("", "is a folder; give the name of a file"),
        ("missing/new.csv", "missing does not exist; make it first"),
        ("x" * 300, "cannot be written"),
        ("a\0b", "cannot be written"),
    ],
)
@pytest.mark.parametrize("force", [False, True])
def test_refuses_places_that_cannot_hold_a_file(tmp_path, path, complaint, force):
    with pytest.raises(OutputError, match=complaint):
        check_writable(tmp_path / path, force=force)


def test_refuses_a_folder_closed_to_writing(tmp_path, monkeypatch):
    monkeypatch.setattr(files.os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="cannot be written to; choose another one"):
        check_writable(tmp_path / "new.csv")
    with pytest.raises(OutputError, match="cannot be written to; choose another one"):
        make_folder(tmp_path)


@pytest.mark.parametrize("content", ["µm\r\n1\n", b"\x00\xff"])
def test_writes_exactly_the_content_and_no_other_file(tmp_path, content):
    for _ in range(2):
        write_atomically(tmp_path / "file", content)
    expected = content if isinstance(content, bytes) else content.encode()
    assert (tmp_path / "file").read_bytes() == expected
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("name", "begin", "kind"),
    [
        ("a.json", b'{"format": "minorloop rig", "version": 1', "a rig file"),
        ("a.json", b'{\n  "version": 1, "format": "minorloop model"', "a model file"),
        ("a.csv", b'{"devices": {', "a JSON file"),
        ("a.csv", b"x [deg],y [deg]", "a table"),
        ("a.toml", b"tick = 0.04", "a TOML file"),
        ("a.txt", b"{u},{y}", ""),
    ],
)
def test_what_a_file_is_is_known_by_its_begin_or_its_ending(name, begin, kind):
    assert kind_of_file(name, begin) == kind


def test_a_failure_leaves_the_old_file_and_no_other(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "replace", full)
    with pytest.raises(OutputError, match="file cannot be written: No space left"):
        write_atomically(file, "new")
    assert file.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_writes_through_a_link_and_keeps_it(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("old")
    link.symlink_to(target)
    write_atomically(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_folder_is_made_with_its_parents_and_accepted_if_empty(tmp_path):
    folder = make_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert make_folder(folder) == folder
    (folder / "file").touch()
    with pytest.raises(OutputError, match="not empty"):
        make_folder(folder)


@pytest.mark.parametrize(
    ("before", "now", "says"),
    [
        ({}, {}, ""),
        ({"a": 1, "b": {"c": [1, 2]}}, {"b": {"c": [1, 2]}, "a": 1.0}, ""),
        ({"a": 1}, {"a": 2}, "a was 1 and is 2 now"),
        ({"a": 1}, {}, "a was 1 and is left out now"),
        ({"b": {"c": 1}}, {"b": {"c": 1, "d": "x"}}, "b.d was left out and is 'x' now"),
        ({"b": {"c": 1}}, {"b": 1}, "b was {'c': 1} and is 1 now"),
    ],
)
def test_the_first_difference_is_named(before, now, says):
    assert first_difference(before, now) == says


CONTROL = ["\0", "\t", "\n", "\r", "\x1b", "\x7f", "\x85", "\x9b", "\u061c", "\u200e", "\u200f"]
CONTROL += ["\u2028", "\u2029", "\u202a", "\u202e", "\u2066", "\u2069"]


@pytest.mark.parametrize("letter", CONTROL)
def test_refuses_names_with_control_characters(letter):
    with pytest.raises(RecordError, match=f"the name .* U\\+{ord(letter):04X}") as caught:
        check_name("the name", f"a{letter}b", RecordError)
    assert str(caught.value).isprintable()
    with pytest.raises(ParameterError):
        check_name("the name", letter)
    assert printable(f"a{letter}b") == "a\N{REPLACEMENT CHARACTER}b"


@pytest.mark.parametrize(
    "text", ["=1+1", "+1+1", "-1-1", "@SUM(1)", "\tx", " =1", "'=1", "\uff1dx", "-", "=cmd|'x'!A0"]
)
def test_texts_that_begin_like_formulas_are_quoted(text):
    written = table_text([text], [[text, 1.5]])
    for cell in (row[0] for row in csv.reader(io.StringIO(written))):
        assert cell == f"'{text}"
        assert unquoted(cell) == text


@pytest.mark.parametrize(
    "cell", [-1.5, 1e-300, float("nan"), None, 3, "-1.5", "+2", "-1e-5", "a=1"]
)
def test_numbers_stay_numbers(cell):
    (row,) = csv.reader(io.StringIO(table_text([cell], [])))
    assert row == ["" if cell is None else str(cell)]


@given(st.lists(st.text(st.sampled_from("'=+-@ \tab1.,;\"\n\uff0b"), max_size=6), min_size=1))
def test_the_texts_of_a_table_are_read_back(cells):
    rows = csv.reader(io.StringIO(table_text(cells, [cells]), newline=""))
    assert [[unquoted(cell) for cell in row] for row in rows] in ([cells, cells], [[], []])
