"""The page on which a person looks through a result: one reviewer, one result, this computer only.

The address holds a token that cannot be guessed. A request without it, under another host's name, or from a page of
another site is refused.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from importlib import resources
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.review.box_rows import chunk
from tsuiseki.tracking.review.pictures import Pictures
from tsuiseki.tracking.review.reviewed import Reviewed

HOST = "127.0.0.1"
LONGEST = 100_000
"""Bytes of a request."""
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
WRONG_TOKEN = "This address lacks its token. Open the whole address that `tsuiseki review` printed."
OTHER_SITE = "Another site asked for this page. Type its address, or open it from the terminal."


class Guard:
    """Lets through to ``app`` what asks under the right name, from its own page, with the token in the path."""

    def __init__(self, app: ASGIApp, token: str, port: int) -> None:
        self._app, self._token = app, token
        self._hosts = {f"{HOST}:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if refused:
            await PlainTextResponse(refused, 403, HEADERS)(scope, receive, send)
            return
        await self._app(scope, receive, _with_headers(send))

    def _refusal(self, scope: Scope) -> str:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if host not in self._hosts:
            return "This page answers under 127.0.0.1 only."
        if headers.get("origin", f"http://{host}") != f"http://{host}":
            return OTHER_SITE
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return OTHER_SITE
        given = scope["path"].split("/")[1].encode()
        return "" if secrets.compare_digest(given, self._token.encode()) else WRONG_TOKEN


def _with_headers(send: Send) -> Send:
    async def sent(message: Any) -> None:
        if message["type"] == "http.response.start":
            own = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
            message = {**message, "headers": [*message["headers"], *own]}
        await send(message)

    return sent


def application(reviewed: Reviewed, pictures: Pictures | None, token: str, port: int) -> ASGIApp:
    """The page and its data, for ``http://127.0.0.1:PORT/TOKEN/``."""

    async def data(request: Request) -> Response:
        return JSONResponse(reviewed.state)

    async def alive(request: Request) -> Response:
        return JSONResponse(reviewed.state["version"])

    async def boxes(request: Request) -> Response:
        return Response(chunk(reviewed.rows, request.path_params["number"]), media_type="application/octet-stream")

    async def picture(request: Request) -> Response:
        frame = request.path_params["frame"]
        if pictures is None or frame >= pictures.length:
            raise HTTPException(404, "There is no such picture.")
        return Response(await run_in_threadpool(pictures.jpeg, frame), media_type="image/jpeg")

    async def change(request: Request) -> Response:
        given = await _given(request)
        return JSONResponse(await run_in_threadpool(reviewed.change, request.path_params["what"], given))

    routes = [
        Route("/data", data),
        Route("/alive", alive),
        Route("/boxes/{number:int}", boxes),
        Route("/picture/{frame:int}", picture),
        Route("/change/{what}", change, methods=["POST"]),
        *(Route(f"/{name}", _file(content, kind)) for name, (content, kind) in _files().items()),
    ]
    errors = {HTTPException: _plain, RequestError: _refused, RunError: _refused}
    app = Starlette(routes=[Route(f"/{token}{one.path}", one.endpoint, methods=one.methods) for one in routes])
    for error, handler in errors.items():
        app.add_exception_handler(error, handler)
    return Guard(app, token, port)


async def _given(request: Request) -> dict[str, Any]:
    """The JSON of a request; only a page of this server can send that type."""
    if request.headers.get("content-type") != "application/json":
        raise HTTPException(415, "Expected JSON.")
    content = b""
    async for part in request.stream():
        content += part
        if len(content) > LONGEST:
            raise HTTPException(413, "Expected a shorter request.")
    import json

    try:
        given = json.loads(content)
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise HTTPException(400, "Expected a JSON object.")
    return given


async def _plain(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    said = "There is nothing at this address." if error.detail == "Not Found" else error.detail
    return PlainTextResponse(said, error.status_code)


async def _refused(request: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), 400 if isinstance(error, RequestError) else 500)


def _files() -> dict[str, tuple[bytes, str]]:
    """Content and type of the files of the page, by name; the page itself has none."""
    found = {}
    for entry in resources.files("tsuiseki.tracking.review").joinpath("static").iterdir():
        name = entry.name
        kind = TYPES.get(name[name.rfind(".") :])
        if kind:
            found["" if name == "index.html" else name] = entry.read_bytes(), kind
    return found


def _file(content: bytes, kind: str) -> Callable[[Request], Any]:
    async def send(request: Request) -> Response:
        return Response(content, media_type=kind)

    return send


class Server:
    """Serves a page on a thread of its own until it is stopped.

    Args:
        make: the application, from the port.
        ports: to be tried in this order; 0 is any free one.

    Attributes:
        port: that was free.

    Raises:
        RequestError: none of ``ports`` is free.
    """

    def __init__(self, make: Callable[[int], ASGIApp], ports: tuple[int, ...]) -> None:
        import socket

        import uvicorn

        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        for number in ports:
            try:
                self._socket.bind((HOST, number))
                break
            except OSError as error:
                if number == ports[-1]:
                    raise RequestError(f"expected a free port for the page, got {error}") from error
        self.port = self._socket.getsockname()[1]
        settings = uvicorn.Config(
            make(self.port), log_level="critical", access_log=False, lifespan="off", timeout_graceful_shutdown=1
        )
        self._server = uvicorn.Server(settings)
        self._thread = threading.Thread(target=self._server.run, args=([self._socket],), daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Until the server ends by itself, or a signal comes."""
        while self._thread.is_alive():
            self._thread.join(0.2)

    def stop(self) -> None:
        """End it; what it answers at this moment has half a second."""
        self._server.should_exit = True
        self._thread.join(0.5)
        self._socket.close()
