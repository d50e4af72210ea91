import os
import re
import signal
import sys
from multiprocessing import forkserver
from pathlib import Path

import pytest

from minorloop.fleet._workers import _held_back, get_ready


def blocked():
    return signal.pthread_sigmask(signal.SIG_BLOCK, [])


def test_an_interrupt_waits_until_what_is_being_made_is_made():
    made = []

    def make():
        with _held_back():
            signal.raise_signal(signal.SIGINT)
            made.append(True)
        made.append(False)

    with pytest.raises(KeyboardInterrupt):
        make()
    assert made == [True]
    with _held_back():
        pass


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux only")
def test_workers_do_not_hear_an_interrupt_and_this_process_does(monkeypatch):
    server = forkserver.ForkServer()  # not that of other tests
    monkeypatch.setattr(forkserver, "set_forkserver_preload", lambda names: None)
    monkeypatch.setattr(forkserver, "ensure_running", server.ensure_running)
    get_ready()
    assert signal.SIGINT not in blocked()
    status = Path(f"/proc/{server._forkserver_pid}/status").read_text()
    server._stop()
    mask = int(re.search(r"SigBlk:\s*(\w+)", status)[1], 16)
    assert mask >> (signal.SIGINT - 1) & 1


@pytest.mark.skipif(sys.platform != "linux", reason="workers are forked on Linux only")
def test_workers_compute_with_one_thread_and_this_process_keeps_its_environment(monkeypatch):
    seen = {}
    monkeypatch.setattr(forkserver, "set_forkserver_preload", lambda names: None)
    monkeypatch.setattr(forkserver, "ensure_running", lambda: seen.update(os.environ))
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    before = dict(os.environ)
    get_ready()
    assert os.environ == before
    assert [seen[name] for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")] == ["1", "1"]
