"""The page on which a reviewer corrects a result: one reviewer, one result, this computer only.

The address holds a token that cannot be guessed. A request without it, under another host's name, or from a page of
another site is refused.
"""

from __future__ import annotations

import mimetypes
import secrets
import socket
from collections.abc import Awaitable, Callable
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.base import BaseHTTPMiddleware
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.review.jpeg_frames import JpegFrames
from tsuiseki.tracking.review.reviewed import Reviewed

HOST = "127.0.0.1"
LONGEST = 100_000
"""Bytes of a request."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
# What a computer calls them is not certain.
mimetypes.add_type("text/javascript", ".js")


def application(reviewed: Reviewed, pictures: JpegFrames | None, token: str, port: int) -> Starlette:
    """The page and its data, for ``http://127.0.0.1:PORT/TOKEN/``."""

    async def data(_: Request) -> Response:
        return JSONResponse(reviewed.state)

    async def version(_: Request) -> Response:
        return JSONResponse(reviewed.state["version"])

    async def boxes(request: Request) -> Response:
        return Response(reviewed.chunk(request.path_params["number"]), media_type="application/octet-stream")

    async def picture(request: Request) -> Response:
        frame = request.path_params["frame"]
        if pictures is None or frame >= pictures.length:
            return PlainTextResponse("There is no such picture.", 404)
        return Response(await run_in_threadpool(pictures.jpeg, frame), media_type="image/jpeg")

    async def change(request: Request) -> Response:
        size = request.headers.get("content-length", "")
        # Only a page of this server can send JSON.
        if request.headers.get("content-type") != "application/json" or not 0 < int(size or 0) <= LONGEST:
            raise RequestError("expected a short request in JSON")
        try:
            given = dict(await request.json())
        except (ValueError, TypeError, RecursionError) as error:
            raise RequestError("expected a JSON object") from error
        return JSONResponse(await run_in_threadpool(reviewed.change, request.path_params["what"], given))

    async def guarded(request: Request, go_on: Callable[[Request], Awaitable[Response]]) -> Response:
        refused = refusal(request, token, port)
        response = PlainTextResponse(refused, 403) if refused else await go_on(request)
        response.headers.update(HEADERS)
        return response

    routes = [
        Route("/data", data),
        Route("/version", version),
        Route("/boxes/{number:int}", boxes),
        Route("/picture/{frame:int}", picture),
        Route("/change/{what}", change, methods=["POST"]),
        Mount("/", StaticFiles(directory=Path(__file__).parent / "static", html=True)),
    ]
    return Starlette(
        routes=[Mount(f"/{token}", routes=routes)],
        middleware=[Middleware(BaseHTTPMiddleware, dispatch=guarded)],
        exception_handlers={404: _missing, RequestError: _wrong, RunError: _wrong},
    )


def refusal(request: Request, token: str, port: int) -> str:
    """Why a request is refused; empty where it asks the right host, from its own page, with the token."""
    host = request.headers.get("host", "")
    if host not in (f"{HOST}:{port}", f"localhost:{port}"):
        return f"This page answers under {HOST}:{port} only."
    own_site = request.headers.get("sec-fetch-site", "none") in ("none", "same-origin")
    if not own_site or request.headers.get("origin", f"http://{host}") != f"http://{host}":
        return "Another site asked for this page. Copy its address from the terminal into a new tab."
    if not secrets.compare_digest(request.url.path.split("/")[1].encode(), token.encode()):
        return "This address lacks its token. Open the whole address that tsuiseki review printed."
    return ""


def _missing(*_: object) -> Response:
    return PlainTextResponse("There is nothing at this address.", 404)


def _wrong(_: Request, error: Exception) -> Response:
    return PlainTextResponse(str(error), 400 if isinstance(error, RequestError) else 500)


def listening(port: int) -> socket.socket:
    """A socket on this computer's ``port``, or where that is taken on any other.

    Raises:
        RequestError: no port is free.
    """
    for number in (port, 0):
        opened = socket.socket()
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            opened.bind((HOST, number))
            opened.listen()  # before its address is shown
            return opened
        except OSError as error:
            opened.close()
            reason = error
    raise RequestError(f"expected a free port for the page, got {reason}")
