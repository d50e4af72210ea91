"""What a process does to itself: name, niceness, limits, and to end with its parent."""

import contextlib
import ctypes
import os

BEGINNING = 180.0
"""Seconds in which a process must start, on a busy machine."""
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15  # of prctl


def bind_to_parent(name: str, death: int) -> None:
    """Name this process and have Linux signal it when its parent ends; elsewhere do nothing."""
    with contextlib.suppress(OSError, AttributeError):
        system = ctypes.CDLL(None)
        system.prctl(_SET_NAME, name.encode()[:15], 0, 0, 0)
        system.prctl(_SET_DEATH_SIGNAL, death, 0, 0, 0)


def be_nice(by: int) -> None:
    """Change the niceness of this process; few systems allow less of it."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(by)


def limit_resources(memory: int, file: int) -> None:
    """Limit this process to bytes of memory for data, and of each file that it writes.

    An allocation beyond the limit then raises `MemoryError`, and a write `OSError`. Address space
    is no measure: libraries reserve more of it than they use. Windows has no such limits, and
    macOS does not enforce that of memory.
    """
    with contextlib.suppress(ImportError):
        import resource

        for kind, most in ((resource.RLIMIT_DATA, memory), (resource.RLIMIT_FSIZE, file)):
            _, hard = resource.getrlimit(kind)
            lower = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(kind, (lower, hard))


def is_stopped(child: int) -> bool:
    """Return whether a signal has stopped a child; False if the system cannot tell."""
    if not hasattr(os, "waitid"):
        return False
    with contextlib.suppress(ChildProcessError):
        return os.waitid(os.P_PID, child, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None
    return False
