"""Report that a command compiles code, as it does when first run on a machine."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

COMPILES = "compiling code that runs here for the first time; this takes up to two minutes, once"
_SHORT = 2.0
"""Seconds of compilation that are not reported."""


@contextmanager
def compilation_said(say: Callable[[str], None]) -> Iterator[None]:
    """Call ``say`` once if compilation inside takes longer than a few seconds."""
    from numba.core import event

    class Listener(event.Listener):
        """Adds up the seconds of compilation, which may be nested."""

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
