import itertools
import time

from numba.core import event

from minorloop.cli._compilation import COMPILES, compilation_said


def compiled(function):
    """Announce the compilation of a function, as numba does."""
    with event.trigger_event("numba:compile", data={"function": function}):
        pass


def test_a_compilation_of_seconds_is_said_once(monkeypatch):
    said, seconds = [], itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(seconds)))
    with compilation_said(said.append):
        for function in range(3):
            compiled(function)
        assert said == []
        for function in range(3):
            compiled(function)
        assert said == [COMPILES]
    compiled(7)
    assert said == [COMPILES]
