import asyncio
from unittest.mock import Mock

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from websockets.exceptions import ConnectionClosed
from websockets.protocol import State

from minorloop.page.admission import Admission
from minorloop.page.connections import admit
from minorloop.page.serving import LONGEST_HEADER, Sockets
from page_rig import Running


async def echo(socket):
    admit(socket.scope)
    await socket.accept()
    async for said in socket.iter_text():
        await socket.send_text(said)


def application(authentication):
    routes = [
        Route("/", lambda request: PlainTextResponse("")),
        Route("/known", lambda request: PlainTextResponse("")),
        WebSocketRoute("/ws", echo),
    ]
    admission = Middleware(Admission, authentication=authentication)
    return Starlette(routes=routes, middleware=[admission])


@pytest.fixture(scope="module")
def running():
    found = Running(application)
    yield found
    found.stop()


def read_all(client):
    parts = []
    while part := client.recv(4096):
        parts.append(part)
    return b"".join(parts).decode()


def test_what_is_not_finished_in_time_is_closed(running):
    client = running.raw(b"GET / HTTP/1.1\r\nX-Slow: ")
    assert read_all(client) == ""
    client.close()


def test_an_address_of_thousands_of_characters_is_answered(running):
    assert running.ask("/known?" + "x" * 30_000)[0] == 200
    status, sentence = running.ask("/?" + "x" * 200_000)
    assert status == 431
    assert "shorten the name" in sentence


def test_what_a_websocket_would_break_off_is_answered(running):
    foreign = f"{running.cookie}; other={'x' * LONGEST_HEADER}"
    with pytest.raises(Exception, match="431"):
        running.page(Cookie=foreign)
    assert running.ask("/known", Cookie=foreign)[0] == 200


def test_a_browser_with_the_cookie_continues_after_a_restart(running):
    assert running.ask("/known")[0] == 200
    running.stop()
    running.start(running.authentication)
    assert running.ask("/known")[0] == 200


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
            page.recv(timeout=20.0)
    assert caplog.records == []
