"""Say that a command compiles, which it does when it runs for the first time on a machine."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

COMPILES = (
    "compiling what runs here for the first time; this takes from seconds to two minutes, once"
)
_SHORT = 2.0
"""Seconds of compilation that need no sentence."""


@contextmanager
def compilation_said(say: Callable[[str], None]) -> Iterator[None]:
    """Call ``say`` once if compilation inside takes longer than some seconds."""
    from numba.core import event

    class Listener(event.Listener):
        """Adds up the seconds; what is compiled may compile others."""

        depth, began, total, said = 0, 0.0, 0.0, False

        def on_start(self, event: Any) -> None:
            if self.depth == 0:
                self.began = time.monotonic()
            self.depth += 1
            if not self.said and self.total > _SHORT:
                self.said = True
                say(COMPILES)

        def on_end(self, event: Any) -> None:
            self.depth -= 1
            if self.depth == 0:
                self.total += time.monotonic() - self.began

    with event.install_listener("numba:compile", Listener()):
        yield
