"""A session over a line that delays, drops, holds up and is cut."""

import numpy as np
import pytest

from console_rig import Pilot, right
from minorloop_head.console import messages

TICK = 0.04
HELD_WITHIN = 0.2


class Remote(Pilot):
    """A pilot whose page sends 50 times a second over a line.

    The line has a latency and a jitter in seconds, and drops a share of what is sent.
    """

    def __init__(self, latency, jitter=0.0, drop=0.0):
        super().__init__()
        self.latency, self.jitter, self.drop = latency, jitter, drop
        self.cut = self.suspended = False
        self.pose, self.stick = right(0.0), (0.0, 0.0)
        self._rng, self._way = np.random.default_rng(4), []

    def say(self, kind, **content):
        self.seq += 1
        if self.cut or self._rng.random() < self.drop:
            return
        due = self.now + self.latency + self.jitter * self._rng.random()
        if self._way:  # messages of a stream do not overtake each other
            due = max(due, self._way[-1][0])
        self._way.append((due, kind(seq=self.seq, t=self.now, grant=1, **content)))

    def arrived(self):
        while not self.suspended and self._way and self._way[0][0] <= self.now:
            yield self._way.pop(0)[1]

    def run(self, seconds, look=lambda session: None):
        for _ in range(round(seconds / TICK)):
            for _ in range(2):
                self.say(messages.Drive, pose=self.pose, age=0.0, stick=self.stick, clutch=False)
                self.now += TICK / 2
            for message in self.arrived():
                self.session.receive(message, self.now)
            self.session.tick(self.now)
            look(self.session)

    def on_the_way(self):
        """In HEAD, turning, the catheter moving."""
        self.run(1.0)
        self.say(messages.SetMode, mode="HEAD")
        self.run(1.0)
        self.pose, self.stick = right(25.0), (1.0, 0.0)
        self.run(1.0)
        assert self.session.state.mode == "HEAD"
        assert self.session.state.command[0] > 0.05
        assert self.session.state.rates[0] > 0
        return self


def held_after(remote):
    """Seconds until it held with the catheter stopped, and the command then."""
    began = remote.now
    for _ in range(25):
        remote.run(TICK)
        state = remote.session.state
        if state.mode == "HOLD" and state.rates == (0.0, 0.0):
            return remote.now - began, state.command
    raise AssertionError("it never held")


@pytest.mark.parametrize("latency", [0.05, 0.3])
def test_a_line_that_is_slow_and_drops_a_tenth_still_steers(latency):
    remote = Remote(latency, jitter=0.02, drop=0.1).on_the_way()
    modes = set()
    remote.run(10.0, lambda session: modes.add(session.state.mode))
    assert modes == {"HEAD"}
    assert remote.session.state.command[0] == pytest.approx(np.radians(24.0 * 30 / 45), abs=8e-3)


@pytest.mark.parametrize("how", ["cut", "suspended"])
def test_a_line_that_is_cut_or_held_up_holds_in_time_and_continues_without_a_jump(how):
    remote = Remote(0.01).on_the_way()
    setattr(remote, how, True)
    seconds, command = held_after(remote)
    assert seconds <= HELD_WITHIN
    remote.pose = right(-40.0)
    remote.run(1.0)
    setattr(remote, how, False)
    remote.run(1.0)  # delayed messages arrive at once; they move nothing
    assert remote.session.state.mode == "HOLD"
    assert remote.session.state.command == command
    remote.say(messages.SetMode, mode="HEAD")
    remote.run(0.4)
    assert remote.session.state.mode == "HEAD"
    assert remote.session.state.command == pytest.approx(command, abs=1.7e-3)
