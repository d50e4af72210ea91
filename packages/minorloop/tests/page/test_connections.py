import os
import resource
import selectors
import socket
import sys
import time

import pytest

from minorloop.page import connections
from minorloop.page.connections import Limits, Listener, Selector, admitted, mark

SMALL = Limits(strangers=4, each=2, header=5.0, idle=5.0, accepted=3, served=2, spare=0)


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
    found.setblocking(False)
    opened.append(found)
    return found


def call(listener, opened, source="127.0.0.1"):
    """A client that has connected."""
    client = socket.socket()
    opened.append(client)
    client.settimeout(10.0)
    client.bind((source, 0))
    client.connect(listener.getsockname())
    return client


def taken(listener, opened):
    """The next connection, after any number of turns."""
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        try:
            connection, _ = listener.accept()
        except BlockingIOError:
            continue
        opened.append(connection)
        return connection
    raise AssertionError("nobody came")


def meet(listener, opened, source="127.0.0.1"):
    client = call(listener, opened, source)
    return client, taken(listener, opened)


def is_closed(client):
    try:
        return client.recv(1) == b""
    except ConnectionResetError:
        return True


def test_few_are_accepted_in_a_turn(listener, opened):
    for _ in range(5):
        call(listener, opened)
    for _ in range(3):
        opened.append(listener.accept()[0])
    with pytest.raises(BlockingIOError):
        listener.accept()
    opened.append(listener.accept()[0])


def test_who_came_with_the_key_makes_room_for_nobody(listener, opened):
    client, accepted = meet(listener, opened)
    scope = {"client": client.getsockname()}
    mark(scope, listener)
    with admitted(scope):
        others = [meet(listener, opened) for _ in range(6)]
        listener.sweep(time.monotonic() + 60.0)
        assert not accepted.dropped
        assert all(other.dropped for _, other in others)
    listener.sweep(time.monotonic() + 60.0)
    assert accepted.dropped


@pytest.mark.skipif(sys.platform != "linux", reason="needs many addresses of this machine")
def test_an_address_with_too_many_makes_room_for_itself(listener, opened, monkeypatch):
    monkeypatch.setattr(connections, "is_loopback", lambda address: False)
    _, quiet = meet(listener, opened, "127.0.0.7")
    greedy = [meet(listener, opened, "127.0.0.8")[1] for _ in range(3)]
    assert [each.dropped for each in (quiet, *greedy)] == [False, True, False, False]


def test_a_stranger_has_little_time(listener, opened):
    client, accepted = meet(listener, opened)
    listener.sweep(time.monotonic() + SMALL.header - 1.0)
    assert not accepted.dropped
    listener.sweep(time.monotonic() + SMALL.header + 1.0)
    assert accepted.dropped
    assert is_closed(client)


def test_what_is_closed_is_forgotten(listener, opened):
    client, accepted = meet(listener, opened)
    assert listener.of(client.getsockname()) is accepted
    accepted.close()
    assert listener.of(client.getsockname()) is None
    assert listener.strangers == {}


def test_without_files_the_next_is_closed_and_nothing_is_raised(listener, opened):
    clients = [call(listener, opened) for _ in range(2)]
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    full = os.dup(0)
    os.close(full)
    resource.setrlimit(resource.RLIMIT_NOFILE, (full, limits[1]))
    try:
        with pytest.raises(BlockingIOError):
            listener.accept()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    assert all(is_closed(client) for client in clients)
    meet(listener, opened)


def test_an_event_loop_hears_who_is_known_first_and_strangers_in_turn(listener, opened):
    pairs = [meet(listener, opened) for _ in range(4)]
    pairs[-1][1].admit()
    with Selector(listener) as selector:
        for client, accepted in pairs:
            selector.register(accepted, selectors.EVENT_READ)
            client.sendall(b"x")
        heard = [[key.fileobj for key, _ in selector.select(5.0)] for _ in range(3)]
    one, two, three, known = (accepted for _, accepted in pairs)
    assert heard == [[known, one, two], [known, three, one], [known, two, one]]
