"""Limit linear algebra on small matrices to one thread."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

_THREADED = 3000
"""Number of unknowns from which a second thread makes a solution faster."""


@contextmanager
def one_thread(unknowns: int = 0) -> Iterator[None]:
    """Limit linear algebra to one thread if there are few unknowns.

    On small matrices threads gain little. If another process keeps a core busy, they wait for each
    other tens of times longer than the computation takes.

    Parameters
    ----------
    unknowns : int
        Unknowns of the largest system to solve; above 3,000 nothing is limited.
    """
    if unknowns > _THREADED:
        yield
        return
    with _linear_algebra().limit(limits=1, user_api="blas"):
        yield


@cache
def _linear_algebra() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  # has a library with threads, which counts once it is loaded

    return ThreadpoolController()  # type: ignore[no-untyped-call]
