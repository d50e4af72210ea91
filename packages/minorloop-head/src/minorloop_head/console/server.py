"""The server of the pages: it passes messages between the pages and the control loop.

It does not steer. The control loop is a separate process, and holds if the server fails.
"""

from __future__ import annotations

import asyncio
import contextlib
import pickle
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from minorloop.errors import MinorloopError, SignalError, counted
from minorloop.page.admission import Admission
from minorloop.page.auth import Authentication
from minorloop.page.connections import admit
from minorloop.page.lab import LabPage, files_of, page_of
from minorloop.page.workers import Workers
from minorloop_head.console import messages, recording
from minorloop_head.console.clients import SILENCE, Clients, HostileMessageError, Viewer
from minorloop_head.console.link import ConsoleLink
from minorloop_head.console.reports import table_of
from minorloop_head.console.settings import STATIC, LoopSettings
from minorloop_head.console.units import to_si
from minorloop_head.console.wall_image import WallImage
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.vision.imaging import opencv

_PAINT_EVERY, _SHOW_EVERY = 5, 25
"""Pictures per update of the map, and per message with it: five and one per second."""
_JOB = bytes([messages.JOB])
_MOST_MESHES = 100
"""Largest number of findings whose meshes are kept in memory."""
_MESHES = {"ply": "application/octet-stream", "glb": "model/gltf-binary"}
_SWEPT = {"png": "image/png", "csv": "text/csv"}
_MEASURED = ("phi", "phi_sd", "z", "z_sd", "diameter", "diameter_sd", "depth", "depth_sd")
_CLOSED, _REFUSED = 1001, 1008  # codes of RFC 6455


@dataclass(frozen=True, kw_only=True)
class Console:
    """The server of the console."""

    authentication: Authentication
    loop: LoopSettings = field(default_factory=LoopSettings)
    link: Callable[..., ConsoleLink] = ConsoleLink
    """Creates the link to the control loop from its settings and a receiver of its messages."""
    workers: int = 2
    """Simultaneous computations of the lab page."""

    def app(self) -> Starlette:
        """Return the application, for uvicorn."""
        return _Server(self).app()


