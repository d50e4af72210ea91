import asyncio

import pytest

from minorloop.head.console import messages
from minorloop.head.console.clients import Clients, HostileMessageError


def ping(seq, t=0.0):
    return messages.Ping(seq=seq, t=t)


def order(grant, seq=1):
    return messages.Measure(seq=seq, t=0.0, grant=grant)


def told(viewer):
    return asyncio.run(asyncio.wait_for(viewer.waiting(), 1))


def test_one_has_the_controls_until_they_are_free():
    hub = Clients()
    one, other = hub.join(), hub.join()
    assert hub.take(one)
    assert not hub.take(other)
    assert hub.pilot is one
    assert hub.may(one, order(one.granted))
    hub.free()
    assert hub.take(other)
    assert other.granted > one.granted


def test_a_pilot_who_leaves_frees_the_controls():
    hub = Clients()
    one = hub.join()
    hub.take(one)
    assert hub.leave(one)
    assert hub.pilot is None
    assert not hub.leave(hub.join())


def test_orders_of_those_who_never_had_the_controls_are_hostile():
    hub = Clients()
    pilot, other = hub.join(), hub.join()
    hub.take(pilot)
    for grant in (0, 1, 2):
        with pytest.raises(HostileMessageError, match="take the controls"):
            hub.may(other, order(grant))
    with pytest.raises(HostileMessageError):
        hub.may(pilot, order(2))


def test_orders_that_were_on_their_way_are_ignored():
    hub = Clients()
    one = hub.join()
    hub.take(one)
    late = order(one.granted)
    hub.free()
    assert not hub.may(one, late)
    hub.take(one)
    assert not hub.may(one, late)
    assert hub.may(one, order(one.granted))


@pytest.mark.parametrize("second", [ping(5, 1.0), ping(4, 2.0), ping(6, 0.5)])
def test_what_comes_out_of_order_is_hostile(second):
    viewer = Clients().join()
    viewer.check(ping(5, 1.0), viewer.heard)
    with pytest.raises(HostileMessageError, match="must rise"):
        viewer.check(second, viewer.heard)


def test_a_flood_is_hostile():
    viewer = Clients().join()

    def flood():
        for seq in range(1000):
            viewer.check(ping(seq), viewer.heard)

    with pytest.raises(HostileMessageError, match="a second"):
        flood()


def test_a_steady_stream_is_not():
    viewer, now = Clients().join(), 0.0
    viewer.heard = now
    for seq in range(5000):
        now += 1 / 60
        viewer.check(ping(seq, now), now)


def test_a_silent_pilot_is_noticed():
    hub = Clients()
    assert not hub.silent(1e9)
    one = hub.join()
    hub.take(one)
    assert not hub.silent(one.heard + 1)
    assert hub.silent(one.heard + 4)


def test_a_slow_viewer_gets_the_newest_and_costs_no_memory():
    hub = Clients()
    viewer = hub.join()
    for k in range(1000):
        hub.show("image", b"image %d" % k)
        hub.tell(b'{"n":%d}' % k)
    got = told(viewer)
    assert len(got) < 250
    assert b"image 999" in got
    assert b"image 998" not in got
    assert b'{"n":999}' in got


def test_who_comes_late_is_told_what_the_others_know():
    hub = Clients()
    hub.hello = b'{"type":"hello"}'
    hub.show("state", b"state")
    got = told(hub.join())
    assert hub.hello in got
    assert hub.findings in got
    assert b"state" in got
