import dataclasses
import os
import resource
import sqlite3
import subprocess
import sys
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from minorloop import OutputError, ParameterError, Plan, Setup, Store, StoreError
from minorloop.files import lock_path
from minorloop.lab import _store_file as store_file
from minorloop.lab._store_file import is_store
from minorloop.lab.store import Point

LEVELS = [0.0, 0.5, -0.25, np.nan, 1.0]
PLAN = Plan(LEVELS, 40.0, input="voltage [V]")
SETUP = Setup("twin:ipmc", "voltage [V]", "curvature [1/m]", specimen=3, options={"noise": 0.1})
STATE = {"state": [0.1, 0.2, -1e-17], "samples": 40}


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    monkeypatch.setattr(store_file, "LOCK_WAIT", 0.01)


def _point(index, /, **changed):
    level = PLAN.inputs[index]
    fields = {
        "index": index,
        "input": 0.75 if np.isnan(level) else float(level),
        "value": np.sin(index),
        "sd": 0.01,
        "verdict": "settled",
        "t": 40.0 * (index + 1),
        "held": 40.0,
        "checkpoint": STATE,
        "sample_interval": 8.0,
        "time_uncertainty": 0.05,
    }
    return Point(**{**fields, **changed})


def _trace(index, samples=5):
    t = np.arange(1, samples + 1) * 40.0 / samples
    return t, np.cos(index + t)


def _filled(path, points=3):
    """A store in the middle of a run, closed."""
    with Store.create(path, PLAN, SETUP) as store:
        store.set_origin(STATE)
        with suppress(KeyboardInterrupt), store.session("fresh"):
            for index in range(points):
                store.add(_point(index), *_trace(index))
            raise KeyboardInterrupt
    return path


def _content(path, *, write=False):
    """All that a store can tell, as text, so that NaN equals NaN."""
    with Store.open(path, write=write) as store:
        traces = [[part.tolist() for part in store.trace(k)] for k in range(len(store))]
        told = (store.points(), store.sessions(), store.origin(), store.finished, store.last())
        return repr((store.plan.to_json(), store.setup, traces, told, store.columns()))


def _folder_is_clean(folder, *names):
    return sorted(entry.name for entry in folder.iterdir()) == sorted(names)


class TestKeeping:
    def test_points_are_read_as_they_were_written(self, tmp_path):
        with Store.open(_filled(tmp_path / "a.sqlite")) as store:
            assert store.plan.difference(PLAN) == ""
            assert store.setup == SETUP
            assert store.points() == [_point(k) for k in range(3)]
            assert store.last() == _point(2)
            assert store.origin() == STATE
            assert len(store) == 3
            assert not store.finished
            for index in range(3):
                np.testing.assert_array_equal(store.trace(index), _trace(index))
            record, columns = store.record(), store.columns()
            (session,) = store.sessions()
            assert (session.first, session.mode, session.end) == (0, "fresh", "interrupted")
            assert session.began <= session.ended
        np.testing.assert_array_equal([record.u, record.t], [LEVELS[:3], [40.0, 80.0, 120.0]])
        assert (str(record.input), str(record.output)) == ("voltage [V]", "curvature [1/m]")
        assert columns["index"] == [0, 1, 2]
        assert columns["voltage [V]"] == LEVELS[:3]
        assert {len(column) for column in columns.values()} == {3}
        assert list(columns)[2:5] == ["curvature [1/m]", "sd [1/m]", "verdict"]
        assert _folder_is_clean(tmp_path, "a.sqlite")

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=20)
    @given(data=st.data())
    def test_every_float_is_kept_to_the_last_bit(self, tmp_path, data):
        numbers = st.floats(allow_infinity=False)
        levels = data.draw(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=3))
        plan = Plan(levels, 40.0)
        path = tmp_path / f"{os.urandom(8).hex()}.sqlite"
        added = []
        with Store.create(path, plan, SETUP) as store:
            for index, level in enumerate(levels):
                state = data.draw(st.none() | st.dictionaries(st.text(), st.floats() | st.text()))
                value, sd = data.draw(numbers), data.draw(numbers)
                point = Point(index, level, value, sd, "settled", 40.0, 40.0, state)
                y = data.draw(st.lists(st.floats(), min_size=1, max_size=4))
                store.add(point, np.arange(len(y)), np.array(y))
                added.append((point, y))
        with Store.open(path) as store:
            for (point, y), kept in zip(added, store.points(), strict=True):
                assert repr(kept).replace("-0.0", "0.0") == repr(point).replace("-0.0", "0.0")
                np.testing.assert_array_equal(store.trace(point.index)[1], y)

    def test_it_is_finished_with_the_last_level_or_when_it_is_enough(self, tmp_path):
        with Store.create(tmp_path / "a", PLAN, SETUP) as store:
            for index in range(len(PLAN)):
                assert not store.finished
                store.add(_point(index), *_trace(index))
            assert store.finished
            with pytest.raises(ParameterError, match="has 5 of 5 points"):
                store.add(_point(4, index=5), *_trace(5))
        with Store.open(_filled(tmp_path / "b"), write=True) as store:
            store.set_enough()
            with pytest.raises(ParameterError, match="has 3 of 5 points"):
                store.add(_point(3), *_trace(3))
        with Store.open(tmp_path / "b") as store:
            assert store.finished

    @pytest.mark.parametrize("name", ["a b?c#d%20e", "ä.sqlite", "file:x?mode=ro", ":memory:"])
    def test_a_name_is_only_a_name(self, tmp_path, monkeypatch, name):
        monkeypatch.chdir(tmp_path)
        _filled(name)
        assert is_store(name)
        assert len(_content(name)) > 100
        assert _folder_is_clean(tmp_path, name)


