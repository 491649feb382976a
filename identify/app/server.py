"""The server: on this machine only, for whoever has the address with its token; everything else is refused."""

from __future__ import annotations

import json
import re
import secrets
import socket
import tempfile
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path

import numpy as np
import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from data_io import LogError
from identify.app.folder import Document, Folder, PageError, PageQuery
from identify.app.page import Answer, Page
from identify.base.errors import IdentifyError

HOST = "127.0.0.1"
OWN_HOST = re.compile(r"(127\.0\.0\.1|localhost):\d{1,5}")
"""This machine, by any port: where a tunnel leads to the server it is another one than the server's. A page of somebody
else has another host, or an origin with another port than the one it asks."""
FILES = Path(__file__).parent / "static"
LARGEST_QUESTION = 4_000_000  # bytes of a question of the page
SECONDS = 2  # in which the server stops
OWN_PAGES = "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; base-uri 'none'; form-action 'none'; \
frame-ancestors 'self'"
OTHERS_PAGES = "sandbox allow-scripts allow-popups allow-downloads; default-src 'none'; style-src 'unsafe-inline'; \
script-src 'unsafe-inline'; img-src data: blob:; font-src data:; frame-ancestors 'self'"
"""Reports have names of logs in them: they may show and fold themselves, and reach nothing."""
PLAIN = "text/plain"
SHOWN = {".html": "text/html", ".svg": "image/svg+xml", ".png": "image/png", ".json": PLAIN, ".csv": PLAIN,
         ".toml": PLAIN, ".tex": PLAIN}  # fmt: skip


