"""What pages that are served to this computer share: a port, a guard before every answer, a thread, JPEG pictures."""

from __future__ import annotations

import importlib.util
import socket
import threading
from collections.abc import Awaitable, Callable, Collection, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.report.local_page import HEADERS, HOST, refusal
from tsuiseki.tracking.types import ImageArray

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.requests import Request
    from starlette.responses import Response

# Quality of JPEG, from 0 to 100.
QUALITY = 82
# Seconds that the thread of a page has to end.
GOODBYE = 0.5


def check_packages(what: str) -> None:
    """Refuse to do ``what`` where the packages that serve a page are missing; raises RequestError."""
    if missing := [name for name in ("starlette", "uvicorn") if importlib.util.find_spec(name) is None]:
        needs = " and ".join(missing)
        raise RequestError(f"{what} needs {needs}; install the extra: pip install 'tsuiseki[review]'")


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


def guard(token: str, port: int, without_token: Collection[str] = ()) -> Middleware:
    """Refuses requests that `refusal` does not let through, and gives every answer the headers of a local page.

    Args:
        token: of the page.
        port: on which it is served.
        without_token: paths that the right host and site may ask for without it.
    """
    from starlette.middleware import Middleware
    from starlette.middleware.base import BaseHTTPMiddleware
    from starlette.responses import PlainTextResponse

    async def guarded(request: Request, go_on: Callable[[Request], Awaitable[Response]]) -> Response:
        path = request.url.path
        refused = refusal(f"/{token}" if path in without_token else path, request.headers, token, port)
        response = PlainTextResponse(refused, 403) if refused else await go_on(request)
        response.headers.update(HEADERS)
        return response

    return Middleware(BaseHTTPMiddleware, dispatch=guarded)


@contextmanager
def serving(application: Starlette, opened: socket.socket) -> Iterator[threading.Thread]:
    """The thread that serves an application on a socket of `listening`, until the ``with`` block ends."""
    import uvicorn

    server = uvicorn.Server(uvicorn.Config(application, log_config=None, log_level="critical", lifespan="off"))
    thread = threading.Thread(target=server.run, args=([opened],), name="tsuiseki-page", daemon=True)
    thread.start()
    try:
        yield thread
    finally:
        server.should_exit = True
        thread.join(GOODBYE)


def jpeg_of(image: ImageArray, longest: int) -> bytes:
    """An image ``(H, W, 3)`` uint8 RGB as JPEG, whose longer side has at most so many pixels."""
    if (scale := longest / max(image.shape[:2])) < 1:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    blue_first = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), np.uint8)
    return bytes(cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
