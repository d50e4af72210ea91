import threading

import pytest

from minorloop.errors import RecordError
from minorloop_head.console import recording
from minorloop_head.console.recording import (
    PICTURE,
    TEXT,
    Recorder,
    SessionRecording,
    entries,
    listed,
)

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
        self.close, self.closed = file.close, False

    def write(self, content):
        return self._file.write(content[: len(content) // 2])


@pytest.fixture
def kept(tmp_path):
    """Recordings that are written by a thread, and why they ended."""
    said = []
    found = SessionRecording(tmp_path, said.append)
    threading.Thread(target=found.write, daemon=True).start()
    return found, said


def test_recordings_follow_each_other_and_each_has_its_own_entries(kept, tmp_path):
    sessions, said = kept
    for name, entry in zip(("one", "two"), SAID, strict=False):
        sessions.begin(name)
        sessions.keep(*entry)
        late = sessions.recorder
        sessions.end()
        sessions._unwritten.put((late, SAID[2]))  # kept by a thread that saw it go on
    sessions.keep(*SAID[2])  # none goes on
    sessions.close(10.0)
    assert list(entries(tmp_path / "one.session")) == SAID[:1]
    assert list(entries(tmp_path / "two.session")) == SAID[1:2]
    assert said == []


def test_after_a_recording_that_the_disk_ended_another_one_can_begin(kept, tmp_path):
    sessions, said = kept
    sessions.begin("full")
    sessions.recorder._file = Full(sessions.recorder._file)
    sessions.keep(*SAID[1])
    sessions.close(10.0)
    (sentence,) = said
    assert "No space left" in sentence
    sessions.begin("next")
    sessions.keep(*SAID[0])
    sessions.close(10.0)
    assert list(entries(tmp_path / "next.session")) == SAID[:1]


def test_a_disk_that_is_too_slow_ends_the_recording_and_nothing_waits_for_it(monkeypatch, tmp_path):
    monkeypatch.setattr(recording, "MOST_UNWRITTEN", 2)
    said = []
    sessions = SessionRecording(tmp_path, said.append)  # nothing writes it
    sessions.begin("slow")
    for _ in range(4):
        sessions.keep(*SAID[0])
    sessions.close(0.0)
    assert (sessions.recorder, said) == (None, ["the disk is too slow; recording ended"])
    threading.Thread(target=sessions.write, daemon=True).start()
    sessions.close(10.0)
    assert list(entries(tmp_path / "slow.session")) == SAID[:1] * 3


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
