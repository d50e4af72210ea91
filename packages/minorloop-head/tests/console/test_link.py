import asyncio
import json
from multiprocessing import Pipe

import msgspec

from console_rig import text
from minorloop_head.console import messages
from minorloop_head.console.channel import NewestPipe
from minorloop_head.console.link import ConsoleLink
from minorloop_head.console.settings import LoopSettings

HELLO, STATE = text("hello"), text("state")


class Linked:
    """A link, and this end of its pipe."""

    def __init__(self):
        self.received, self.came = [], asyncio.Event()
        self.channel = NewestPipe()
        self.link = ConsoleLink(LoopSettings(), self.hear, loop=self.channel)
        self.link.start()

    def hear(self, content):
        self.received.append(json.loads(content))
        self.came.set()

    def loop(self):
        """This end of a new pipe."""
        ours, theirs = Pipe()
        self.channel.renew(theirs)
        return ours

    async def until(self, kind, text=""):
        async with asyncio.timeout(60):
            while not any(s["type"] == kind and text in s.get("text", "") for s in self.received):
                self.came.clear()
                await self.came.wait()
        self.received.clear()

    async def ordered(self, pipe):
        """The first order that arrives; it is repeated until then."""
        async with asyncio.timeout(60):
            while not pipe.poll():
                self.link.order(messages.ControlsTaken())
                await asyncio.sleep(0)
        return msgspec.msgpack.decode(pipe.recv_bytes(), type=messages.ToLoop)


def test_a_loop_that_is_silent_or_ends_is_reported_and_the_next_is_used():
    async def talk():
        linked = Linked()
        pipe = linked.loop()
        pipe.send_bytes(HELLO)
        await linked.until("hello")
        assert await linked.ordered(pipe) == messages.ControlsTaken()
        await linked.until("failed", "does not respond")
        pipe.send_bytes(STATE)
        await linked.until("state")
        pipe.close()
        await linked.until("failed", "has ended")
        pipe = linked.loop()
        pipe.send_bytes(HELLO)
        await linked.until("hello")
        assert await linked.ordered(pipe) == messages.ControlsTaken()

    asyncio.run(talk())


def test_an_order_that_nobody_would_carry_out_now_is_dropped():
    async def talk():
        linked = Linked()
        pipe = linked.loop()
        linked.link.order(messages.SetMode(seq=1, t=0.0, grant=1, mode="HEAD"))
        linked.link.order(messages.Release(seq=2, t=0.0, grant=1))
        assert await asyncio.to_thread(pipe.poll, 60)
        first = msgspec.msgpack.decode(pipe.recv_bytes(), type=messages.ToLoop)
        assert isinstance(first, messages.Release)

    asyncio.run(talk())
