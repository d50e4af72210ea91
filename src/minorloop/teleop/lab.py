"""The lab page's side of the server: files in, models out, each user in a folder of their own."""

from __future__ import annotations

import asyncio
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from minorloop.teleop import lab_work
from minorloop.teleop.workers import Workers

MOST_BYTES = 32 * 1024**2
_LONGEST_REQUEST = 512 * 1024
_MOST_USERS = 64
_KEPT = 4 * 3600.0


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


@dataclass(eq=False)
class _User:
    """A file that was dropped, and what became of it."""

    folder: Path
    name: str
    used: float = field(default_factory=time.monotonic)


class Lab:
    """Files, their users, and the workers that compute for them."""

    def __init__(self, *, workers: int = 2) -> None:
        self._workers, self._quick = Workers(workers), Workers(1, longest=20.0)
        self._users: dict[str, _User] = {}

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
        self._root = Path(tempfile.mkdtemp(prefix="minorloop-lab-"))
        await self._workers.start()
        await self._quick.start()

    async def stop(self) -> None:
        """End the workers and remove the files."""
        await self._workers.stop()
        await self._quick.stop()
        await asyncio.to_thread(shutil.rmtree, self._root, ignore_errors=True)

    async def _drop(self, request: Request) -> Response:
        """Take in a file."""
        self._make_room()
        user = secrets.token_urlsafe(16)
        name = _name(request.query_params.get("name", ""))
        folder = self._root / user
        folder.mkdir()
        try:
            content = await _body(request, MOST_BYTES)
        except _RefusedError as error:
            shutil.rmtree(folder, ignore_errors=True)
            return _refusal(str(error), 413)
        await asyncio.to_thread((folder / name).write_bytes, content)
        told = await self._quick.ask("look", folder=str(folder), name=name)
        if "error" in told:
            shutil.rmtree(folder, ignore_errors=True)
            return _refusal(told["error"])
        self._users[user] = _User(folder, name)
        return JSONResponse({"user": user, **told})

    async def _identify(self, request: Request) -> Response:
        """Stages and the result, a line of JSON each, as they come."""
        try:
            user = self._user(request)
            choice = await _decoded(request, _Choice)
        except _RefusedError as error:
            return _refusal(str(error))
        options = {"folder": str(user.folder), "name": user.name, **msgspec.structs.asdict(choice)}

        async def lines() -> AsyncIterator[bytes]:
            async for told in self._workers.run("identify_file", **options):
                yield msgspec.json.encode(told) + b"\n"

        return StreamingResponse(
            lines(), media_type="application/x-ndjson", headers={"Cache-Control": "no-store"}
        )

    async def _move(self, request: Request) -> Response:
        return await self._asked(request, "move", _Move)

    async def _invert(self, request: Request) -> Response:
        return await self._asked(request, "invert", _Targets)

    async def _asked(self, request: Request, task: str, kind: type[msgspec.Struct]) -> Response:
        try:
            user = self._user(request)
            asked = await _decoded(request, kind)
        except _RefusedError as error:
            return _refusal(str(error))
        told = await self._quick.ask(task, folder=str(user.folder), **msgspec.structs.asdict(asked))
        return _refusal(told["error"]) if "error" in told else JSONResponse(told)

    async def _download(self, request: Request) -> Response:
        try:
            user = self._user(request)
        except _RefusedError as error:
            return _refusal(str(error), 404)
        name = request.path_params["file"]
        file = user.folder / name
        if name not in (lab_work.MODEL, lab_work.REPORT, lab_work.INPUTS) or not file.is_file():
            return _refusal("there is no such file yet", 404)
        return FileResponse(file, filename=name, headers={"Cache-Control": "no-store"})

    def _user(self, request: Request) -> _User:
        user = self._users.get(request.path_params["user"])
        if user is None:
            raise _RefusedError("this file is no longer here; drop it again")
        user.used = time.monotonic()
        return user

    def _make_room(self) -> None:
        """Forget files that were not used for long, or that are one too many."""
        now = time.monotonic()
        order = sorted(self._users, key=lambda key: self._users[key].used)
        surplus = len(order) - _MOST_USERS + 1
        for rank, key in enumerate(order):
            if rank < surplus or now - self._users[key].used > _KEPT:
                shutil.rmtree(self._users.pop(key).folder, ignore_errors=True)


class _RefusedError(Exception):
    """A request that is answered with a sentence."""


async def _body(request: Request, most: int) -> bytes:
    content = bytearray()
    try:
        async for chunk in request.stream():
            content += chunk
            if len(content) > most:
                raise _RefusedError(
                    f"the file is larger than {most >> 20} MiB; give a smaller one, or use "
                    "'minorloop identify' on the command line"
                )
    except ClientDisconnect:
        raise _RefusedError("the page has gone") from None
    return bytes(content)


async def _decoded(request: Request, kind: type[Any]) -> Any:
    try:
        return msgspec.json.decode(await _body(request, _LONGEST_REQUEST), type=kind)
    except (ValueError, RecursionError) as error:
        raise _RefusedError(f"the request cannot be read: {error}") from None


def _refusal(sentence: str, status: int = 422) -> Response:
    return JSONResponse({"error": sentence}, status_code=status)


def _name(given: str) -> str:
    """A file name that stays in its folder."""
    plain = re.sub(r"[^\w .()+-]", "_", given.replace("\\", "/").rsplit("/", 1)[-1]).strip(" .")
    return plain[-80:] if plain and plain not in _TAKEN else "data.csv"


_TAKEN = (lab_work.MODEL, lab_work.REPORT, lab_work.INPUTS)
