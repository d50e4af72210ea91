"""Run the server of the pages with uvicorn, with limits for unauthenticated connections.

uvicorn limits neither the time of a slow request nor the number of connections (its
``limit_concurrency`` also refuses authenticated users). The listening socket limits both. The
protocol below answers requests that are too long so that the answer arrives.
"""

import asyncio
import logging
import sys
import time
from contextlib import suppress

import h11
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.exceptions import InvalidState

from minorloop.page.auth import WAITING, Serving
from minorloop.page.connections import Limits, Listener, mark

LONGEST_HEADER = 8000
"""Most bytes of the address of a request, and of each header: the limit of the websocket library.
"""
_LONGEST_HEAD, _MOST_HEADERS = 1 << 16, 100
"""Most bytes and largest number of all headers of a request."""
_LONG = (
    f"the address of the request or one of its headers is longer than {LONGEST_HEADER} bytes, or "
    f"there are more than {_MOST_HEADERS} headers; shorten the name of the file, or remove the "
    "cookies of this host in your browser"
)
_UNREADABLE = "this is not a valid HTTP request; open the address that the server printed"


def serve(
    app: ASGIApp,
    how: Serving,
    *,
    limits: Limits | None = None,
    server: type[uvicorn.Server] = uvicorn.Server,
) -> None:
    """Serve an application until a signal ends it; the socket is closed at the end.

    It may run again with the same authentication: browsers with the cookie stay connected. A
    subclass of ``server`` may decide when it ends.
    """
    listener = Listener(how.listening, limits)
    config = uvicorn.Config(
        _Marking(app, listener),
        http=_Http,
        ws=Sockets,
        log_level="warning",
        access_log=False,
        proxy_headers=False,  # connections are found by the address of their client
        h11_max_incomplete_event_size=_LONGEST_HEAD,
        ws_max_size=1 << 14,
        ws_max_queue=64,
        ws_per_message_deflate=False,
        ws_ping_interval=10.0,
        ws_ping_timeout=10.0,
        ssl_certfile=how.certificate,
        ssl_keyfile=how.private_key,
        timeout_graceful_shutdown=2,
        server_header=False,
        backlog=WAITING,
    )
    for name in ("uvicorn.error", "asyncio"):
        logging.getLogger(name).addFilter(_RateLimitedLog())
    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(_served(server(config), listener))


async def _served(server: uvicorn.Server, listener: Listener) -> None:
    sweeping = asyncio.create_task(listener.sweeping())
    try:
        await server.serve(sockets=[listener])
    finally:
        sweeping.cancel()


class _Marking:
    """Writes the connection of each request into its scope.

    A request that is cut off at the end of the server is not an error of the application.
    """

    def __init__(self, app: ASGIApp, listener: Listener) -> None:
        self._app, self._listener = app, listener

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "lifespan":
            mark(scope, self._listener)
        with suppress(asyncio.CancelledError):
            await self._app(scope, receive, send)


class _Http(H11Protocol):
    """HTTP protocol that answers a bad request with a sentence before it closes the connection."""

    _refused = False

    def data_received(self, data: bytes) -> None:
        """Receive data; data after a refusal is read and ignored, so that the answer arrives."""
        if not self._refused:
            super().data_received(data)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Refuse a request that the websocket library would close without an answer."""
        if self._too_long(event):
            self._refuse(431, _LONG)
        else:
            super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """Answer a request that cannot be read."""
        hint = getattr(sys.exc_info()[1], "error_status_hint", 400)
        self._refuse(hint, _LONG if hint == 431 else _UNREADABLE)

    def shutdown(self) -> None:
        """Close the connection, also after a refusal."""
        if self._refused:
            self.transport.close()
        else:
            super().shutdown()

    def _too_long(self, event: h11.Request) -> bool:
        headers = event.headers.raw_items()
        longest = max([len(event.target), *(len(name) + len(value) for name, value in headers)])
        return longest > LONGEST_HEADER or len(headers) > _MOST_HEADERS

    def _refuse(self, status: int, sentence: str) -> None:
        self._refused = True
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
            if self.cycle.response_started:
                self.transport.close()
                return
        body = (sentence + "\n").encode()
        head = (
            f"HTTP/1.1 {status} Refused\r\nContent-Type: text/plain; charset=utf-8\r\n"
            f"Content-Length: {len(body)}\r\nConnection: close\r\n"
            "X-Content-Type-Options: nosniff\r\n\r\n"
        )
        self.transport.write(head.encode() + body)
        self.flow.resume_reading()
        # Seconds that a refused connection stays open, for the answer to arrive
        self.loop.call_later(2.0, self.transport.abort)


class Sockets(WebSocketsSansIOProtocol):
    """Websocket protocol whose connection may already be closing at the end of the server.

    A text that is not UTF-8 closes the connection with a reason, instead of a traceback in the log.
    """

    def send_receive_event_to_app(self) -> None:
        """Pass on a whole message."""
        try:
            if self.curr_msg_data_type == "text":
                b"".join(self.frames).decode()
        except UnicodeDecodeError:
            self.frames = []
            self.conn.send_close(1007, "the message is not UTF-8; send JSON texts")
            self.handle_parser_exception()
        else:
            super().send_receive_event_to_app()

    def shutdown(self) -> None:
        """Close the connection."""
        try:
            super().shutdown()
        except InvalidState:
            self.transport.close()


class _RateLimitedLog(logging.Filter):
    """Log filter that passes at most five messages in ten seconds."""

    _most, _seconds = 5, 10.0
    _began, _count = -_seconds, 0

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a message may pass; the first after a pause gives the number left out."""
        now = time.monotonic()
        if now - self._began >= self._seconds:
            missing, self._began, self._count = self._count - self._most, now, 0
            if missing > 0:
                record.msg = f"{record.getMessage()} ({missing} more messages were left out)"
                record.args = ()
        self._count += 1
        return self._count <= self._most
