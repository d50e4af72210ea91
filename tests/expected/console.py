"""A case of the console: what its session replies to a pilot who steers, tracks and measures."""

from __future__ import annotations

from typing import Any

import msgspec

from console_rig import DirectCamera, Pilot, right
from expected.case import Case
from minorloop_head.console import messages

_EVERY = 25
"""Ticks between the replies that are kept: one a second."""


class _Recorded(Pilot):
    """A pilot who keeps a reply of the session each second."""

    def __init__(self) -> None:
        super().__init__(DirectCamera())
        self.replies: list[Any] = []
        self.ticks = 0

    def silence(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            super().silence()
            self.ticks += 1
            if self.ticks % _EVERY == 0:
                self.replies.append(msgspec.json.decode(self.session.report(self.now)))


def _session() -> Any:
    pilot = _Recorded()
    pilot.steering()
    pilot.drive(100, pose=right(20.0, 10.0))
    pilot.order(messages.SetMode, mode="HOLD")
    pilot.silence(50)
    pilot.tracking()
    pilot.measured()
    pilot.drive(50)
    pilot.silence(100)  # the pilot is gone
    return {
        "replies": pilot.replies,
        "findings": msgspec.to_builtins(pilot.session.findings),
        "ticks": pilot.ticks,
    }


CASES = (Case("console", _session, quick=False),)
