"""The lab page's side of the server: files in, models out, each user in a folder of their own."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from collections.abc import AsyncIterator, Coroutine, Iterator
from typing import Annotated, Any, Literal

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from minorloop.head.console import lab_work
from minorloop.head.console.uploads import FullError, Quota, Upload, Uploads
from minorloop.head.console.workers import Workers

_LONGEST_REQUEST = 512 * 1024
_LONGEST_NAME = 120
"""Bytes of the name under which a file is kept; systems allow 255."""
_MOST_JOBS = 32
_AT_ONCE = 4
_PAUSE, _WHOLE = 10.0, 600.0
"""Seconds without a byte, and from the first byte of a body to its last."""


class _Choice(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What to identify, and how."""

    input: str
    output: str
    levels: Annotated[int, msgspec.Meta(ge=1, le=100)] = 25
    lag: Annotated[int, msgspec.Meta(ge=0, le=1000)] | Literal["auto"] = "auto"
    holdout: Annotated[float, msgspec.Meta(ge=0.0, le=0.9)] = 0.3
    spacing: Literal["uniform", "adaptive"] = "uniform"
    relay: Literal["bipolar", "unipolar"] = "bipolar"
    signed: bool = False


class _Move(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One more input to the model; ``memory`` is what the last move gave."""

    u: float
    memory: Annotated[list[float], msgspec.Meta(max_length=1000)] | None = None


class _Targets(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Outputs wanted, in order."""

    targets: Annotated[list[float], msgspec.Meta(max_length=10_000)]
    start: Literal["negative", "positive", "demagnetised"] = "negative"


class LabPage:
    """Files, their users, and the workers that compute for them.

    Parameters
    ----------
    workers : int
        Computations that may run at once; where there are two or more, large files leave one to
        small files.
    quota : Quota, optional
        What files may take.
    """

    def __init__(self, *, workers: int = 2, quota: Quota | None = None) -> None:
        self._workers, self._quick = Workers(workers), Workers(1, longest=20.0)
        self._quota = quota or Quota()
        self._uploads = Uploads(self._quota)
        self._jobs, self._large = 0, 0
        self._reading = asyncio.Semaphore(_AT_ONCE)
        self._for_large = asyncio.Semaphore(max(workers - 1, 1))

    def routes(self) -> list[BaseRoute]:
        """What the page asks for."""
        return [
            Route("/api/lab", self._drop, methods=["POST"]),
            Route("/api/lab/{user}/identify", self._identify, methods=["POST"]),
            Route("/api/lab/{user}/move", self._move, methods=["POST"]),
            Route("/api/lab/{user}/invert", self._invert, methods=["POST"]),
            Route("/api/lab/{user}/{file}", self._download),
        ]

    async def start(self) -> None:
        """Make room, and start the workers."""
        await self._uploads.start()
        self._expiring = asyncio.create_task(self._uploads.expire())
        await self._workers.start()
        await self._quick.start()

    async def stop(self) -> None:
        """End the workers and remove the files."""
        self._expiring.cancel()
        await self._workers.stop()
        await self._quick.stop()
        await self._uploads.stop()

    async def _drop(self, request: Request) -> Response:
        """Take in a file."""
        try:
            size = _length(request, self._quota.file)
            with self._job(size):
                upload = await self._received(request, size)
                told = await self._looked_at(request, upload)
        except _RefusedError as error:
            return _refusal(str(error), error.status)
        except FullError as error:
            return _refusal(str(error), 507)
        return JSONResponse({"user": upload.key, **told})

    async def _received(self, request: Request, size: int) -> Upload:
        """The file of a request, on disk; nothing is left of one that does not come whole."""
        name = _name(request.query_params.get("name", ""))
        upload = await self._uploads.add(name, size)
        try:
            async with contextlib.AsyncExitStack() as stack:
                if size > self._quota.small:
                    await stack.enter_async_context(self._reading)
                stack.enter_context(upload.in_use())
                await self._uploads.write(upload, _chunks(request, self._quota.file))
        except BaseException:
            await self._uploads.remove(upload)
            raise
        return upload

    async def _looked_at(self, request: Request, upload: Upload) -> dict[str, Any]:
        """What is in a file; it is removed if its page has gone, or nothing can be done with it."""
        told: dict[str, Any] = {}
        try:
            told = await _while_there(request, self._look(upload))
            if "error" in told:
                raise _RefusedError(told["error"])
        finally:
            if "columns" not in told:
                await self._uploads.remove(upload)
        return told

    async def _look(self, upload: Upload) -> dict[str, Any]:
        options = {"folder": str(upload.folder), "name": upload.name}
        with upload.in_use():
            if not self._is_large(upload):
                return await self._quick.ask("look", **options)
            async with self._for_large:
                return await self._workers.ask("look", **options)

    async def _identify(self, request: Request) -> Response:
        """Stages and the result, a line of JSON each, as they come."""
        try:
            upload = self._upload(request)
            choice = await _decoded(request, _Choice)
        except _RefusedError as error:
            return _refusal(str(error), error.status)
        return StreamingResponse(
            self._identified(upload, msgspec.structs.asdict(choice)),
            media_type="application/x-ndjson",
            headers={"Cache-Control": "no-store"},
        )

    async def _identified(self, upload: Upload, choice: dict[str, Any]) -> AsyncIterator[bytes]:
        options = {"folder": str(upload.folder), "name": upload.name, **choice}
        try:
            async with contextlib.AsyncExitStack() as stack:
                stack.enter_context(upload.in_use())
                stack.enter_context(self._job(upload.length))
                if self._is_large(upload):
                    if self._for_large.locked():
                        yield _line({"stage": "waiting for other large files"})
                    await stack.enter_async_context(self._for_large)
                async for told in self._workers.run("identify_file", **options):
                    yield _line(told)
        except _RefusedError as error:
            yield _line({"error": str(error)})

    async def _move(self, request: Request) -> Response:
        return await self._asked(request, "move", _Move)

    async def _invert(self, request: Request) -> Response:
        return await self._asked(request, "invert", _Targets)

    async def _asked(self, request: Request, task: str, kind: type[msgspec.Struct]) -> Response:
        try:
            upload = self._upload(request)
            asked = msgspec.structs.asdict(await _decoded(request, kind))
            with upload.in_use(), self._job(0):
                told = await self._quick.ask(task, folder=str(upload.folder), **asked)
        except _RefusedError as error:
            return _refusal(str(error), error.status)
        return _refusal(told["error"]) if "error" in told else JSONResponse(told)

    async def _download(self, request: Request) -> Response:
        try:
            upload = self._upload(request)
        except _RefusedError as error:
            return _refusal(str(error), 404)
        name = request.path_params["file"]
        file = upload.folder / name
        if name not in _TAKEN or not file.is_file():
            return _refusal("there is no such file yet", 404)
        return FileResponse(file, filename=name, headers={"Cache-Control": "no-store"})

    def _upload(self, request: Request) -> Upload:
        upload = self._uploads.find(request.path_params["user"])
        if upload is None:
            raise _RefusedError("this file is no longer here; drop it again")
        return upload

    def _is_large(self, upload: Upload) -> bool:
        return upload.length > self._quota.small

    @contextlib.contextmanager
    def _job(self, size: int) -> Iterator[None]:
        """Count a job while it is done, or waits; large files are fewer than all."""
        large = int(size > self._quota.small)
        if self._jobs >= _MOST_JOBS or self._large + large > self._quota.large:
            raise _RefusedError("the lab has too much to do; try again in a minute", 503)
        self._jobs, self._large = self._jobs + 1, self._large + large
        try:
            yield
        finally:
            self._jobs, self._large = self._jobs - 1, self._large - large


class _RefusedError(Exception):
    """A request that is answered with a sentence."""

    def __init__(self, sentence: str, status: int = 422) -> None:
        super().__init__(sentence)
        self.status = status


async def _while_there(request: Request, work: Coroutine[Any, Any, dict[str, Any]]) -> Any:
    """What work gives, unless the page goes away; then the work is broken off."""
    job = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(request.receive())  # after the body, only that it has gone comes
    try:
        await asyncio.wait((job, gone), return_when=asyncio.FIRST_COMPLETED)
        if not job.done():
            raise _RefusedError(_GONE)
        return job.result()
    finally:
        job.cancel()
        gone.cancel()
        await asyncio.gather(job, gone, return_exceptions=True)


_GONE = "the page has gone"


def _too_large(most: int) -> _RefusedError:
    shown = f"{most >> 20} MiB" if most >> 20 else f"{most >> 10} KiB"
    return _RefusedError(
        f"what was sent is larger than {shown}; give a smaller file, or use "
        "'minorloop identify' on the command line",
        413,
    )


def _length(request: Request, most: int) -> int:
    """Bytes that a body is going to have; as many as it may if it does not say."""
    said = request.headers.get("content-length")
    length = most if said is None else int(said)
    if length > most:
        raise _too_large(most)
    return length


async def _chunks(request: Request, most: int) -> AsyncIterator[bytes]:
    """A body as it comes; refused if it is too large, or comes too slowly."""
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
        raise _RefusedError(_GONE) from None
    except TimeoutError:
        raise _RefusedError("the request came too slowly; send it again", 408) from None


async def _decoded(request: Request, kind: type[Any]) -> Any:
    _length(request, _LONGEST_REQUEST)
    content = b"".join([chunk async for chunk in _chunks(request, _LONGEST_REQUEST)])
    try:
        return msgspec.json.decode(content, type=kind)
    except (ValueError, RecursionError) as error:
        raise _RefusedError(f"the request cannot be read: {error}") from None


def _line(told: dict[str, Any]) -> bytes:
    return msgspec.json.encode(told) + b"\n"


def _refusal(sentence: str, status: int = 422) -> Response:
    return JSONResponse({"error": sentence}, status_code=status)


def _name(given: str) -> str:
    """A file name that stays in its folder, and that its system takes."""
    last = given[-10 * _LONGEST_NAME :].replace("\\", "/").rsplit("/", 1)[-1]
    plain = re.sub(r"[^\w .()+-]", "_", last)[-80:]
    while len(plain.encode()) > _LONGEST_NAME:
        plain = plain[1:]
    plain = plain.strip(" .")
    return plain if plain and plain not in _TAKEN else "data.csv"


_TAKEN = (lab_work.MODEL, lab_work.REPORT, lab_work.INPUTS)
