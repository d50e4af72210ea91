"""Limit linear algebra to one thread."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra to one thread.

    A fit consists of thousands of products of small blocks, for which threads wait longer than they
    compute. If another process keeps a core busy, they wait tens of times longer. The result is the
    same, to the last bit, on any number of cores.
    """
    with _linear_algebra().limit(limits=1, user_api="blas"):
        yield


@cache
def _linear_algebra() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  # has a library with threads, which counts once it is loaded

    return ThreadpoolController()  # type: ignore[no-untyped-call]