class _Server:
    def __init__(self, console: Console) -> None:
        self._authentication = console.authentication
        self._folder = Path(console.loop.folder)
        self._clients = Clients(silence=max(SILENCE, 3 * console.loop.timeout))
        self._workers = console.workers
        self._link = console.link(console.loop, self._receive)
        self._wall_image: WallImage | None = None
        self._painting = False
        self._images = 0
        self._meshes: dict[int, dict[str, bytes]] = {}
        self._sweeps, self._swept = 0, dict[str, bytes]()
        self._mapping: set[asyncio.Task[None]] = set()
        self._fitting: dict[asyncio.Task[None], int] = {}
        self._known: set[int] = set()
        self._fitters = Workers(
            min(self._workers, 1), tasks="minorloop_head.console.depth_work", longest=300.0, nice=7
        )
        # Import and compile now, or all pages wait at the first picture. No process may be started
        # while OpenCV is imported, since that changes the path of modules meanwhile.
        opencv()
        lens = Pinhole(32, 24, 26.0, (15.5, 11.5))
        small = HeadCalibration(lens=lens, leds=np.zeros((3, 3)))
        WallImage(small, 0.05).paint(np.zeros((24, 32), np.uint8), (0.0, 0.0, 0.0, 0.0))

    def app(self) -> Starlette:
        self._lab = LabPage(workers=self._workers)
        routes: list[BaseRoute] = [
            Route("/", self._operate),
            WebSocketRoute("/ws", self._connect),
            Route("/api/recordings", self._recordings),
            Route("/api/findings.json", self._findings),
            Route("/api/findings.csv", self._findings_csv),
            Route("/api/findings/{number}.{kind}", self._mesh),
            Route("/api/map.png", self._map),
            Route("/api/sweep.{kind}", self._sweep),
            *self._lab.routes(),
            *files_of(STATIC, "/"),
        ]
        middleware = [Middleware(Admission, authentication=self._authentication)]
        return Starlette(routes=routes, middleware=middleware, lifespan=self._lifespan)

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        self._events = asyncio.get_running_loop()
        self._link.start()
        await self._lab.start()
        watch = asyncio.create_task(self._watch())
        try:
            yield
        finally:
            watch.cancel()
            await self._lab.stop()
            await self._fitters.stop()
            await asyncio.to_thread(self._link.stop)

    async def _operate(self, request: Request) -> Response:
        return page_of(STATIC / "index.html")

    async def _watch(self) -> None:
        """Take the controls back from a silent pilot."""
        while True:
            await asyncio.sleep(0.25)
            if self._clients.is_pilot_silent(time.monotonic()):
                pilot = self._clients.pilot
                self._free()
                if pilot is not None:
                    text = "the controls were taken back: your page sent nothing"
                    pilot.send(messages.encode(messages.Notice(text=text)))

    def _free(self) -> None:
        self._clients.free()
        self._link.order(messages.Release(seq=0, t=0.0, grant=0))

    def _receive(self, content: bytes) -> None:
        """Pass on a message of the loop or the camera process."""
        if content[:1] == _JOB:
            self._begin_fit(pickle.loads(content[1:]))  # from the camera process only
            return
        if content[:1] != b"{":
            self._clients.send_newest("image", content)
            self._images += 1
            if (
                self._images % _PAINT_EVERY == 0
                and self._wall_image is not None
                and not self._painting
            ):
                self._painting = True
                show = self._images % _SHOW_EVERY == 0
                asyncio.get_running_loop().run_in_executor(None, self._paint, content, show)
            return
        if content.startswith(b'{"type":"state"'):
            self._clients.failed = None
            self._clients.send_newest("state", content)
            return
        if content.startswith(b'{"type":"hello"'):
            self._handle_hello(content)
        elif content.startswith(b'{"type":"findings"'):
            self._clients.findings = content
            self._keep_known({f.number for f in messages.decode_findings(content)})
        elif content.startswith(b'{"type":"recording"'):
            self._clients.recording = content
        elif content.startswith(b'{"type":"failed"'):
            self._clients.failed = content
        self._clients.send(content)

    def _handle_hello(self, hello: bytes) -> None:
        """Handle the first message of a loop; send the findings to a restarted loop."""
        self._clients.hello = hello
        if self._wall_image is None:
            self._wall_image = WallImage(
                HeadCalibration.from_dict(msgspec.json.decode(hello)["known"])
            )
        findings = messages.decode_findings(self._clients.findings)
        if findings:
            self._link.order(messages.KnownFindings(findings=findings))

    def _keep_known(self, numbers: set[int]) -> None:
        """Drop fits and meshes of deleted findings; prepare a scan at the first finding."""
        self._known = numbers
        if numbers:
            self._fitters.start()
        for number in set(self._meshes) - numbers:
            del self._meshes[number]
        for fitting, number in self._fitting.items():
            if number not in numbers:
                fitting.cancel()
                self._send_progress(number, "", 0.0)

    def _begin_fit(self, job: dict[str, Any]) -> None:
        if "finding" not in job:
            mapping = asyncio.get_running_loop().create_task(self._map_sweep(job))
            self._mapping.add(mapping)
            mapping.add_done_callback(self._mapping.discard)
            return
        if job["finding"] not in self._known:  # deleted during its scan
            return
        fitting = asyncio.get_running_loop().create_task(self._fit(job))
        self._fitting[fitting] = job["finding"]
        fitting.add_done_callback(self._fitting.pop)

    async def _fit(self, job: dict[str, Any]) -> None:
        """Fit the echoes of a scan in a worker; send the result to the loop and the pages."""
        number = job["finding"]
        last: dict[str, Any] = {}
        began = time.monotonic()
        async for last in self._fitters.run("depth", **job):
            if "stage" in last:
                self._send_progress(number, last["stage"], round(time.monotonic() - began, 1))
        if "error" in last:
            text = f"the depth is unknown: {last['error']}"
            self._clients.send(messages.encode(messages.Notice(text=text)))
        else:
            self._meshes[number] = last["meshes"]
            while len(self._meshes) > _MOST_MESHES:
                del self._meshes[next(iter(self._meshes))]
            self._link.order(messages.DepthFitted(finding=number, result=last["result"]))
        self._send_progress(number, "", 0.0)

    async def _map_sweep(self, job: dict[str, Any]) -> None:
        """Map the bursts of a sweep in a worker; send the finds to the loop and the pages."""
        self._send_progress(0, "mapping the wall", 0.0)
        found = await self._fitters.ask("sweep", **job)
        self._send_progress(0, "", 0.0)
        if "error" in found:
            text = f"there is no map of the sweep: {found['error']}"
            self._clients.send(messages.encode(messages.Notice(text=text)))
            return
        self._sweeps, self._swept = self._sweeps + 1, found["files"]
        mapped, whole, finds = round(found["mapped"], 3), found["whole"], len(found["finds"])
        self._clients.swept = messages.encode(
            messages.SweepMapped(number=self._sweeps, finds=finds, mapped=mapped, whole=whole)
        )
        self._clients.send(self._clients.swept)
        if not whole:
            said = f"the sweep was cut off: {mapped:.0%} of its area is mapped, with "
            notice = messages.Notice(text=f"{said}{counted(finds, 'find')}")
            self._clients.send(messages.encode(notice))
        self._link.order(messages.SweepFitted(finds=found["finds"]))

    def _send_progress(self, number: int, stage: str, seconds: float) -> None:
        progress = messages.DepthProgress(finding=number, stage=stage, seconds=seconds)
        self._clients.send(messages.encode(progress))

    def _paint(self, content: bytes, show: bool) -> None:
        """Add a picture to the map, and send the map if ``show``; for a thread."""
        try:
            cv2 = opencv()
            _, number, t, *where = messages.HEADER.unpack_from(content)
            coded = np.frombuffer(content, np.uint8, offset=messages.HEADER.size)
            image = cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE)
            assert self._wall_image is not None
            position = to_si(where)
            self._wall_image.paint(image, position)
            if show:
                grey, first, last = self._wall_image.window(position[2])
                _, jpeg = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 80])
                place = (1e3 * first, 1e3 * last, where[2], where[3])
                shown = messages.picture(messages.MAP, number, t, place, bytes(jpeg))
                self._events.call_soon_threadsafe(self._clients.send_newest, "map", shown)
        finally:
            self._painting = False

    async def _connect(self, socket: WebSocket) -> None:
        """Serve the websocket of a page until it closes."""
        headers = socket.headers
        if not self._authentication.is_own_page(headers.get("origin"), headers.get("host")):
            await _refuse(socket, "this connection comes from another page; open the console's own")
            return
        if not self._authentication.has_token(headers.get("cookie")):
            await _refuse(socket, "the key is missing; open the address that the console printed")
            return
        admit(socket.scope)
        await socket.accept()
        if "replay" in socket.query_params:
            await self._replay(socket, socket.query_params["replay"])
        else:
            await self._view(socket)

    async def _view(self, socket: WebSocket) -> None:
        """Send to a page and receive from it until it closes."""
        viewer = self._clients.join()
        sending = asyncio.create_task(_send(socket, viewer))
        try:
            await self._listen(socket, viewer)
        except (SignalError, WebSocketDisconnect) as error:
            if not isinstance(error, WebSocketDisconnect):
                await _close(socket, _REFUSED, str(error))
        finally:
            sending.cancel()
            if self._clients.leave(viewer):
                self._link.order(messages.Release(seq=0, t=0.0, grant=0))

    async def _listen(self, socket: WebSocket, viewer: Viewer) -> None:
        while True:
            frame = await socket.receive()
            if frame["type"] == "websocket.disconnect":
                return
            if frame.get("text") is None:
                raise HostileMessageError("binary messages are not accepted; send JSON texts")
            message = messages.decode(frame["text"])
            now = time.monotonic()
            viewer.check(message, now)
            if isinstance(message, messages.Ping):
                pong = messages.Pong(seq=message.seq, t=message.t)
                viewer.send_newest("pong", messages.encode(pong))
            elif isinstance(message, messages.Take):
                if self._clients.take(viewer):
                    self._link.order(messages.ControlsTaken())
            elif self._clients.may(viewer, message):
                self._link.order(message)
                if isinstance(message, messages.Release):
                    self._clients.free()

    async def _replay(self, socket: WebSocket, name: str) -> None:
        """Send a recording at its original rate."""
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
            await socket.send_text(messages.encode(messages.ReplayEnded()).decode())
            await _close(socket, _CLOSED, "the recording has ended")
        except MinorloopError as error:
            await _close(socket, _REFUSED, str(error))
        except (WebSocketDisconnect, RuntimeError):
            return

    async def _recordings(self, request: Request) -> Response:
        return JSONResponse(recording.listed(self._folder))

    async def _findings(self, request: Request) -> Response:
        found = messages.decode_findings(self._clients.findings)
        units = {name: "deg" if name.startswith("phi") else "mm" for name in _MEASURED}
        content = {"units": units, "findings": found}
        return _download(msgspec.json.encode(content), "application/json", "findings.json")

    async def _findings_csv(self, request: Request) -> Response:
        rows = messages.decode_findings(self._clients.findings)
        return _download(table_of(rows).encode(), "text/csv", "findings.csv")

    async def _mesh(self, request: Request) -> Response:
        number, kind = request.path_params["number"], request.path_params["kind"]
        written = {str(known): meshes for known, meshes in self._meshes.items()}
        mesh = written.get(number, {}).get(kind)
        if mesh is None:
            sentence = f"finding {number[:20]} has no {kind[:8]} yet; measure its depth first"
            return JSONResponse({"error": sentence}, status_code=404)
        return _download(mesh, _MESHES[kind], f"finding-{number}.{kind}")

    async def _sweep(self, request: Request) -> Response:
        kind = request.path_params["kind"]
        content = self._swept.get(kind)
        if content is None:
            sentence = f"there is no {kind[:8]} of a sweep; press Sweep, or ask for png or csv"
            return JSONResponse({"error": sentence}, status_code=404)
        return _download(content, _SWEPT[kind], f"sweep.{kind}")

    async def _map(self, request: Request) -> Response:
        if self._wall_image is None:
            return JSONResponse({"error": "there is no map yet"}, status_code=404)
        _, png = opencv().imencode(".png", self._wall_image.seen)
        return _download(bytes(png), "image/png", "map.png")


def _download(content: bytes, kind: str, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"', "Cache-Control": "no-store"}
    return Response(content, media_type=kind, headers=headers)


async def _send(socket: WebSocket, viewer: Viewer) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            for content in await viewer.outgoing():
                if content[:1] == b"{":
                    await socket.send_text(content.decode())
                else:
                    await socket.send_bytes(content)


async def _refuse(socket: WebSocket, reason: str) -> None:
    """Close with a reason; the connection is accepted first, so that the reason arrives."""
    await socket.accept()
    await _close(socket, _REFUSED, reason)


async def _close(socket: WebSocket, code: int, reason: str) -> None:
    """Close with a reason; the protocol allows 123 bytes."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await socket.close(code, reason.encode()[:120].decode(errors="ignore"))
