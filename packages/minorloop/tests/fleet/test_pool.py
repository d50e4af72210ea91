"""Local workers that hang, end or are stopped; see `fleet_faults` for what makes them."""

import os
import re
import signal
from pathlib import Path

import pytest

import fleet_faults
from fleet_records import write_manifest, write_record
from minorloop.errors import FleetError
from minorloop.fleet import _pool, _worker, identification
from minorloop.fleet._fitting import Task
from minorloop.fleet._pool import Pool
from minorloop.fleet._worker import Worker
from minorloop.fleet.identification import identify_fleet
from minorloop.fleet.manifest import Specimen

OPTIONS = {"levels": 6, "prior": "none", "smoothness": 0.0}
ENDLESS = float("inf")


@pytest.fixture
def fleet(tmp_path, monkeypatch):
    """Return a function that makes a fleet with these names and the faults of `fleet_faults`."""
    monkeypatch.setattr(identification, "identify_one", fleet_faults.work)
    for name, seconds in (("NOTICE", 0.3), ("APART", 0.0), ("STOPPED", 0.3)):
        monkeypatch.setattr(_pool, name, seconds)

    def make(*names):
        for k, name in enumerate(names):
            write_record(tmp_path / f"{name}.csv", k)
        return write_manifest(tmp_path, names)

    return make


@pytest.fixture
def started(monkeypatch):
    """Numbers of the processes that are started."""
    numbers = []

    class Noted(Worker):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            numbers.append(self.pid)

    monkeypatch.setattr(_pool, "Worker", Noted)
    return numbers


def is_alive(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_worker_that_hangs_ends_or_stops_costs_one_specimen_at_most(fleet, tmp_path, started):
    said, names = [], ["hang", "die", "die-once", "stop-once", "a"]
    summary = identify_fleet(
        fleet(*names), tmp_path / "out", workers=2, limit=1.5, say=said.append, **OPTIONS
    )
    failed = {one.specimen: one.error for one in summary.failures}
    assert failed.keys() == {"hang", "die"}
    assert "no model within the limit of 1.5 s" in failed["hang"]
    assert "2 workers ended during its fit, the last one ended (SIGKILL)" in failed["die"]
    text = "\n".join(said)
    assert re.search(r"specimen hang has run for \d s; the limit is 1.5 s", text)
    assert "specimen hang has reached the limit of 1.5 s and is given up" in text
    assert "the worker of specimen die-once ended (SIGKILL); the specimen is tried once" in text
    assert "the worker of specimen stop-once was stopped for" in text
    assert not any(is_alive(number) for number in started)


def test_an_interrupt_in_an_endless_fit_leaves_no_process_and_keeps_results(
    fleet, tmp_path, started
):
    specimens, done, before = fleet("a", "b", "hang"), [], set(os.listdir("/proc/self/fd"))

    def say(sentence):
        if "specimen hang has run" in sentence:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        identify_fleet(specimens, tmp_path / "out", workers=1, say=say, **OPTIONS)
    assert not any(is_alive(number) for number in started)
    assert set(os.listdir("/proc/self/fd")) == before
    summary = identify_fleet(
        specimens[:2],
        tmp_path / "out",
        watch=lambda *told: done.append(told),
        **OPTIONS,
    )
    assert (len(summary.identified), done) == (2, [])


def test_a_time_limit_does_not_count_time_in_which_the_machine_sleeps(monkeypatch):
    class Asleep:
        """A worker in whose one fit the machine slept for an hour, between two looks."""

        pid, ended = 0, False

        def __init__(self, work, limit):
            self.ready = _pool.Future()
            self.ready.set_result(None)
            self.answer = _pool.Future()

        def ask(self, task):
            return self.answer

        def is_stopped(self):
            if clock[0] > 2 * 3600.0:
                self.answer.set_result({"model": 1})
            return False

        def end(self):
            return ""

    clock = [0.0]

    def monotonic():
        clock[0] += 1800.0
        return clock[0]

    monkeypatch.setattr(_pool, "Worker", Asleep)
    monkeypatch.setattr(_pool.time, "monotonic", monotonic)
    task = Task(Specimen("a", Path("a.csv"), "u", "y"), b"", {})
    with Pool(1, 60.0, None, print) as pool:
        assert [one for one in pool.run([task]) if one] == [(task, {"model": 1})]


def test_workers_that_cannot_be_started_end_the_fleet(fleet, tmp_path, monkeypatch):
    monkeypatch.setattr(_worker, "_COMMAND", "raise SystemExit('no such luck')")
    with pytest.raises(FleetError, match=r"cannot be started.*exit status 1: no such luck.*0 of 1"):
        identify_fleet(fleet("a"), tmp_path / "out", workers=1, **OPTIONS)


@pytest.fixture
def task(tmp_path):
    """Return a function that makes a task with the fault that its name says."""

    def make(name):
        write_record(tmp_path / f"{name}.csv", 0)
        (one,) = write_manifest(tmp_path, [name])
        return Task(one, one.read(), OPTIONS)

    return make


def test_a_worker_ends_without_its_parent_or_long_after_the_limit(task):
    for limit, abandon, how in (
        (ENDLESS, lambda worker: worker._process.stdin.close(), "exit status 0"),
        (ENDLESS, lambda worker: worker.ask(task("hang")), "SIGIO"),
        (0.1 - _worker.GRACE, lambda worker: worker.ask(task("hang")), "SIGALRM"),
    ):
        worker = Worker(fleet_faults.work, limit)
        worker.ready.result(60)
        abandon(worker)
        if how == "SIGIO":
            fleet_faults.wait_until_seen(task("hang"))
            os.close(worker._alive)
            worker._alive = os.dup(0)
        worker._process.wait(60)
        assert worker.end() == how


def test_a_worker_has_one_thread_and_returns_only_results(task):
    worker = Worker(fleet_faults.threads, ENDLESS)
    worker.ready.result(60)
    found = worker.ask(task("a")).result(60)
    assert found == {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "blas": [1]}
    assert worker.end() == "SIGKILL: a library has its say"
    assert worker.end() == ""
