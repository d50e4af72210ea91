import threading
from pathlib import Path

import pytest

from minorloop.fleet import _reading, results
from minorloop.fleet._pool import Pool
from minorloop.fleet._reading import read_records, read_within
from minorloop.fleet.manifest import Specimen, read_manifest


class Hanging(Specimen):
    """A specimen whose record is read only after the gate is opened."""

    def read(self):
        GATE.wait()
        return b"late"


GATE = threading.Event()


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    GATE.clear()
    for name in ("_SOON", "_SOON_IF_LATE", "TICK", "NOTICE"):
        monkeypatch.setattr(_reading, name, 0.0)
    yield
    GATE.set()


@pytest.fixture
def specimens(tmp_path):
    (tmp_path / "a.csv").write_text("u,y\n")
    sound = Specimen("sound", tmp_path / "a.csv", "u", "y")
    return [Hanging("hung", Path("hung.csv"), "u", "y"), sound]


def test_a_record_that_hangs_does_not_delay_the_others_and_fails_by_the_limit(specimens):
    said, failed = [], []
    found = read_records(specimens, 0.5, said.append, lambda one, why: failed.append((one, why)))
    assert [one[0].name for one in found if one] == ["sound"]
    assert "the record of specimen hung has not been read for" in said[0]
    ((one, why),) = failed
    assert one.name == "hung"
    assert "not read within 0.5 s" in str(why)


def test_a_late_record_is_used_when_it_comes(specimens):
    order = []
    for found in read_records(specimens, 60.0, order.append, None):
        if found is not None:
            order.append(found[0].name)
            GATE.set()
    assert [text for text in order if " " not in text] == ["sound", "hung"]


def test_a_record_of_an_earlier_start_that_hangs_is_not_waited_for(
    specimens, monkeypatch, tmp_path
):
    with pytest.raises(TimeoutError):
        read_within(specimens[0], 0.0)
    monkeypatch.setattr(results, "_READING", 0.0)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "hung.json").write_text('{"specimen": "hung", "error": "e"}')
    assert results.earlier_outcomes(tmp_path, specimens[:1], failed=True) == {}


def test_a_pool_waits_for_tasks_that_are_not_ready():
    assert list(Pool(1, 60.0, None, print).run([None, None])) == [None, None]


def test_a_loop_of_links_fails_one_specimen_only(tmp_path):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    (tmp_path / "a.csv").write_text("u,y\n")
    (tmp_path / "m.csv").write_text("specimen,file,input,output\nl,loop.csv,u,y\na,a.csv,u,y\n")
    failed = []
    found = read_records(
        read_manifest(tmp_path / "m.csv"), 60.0, print, lambda one, why: failed.append((one, why))
    )
    assert [one[0].name for one in found if one] == ["a"]
    ((one, why),) = failed
    assert one.name == "l"
    assert "symbolic links" in str(why)
