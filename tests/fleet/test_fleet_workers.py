import os
import sys
from multiprocessing import forkserver

import pytest

from minorloop.fleet._workers import get_ready


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
