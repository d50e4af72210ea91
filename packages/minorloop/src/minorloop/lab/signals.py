"""Defer signals that end the process until they do no harm.

A signal in the middle of a line to an instrument would leave half of the line there. A signal while
a source is made safe would leave the source on. So a signal is only noted while it is `Deferred`,
and raised as `Stopped` while it is `Allowed`. Only the first signal is raised: a second signal does
not interrupt the end that the first has begun.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

# SIGINT is restored last: its usual handler raises an error when all others are already restored.
_NAMES = ("SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK", "SIGINT")


class Stopped(KeyboardInterrupt):
    """A signal requests the end of the process."""


class _State:
    """The signal that the main thread received, and whether it may be raised now."""

    def __init__(self) -> None:
        self.installed = self.may_raise = False
        self.forget()

    def forget(self) -> None:
        """Forget the signal."""
        self.raised, self.noted = False, ""

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.noted = self.noted or signal.Signals(number).name
        self.deliver()

    def deliver(self) -> None:
        """Raise the noted signal, once, if that is allowed."""
        if self.may_raise and self.noted and not self.raised:
            self.raised = True
            raise Stopped(self.noted)


_state = _State()


class _Switched:
    """A context in which signals are raised or deferred, independent of the context around it."""

    _may_raise: bool

    def __enter__(self) -> None:
        self._counts = _state.installed and _in_main_thread()
        if self._counts:
            self._before = _state.may_raise
            _state.may_raise = self._may_raise
            _state.deliver()

    def __exit__(self, *error: object) -> None:
        if self._counts:
            _state.may_raise = self._before
            if sys.exception() is None:  # an error has priority over a signal
                _state.deliver()


class Deferred(_Switched):
    """A context at whose end signals are raised."""

    _may_raise = False


class Allowed(_Switched):
    """A context that signals interrupt, even inside one that defers them."""

    _may_raise = True


@contextmanager
def ended_by_signals(*, exiting: bool = False) -> Iterator[None]:
    """Raise `Stopped` for the first signal that ends a process, if this is allowed.

    Later signals are only noted. A deferred signal is raised at the end of the deferral. An ignored
    signal, such as SIGHUP under ``nohup``, stays ignored. Inside another such context, and outside
    the main thread, this has no effect.

    ``exiting``: whether the process exits after the first signal. Later signals are then also
    ignored after the context, so that they do not change the exit status.
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
            if handler not in (signal.SIG_IGN, None):  # None: not set from Python
                before[number] = handler
                signal.signal(number, _state.note)
        with Allowed():
            yield
    finally:
        _state.may_raise = _state.installed = False
        ignored = exiting and bool(_state.noted)
        for number, handler in before.items():
            signal.signal(number, signal.SIG_IGN if ignored else handler)
        if _state.noted and not _state.raised and sys.exception() is None:
            raise Stopped(_state.noted)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
