"""The lab page and its requests: uploaded files, identification, moves and inversion."""

import asyncio
import contextlib
import re
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from minorloop.operators.plane import Relay
from minorloop.page.admission import Admission, plain
from minorloop.page.auth import Authentication
from minorloop.page.uploads import RESULTS, FullError, Quota, Upload, Uploads
from minorloop.page.workers import Workers

STATIC = Path(__file__).parent / "static"
"""Folder of the page."""
_LONGEST_REQUEST = 512 * 1024
"""Most bytes of a request other than a file; 10,000 targets fit into it."""
_LONGEST_NAME = 120
"""Most bytes of the name under which a file is stored; systems allow 255."""
_MOST_JOBS = 32
"""Most requests that compute or wait at the same time."""
_PAUSE, _WHOLE = 10.0, 600.0
"""Most seconds without a byte, and for a whole body."""


class _Choice(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Columns and options of an identification; rows from ``first`` up to ``last`` are used."""

    input: str
    output: str
    time: str | None = None
    first: Annotated[int, msgspec.Meta(ge=0)] = 0
    last: Annotated[int, msgspec.Meta(ge=1)] | None = None
    skip: Annotated[int, msgspec.Meta(ge=0)] = 0
    curves: str | None = None
    start_of_curve: Literal["negative", "positive", "demagnetised", "as-left"] | None = None
    groups: str | None = None
    start: Literal["negative", "positive", "demagnetised"] = "negative"
    levels: Annotated[int, msgspec.Meta(ge=1, le=100)] | Literal["auto"] = "auto"
    diagonal: Literal["auto", "uniform", "reversible"] = "auto"
    slope: bool | Literal["auto"] = "auto"
    lag: Annotated[int, msgspec.Meta(ge=0, le=1000)] | Literal["auto"] = "auto"
    holdout: Annotated[float, msgspec.Meta(ge=0.0, le=0.9)] = 0.3
    spacing: Literal["uniform", "adaptive"] = "uniform"
    relay: Relay = "bipolar"
    signed: bool = False
    dynamics: Literal["none", "auto"] = "none"
    creep: Literal["none", "auto", "thermal", "spectrum"] = "none"
    rate: bool = False


class _Move(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One more input to the model; ``memory`` is the result of the last move."""

    u: float
    memory: Annotated[list[float], msgspec.Meta(max_length=1000)] | None = None


class _Targets(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Target outputs, in order."""

    targets: Annotated[list[float], msgspec.Meta(max_length=10_000)]
    start: Literal["negative", "positive", "demagnetised"] = "negative"


# Made at import, because it takes time that the first user would have to wait for.
_choices = msgspec.json.Decoder(_Choice)
_asked: dict[str, msgspec.json.Decoder[Any]] = {
    "move": msgspec.json.Decoder(_Move),
    "invert": msgspec.json.Decoder(_Targets),
}


class _RefusedError(Exception):
    """A request that is refused with a sentence."""

    def __init__(self, sentence: str, status: int = 422) -> None:
        super().__init__(sentence)
        self.status = status


def _answered(work: Callable[[Any, Request], Awaitable[Response]]) -> Any:
    """Return a method that answers a refusal with a response."""

    @wraps(work)
    async def answer(lab: Any, request: Request) -> Response:
        try:
            return await work(lab, request)
        except _RefusedError as error:
            return JSONResponse({"error": str(error)}, status_code=error.status)
        except FullError as error:
            return JSONResponse({"error": str(error)}, status_code=507)

    return answer


class LabPage:
    """Uploaded files and the workers that compute with them.

    ``workers`` is the number of simultaneous identifications; a further worker answers quick
    requests. Uploads are kept in ``folder``, by default in the system's folder for temporary files.
    """

    def __init__(
        self, *, workers: int = 2, quota: Quota | None = None, folder: Path | None = None
    ) -> None:
        self._quota = quota = quota or Quota()
        limited = partial(Workers, memory=quota.memory, file=quota.result)
        self._workers, self._quick = limited(workers), limited(1, longest=60.0)
        self._uploads = Uploads(quota, folder)
        self._jobs = 0

    def routes(self) -> list[BaseRoute]:
        """Return the routes of the lab page."""
        return [
            Route("/lab", self.open),
            *files_of(STATIC, "/lab"),
            Route("/api/lab", self._drop, methods=["POST"]),
            Route("/api/lab/{user}/identify", self._identify, methods=["POST"]),
            Route("/api/lab/{user}/move", self._ask, methods=["POST"]),
            Route("/api/lab/{user}/invert", self._ask, methods=["POST"]),
            Route("/api/lab/{user}/{file}", self._download),
        ]

    async def start(self) -> None:
        """Make the folder of uploads."""
        await self._uploads.start()
        self._expiring = asyncio.create_task(self._uploads.expire())

    async def open(self, request: Request) -> Response:
        """Return the page, and start the workers, which takes longer than the choice of a file."""
        self._workers.start()
        self._quick.start()
        return page_of(STATIC / "lab.html")

    async def stop(self) -> None:
        """Stop the workers and remove the files."""
        self._expiring.cancel()
        await self._workers.stop()
        await self._quick.stop()
        await self._uploads.stop()

    @_answered
    async def _drop(self, request: Request) -> Response:
        """Receive a file and describe its columns."""
        size = _length(request, self._quota.file)
        with self._job():
            upload = await self._received(request, size)
            described = await self._described(request, upload)
        return JSONResponse({"user": upload.key, **described})

    async def _received(self, request: Request, size: int) -> Upload:
        """Write the file of a request to disk; remove an incomplete file."""
        name = _name(request.query_params.get("name", ""))
        upload = await self._uploads.add(name, size)
        try:
            with upload.in_use():
                await self._uploads.write(upload, _chunks(request, self._quota.file))
        except BaseException:
            await self._uploads.remove(upload)
            raise
        return upload

    async def _described(self, request: Request, upload: Upload) -> dict[str, Any]:
        """Describe a file; it is removed if its page has closed, or it is unusable."""
        found: dict[str, Any] = {}
        try:
            found = await _while_connected(request, self._look(upload))
            if "error" in found:
                raise _RefusedError(found["error"])
        finally:
            if "columns" not in found:
                await self._uploads.remove(upload)
        return found

    async def _look(self, upload: Upload) -> dict[str, Any]:
        with upload.in_use():
            return await self._quick.ask("look", folder=str(upload.folder), name=upload.name)

    @_answered
    async def _identify(self, request: Request) -> Response:
        """Send stages and the result, each as a line of JSON."""
        upload = self._upload(request)
        choice = await _decoded(request, _choices)
        return StreamingResponse(
            self._identified(upload, msgspec.structs.asdict(choice)),
            media_type="application/x-ndjson",
            headers={"Cache-Control": "no-store"},
        )

    async def _identified(self, upload: Upload, choice: dict[str, Any]) -> AsyncIterator[bytes]:
        options = {"folder": str(upload.folder), "name": upload.name, **choice}
        try:
            with upload.in_use(), self._job():
                async for report in self._workers.run("identify_file", **options):
                    yield _line(report)
        except _RefusedError as error:
            yield _line({"error": str(error)})

    @_answered
    async def _ask(self, request: Request) -> Response:
        """Answer a move or targets."""
        task = request.url.path.rsplit("/", 1)[-1]
        upload = self._upload(request)
        options = msgspec.structs.asdict(await _decoded(request, _asked[task]))
        with upload.in_use(), self._job():
            found = await self._quick.ask(task, folder=str(upload.folder), **options)
        if "error" in found:
            raise _RefusedError(found["error"])
        return JSONResponse(found)

    @_answered
    async def _download(self, request: Request) -> Response:
        upload, name = self._upload(request, 404), request.path_params["file"]
        file = upload.folder / name
        if name not in RESULTS or not file.is_file():
            raise _RefusedError("this file does not exist yet; identify a model first", 404)
        return FileResponse(file, filename=name, headers={"Cache-Control": "no-store"})

    def _upload(self, request: Request, status: int = 422) -> Upload:
        upload = self._uploads.find(request.path_params["user"])
        if upload is None:
            raise _RefusedError("this file was removed; drop it again", status)
        return upload

    @contextlib.contextmanager
    def _job(self) -> Iterator[None]:
        """Count a job while it runs or waits."""
        if self._jobs >= _MOST_JOBS:
            raise _RefusedError("the lab is busy; try again in a minute", 503)
        self._jobs += 1
        try:
            yield
        finally:
            self._jobs -= 1


def application(authentication: Authentication, lab: LabPage) -> Starlette:
    """Return the application that serves only the lab page."""

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        await lab.start()
        try:
            yield
        finally:
            await lab.stop()

    middleware = [Middleware(Admission, authentication=authentication)]
    routes = [Route("/", lab.open), *lab.routes()]
    return Starlette(routes=routes, middleware=middleware, lifespan=lifespan)


def page_of(file: Path) -> Response:
    """Return a page that `make pages` has built, or a sentence on how to build it."""
    if not file.is_file():
        return plain(503, "the pages are not built; run 'make pages', which needs node, and reload")
    return FileResponse(file, headers={"Cache-Control": "no-cache"})


def files_of(folder: Path, path: str) -> list[BaseRoute]:
    """Return the route of the files that the pages of a folder load, if they are built."""
    return [Mount(path, StaticFiles(directory=folder))] if folder.is_dir() else []


async def _while_connected(request: Request, work: Coroutine[Any, Any, dict[str, Any]]) -> Any:
    """Return the result of some work; cancel it if the page closes."""
    job = asyncio.ensure_future(work)
    # After the body, the next event is the end of the connection.
    closed = asyncio.ensure_future(request.receive())
    try:
        await asyncio.wait((job, closed), return_when=asyncio.FIRST_COMPLETED)
        if not job.done():
            raise _RefusedError(_CLOSED)
        return job.result()
    finally:
        job.cancel()
        closed.cancel()
        await asyncio.gather(job, closed, return_exceptions=True)


_CLOSED = "the page was closed"


def _too_large(most: int) -> _RefusedError:
    shown = f"{most >> 20} MiB" if most >> 20 else f"{most >> 10} KiB"
    return _RefusedError(
        f"the request is larger than {shown}; give a smaller file, or use "
        "'minorloop identify' on the command line",
        413,
    )


def _length(request: Request, most: int) -> int:
    """Return the announced bytes of a body, or the largest allowed number."""
    announced = request.headers.get("content-length")
    length = most if announced is None else int(announced)
    if length > most:
        raise _too_large(most)
    return length


async def _chunks(request: Request, most: int) -> AsyncIterator[bytes]:
    """Yield the parts of a body; refuse a body that is too large or too slow."""
    size, end = 0, time.monotonic() + _WHOLE
    stream = aiter(request.stream())
    try:
        while True:
            async with asyncio.timeout(min(_PAUSE, end - time.monotonic())):
                chunk = await anext(stream, None)
            if chunk is None:
                return
            size += len(chunk)
            if size > most:
                raise _too_large(most)
            yield chunk
    except ClientDisconnect:
        raise _RefusedError(_CLOSED) from None
    except TimeoutError:
        raise _RefusedError("the request came too slowly; send it again", 408) from None


async def _decoded(request: Request, decoder: msgspec.json.Decoder[Any]) -> Any:
    _length(request, _LONGEST_REQUEST)
    content = b"".join([chunk async for chunk in _chunks(request, _LONGEST_REQUEST)])
    try:
        return decoder.decode(content)
    except (ValueError, RecursionError) as error:
        raise _RefusedError(f"the request cannot be read: {error}") from None


def _line(report: dict[str, Any]) -> bytes:
    return msgspec.json.encode(report) + b"\n"


def _name(given: str) -> str:
    """Return a file name that stays inside its folder and that file systems accept."""
    last = given[-10 * _LONGEST_NAME :].replace("\\", "/").rsplit("/", 1)[-1]
    plain = re.sub(r"[^\w .()+-]", "_", last)[-80:]
    while len(plain.encode()) > _LONGEST_NAME:
        plain = plain[1:]
    plain = plain.strip(" .")
    return plain if plain and plain not in RESULTS else "data.csv"
