import asyncio
import multiprocessing
import os
import signal
import time
from pathlib import Path

from minorloop.teleop import workers


def told(task, *, longest=60.0, times=1, **options):
    """What tasks tell, one after the other, on one worker."""

    async def ask():
        pool = workers.Workers(1, longest=longest)
        await pool.start()
        try:
            return [[each async for each in pool.run(task, **options)] for _ in range(times)]
        finally:
            await pool.stop()

    return asyncio.run(ask())


def test_refusals_are_sentences_and_the_worker_goes_on(tmp_path):
    for (answer,) in told("move", times=2, folder=str(tmp_path), memory=None, u=0.5):
        assert "no model yet" in answer["error"]


def test_a_file_that_is_not_there_is_a_refusal(tmp_path):
    ((answer,),) = told("look", folder=str(tmp_path), name="none.csv")
    assert "none.csv" in answer["error"]


def test_what_a_process_takes_to_begin_is_not_what_a_task_takes(tmp_path):
    ((answer,),) = told("look", longest=0.5, folder=str(tmp_path), name="none.csv")
    assert "none.csv" in answer["error"]


def test_what_takes_too_long_is_ended_and_the_next_is_served(tmp_path):
    first, second = told("move", times=2, longest=1e-6, folder=str(tmp_path), memory=None, u=0.5)
    assert "took over" in first[-1]["error"]
    assert "took over" in second[-1]["error"]


def test_a_worker_that_dies_is_replaced(tmp_path):
    async def ask():
        pool = workers.Workers(1)
        await pool.start()
        try:
            for worker in pool._all:
                worker._process.kill()
                worker._process.join()
            first = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            second = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            return first, second
        finally:
            await pool.stop()

    first, second = asyncio.run(ask())
    assert "ended unexpectedly" in first["error"]
    assert "no model yet" in second["error"]


def test_a_worker_that_is_stopped_is_replaced_and_gone(tmp_path):
    async def ask():
        pool = workers.Workers(1)
        await pool.start()
        try:
            (worker,) = pool._all
            await worker.begun()
            os.kill(worker._process.pid, signal.SIGSTOP)
            first = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            second = await pool.ask("move", folder=str(tmp_path), memory=None, u=0.5)
            worker._process.join()
            return first, second, worker._process.exitcode
        finally:
            await pool.stop()

    first, second, status = asyncio.run(ask())
    assert "ended unexpectedly" in first["error"]
    assert "no model yet" in second["error"]
    assert status == -signal.SIGKILL


def serving(pids):
    """Start a worker, say which, and be killed; for a process of its own."""

    async def serve():
        pool = workers.Workers(1)
        await pool.start()
        (worker,) = pool._all
        await worker.begun()
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