class TestRefusals:
    def test_only_the_next_point_of_the_plan_is_added(self, tmp_path):
        with Store.create(tmp_path / "a", PLAN, SETUP) as store:
            for index in (1, 4, -1):
                with pytest.raises(ParameterError, match=f"point {index} cannot be added"):
                    store.add(_point(index, index=index), *_trace(0))
            with pytest.raises(ParameterError, match=r"point 0 was taken at 0\.1; its level is 0"):
                store.add(_point(0, input=0.1), *_trace(0))
            with pytest.raises(ParameterError, match="point 0 was taken at nan"):
                store.add(_point(0, input=np.nan), *_trace(0))
            with pytest.raises(ParameterError, match=r"times \(5,\) and outputs \(4,\)"):
                store.add(_point(0), _trace(0)[0], np.zeros(4))
            assert len(store) == 0
            for index in range(3):
                store.add(_point(index), *_trace(index))
            for level in (np.nan, np.inf):
                with pytest.raises(ParameterError, match=f"point 3 was taken at {level}; .* open"):
                    store.add(_point(3, input=level), *_trace(3))
            for index in (3, -1):
                with pytest.raises(ParameterError, match=f"no point {index}; .* the first 3"):
                    store.trace(index)

    def test_another_run_is_refused(self, tmp_path):
        with Store.create(tmp_path / "a", PLAN, SETUP) as store:
            store.check_same(Plan(LEVELS, 40.0, input="voltage [V]"), SETUP)
            with pytest.raises(StoreError, match=r"run: inputs.1 was 0\.5 and is 0\.4 now; give"):
                store.check_same(Plan([0.0, 0.4, -0.25, 0, 1], 40.0, input="voltage [V]"))
            for changes, says in (
                ({"specimen": 4}, "specimen was 3 and is 4 now"),
                ({"options": {"noise": 0.2}}, r"options.noise was 0\.1 and is 0\.2 now"),
            ):
                with pytest.raises(StoreError, match=says):
                    store.check_same(PLAN, dataclasses.replace(SETUP, **changes))

    def test_nothing_is_replaced(self, tmp_path):
        (tmp_path / "a").write_text("kept")
        with pytest.raises(OutputError, match="exists already"):
            Store.create(tmp_path / "a", PLAN, SETUP)
        assert (tmp_path / "a").read_text() == "kept"
        with pytest.raises(ParameterError, match="cannot be written as JSON"):
            Store.create(tmp_path / "b", PLAN, Setup("a", "u", "y", options={"noise": {1, 2}}))
        assert _folder_is_clean(tmp_path, "a")
        with pytest.raises(OutputError, match="does not exist; make it first"):
            Store.create(tmp_path / "no" / "a", PLAN, SETUP)

    def test_what_appears_meanwhile_is_not_replaced_either(self, tmp_path, monkeypatch):
        def late(path, **_):
            Path(path).write_text("kept")
            return Path(path)

        monkeypatch.setattr(store_file, "check_writable", late)
        with pytest.raises(OutputError, match="exists already"):
            Store.create(tmp_path / "a", PLAN, SETUP)
        assert (tmp_path / "a").read_text() == "kept"
        assert _folder_is_clean(tmp_path, "a")

    def test_a_file_system_without_links_will_do(self, tmp_path, monkeypatch):
        def refuse(*_):
            raise PermissionError(1, "Operation not permitted")

        monkeypatch.setattr(os, "link", refuse)
        _filled(tmp_path / "a")
        assert _folder_is_clean(tmp_path, "a")

    @pytest.mark.parametrize(("length", "fits"), [(247, True), (248, False), (251, False)])
    def test_a_name_leaves_room_for_those_beside_it(self, tmp_path, length, fits):
        path = tmp_path / ("n" * length)
        if fits:
            assert len(_content(_filled(path), write=True)) > 100
            return
        with pytest.raises(OutputError, match=r"up to 8 more characters .*; give a shorter name"):
            Store.create(path, PLAN, SETUP)
        assert _folder_is_clean(tmp_path)

    @pytest.mark.parametrize("write", [False, True])
    @pytest.mark.parametrize(
        ("content", "says"),
        [
            (b"", "not an experiment store"),
            (b"u,y\n1,2\n", "not an experiment store"),
            (b"SQLite format 3\0" + b"\xff" * 4096, "it is not an experiment store, or damaged"),
            (bytes(5000), "it is not an experiment store, or damaged"),
        ],
    )
    def test_a_file_that_is_no_store(self, tmp_path, content, says, write):
        (tmp_path / "a").write_bytes(content)
        with pytest.raises(StoreError, match=says):
            Store.open(tmp_path / "a", write=write)
        assert (tmp_path / "a").read_bytes() == content
        assert _folder_is_clean(tmp_path, "a")

    @pytest.mark.parametrize("version", [1, store_file.VERSION + 1])
    def test_a_store_of_another_version(self, tmp_path, version):
        path = _filled(tmp_path / "a")
        hand = sqlite3.connect(path)
        hand.execute(f"PRAGMA user_version = {version}")
        hand.close()
        with pytest.raises(StoreError, match=f"has format {version} and this minorloop reads 2"):
            Store.open(path)

    def test_who_opens_to_read_does_not_write(self, tmp_path):
        before = _filled(tmp_path / "a").read_bytes()
        with Store.open(tmp_path / "a") as store:
            with pytest.raises(StoreError, match="protected against writing; its points are kept"):
                store.add(_point(3), *_trace(3))
            with (
                pytest.raises(StoreError, match="protected against writing"),
                store.session("restored"),
            ):
                pass
        assert (tmp_path / "a").read_bytes() == before


