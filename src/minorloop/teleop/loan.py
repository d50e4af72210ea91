"""A camera that is lent to a procedure which wants its frames one after the other.

The procedure runs in a thread and takes turns with who lends: it computes only between being given
a frame and asking for the next one.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from typing import Any

from minorloop.lab.actuator import Frame
from minorloop.teleop.plant import Tip, Where, angles_of


class _Ended(Exception):
    pass


class Loan:
    """A camera on loan.

    Parameters
    ----------
    tip : Tip
    work : callable
        Gets the loan, which is a camera with lights and a focus.
    """

    def __init__(self, tip: Tip, work: Callable[[Loan], Any]) -> None:
        self._tip = tip
        self._given: queue.Queue[Frame | None] = queue.Queue(1)
        self._turn: queue.Queue[None] = queue.Queue(1)
        self._where: Where = (0.0, 0.0, 0.0, 0.0)
        self.all_lit, self.done = True, False
        self.poses: list[tuple[float, float]] = []
        self.result: Any = None
        self._thread = threading.Thread(target=self._run, args=(work,), daemon=True)
        self._thread.start()
        self._turn.get()

    def give(self, frame: Frame, where: Where) -> None:
        """Give the next frame, and wait until another is wanted or all is done."""
        self._where = where
        self.poses.append(angles_of(where))
        self._given.put(frame)
        self._turn.get()

    def end(self) -> None:
        """Take the camera back, all lights on."""
        if not self.done:
            self._given.put(None)
            self._thread.join()
        self._tip.switch((True, True, True))

    def frame(self) -> Frame:
        """For the procedure: the next frame."""
        self._turn.put(None)
        frame = self._given.get()
        if frame is None:
            raise _Ended
        return frame

    def switch(self, lights: Sequence[bool]) -> None:
        """For the procedure: which lights are on from the next frame."""
        self.all_lit = all(lights)
        self._tip.switch(lights)

    def expose(self, exposure: float, gain: float = 1.0) -> None:
        """For the procedure: shutter and gain."""
        self._tip.expose(exposure, gain)

    def focus_at(self, distance: float) -> None:
        """For the procedure: send the focus to a distance in metres."""
        self._tip.focus_at(distance)

    def angles(self) -> tuple[float, float]:
        """For the procedure: pan and tilt of the frame before, in radians."""
        return angles_of(self._where)

    def _run(self, work: Callable[[Loan], Any]) -> None:
        try:
            self.result = work(self)
        except _Ended:
            return
        finally:
            self.done = True
            self._turn.put(None)
