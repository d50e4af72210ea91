"""What every request is asked at the door, and what every answer says to the browser."""

from __future__ import annotations

from typing import Any

from minorloop.errors import MissingExtraError
from minorloop.head.console.auth import Authentication
from minorloop.head.console.connections import admitted

try:
    from starlette.requests import Request
    from starlette.responses import RedirectResponse, Response
    from starlette.types import ASGIApp, Receive, Scope, Send
except ImportError:
    raise MissingExtraError("starlette", "head") from None

_POLICY = (
    "default-src 'self'; img-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; "
    "connect-src 'self'{sockets}; object-src 'none'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'"
)
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "xr-spatial-tracking=(self), gyroscope=(self), accelerometer=(self)",
}


class Admission:
    """Lets in who has the key, and pages of this server only.

    Parameters
    ----------
    app : ASGI application
    doors : Authentication
    """

    def __init__(self, app: ASGIApp, doors: Authentication) -> None:
        self._app, self._doors = app, doors

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request that may not come in; websockets get their reason from the server."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        response = self._refusal(request)
        host = request.headers.get("host") if response is None else None
        guarded = _with_headers(send, host)
        if response is None and self._doors.opens(request.query_params.get("key")):
            response = self._welcome(request)
        elif response is None and not self._known(request):
            response = plain(403, "open the address that the console printed, with its key")
        if response is not None:
            await response(scope, receive, guarded)
            return
        with admitted(scope):
            await self._app(scope, receive, guarded)

    def _known(self, request: Request) -> bool:
        return self._doors.known("; ".join(request.headers.getlist("cookie")))

    def _refusal(self, request: Request) -> Response | None:
        host = request.headers.get("host")
        if not self._doors.serves(host):
            return plain(421, "this server has another name")
        origin = request.headers.get("origin")
        if request.method not in ("GET", "HEAD") and not self._doors.own(origin, host):
            return plain(403, "this request comes from another page")
        return None

    def _welcome(self, request: Request) -> Response:
        # Two slashes at the beginning would name another host.
        response = RedirectResponse("/" + request.url.path.lstrip("/"), status_code=303)
        # A proxy says so if browsers talk https with it; a lie would only lock out who tells it.
        proxied = request.headers.get("x-forwarded-proto", "") == "https"
        response.set_cookie(
            self._doors.cookie,
            self._doors.token,
            httponly=True,
            samesite="lax",
            secure=proxied or request.url.scheme == "https",
        )
        return response


def _with_headers(send: Send, host: str | None) -> Send:
    """Add what every answer says; ``host`` is where pages may open their websocket."""
    sockets = "" if host is None else f" ws://{host} wss://{host}"
    headers = {"Content-Security-Policy": _POLICY.format(sockets=sockets), **_HEADERS}
    extra = [(name.lower().encode(), value.encode()) for name, value in headers.items()]

    async def wrapped(message: Any) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return wrapped


def plain(status: int, text: str) -> Response:
    """An answer of one sentence."""
    return Response(text + "\n", status_code=status, media_type="text/plain")
