"""Signals that end a process, and when they may.

A signal that came in the middle of a line to an instrument would leave half of it there, and one
that came while a source is made safe would leave it on. So a signal is only noted where it is
`Deferred`, and raised as `Stopped` where it is `Allowed`, and that once: no second signal
interrupts what the first has begun.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

__all__ = ["Allowed", "Deferred", "Stopped", "ended_by_signals"]

# The last one is given back last: its usual handler raises, and then all others are back.
_NAMES = ("SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK", "SIGINT")


class Stopped(KeyboardInterrupt):
    """The process was asked to end."""


class _State:
    """What came to the main thread, and whether it may be told now."""

    def __init__(self) -> None:
        self.installed = self.may_raise = False
        self.forget()

    def forget(self) -> None:
        """Forget what came."""
        self.raised, self.noted = False, ""

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.noted = self.noted or signal.Signals(number).name
        self.tell()

    def tell(self) -> None:
        """Raise what was noted, once, if that is allowed."""
        if self.may_raise and self.noted and not self.raised:
            self.raised = True
            raise Stopped(self.noted)


_state = _State()


class _Switched:
    """Signals are raised or deferred in here, whatever they are around it."""

    _may_raise: bool

    def __enter__(self) -> None:
        self._counts = _state.installed and _in_main_thread()
        if self._counts:
            self._before = _state.may_raise
            _state.may_raise = self._may_raise
            _state.tell()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._counts:
            _state.may_raise = self._before
            if sys.exception() is None:  # an error on its way says more than a signal
                _state.tell()


class Deferred(_Switched):
    """A context in which signals wait until it is over."""

    _may_raise = False


class Allowed(_Switched):
    """A context that signals interrupt, though what is around it defers them."""

    _may_raise = True


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Raise `Stopped` for the first signal that ends a process, where that is allowed.

    Later signals are only noted. One that came where it was deferred is raised at the end. A
    signal that is ignored, as SIGHUP under ``nohup``, stays so. Inside another such context, and
    in any thread but the main one, this does nothing.
    """
    if _state.installed or not _in_main_thread():
        yield
        return
    before: dict[int, Any] = {}
    _state.forget()
    try:
        _state.installed = True
        for number in (getattr(signal, name) for name in _NAMES if hasattr(signal, name)):
            handler = signal.getsignal(number)
            if handler not in (signal.SIG_IGN, None):  # None: set by no Python code
                before[number] = handler
                signal.signal(number, _state.note)
        with Allowed():
            yield
    finally:
        _state.may_raise = _state.installed = False
        for number, handler in before.items():
            signal.signal(number, handler)
        if _state.noted and not _state.raised and sys.exception() is None:
            raise Stopped(_state.noted)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
