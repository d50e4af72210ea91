import os

import pytest

from minorloop import files
from minorloop.errors import OutputError
from minorloop.files import check_writable, first_difference, make_folder, write_atomically


def test_a_new_name_in_an_existing_folder_is_writable(tmp_path):
    assert check_writable(tmp_path / "new.csv") == tmp_path / "new.csv"
    assert not (tmp_path / "new.csv").exists()


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


def test_never_replaces_a_device():
    with pytest.raises(OutputError, match="not a regular file"):
        check_writable(os.devnull, force=True)


def test_refuses_a_folder_closed_to_writing(tmp_path, monkeypatch):
    monkeypatch.setattr(files.os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="cannot be written to; choose another one"):
        check_writable(tmp_path / "new.csv")
    with pytest.raises(OutputError, match="cannot be written to; choose another one"):
        make_folder(tmp_path)


@pytest.mark.parametrize("content", ["µm\r\n1\n", b"\x00\xff"])
def test_writes_exactly_what_it_is_given_and_nothing_else(tmp_path, content):
    for _ in range(2):
        write_atomically(tmp_path / "file", content)
    expected = content if isinstance(content, bytes) else content.encode()
    assert (tmp_path / "file").read_bytes() == expected
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_a_failure_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
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


def test_a_folder_is_made_with_its_parents_and_taken_again_while_empty(tmp_path):
    folder = make_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert make_folder(folder) == folder
    (folder / "file").touch()
    with pytest.raises(OutputError, match="not empty"):
        make_folder(folder)


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="is a file; give the name of a folder"):
        make_folder(tmp_path / "file")
    with pytest.raises(OutputError, match="cannot be written"):
        make_folder(tmp_path / "file" / "inside")


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
