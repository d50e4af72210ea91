import socket
import sys
import time

import pytest

from minorloop.page import connections
from minorloop.page.connections import Limits, Listener, admit, mark

SMALL = Limits(unauthenticated=4, each=2, header=5.0)


@pytest.fixture
def opened():
    """Sockets to close at the end."""
    found = []
    yield found
    for each in found:
        each.close()


@pytest.fixture
def listener(opened):
    listening = socket.socket()
    listening.bind(("127.0.0.1", 0))
    found = Listener(listening, SMALL)
    found.listen(64)
    opened.append(found)
    return found


def meet(listener, opened, source="127.0.0.1"):
    """A client that has connected, with the connection that was accepted."""
    client = socket.socket()
    client.settimeout(10.0)
    client.bind((source, 0))
    client.connect(listener.getsockname())
    opened += [client, listener.accept()[0]]
    return client


def is_closed(client):
    client.setblocking(False)
    try:
        return client.recv(1) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_who_came_with_the_key_makes_room_for_nobody(listener, opened):
    client = meet(listener, opened)
    scope = {"client": client.getsockname()}
    mark(scope, listener)
    admit(scope)
    others = [meet(listener, opened) for _ in range(6)]
    assert [is_closed(other) for other in others] == [True, True, *[False] * 4]
    listener.sweep(time.monotonic() + 60.0)
    assert all(map(is_closed, others))
    assert not is_closed(client)


@pytest.mark.skipif(sys.platform != "linux", reason="needs many addresses of this machine")
def test_an_address_with_too_many_makes_room_for_itself(listener, opened, monkeypatch):
    monkeypatch.setattr(connections, "is_loopback", lambda address: False)
    quiet = meet(listener, opened, "127.0.0.7")
    greedy = [meet(listener, opened, "127.0.0.8") for _ in range(3)]
    assert [is_closed(each) for each in (quiet, *greedy)] == [False, True, False, False]


def test_a_stranger_has_little_time(listener, opened):
    client = meet(listener, opened)
    listener.sweep(time.monotonic() + SMALL.header - 1.0)
    assert not is_closed(client)
    listener.sweep(time.monotonic() + SMALL.header + 1.0)
    assert is_closed(client)


def test_a_stranger_that_has_gone_takes_no_room(listener, opened):
    clients = [meet(listener, opened) for _ in range(4)]
    opened[-1].close()
    clients.append(meet(listener, opened))
    assert [is_closed(client) for client in clients] == [False, False, False, True, False]
