"""The server of the pages: who may come in, who is told what, and what the pilot orders.

It steers nothing: the control loop is a process of its own, and goes on holding whatever becomes
of the server.
"""

from __future__ import annotations

import asyncio
import contextlib
import pickle
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minorloop.errors import MinorloopError, MissingExtraError, SignalError
from minorloop.head.console import messages, recording
from minorloop.head.console.admission import Admission, plain
from minorloop.head.console.auth import Authentication
from minorloop.head.console.clients import SILENCE, Clients, HostileMessageError, Viewer
from minorloop.head.console.connections import admitted
from minorloop.head.console.imaging import opencv
from minorloop.head.console.link import ConsoleLink
from minorloop.head.console.plant import PlantView
from minorloop.head.console.reports import table_of
from minorloop.head.console.settings import LoopSettings
from minorloop.head.console.wall_image import WallImage
from minorloop.head.console.workers import Workers
from minorloop.head.geometry import Pinhole

try:
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.requests import Request
    from starlette.responses import FileResponse, JSONResponse, Response
    from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
    from starlette.staticfiles import StaticFiles
    from starlette.websockets import WebSocket, WebSocketDisconnect
except ImportError:
    raise MissingExtraError("starlette", "head") from None

STATIC = Path(__file__).parent / "static"
_PAINT_EVERY = 5
_SHOW_EVERY = 25
_JOB = bytes([messages.JOB])
_MOST_MESHES = 100
_MESHES = {"ply": "application/octet-stream", "glb": "model/gltf-binary"}
_MEASURED = ("phi", "phi_sd", "z", "z_sd", "diameter", "diameter_sd", "depth", "depth_sd")
_CLOSED, _REFUSED = 1001, 1008


@dataclass(frozen=True, kw_only=True)
class Console:
    """The seat's server.

    Parameters
    ----------
    doors : Authentication
    loop : LoopSettings
    link : callable
        What makes the link to the control loop from its settings and a listener.
    workers : int
        Computations of the lab page that may run at once.
    """

    doors: Authentication
    loop: LoopSettings = field(default_factory=LoopSettings)
    link: Callable[..., ConsoleLink] = ConsoleLink
    workers: int = 2

    def app(self) -> Starlette:
        """The application, for uvicorn."""
        return _Server(self).app()