class Guard:
    """Lets through what names this server and its token, and comes from its own pages; the rest gets one sentence."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] != "http":
            return
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        token, _, rest = scope["path"].removeprefix("/").partition("/")
        known = secrets.compare_digest(token.encode(), self._token.encode())
        if not OWN_HOST.fullmatch(host) or (origin is not None and origin != f"http://{host}") or not known:
            refusal = PlainTextResponse("Refused: open the address that stickslip app printed, with its token.", 403)
            await refusal(scope, receive, send)
            return

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                said = {key.lower() for key, _ in message["headers"]}
                for key, value in SAFE.items():
                    if key not in said:
                        message["headers"].append((key, value))
            await send(message)

        await self._app({**scope, "path": f"/{rest}", "raw_path": None, "root_path": ""}, receive, guarded)


SAFE = {
    b"content-security-policy": OWN_PAGES.encode(),
    b"x-content-type-options": b"nosniff",
    b"referrer-policy": b"no-referrer",
    b"cross-origin-resource-policy": b"same-origin",
    b"cross-origin-opener-policy": b"same-origin",
    b"cache-control": b"no-store",
}


def application(page: Page, token: str, uploads: Path) -> ASGIApp:
    """The application for one folder; uploads: where files that are dropped in lie until they are whole."""
    routes: list[BaseRoute] = [
        Route(f"/api/{name}", _endpoint(work), methods=[method]) for name, (method, work) in page.answers.items()
    ]
    routes += [
        Route("/api/add", _adding(page.folder, uploads), methods=["POST"]),
        Route("/files/{path:path}", _file(page.folder), methods=["GET"]),
        Mount("/", StaticFiles(directory=FILES, html=True)),
    ]
    return Guard(Starlette(routes=routes, exception_handlers=dict.fromkeys(REFUSALS, _failed)), token)


def _endpoint(work: Callable[[PageQuery], Answer]) -> Callable[[Request], Awaitable[Response]]:
    """Ask `work` in a thread; curves go back as they lie in memory, everything else as JSON."""

    async def answer(request: Request) -> Response:
        query, body = Document(request.query_params), b""
        async for piece in request.stream():
            body += piece
            if len(body) > LARGEST_QUESTION:
                return _refused("this request is larger than any of the page; load the page again", 413)
        try:
            query |= json.loads(body or b"{}")
        except (ValueError, TypeError, RecursionError):
            return _refused("the question is no JSON; load the page again")
        found = await run_in_threadpool(work, PageQuery(query))
        if isinstance(found, Response):
            return found
        if isinstance(found, np.ndarray):
            data = np.ascontiguousarray(found, "<f8").tobytes()
            return Response(data, media_type="application/octet-stream", headers={"x-rows": str(len(found))})
        return JSONResponse(found)

    return answer


REFUSALS = (IdentifyError, LogError, OSError, HTTPException, Exception)


async def _failed(request: Request, error: Exception) -> Response:
    """Every error as one sentence; a defect is said, never shown as a traceback."""
    if isinstance(error, (IdentifyError, LogError)):
        return _refused(str(error))
    if isinstance(error, HTTPException):
        return _refused("there is no such page; load the address that stickslip app printed", error.status_code)
    if isinstance(error, UnicodeError):
        return _refused("a character of this text cannot be stored; write it without")
    if isinstance(error, OSError):
        return _refused(f"{error.strerror or error}; check the file and the space left")
    return _refused(f"a defect of ours ({type(error).__name__}: {error}); report it", 500)


def _refused(sentence: str, code: int = 400) -> Response:
    return JSONResponse({"error": sentence}, status_code=code)


def _adding(folder: Folder, uploads: Path) -> Callable[[Request], Awaitable[Response]]:
    """A file dropped into the page: added under its own name, never over another one."""

    async def add(request: Request) -> Response:
        name, part = request.query_params.get("name", ""), uploads / secrets.token_hex(8)
        try:
            target = folder.path(name)
            if Path(name).name != name:
                raise PageError(f"{name!r} is no name of a file; rename it")
            if target.exists():
                raise FileExistsError
            with part.open("wb") as handle:
                async for piece in request.stream():
                    await run_in_threadpool(handle.write, piece)
            target.open("xb").close()  # of several of one name the first that is whole
            part.replace(target)
        except FileExistsError:
            return _refused(f"{name} is there already; rename the file and drop it again")
        except OSError as error:
            return _refused(f"{name} cannot be added ({error.strerror}); copy it into the folder yourself")
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)
        return JSONResponse({"path": name})

    return add


def _file(folder: Folder) -> Callable[[Request], Awaitable[Response]]:
    """A file of the folder: reports and pictures shown without any rights, everything else to be kept."""

    async def answer(request: Request) -> Response:
        try:
            path = folder.file(request.path_params["path"])
        except PageError as error:
            return _refused(str(error), 404)
        kind = SHOWN.get(path.suffix.lower())
        if kind is None or "keep" in request.query_params:
            return FileResponse(path, filename=path.name, media_type="application/octet-stream")
        return FileResponse(path, media_type=kind, headers={"content-security-policy": OTHERS_PAGES})

    return answer


class Serving:
    """A server at work on a free port of this machine; `address` has the token in it."""

    def __init__(self, folder: Folder, port: int = 0) -> None:
        """Raises OSError where the port is taken."""
        self.page = Page(folder)
        # asyncio sends small answers at once (TCP_NODELAY) only where the protocol is named; else each waits 40 ms
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.bind((HOST, port))
        self._socket.listen()
        self.port = int(self._socket.getsockname()[1])
        self.token = secrets.token_urlsafe(24)
        self._uploads = tempfile.TemporaryDirectory(prefix="added-", dir=folder.own("x").parent)
        config = uvicorn.Config(
            application(self.page, self.token, Path(self._uploads.name)),
            log_level="critical",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=SECONDS,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._server.run, args=([self._socket],), daemon=True)

    @property
    def address(self) -> str:
        """What to open."""
        return f"http://{HOST}:{self.port}/{self.token}/"

    @cached_property
    def door(self) -> Path:
        """A file that leads a browser to the address; only this user can read it, while every user of the machine can
        read the arguments of a program. Its name is not hidden: packaged browsers open no hidden file."""
        path = self.page.folder.root / f"stickslip-app-{secrets.token_hex(4)}.html"
        path.touch(mode=0o600, exist_ok=False)
        path.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={self.address}">', encoding="utf-8")
        return path

    def start(self) -> None:
        """Serve, in a thread."""
        self._thread.start()

    def wait(self, seconds: float | None = None) -> bool:
        """Whether it still serves after so long (None: for ever)."""
        self._thread.join(seconds)
        return self._thread.is_alive()

    def stop(self) -> None:
        """Stop serving; jobs that run go on."""
        self._server.should_exit = True
        self.page.looks.close()
        self._thread.join(SECONDS + 1.0)
        if not self._thread.is_alive():  # on a busy machine it may still be at it; then it ends with the process
            self._socket.close()
        self._uploads.cleanup()
        if "door" in self.__dict__:
            self.door.unlink(missing_ok=True)
