"""Linear algebra in one thread, where more would only wait for each other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

_THREADED = 3000
"""Unknowns from which on a second thread gains anything."""


@contextmanager
def one_thread(unknowns: int = 0) -> Iterator[None]:
    """Keep the linear algebra to one thread where there are few unknowns.

    Threads gain little on small matrices, and wait for each other, tens of times as long as the
    work takes, once anything else keeps a core busy.

    Parameters
    ----------
    unknowns : int
        Of the largest system that is solved; from 3,000 on nothing is limited.
    """
    if unknowns > _THREADED:
        yield
        return
    with _linear_algebra().limit(limits=1, user_api="blas"):
        yield


@cache
def _linear_algebra() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  # its library has threads of its own: only loaded ones count

    return ThreadpoolController()  # type: ignore[no-untyped-call]