@contextmanager
def _without_privileges(folder):
    """Be nobody, for whom rights count; a superuser may write everywhere."""
    if os.geteuid() != 0:
        yield
        return
    for path in (folder, *folder.iterdir()):
        os.chown(path, 65534, 65534)
    os.setresuid(65534, 65534, 0)
    try:
        yield
    finally:
        os.setresuid(0, 0, 0)


class TestRights:
    @pytest.fixture
    def folder(self):
        """A folder that nobody can reach; those above a test's own are closed to others."""
        with tempfile.TemporaryDirectory() as name:
            yield Path(name)

    def test_a_folder_or_a_file_closed_to_writing_gives_but_does_not_take(self, folder):
        path = _filled(folder / "a")
        expected = _content(path)
        for closed, rights, says in (
            (folder, 0o555, "and its folder must be writable"),
            (path, 0o444, "must be writable; check their permissions"),
        ):
            before = closed.stat().st_mode
            closed.chmod(rights)
            with _without_privileges(folder):
                assert _content(path) == expected
                with pytest.raises(StoreError, match=says):
                    Store.open(path, write=True)
            closed.chmod(before)
        path.chmod(0)
        with _without_privileges(folder), pytest.raises(StoreError, match="cannot be opened"):
            Store.open(path)


OPEN = """
import sys
from minorloop.lab import _store_file, store
_store_file.LOCK_WAIT = 0.01
try:
    store.Store.open(sys.argv[1], write=True)
except store.StoreError as error:
    print(error)
"""


def _refusal_of_another_process(path):
    """What another process says that cannot open a store to write."""
    command = [sys.executable, "-c", OPEN, str(path)]
    return subprocess.run(command, stdout=-1, text=True, check=True).stdout


