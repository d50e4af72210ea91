import pytest

from minorloop.errors import RecordError
from minorloop.head.console.recording import PICTURE, TEXT, Recorder, entries, listed

SAID = [(TEXT, 1.0, b'{"type":"hello"}'), (PICTURE, 1.04, b"\x01" * 500), (TEXT, 1.08, b"{}")]


@pytest.fixture
def recorded(tmp_path):
    recorder = Recorder(tmp_path / "sessions", "one")
    for entry in SAID:
        recorder.write(*entry)
    recorder.close()
    return recorder.path


def test_what_was_written_is_read(recorded):
    assert list(entries(recorded)) == SAID
    assert listed(recorded.parent) == ["one"]


def test_entries_survive_without_closing(tmp_path):
    recorder = Recorder(tmp_path, "killed")
    recorder.write(*SAID[0])
    assert list(entries(recorder.path)) == SAID[:1]
    recorder.close()


def test_an_entry_that_the_disk_does_not_take_leaves_nothing(tmp_path):
    recorder = Recorder(tmp_path, "full")
    recorder.write(*SAID[0])
    file, recorder._file = recorder._file, Full(recorder._file)
    with pytest.raises(OSError, match="No space left"):
        recorder.write(*SAID[1])
    recorder._file = file
    recorder.write(*SAID[2])
    recorder.close()
    assert list(entries(recorder.path)) == [SAID[0], SAID[2]]


class Full:
    """A file that writes only half of the content, as on a disk that becomes full."""

    def __init__(self, file):
        self._file, self.truncate, self.seek = file, file.truncate, file.seek

    def write(self, content):
        return self._file.write(content[: len(content) // 2])


def test_wherever_it_was_cut_what_is_whole_is_read(recorded):
    content = recorded.read_bytes()
    for cut in range(21, len(content), 7):
        recorded.write_bytes(content[:cut])
        found = list(entries(recorded))
        assert found == SAID[: len(found)]
        assert len(found) < len(SAID)


def test_what_is_no_recording_is_refused(recorded):
    damaged = recorded.read_bytes()
    recorded.write_bytes(b"something else")
    with pytest.raises(RecordError, match="not a recorded session"):
        list(entries(recorded))
    recorded.write_bytes(damaged[:20] + b"\xff" * 40)
    with pytest.raises(RecordError, match="damaged"):
        list(entries(recorded))


def test_a_recording_is_never_replaced(recorded):
    with pytest.raises(FileExistsError):
        Recorder(recorded.parent, "one")


def test_only_recordings_are_listed(recorded):
    (recorded.parent / "notes.session").write_text("not one")
    (recorded.parent / "folder.session").mkdir()
    assert listed(recorded.parent) == ["one"]


def test_a_missing_folder_has_no_recordings(tmp_path):
    assert listed(tmp_path / "none") == []
