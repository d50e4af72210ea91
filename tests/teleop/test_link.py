import asyncio

from minorloop.teleop import messages
from minorloop.teleop.link import Link
from minorloop.teleop.loop import LoopSettings


def test_orders_go_to_the_loop_and_what_it_says_comes_back(tmp_path):
    async def talk():
        said, there = [], asyncio.Event()

        def hear(content):
            said.append(content)
            if content.startswith(b'{"type":"recording"'):
                there.set()

        link = Link(LoopSettings(folder=str(tmp_path)), hear)
        link.start()
        link.order(messages.Record(seq=1, t=0.0, grant=1, on=True))
        await asyncio.wait_for(there.wait(), 120)
        await asyncio.to_thread(link.stop)
        return said, link.process.exitcode

    said, code = asyncio.run(talk())
    first = next(content for content in said if content.startswith(b"{"))
    assert first.startswith(b'{"type":"hello"')
    assert code == 0
    assert len(list(tmp_path.glob("*.session"))) == 1
