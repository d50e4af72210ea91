"""Set name, niceness and limits of this process, and end it with its parent."""

import contextlib
import ctypes
import os

BEGINNING = 180.0
"""Longest start of a process on a busy machine, in seconds."""
_SET_DEATH_SIGNAL, _SET_NAME = 1, 15  # of prctl


def bind_to_parent(name: str, death: int) -> None:
    """Name this process, and let Linux signal it when its parent ends; no effect elsewhere."""
    with contextlib.suppress(OSError, AttributeError):
        system = ctypes.CDLL(None)
        system.prctl(_SET_NAME, name.encode()[:15], 0, 0, 0)
        system.prctl(_SET_DEATH_SIGNAL, death, 0, 0, 0)


def be_nice(by: int) -> None:
    """Change the niceness of this process; few systems allow a decrease."""
    with contextlib.suppress(OSError, AttributeError):
        os.nice(by)


def limit_resources(memory: int, file: int) -> None:
    """Limit the bytes of memory for data of this process, and of each file that it writes.

    An allocation beyond the limit then raises `MemoryError`, and a write `OSError`. Address space
    is not limited, because libraries reserve more than they use. Windows has no such limits, and
    macOS does not enforce the limit of memory.
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
