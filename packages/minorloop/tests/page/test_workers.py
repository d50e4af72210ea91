import asyncio
import multiprocessing
import os
import signal
import sys
import time
from pathlib import Path

import pytest

from minorloop.page import workers

QUICK = "worker_tasks"


def told(task, *, longest=60.0, times=1, tasks=QUICK, limits=None, **options):
    """Reports of tasks, one after the other, on one worker."""

    async def ask():
        pool = workers.Workers(1, longest=longest, tasks=tasks, **limits or {})
        pool.start()
        try:
            return [[each async for each in pool.run(task, **options)] for _ in range(times)]
        finally:
            await pool.stop()

    return asyncio.run(ask())


def test_refusals_are_sentences_and_the_worker_continues():
    for stage, answer in told("refuse", times=2):
        assert stage == {"stage": "looking"}
        assert answer == {"error": "this is always refused"}


def test_what_a_process_takes_to_begin_is_not_what_a_task_takes(tmp_path):
    tasks = workers.TASKS  # it imports for longer than the task may take
    ((answer,),) = told("look", longest=0.5, tasks=tasks, folder=str(tmp_path), name="none.csv")
    assert "none.csv" in answer["error"]


@pytest.mark.skipif(sys.platform != "linux", reason="the system does not enforce the limits")
def test_memory_and_files_beyond_the_limit_are_refused_and_the_worker_continues(tmp_path):
    limits = {"memory": 2**29, "file": 2**20}
    for (answer,) in told("take", times=2, limits=limits, size=2**29):
        assert "needs more than the allowed 0.5 GiB of memory" in answer["error"]
    assert told("take", limits=limits, size=2**24) == [[{"taken": 2**24}]]
    path = str(tmp_path / "large")
    (answers,) = told("write", limits=limits, path=path, size=2**20 + 1)
    assert answers[-1]["error"].startswith("this cannot be done")


def test_what_takes_too_long_is_ended_and_the_next_is_served():
    first, second = told("endless", times=2, longest=0.1)
    assert "took over" in first[-1]["error"]
    assert "took over" in second[-1]["error"]


async def asked_twice(signum, *, at_work):
    """Results of two tasks whose worker gets a signal, and the exit code of that worker."""
    pool = workers.Workers(1, tasks=QUICK)
    pool.start()
    try:
        (worker,) = pool._all
        if not at_work:
            await worker.ready()
        first = asyncio.create_task(pool.ask("refuse"))
        if at_work:  # it waits for the worker to begin
            await asyncio.sleep(0)
        os.kill(worker._process.pid, signum)
        if not at_work:  # until the signal has done its work
            os.waitid(os.P_PID, worker._process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
        answers = await first, await pool.ask("refuse")
        worker._process.join()
        return *answers, worker._process.exitcode
    finally:
        await pool.stop()


@pytest.mark.parametrize("signum", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize(
    ("at_work", "said"), [(True, "ended unexpectedly"), (False, "always refused")]
)
def test_a_worker_that_dies_or_is_stopped_is_replaced_at_rest_before_the_task(
    signum, at_work, said
):
    first, second, status = asyncio.run(asked_twice(signum, at_work=at_work))
    assert said in first["error"]
    assert "always refused" in second["error"]
    assert status == -signal.SIGKILL


def test_ctrl_c_which_a_terminal_sends_to_all_processes_does_not_disturb_a_worker():
    async def ask():
        pool = workers.Workers(1, tasks=QUICK)
        pool.start()
        try:
            (worker,) = pool._all
            await worker.ready()
            os.kill(worker._process.pid, signal.SIGINT)
            answer = await pool.ask("refuse")
            return answer, worker in pool._all, worker._process.exitcode
        finally:
            await pool.stop()

    answer, same, status = asyncio.run(ask())
    assert "always refused" in answer["error"]
    assert (same, status) == (True, None)


def serving(pids):
    """Start a worker, say which, and be killed; for a process of its own."""

    async def serve():
        pool = workers.Workers(1, tasks=QUICK)
        pool.start()
        (worker,) = pool._all
        await worker.ready()
        pids.send(worker._process.pid)
        os.kill(os.getpid(), signal.SIGKILL)

    asyncio.run(serve())


def runs(pid):
    """Whether there is a process that is more than an entry that nobody has fetched."""
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_a_worker_ends_with_a_server_that_was_killed():
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    server = context.Process(target=serving, args=(theirs,))
    server.start()
    worker = ours.recv()
    server.join()
    deadline = time.monotonic() + 60
    while runs(worker):
        assert time.monotonic() < deadline
