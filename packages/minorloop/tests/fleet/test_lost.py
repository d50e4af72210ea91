"""Fleets as processes of their own, whose cluster or command is lost in the middle."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from fleet_records import write_fleet
from later import Later

psutil = Later("psutil")
pytestmark = pytest.mark.whole

NAMES = [f"s{k}" for k in range(6)]
OPTIONS = ["--law", "levels=6", "--prior", "smooth", "--limit", "60"]
COMMAND = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in what a shell runs behind
from minorloop.fleet import identification
import fleet_faults
identification.identify_one = fleet_faults.work
from minorloop.cli import main
sys.exit(main(sys.argv[1:]))
"""


def until(condition, seconds=100.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "what was waited for did not happen"
        time.sleep(0.01)


def results(folder):
    return {file.name: file.read_bytes() for file in (folder / "out" / "results").glob("*.json")}


@pytest.fixture
def started(tmp_path):
    """Starts a program of Python in the folder, which is killed in the end."""
    shared = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    with ExitStack() as opened:

        def start(*program):
            process = subprocess.Popen(
                [sys.executable, *program],
                cwd=tmp_path,
                env=shared,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
            opened.enter_context(process)
            opened.callback(process.kill)
            return process

        yield start


@pytest.fixture
def fleet(started, tmp_path):
    """Starts the command, and returns when half of the specimens are done."""

    def fleet(*arguments):
        command = ("fleet", "manifest.csv", "--out", "out", *OPTIONS)
        process = started("-c", COMMAND, *command, *arguments)
        until(lambda: len(results(tmp_path)) >= len(NAMES) // 2 or process.poll() is not None)
        return process

    return fleet


@pytest.fixture
def cluster(started, tmp_path):
    """The scheduler and two workers, by their names, and the address."""
    pytest.importorskip("distributed", reason="needs Dask: minorloop[fleet]")
    file = tmp_path / "scheduler.json"
    local = "--no-dashboard", "--scheduler-file", str(file)
    run = "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"
    scheduler = started(*run, *local)
    until(lambda: file.exists() and "tcp://" in file.read_text())
    run = "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny"
    workers = [started(*run, *local) for _ in range(2)]
    address = re.search(r"tcp://[\d.:]+", file.read_text())[0]
    return {"scheduler": [scheduler], "workers": workers}, address


def check_going_on(fleet, folder, count):
    """The rest is done here, and what was done before stays as it was."""
    before = results(folder)
    assert fleet("--workers", "1").wait(100) == 0
    after = results(folder)
    assert before.items() <= after.items()
    assert len(after) == count


@pytest.mark.parametrize(
    ("who", "number", "message"),
    [
        ("scheduler", "SIGKILL", "the scheduler at"),
        ("workers", "SIGTERM", "no worker at"),
        ("workers", "SIGKILL", "no worker at"),
    ],
)
def test_a_cluster_that_is_lost_ends_the_fleet(who, number, message, cluster, fleet, tmp_path):
    processes, address = cluster
    (tmp_path / "wait.closed").touch()
    write_fleet(tmp_path, [*NAMES, "wait"])
    process = fleet("--workers", address, "--patience", "3")
    for one in processes[who]:
        one.send_signal(getattr(signal, number))
    assert message in process.communicate(timeout=100)[1]
    assert process.returncode == 2
    (tmp_path / "wait.closed").unlink()
    check_going_on(fleet, tmp_path, len(NAMES) + 1)


@pytest.mark.parametrize(("number", "status"), [("SIGINT", 130), ("SIGKILL", -signal.SIGKILL)])
def test_a_command_that_ends_in_an_endless_fit_leaves_no_worker(number, status, fleet, tmp_path):
    write_fleet(tmp_path, ["hang-once", *NAMES])
    process = fleet("--workers", "2")
    workers = psutil.Process(process.pid).children(recursive=True)
    assert workers
    process.send_signal(getattr(signal, number))
    assert process.wait(100) == status
    assert not psutil.wait_procs(workers, 100)[1]
    check_going_on(fleet, tmp_path, len(NAMES) + 1)
