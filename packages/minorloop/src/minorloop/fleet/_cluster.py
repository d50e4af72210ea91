"""Identification on the workers of a Dask cluster."""

import atexit
import logging
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

from minorloop.errors import FleetError, MissingExtraError, ParameterError
from minorloop.fleet._fitting import Found, Task
from minorloop.fleet._worker import FitProcesses, Work

_CONNECT = 10.0
"""Seconds to wait for the first answer of a scheduler."""
_EVERY = 0.5
"""Seconds between two checks of the cluster."""

_workers = FitProcesses()
"""Processes of a worker of the cluster; idle processes wait for the next specimens."""
atexit.register(_workers.close)


def _fit_on_worker(work: Work, task: Task, limit: float) -> Found:
    """Return the result of `FitProcesses.run` on a worker of the cluster, without messages."""
    return _workers.run(work, task, limit, lambda sentence: None)


class Cluster:
    """The workers of the Dask scheduler at an address, which do work as of `FitProcesses.run`.

    ``patience`` is the time to wait for a worker, in seconds. Dask replaces a worker that ends.

    Raises a `ParameterError` if there is no scheduler at the address; a `FleetError` if there is no
    worker in this time.
    """

    def __init__(
        self, address: str, patience: float, work: Work, limit: float, say: Callable[[str], None]
    ) -> None:
        self._address, self._patience = address, patience
        self._fit = partial(_fit_on_worker, work, limit=limit)
        self._client = _connect(address)
        self._worked = time.monotonic()
        try:
            self._client.wait_for_workers(1, timeout=patience)
        except TimeoutError:
            self.close()
            raise self._no_worker() from None
        threads = self._client.nthreads()
        # Number of specimens that are read or queued: three for each thread of the workers
        self.ahead = 3 * max(1, sum(threads.values()))

    def fit(self, task: Task) -> Found:
        """Return the result of a task.

        Raises a `FleetError` if the scheduler is gone, or there is no worker for ``patience``.
        """
        future = self._client.submit(self._fit, task, pure=False)
        while True:
            try:
                found: Found = future.result(timeout=_EVERY)
                return found
            except TimeoutError:
                self._check()
            except Exception as error:
                if future.status != "error":
                    raise self._gone() from None
                reason = f"every worker ended during its fit: {type(error).__name__}: {error}"
                return task.failed(reason)

    def close(self) -> None:
        """Disconnect, which cancels all tasks."""
        with suppress(Exception):  # the scheduler may be gone; its state is not needed
            self._client.close(timeout=_EVERY)

    def _check(self) -> None:
        if self._client.status != "running":
            raise self._gone()
        if self._client.scheduler_info()["workers"]:
            self._worked = time.monotonic()
        elif time.monotonic() - self._worked > self._patience:
            raise self._no_worker()

    def _gone(self) -> FleetError:
        return FleetError(f"the scheduler at {self._address} is gone: it closed the connection")

    def _no_worker(self) -> FleetError:
        return FleetError(
            f"no worker at {self._address} within {self._patience:g} s; start a worker, or give a "
            "longer patience"
        )


def _connect(address: str) -> Any:
    """Return a client of a scheduler; raise an error immediately if there is none."""
    try:
        from distributed import Client
    except ImportError:
        raise MissingExtraError("dask.distributed", "fleet") from None
    scheme, _, place = address.partition("://")
    host, _, port = place.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not port.isdecimal():
        raise ParameterError(
            f"address is {address!r}; give that of a Dask scheduler, such as tcp://10.0.0.1:8786"
        )
    # Losses are reported in one sentence; Dask would add a page of traceback.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT).close()
        return Client(address, timeout=_CONNECT, set_as_default=False)
    except (OSError, OverflowError, ValueError, TimeoutError) as error:
        raise ParameterError(f"there is no Dask scheduler at {address}: {error}") from None
