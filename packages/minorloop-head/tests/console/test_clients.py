import asyncio

import pytest

from minorloop_head.console import messages
from minorloop_head.console.clients import Clients, HostileMessageError


def ping(seq, t=0.0):
    return messages.Ping(seq=seq, t=t)


def order(grant, seq=1):
    return messages.Measure(seq=seq, t=0.0, grant=grant)


def outgoing(viewer):
    return asyncio.run(asyncio.wait_for(viewer.outgoing(), 1))


def test_orders_that_were_on_their_way_are_ignored():
    clients = Clients()
    one = clients.join()
    clients.take(one)
    late = order(one.granted)
    clients.free()
    assert not clients.may(one, late)
    clients.take(one)
    assert not clients.may(one, late)
    assert clients.may(one, order(one.granted))


@pytest.mark.parametrize("second", [ping(5, 1.0), ping(4, 2.0), ping(6, 0.5)])
def test_what_comes_out_of_order_is_hostile(second):
    viewer = Clients().join()
    viewer.check(ping(5, 1.0), viewer.last_message)
    with pytest.raises(HostileMessageError, match="must rise"):
        viewer.check(second, viewer.last_message)


def test_a_flood_is_hostile():
    viewer = Clients().join()

    def flood():
        for seq in range(1000):
            viewer.check(ping(seq), viewer.last_message)

    with pytest.raises(HostileMessageError, match="a second"):
        flood()


def test_a_steady_stream_is_not():
    viewer, now = Clients().join(), 0.0
    viewer.last_message = now
    for seq in range(5000):
        now += 1 / 60
        viewer.check(ping(seq, now), now)


def test_a_slow_viewer_gets_the_newest_and_costs_no_memory():
    clients = Clients()
    viewer = clients.join()
    for k in range(1000):
        clients.send_newest("image", b"image %d" % k)
        clients.send(b'{"n":%d}' % k)
    got = outgoing(viewer)
    assert len(got) < 250
    assert b"image 999" in got
    assert b"image 998" not in got
    assert b'{"n":999}' in got


def test_a_late_viewer_gets_the_present_state():
    clients = Clients()
    clients.hello = b'{"type":"hello"}'
    clients.send_newest("state", b"state")
    got = outgoing(clients.join())
    assert clients.hello in got
    assert clients.findings in got
    assert b"state" in got
