"""Checks of every HTTP request, and security headers of every response."""

from typing import Any

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Receive, Scope, Send

from minorloop.page.auth import Authentication
from minorloop.page.connections import admit

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
    """Admits requests that have the key or the cookie and come from pages of this server."""

    def __init__(self, app: ASGIApp, authentication: Authentication) -> None:
        self._app, self._authentication = app, authentication

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or pass it on; the server itself checks websockets."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        response = self._refusal(request)
        host = request.headers.get("host") if response is None else None
        secured = _with_headers(send, host)
        if response is None and self._authentication.is_key(request.query_params.get("key")):
            response = self._welcome(request)
        elif response is None and not self._has_token(request):
            response = plain(403, "open the address that the server printed, with its key")
        if response is not None:
            await response(scope, receive, secured)
            return
        admit(scope)
        await self._app(scope, receive, secured)

    def _has_token(self, request: Request) -> bool:
        return self._authentication.has_token("; ".join(request.headers.getlist("cookie")))

    def _refusal(self, request: Request) -> Response | None:
        host = request.headers.get("host")
        if not self._authentication.is_own_host(host):
            return plain(421, "this server has another name")
        origin = request.headers.get("origin")
        if request.method not in ("GET", "HEAD") and not self._authentication.is_own_page(
            origin, host
        ):
            return plain(403, "this request comes from another page")
        return None

    def _welcome(self, request: Request) -> Response:
        # A path that begins with two slashes would name another host.
        response = RedirectResponse("/" + request.url.path.lstrip("/"), status_code=303)
        # A proxy sets the header if browsers use https; a false header harms only its sender.
        proxied = request.headers.get("x-forwarded-proto", "") == "https"
        response.set_cookie(
            self._authentication.cookie,
            self._authentication.token,
            httponly=True,
            samesite="lax",
            secure=proxied or request.url.scheme == "https",
        )
        return response


def _with_headers(send: Send, host: str | None) -> Send:
    """Add the security headers; pages may open their websocket at ``host``."""
    sockets = "" if host is None else f" ws://{host} wss://{host}"
    headers = {"Content-Security-Policy": _POLICY.format(sockets=sockets), **_HEADERS}
    extra = [(name.lower().encode(), value.encode()) for name, value in headers.items()]

    async def wrapped(message: Any) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", []), *extra]}
        await send(message)

    return wrapped


def plain(status: int, text: str) -> Response:
    """Return a response of one sentence."""
    return Response(text + "\n", status_code=status, media_type="text/plain")