class TestOneWriterAndManyReaders:
    def test_a_process_that_looks_again_does_not_give_its_store_away(self, tmp_path):
        path = _filled(tmp_path / "a")
        with Store.open(path, write=True) as store:
            assert store.running
            with pytest.raises(StoreError, match="another process has it open"):
                Store.open(path, write=True)
            with Store.open(path) as reader:
                assert reader.running
            assert "another process has it open; wait" in _refusal_of_another_process(path)
            store.add(_point(3), *_trace(3))
        assert _folder_is_clean(tmp_path, "a")

    def test_a_writer_does_not_wait_for_readers(self, tmp_path):
        path = _filled(tmp_path / "a")
        with Store.open(path, write=True) as store:
            store._execute("PRAGMA busy_timeout = 0")
            with store.session("restored"), Store.open(path) as reader:
                cursor = reader._execute("SELECT * FROM point")  # in the middle of reading
                cursor.fetchone()
                store.add(_point(3), *_trace(3))
                assert len(cursor.fetchall()) == 2

    def test_a_reader_has_the_points_that_were_there_when_it_was_opened(self, tmp_path):
        path = _filled(tmp_path / "a")
        with Store.open(path) as reader:
            with Store.open(path, write=True) as store:
                store.add(_point(3), *_trace(3))
                with Store.open(path) as later:
                    assert len(later) == len(later.points()) == 4
                    assert len(later.trace(3)[0]) == 5
            assert not reader.running
            assert len(reader) == len(reader.points()) == reader.record().y.size == 3
            assert reader.totals()["points"] == reader.last().index + 1 == 3
            with pytest.raises(ParameterError, match="there is no point 3"):
                reader.trace(3)
        assert _folder_is_clean(tmp_path, "a")

    def test_a_lock_that_was_just_removed_is_taken_anew(self, tmp_path, monkeypatch):
        """Another process may open the lock before, and lock it after the writer removes it."""
        path, locked = _filled(tmp_path / "a"), []

        def late(lock, flags=os.O_RDONLY, **how):
            locked.append(lock_path(lock, flags, **how))
            if len(locked) == 1:
                os.unlink(lock)
            return locked[-1]

        monkeypatch.setattr(store_file, "lock_path", late)
        with Store.open(path, write=True) as store:
            assert len(locked) == 2
            assert "another process has it open" in _refusal_of_another_process(path)
            store.add(_point(3), *_trace(3))