class _Server:
    def __init__(self, console: Console) -> None:
        self._doors, self._folder = console.doors, Path(console.loop.folder)
        self._hub = Clients(silence=max(SILENCE, 3 * console.loop.timeout))
        self._workers = console.workers
        self._link = console.link(console.loop, self._said)
        self._wall: WallImage | None = None
        self._painting = False
        self._images = 0
        self._meshes: dict[int, dict[str, bytes]] = {}
        self._fitting: dict[asyncio.Task[None], int] = {}
        self._known: set[int] = set()
        many = min(self._workers, 1)
        self._fitters = Workers(
            many, tasks="minorloop.head.console.depth_work", longest=300.0, nice=7
        )
        # What the first picture would wait for, and everybody with it. While OpenCV is imported,
        # the path of modules is not one that a process should be started with.
        with contextlib.suppress(MissingExtraError):  # the camera says so
            opencv()
        lens = Pinhole(32, 24, 26.0, (15.5, 11.5))
        small = PlantView(lens=lens, leds=np.zeros((3, 3)))
        WallImage(small, 0.05).paint(np.zeros((24, 32), np.uint8), (0.0, 0.0, 0.0, 0.0))

    def app(self) -> Starlette:
        from minorloop.head.console.lab import LabPage

        self._lab = LabPage(workers=self._workers)
        routes: list[BaseRoute] = [
            Route("/", _page("index.html")),
            Route("/lab", _page("lab.html")),
            WebSocketRoute("/ws", self._meet),
            Route("/api/recordings", self._recordings),
            Route("/api/findings.json", self._findings),
            Route("/api/findings.csv", self._findings_csv),
            Route("/api/findings/{number}.{kind}", self._mesh),
            Route("/api/map.png", self._map),
            *self._lab.routes(),
        ]
        if STATIC.is_dir():
            routes.append(Mount("/", StaticFiles(directory=STATIC)))
        middleware = [Middleware(Admission, doors=self._doors)]
        return Starlette(routes=routes, middleware=middleware, lifespan=self._living)

    @contextlib.asynccontextmanager
    async def _living(self, app: Starlette) -> AsyncIterator[None]:
        self._events = asyncio.get_running_loop()
        self._link.start()
        await self._lab.start()
        await self._fitters.start()
        watch = asyncio.create_task(self._watch())
        try:
            yield
        finally:
            watch.cancel()
            await self._lab.stop()
            await self._fitters.stop()
            await asyncio.to_thread(self._link.stop)

    async def _watch(self) -> None:
        """Take the controls back from a pilot who has gone silent."""
        while True:
            await asyncio.sleep(0.25)
            if self._hub.silent(time.monotonic()):
                pilot = self._hub.pilot
                self._free()
                if pilot is not None:
                    pilot.tell(
                        messages.encode(
                            "notice", text="the controls were taken back: your page was silent"
                        )
                    )

    def _free(self) -> None:
        self._hub.free()
        self._link.order(messages.Release(seq=0, t=0.0, grant=0))

    def _said(self, content: bytes) -> None:
        """Pass on what the loop says."""
        if content[:1] == _JOB:
            self._begin_fit(pickle.loads(content[1:]))  # from our own process, by its own pipe
            return
        if content[:1] != b"{":
            self._hub.show("image", content)
            self._images += 1
            if self._images % _PAINT_EVERY == 0 and self._wall is not None and not self._painting:
                self._painting = True
                show = self._images % _SHOW_EVERY == 0
                asyncio.get_running_loop().run_in_executor(None, self._paint, content, show)
            return
        if content.startswith(b'{"type":"state"'):
            self._hub.failed = None
            self._hub.show("state", content)
            return
        if content.startswith(b'{"type":"hello"'):
            self._meet_loop(content)
        elif content.startswith(b'{"type":"findings"'):
            self._hub.findings = content
            self._keep_known({f["number"] for f in msgspec.json.decode(content)["findings"]})
        elif content.startswith(b'{"type":"recording"'):
            self._hub.recording = content
        elif content.startswith(b'{"type":"failed"'):
            self._hub.failed = content
        self._hub.tell(content)

    def _meet_loop(self, hello: bytes) -> None:
        """Take in what a loop says first; one that was started anew is told the findings."""
        self._hub.hello = hello
        if self._wall is None:
            self._wall = WallImage(PlantView.heard(msgspec.json.decode(hello)["known"]))
        findings = msgspec.json.decode(self._hub.findings)["findings"]
        if findings:
            self._link.order(messages.Known(findings=findings))

    def _keep_known(self, numbers: set[int]) -> None:
        """Drop fit and meshes of findings that were dropped."""
        self._known = numbers
        for number in set(self._meshes) - numbers:
            del self._meshes[number]
        for fitting, number in self._fitting.items():
            if number not in numbers:
                fitting.cancel()
                self._hub.tell(messages.encode("depth", finding=number, stage="", seconds=0.0))

    def _begin_fit(self, job: dict[str, Any]) -> None:
        if job["finding"] not in self._known:  # dropped while it was scanned
            return
        fitting = asyncio.get_running_loop().create_task(self._fit(job))
        self._fitting[fitting] = job["finding"]
        fitting.add_done_callback(self._fitting.pop)

    async def _fit(self, job: dict[str, Any]) -> None:
        """Have the echoes of a scan fitted, and tell the loop and the pages what came of it."""
        number, last = job["finding"], {}
        began = time.monotonic()
        async for told in self._fitters.run("depth", **job):
            last = told
            if "stage" in told:
                seconds = round(time.monotonic() - began, 1)
                self._hub.tell(
                    messages.encode("depth", finding=number, stage=told["stage"], seconds=seconds)
                )
        if "error" in last:
            self._hub.tell(messages.encode("notice", text=f"the depth is open: {last['error']}"))
        else:
            self._meshes[number] = last["meshes"]
            while len(self._meshes) > _MOST_MESHES:
                del self._meshes[next(iter(self._meshes))]
            self._link.order(messages.Sounded(finding=number, told=last["told"]))
        self._hub.tell(messages.encode("depth", finding=number, stage="", seconds=0.0))

    def _paint(self, content: bytes, show: bool) -> None:
        """Add a picture to the map, and show it now and then; in a thread."""
        try:
            cv2 = opencv()
            _, number, t, *where = messages.HEADER.unpack_from(content)
            coded = np.frombuffer(content, np.uint8, offset=messages.HEADER.size)
            image = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
            assert self._wall is not None
            self._wall.paint(image, tuple(where))
            if show:
                grey, first, last = self._wall.window(where[2])
                _, jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 80])
                place = (first, last, where[2], where[3])
                shown = messages.picture(messages.MAP, number, t, place, bytes(jpeg))
                self._hub_show_soon("map", shown)
        finally:
            self._painting = False

    def _hub_show_soon(self, what: str, content: bytes) -> None:
        self._events.call_soon_threadsafe(self._hub.show, what, content)

    async def _meet(self, socket: WebSocket) -> None:
        """Talk with a page until it goes."""
        headers = socket.headers
        if not self._doors.own(headers.get("origin"), headers.get("host")):
            await _refuse(socket, "this connection comes from another page; open the console's own")
            return
        if not self._doors.known(headers.get("cookie")):
            await _refuse(socket, "the key is missing; open the address that the console printed")
            return
        with admitted(socket.scope):
            await socket.accept()
            if "replay" in socket.query_params:
                await self._replay(socket, socket.query_params["replay"])
            else:
                await self._view(socket)

    async def _view(self, socket: WebSocket) -> None:
        """Show a page what there is, and hear it, until it goes."""
        viewer = self._hub.join()
        sending = asyncio.create_task(_send(socket, viewer))
        try:
            await self._listen(socket, viewer)
        except (SignalError, WebSocketDisconnect) as error:
            if not isinstance(error, WebSocketDisconnect):
                await _close(socket, _REFUSED, str(error))
        finally:
            sending.cancel()
            if self._hub.leave(viewer):
                self._link.order(messages.Release(seq=0, t=0.0, grant=0))

    async def _listen(self, socket: WebSocket, viewer: Viewer) -> None:
        while True:
            frame = await socket.receive()
            if frame["type"] == "websocket.disconnect":
                return
            if frame.get("text") is None:
                raise HostileMessageError("binary messages mean nothing here; send JSON texts")
            message = messages.decode(frame["text"])
            now = time.monotonic()
            viewer.check(message, now)
            if isinstance(message, messages.Ping):
                viewer.show("pong", messages.encode("pong", seq=message.seq, t=message.t))
            elif isinstance(message, messages.Take):
                if self._hub.take(viewer):
                    self._link.order(messages.Taken())
            elif self._hub.may(viewer, message):
                self._link.order(message)
                if isinstance(message, messages.Release):
                    self._hub.free()

    async def _replay(self, socket: WebSocket, name: str) -> None:
        """Send a recording at the pace at which it was made."""
        if name not in recording.listed(self._folder):
            await _close(socket, _REFUSED, f"there is no recording {name[:80]!r}")
            return
        path = self._folder / f"{name}{recording.SUFFIX}"
        began, first = time.monotonic(), None
        try:
            for kind, t, content in recording.entries(path):
                first = t if first is None else first
                await asyncio.sleep(max(began + t - first - time.monotonic(), 0.0))
                if kind == recording.TEXT:
                    await socket.send_text(content.decode())
                else:
                    await socket.send_bytes(content)
            await socket.send_text(messages.encode("ended").decode())
            await _close(socket, _CLOSED, "the recording has ended")
        except MinorloopError as error:
            await _close(socket, _REFUSED, str(error))
        except (WebSocketDisconnect, RuntimeError):
            return

    async def _recordings(self, request: Request) -> Response:
        return JSONResponse(recording.listed(self._folder))

    async def _findings(self, request: Request) -> Response:
        found = msgspec.json.decode(self._hub.findings)["findings"]
        units = {name: "deg" if name.startswith("phi") else "mm" for name in _MEASURED}
        content = {"units": units, "findings": found}
        return _download(msgspec.json.encode(content), "application/json", "findings.json")

    async def _findings_csv(self, request: Request) -> Response:
        rows = msgspec.json.decode(self._hub.findings)["findings"]
        return _download(table_of(rows).encode(), "text/csv", "findings.csv")

    async def _mesh(self, request: Request) -> Response:
        number, kind = request.path_params["number"], request.path_params["kind"]
        written = {str(known): meshes for known, meshes in self._meshes.items()}
        mesh = written.get(number, {}).get(kind)
        if mesh is None:
            sentence = f"finding {number[:20]} has no {kind[:8]} yet; measure its depth first"
            return JSONResponse({"error": sentence}, status_code=404)
        return _download(mesh, _MESHES[kind], f"finding-{number}.{kind}")

    async def _map(self, request: Request) -> Response:
        if self._wall is None:
            return JSONResponse({"error": "there is no map yet"}, status_code=404)
        _, png = opencv().imencode(".png", self._wall.seen)
        return _download(bytes(png), "image/png", "map.png")


def _page(name: str) -> Callable[[Request], Awaitable[Response]]:
    async def page(request: Request) -> Response:
        file = STATIC / name
        if not file.is_file():
            return plain(
                503, "the pages are not built; run 'make pages', which needs node, and reload"
            )
        return FileResponse(file, headers={"Cache-Control": "no-cache"})

    return page


def _download(content: bytes, kind: str, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
    return Response(content, media_type=kind, headers=headers)


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            for content in await viewer.waiting():
                if content[:1] == b"{":
                    await socket.send_text(content.decode())
                else:
                    await socket.send_bytes(content)


async def _refuse(socket: WebSocket, reason: str) -> None:
    """Accept, so that the reason arrives, and close."""
    await socket.accept()
    await _close(socket, _REFUSED, reason)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    """Close with a reason, which may be 123 bytes long."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await socket.close(code, reason.encode()[:120].decode(errors="ignore"))
