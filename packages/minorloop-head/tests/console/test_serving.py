import asyncio
import http.client
import json
import logging
import socket
import threading
from unittest.mock import Mock

import pytest
import uvicorn
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State
from websockets.sync.client import connect

from console_rig import SilentLoop
from minorloop_head.console import messages
from minorloop_head.console.auth import Authentication
from minorloop_head.console.connections import Limits
from minorloop_head.console.loop import LoopSettings
from minorloop_head.console.server import Console
from minorloop_head.console.serving import LONGEST_HEADER, RateLimitedLog, Sockets, _Marking, serve

LIMITS = Limits(strangers=16, header=1.0, idle=30.0)


class Running:
    """A server over real sockets, which can be stopped and started again."""

    def __init__(self, folder):
        self.folder, self.port = folder, 0
        self.start()

    def start(self, authentication=None):
        listening = socket.create_server(("127.0.0.1", self.port))
        self.port = listening.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        self.authentication = authentication or Authentication("127.0.0.1", port=self.port)
        console = Console(
            authentication=self.authentication,
            loop=LoopSettings(folder=str(self.folder)),
            link=self._linked,
            workers=0,
        )
        running = self

        class Server(uvicorn.Server):
            def __init__(self, config):
                super().__init__(config)
                running.server = self

        self.thread = threading.Thread(
            target=serve, args=(console, listening), kwargs={"limits": LIMITS, "server": Server}
        )
        self.thread.start()
        self.cookie = f"{self.authentication.cookie}={self.authentication.token}"

    def _linked(self, *options):
        self.link = SilentLoop(*options)
        return self.link

    def stop(self):
        self.server.should_exit = True
        self.thread.join(30.0)
        assert not self.thread.is_alive()

    def raw(self, content=b"", seconds=10.0):
        found = socket.create_connection(("127.0.0.1", self.port), timeout=seconds)
        found.sendall(content)
        return found

    def ask(self, path, **headers):
        connection = http.client.HTTPConnection(self.host, timeout=20.0)
        connection.request("GET", path, headers={"Cookie": self.cookie, **headers})
        answer = connection.getresponse()
        found = answer.status, answer.read().decode()
        connection.close()
        return found

    def page(self, **headers):
        headers = {"Cookie": self.cookie, **headers}
        origin = f"http://{self.host}"
        address = f"ws://{self.host}/ws"
        return connect(address, origin=origin, additional_headers=headers, proxy=None)


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    found = Running(tmp_path_factory.mktemp("sessions"))
    yield found
    found.stop()


def read_all(client):
    parts = []
    while part := client.recv(4096):
        parts.append(part)
    return b"".join(parts).decode()


def told(page, kind):
    while True:
        content = page.recv(timeout=20.0)
        if isinstance(content, str) and json.loads(content)["type"] == kind:
            return json.loads(content)


def test_a_pilot_continues_and_another_connects_during_a_flood_of_strangers(running):
    begun = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    with running.page() as pilot:
        pilot.send(json.dumps({"type": "take", "seq": 1, "t": 1.0}))
        while not told(pilot, "controls")["grant"]:
            pass
        strangers = [running.raw(begun if k % 2 else b"") for k in range(100)]
        with running.page() as other:
            assert told(other, "controls")["pilot"] == 1
        pilot.send(json.dumps({"type": "ping", "seq": 2, "t": 2.0}))
        assert told(pilot, "pong")["seq"] == 2
        for each in strangers:  # all of them are closed by the server
            try:
                assert each.recv(1) == b""
            except ConnectionResetError:
                pass
            finally:
                each.close()
    assert not any(isinstance(order, messages.Drive) for order in running.link.orders)


def test_what_is_not_finished_in_time_is_closed(running):
    client = running.raw(b"GET / HTTP/1.1\r\nX-Slow: ")
    assert read_all(client) == ""
    client.close()


def test_an_address_of_thousands_of_characters_is_answered(running):
    assert running.ask("/api/recordings?" + "x" * 30_000)[0] == 200
    status, sentence = running.ask("/?" + "x" * 200_000)
    assert status == 431
    assert "shorten the name" in sentence


def test_what_a_websocket_would_break_off_is_answered(running):
    foreign = f"{running.cookie}; other={'x' * LONGEST_HEADER}"
    with pytest.raises(Exception, match="431"):
        running.page(Cookie=foreign)
    assert running.ask("/api/recordings", Cookie=foreign)[0] == 200


@pytest.mark.parametrize("content", [b"\x16\x03\x01\x02\x00\x01\r\n\r\n", b"hello\r\n\r\n"])
def test_an_invalid_request_is_answered(running, content):
    client = running.raw(content)
    answer = read_all(client)
    client.close()
    assert answer.startswith("HTTP/1.1 400 ")
    assert "not a valid HTTP request" in answer


def test_a_browser_with_the_cookie_continues_after_a_restart(running):
    assert running.ask("/api/recordings")[0] == 200
    running.stop()
    running.start(running.authentication)
    assert running.ask("/api/recordings")[0] == 200


def test_a_websocket_that_is_closing_does_not_disturb_the_end(running):
    """Over https, a connection is in this state for as long as its other end takes."""

    async def end():
        protocol = Sockets(running.server.config, uvicorn.server.ServerState(), {})
        protocol.transport, protocol.handshake_complete = Mock(), True
        protocol.conn.state = State.CLOSING
        protocol.shutdown()
        return protocol.transport.close.called

    assert asyncio.run(end())


def test_a_text_that_is_not_utf_8_is_refused_with_a_reason_and_no_traceback(running, caplog):
    with running.page() as page:
        page.send(b'{"type":"\xff"}', text=True)
        with pytest.raises(ConnectionClosed, match="not UTF-8; send JSON texts"):
            told(page, "never")
    assert caplog.records == []


def test_a_request_that_the_end_of_the_server_cuts_off_is_no_error():
    async def cut_off(scope, receive, send):
        raise asyncio.CancelledError

    asyncio.run(_Marking(cut_off, Mock())({"type": "lifespan"}, Mock(), Mock()))


def test_few_messages_are_logged_in_a_time(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("minorloop_head.console.serving.time.monotonic", lambda: now[0])
    seldom = RateLimitedLog(most=2, seconds=10.0)

    def record():
        return logging.LogRecord("x", logging.ERROR, "x", 1, "it %s", ("failed",), None)

    assert [seldom.filter(record()) for _ in range(5)] == [True, True, False, False, False]
    now[0] += 11.0
    late = record()
    assert seldom.filter(late)
    assert late.getMessage() == "it failed (3 more messages were left out)"