class TestDamage:
    """A damaged store is refused in one sentence, or tells exactly what it told before."""

    @staticmethod
    def _survives(path, expected, *, write=False):
        try:
            found = _content(path, write=write)
        except StoreError:
            return False
        finally:
            for leftover in path.parent.glob(f"{path.name}-*"):
                leftover.unlink()
        assert found == expected
        return True

    @pytest.mark.parametrize("write", [False, True])
    @pytest.mark.parametrize("part", ["header", "schema", "rows"])
    def test_a_single_bit(self, tmp_path, part, write):
        path = _filled(tmp_path / "a")
        expected, whole = _content(path), path.read_bytes()
        chance = np.random.default_rng(write)
        begin, end = {"header": (0, 100), "schema": (100, 4096), "rows": (4096, len(whole))}[part]
        bits = np.arange(8 * begin, 8 * end)
        harmless = []
        for bit in chance.choice(bits, 40, replace=False):
            damaged = bytearray(whole)
            damaged[bit // 8] ^= 1 << bit % 8
            path.write_bytes(damaged)
            harmless.append(self._survives(path, expected, write=write))
        assert not all(harmless)
        assert any(harmless)  # what is not in use may be anything

    def test_every_byte_of_a_point_and_its_trace_counts(self, tmp_path):
        path = _filled(tmp_path / "a")
        expected, whole = _content(path), path.read_bytes()
        value = np.array(np.sin(2), dtype=">f8").tobytes()
        trace = _trace(2)[1].astype("<f8").tobytes()
        for piece in (value, trace, b"interrupted", b"-1e-17", b"twin:ipmc", b"settled"):
            begin = whole.rindex(piece)
            for place in range(begin, begin + len(piece)):
                damaged = bytearray(whole)
                damaged[place] ^= 1
                path.write_bytes(damaged)
                assert not self._survives(path, expected)

    def test_a_piece_cut_off(self, tmp_path):
        path = _filled(tmp_path / "a")
        expected, whole = _content(path), path.read_bytes()
        for length in [*range(0, len(whole), 512), 1, 15, 99, 101, len(whole) - 1]:
            path.write_bytes(whole[:length])
            assert not self._survives(path, expected)

    @pytest.mark.parametrize(
        "statement",
        [
            "DELETE FROM point WHERE id = 1",
            "DELETE FROM trace WHERE id = 2",
            "DELETE FROM point WHERE id = 2",
            "DELETE FROM about WHERE name = 'plan'",
            "UPDATE point SET value = value * (1 + 1e-15) WHERE id = 1",
            "UPDATE point SET id = 7 WHERE id = 2",
            "UPDATE point SET sample_interval = 0.0 WHERE id = 1",
            "UPDATE point SET time_uncertainty = 0.0 WHERE id = 1",
            "UPDATE sitting SET way = 'replayed'",
            "UPDATE about SET value = replace(value, '0.5', '0.6') WHERE name = 'plan'",
            "UPDATE about SET value = replace(value, 'ipmc', 'fibre') WHERE name = 'setup'",
            "UPDATE about SET name = 'enough' WHERE name = 'origin'",
            "DROP TABLE sitting",
        ],
    )
    def test_a_row_altered_by_hand(self, tmp_path, statement):
        path = _filled(tmp_path / "a")
        hand = sqlite3.connect(path, isolation_level=None)
        hand.execute(statement)
        hand.close()
        says = r"is damaged|cannot be used|cannot be read"
        with pytest.raises(StoreError, match=says):
            _content(path)
        with pytest.raises(StoreError, match=says):
            Store.open(path, write=True)

    def test_points_of_another_plan(self, tmp_path):
        path = _filled(tmp_path / "a")
        with Store.create(tmp_path / "b", Plan([0.0], 40.0), SETUP):
            pass
        hand = sqlite3.connect(path, isolation_level=None)
        hand.execute("ATTACH ? AS other", (str(tmp_path / "b"),))
        hand.execute("REPLACE INTO about SELECT * FROM other.about WHERE name = 'plan'")
        hand.close()
        for write in (False, True):
            with pytest.raises(StoreError, match=r"point \d is missing or is not that of the plan"):
                Store.open(path, write=write)


@contextmanager
def _files_no_longer_than(size):
    """What a full disk does to a file that grows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class TestFullDisk:
    @pytest.mark.parametrize("room", [0, 4096, 100_000])
    def test_a_disk_that_takes_no_more(self, tmp_path, room):
        path = _filled(tmp_path / "a")
        with Store.open(path, write=True) as store:
            with (
                _files_no_longer_than(path.stat().st_size + room),
                pytest.raises(StoreError, match=r"cannot be written: the disk .*; its points are"),
            ):
                store.add(_point(3), *_trace(3, samples=20_000))
            assert len(store) == 3
            store.add(_point(3), *_trace(3, samples=20_000))
        assert len(_content(path)) > 20_000

    @pytest.mark.parametrize("room", [0, 100, 4096, 10_000])
    def test_no_store_is_begun_where_none_fits(self, tmp_path, room):
        with (
            _files_no_longer_than(room),
            pytest.raises(OutputError, match="a cannot be written: File too large"),
        ):
            Store.create(tmp_path / "a", PLAN, SETUP)
        assert _folder_is_clean(tmp_path)


class TestKilled:
    def test_a_log_that_a_power_cut_leaves_half_written_has_the_points_before(self, tmp_path):
        path, points = _filled(tmp_path / "a"), [_point(k) for k in range(5)]
        with Store.open(path, write=True) as store:
            for k in (3, 4):
                store.add(points[k], *_trace(k))
            main, log = path.read_bytes(), path.with_name("a-wal").read_bytes()
        chance, found = np.random.default_rng(0), []
        for length in [*range(0, len(log), 700), len(log)]:
            copy = tmp_path / f"{length}"
            copy.write_bytes(main)
            tail = chance.bytes(len(log) - length)  # blocks of the disk that were not written
            copy.with_name(f"{length}-wal").write_bytes(log[:length] + tail)
            with Store.open(copy, write=True) as store:
                found.append(len(store))
                assert store.points() == points[: found[-1]]
        assert found == sorted(found)
        assert (found[0], found[-1]) == (3, 5)
