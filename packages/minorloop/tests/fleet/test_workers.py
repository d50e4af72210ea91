"""Local workers that hang, end or are stopped; see `fleet_faults` for what makes them."""

import os
import signal

import pytest

import fleet_faults
from fleet_records import OPTIONS, write_fleet
from minorloop.errors import FleetError
from minorloop.fleet import _worker, identification
from minorloop.fleet._fitting import Task, load_kernels
from minorloop.fleet._worker import Worker
from minorloop.fleet.identification import identify_fleet


@pytest.fixture(autouse=True)
def faults(monkeypatch):
    """The faults of `fleet_faults`."""
    monkeypatch.setattr(identification, "identify_one", fleet_faults.work)


@pytest.fixture
def started(monkeypatch):
    """Numbers of the processes that are started."""
    numbers = []

    class Noted(Worker):
        def __init__(self):
            super().__init__()
            numbers.append(self.pid)

    monkeypatch.setattr(_worker, "Worker", Noted)
    return numbers


def is_alive(number):
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_worker_that_hangs_or_ends_costs_one_specimen_at_most(tmp_path, started):
    said, specimens = [], write_fleet(tmp_path, ["hang", "die", "die-once", "a"])
    summary = identify_fleet(
        specimens, tmp_path / "out", workers=2, limit=5, say=said.append, **OPTIONS
    )
    failed = {one.specimen: one.error for one in summary.failures}
    assert failed.keys() == {"hang", "die"}
    assert "no model within the limit of 5 s" in failed["hang"]
    assert "2 workers ended during its fit, the last ended (SIGKILL)" in failed["die"]
    text = "\n".join(said)
    assert "specimen hang has reached the limit of 5 s and is stopped" in text
    assert "the worker of specimen die-once ended (SIGKILL); the specimen is tried once" in text
    assert not any(is_alive(number) for number in started)


def test_an_interrupt_in_an_endless_fit_leaves_no_process_and_keeps_results(tmp_path, started):
    specimens, before = write_fleet(tmp_path, ["a", "b", "hang"]), set(os.listdir("/proc/self/fd"))
    done = []

    def watch(count, of, last):
        if count == 2:
            fleet_faults.wait_until_seen(specimens[2])
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        identify_fleet(specimens, tmp_path / "out", workers=2, watch=watch, **OPTIONS)
    assert not any(is_alive(number) for number in started)
    assert set(os.listdir("/proc/self/fd")) == before
    summary = identify_fleet(
        specimens[:2], tmp_path / "out", watch=lambda *told: done.append(told), **OPTIONS
    )
    assert (len(summary.identified), done) == (2, [])


def test_workers_that_cannot_be_started_end_the_fleet(tmp_path, monkeypatch):
    monkeypatch.setattr(_worker, "_COMMAND", "raise SystemExit('no such luck')")
    with pytest.raises(FleetError, match=r"cannot be started.*exit status 1: no such luck.*0 of 1"):
        identify_fleet(write_fleet(tmp_path, ["a"]), tmp_path / "out", workers=1, **OPTIONS)


def test_a_worker_ends_without_its_parent_even_in_a_fit(tmp_path):
    (one,) = write_fleet(tmp_path, ["hang"])
    task, idle, busy = Task(one, one.read(), OPTIONS), Worker(), Worker()
    for worker in (idle, busy):
        worker.ask(60, load_kernels)
    idle._pipe.close()
    busy._pipe.send((fleet_faults.work, (task, busy.scratch)))
    fleet_faults.wait_until_seen(one)
    os.close(busy._alive)
    busy._alive = os.dup(0)
    assert idle._process.wait(60) == 1
    assert busy._process.wait(60) == -signal.SIGIO
    assert "EOFError" in idle.end()
    assert busy.end() == "SIGIO"


def test_a_worker_has_one_thread_and_returns_only_results():
    worker = Worker()
    found = worker.ask(60, fleet_faults.threads)
    assert found == {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "blas": [1]}
    assert worker.end() == "SIGKILL: a library has its say"
    assert worker.end() == ""
