"""Workers of a fleet: processes of this machine, or those of a cluster."""

from __future__ import annotations

import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from typing import Any

from minorloop.errors import MissingExtraError, ParameterError

_PATIENCE = 10
_SILENT = 3.0
"""Seconds after which it is said that something is waited for."""
_FORKED = sys.platform == "linux"
"""Whether workers are forked; elsewhere libraries of the system may not survive that."""
_ONE_THREAD = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
_CALM = {
    "distributed.worker.multiprocessing-method": "forkserver" if _FORKED else "spawn",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.scheduler.active-memory-manager.start": False,
}
"""What Dask looks after all the time would take a twentieth of each processor."""


def get_ready() -> None:
    """Begin to load what local workers need, while this process goes on with something else.

    Control-C at a terminal goes to every process; this one ends the others, which do not hear it.
    """
    if not _FORKED:
        return
    from multiprocessing import forkserver, resource_tracker

    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    resource_tracker.ensure_running()  # which would let the signal through again
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        forkserver.set_forkserver_preload(["minorloop.fleet._preload"])
        forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def cluster(
    workers: int | None, address: str | None, patience: float, say: Callable[[str], None]
) -> Iterator[tuple[Any, Any]]:
    """A Dask client with at least one worker, and what gives futures as they complete.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    ParameterError
        If there is no scheduler at the address, or it has no worker for all the patience.
    """
    try:
        import dask
        from distributed import Client, LocalCluster, as_completed
    except ImportError:
        raise MissingExtraError("dask.distributed", "fleet") from None
    if address is not None:
        try:
            client = Client(address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None
        with closing(client):
            _wait_for_a_worker(client, address, patience, say)
            yield client, as_completed
        return
    with dask.config.set(_CALM), ExitStack() as opened:
        with _held_back():  # a cluster that is half made cannot be closed
            local = LocalCluster(
                n_workers=workers or os.cpu_count() or 1,
                threads_per_worker=1,
                processes=True,
                dashboard_address="127.0.0.1:0",  # any port: a fixed one may be another fleet's
                silence_logs=logging.CRITICAL,  # a worker that died is retried, or a failure
            )
            opened.enter_context(local)
            client = opened.enter_context(Client(local, set_as_default=False))
        yield client, as_completed


@contextmanager
def _held_back() -> Iterator[None]:
    """Raise what Control-C asks for at the end of the block, and not within it."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    caught: list[tuple[int, Any]] = []
    signal.signal(signal.SIGINT, lambda number, frame: caught.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    for number, frame in caught[:1]:
        before(number, frame)


def _wait_for_a_worker(
    client: Any, address: str, patience: float, say: Callable[[str], None]
) -> None:
    silent = min(_SILENT, patience)
    try:
        client.wait_for_workers(1, timeout=silent)
        return
    except TimeoutError:
        say(f"no workers at {address}; waiting")
    with suppress(TimeoutError):
        client.wait_for_workers(1, timeout=max(patience - silent, 1e-3))
        return
    raise ParameterError(
        f"no worker came to the scheduler at {address} within {patience:g} s; start some "
        f"(dask worker {address}), or have more patience"
    )


def check_address(address: str) -> None:
    """Refuse at once what is no address, or where nothing listens.

    Raises
    ------
    ParameterError
        If it is so.
    """
    scheme, _, place = address.partition("://")
    if scheme == "inproc":
        return
    host, _, port = place.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not port.isdecimal():
        raise ParameterError(
            f"address is {address!r}; give that of a Dask scheduler, such as tcp://10.0.0.1:8786"
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
    except (OSError, OverflowError, UnicodeError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None
