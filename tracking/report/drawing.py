"""What the user draws on a picture with the mouse, on a page in the browser.

The page is served to this computer only, under an address that cannot be guessed. So it needs neither a display here
nor an OpenCV with windows: over a remote shell the port can be forwarded.
"""

from __future__ import annotations

import os
import secrets
import sys
import threading
import webbrowser
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Generic, TypeVar

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.openers.json_files import json_of
from tsuiseki.tracking.report.local_page import HEADERS, HOST, SILENT, refusal
from tsuiseki.tracking.report.rendering import TEMPLATES
from tsuiseki.tracking.types import ImageArray

T = TypeVar("T")
# Bytes of an answer.
LONGEST = 1_000_000
TEXT = "text/plain; charset=utf-8"


def drawn_on(image: ImageArray, page: str, take: Callable[[Any], T], task: str, instead: str) -> T:
    """What the user draws on an image with the mouse.

    A line says where the page is; where there is a display it opens by itself.

    Args:
        image: ``(H, W, 3)`` uint8 RGB, ``image.png`` of the page.
        page: name of a file in ``templates``, which posts JSON to ``answer``.
        take: makes something of that; a `RequestError` of it is shown on the page, and the user goes on.
        task: what to do there, for the line.
        instead: what to do where no page can be served.

    Raises:
        RequestError: the page cannot be served.
    """
    try:
        server = _Server(image, page, take)
    except OSError as error:
        raise RequestError(f"expected a free port for a page, got {error}; {instead}") from error
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    show_page(server.address, task)
    try:
        while not server.answered.wait(0.2):  # an endless wait would not hear an interrupt on every system
            pass
    finally:
        server.shutdown()
        server.server_close()
    return server.answers[0]


def show_page(address: str, task: str) -> None:
    """Say in a line what to do at an address; where there is a display it opens by itself."""
    print(f"{task} at {address}", file=sys.stderr, flush=True)
    if _has_display():
        webbrowser.open(address)


def _has_display() -> bool:
    """Whether a browser can open; without display it might be one that takes the terminal."""
    on_linux = sys.platform.startswith("linux")
    return not on_linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class _Server(ThreadingHTTPServer, Generic[T]):
    """The page for one image.

    Attributes:
        address: of the page.
        files: type and content of what it serves, by path.
        answers: the one, once it is drawn.
        answered: is set then.
    """

    daemon_threads = True

    def __init__(self, image: ImageArray, page: str, take: Callable[[Any], T]) -> None:
        super().__init__((HOST, 0), _Handler)
        self.token = secrets.token_urlsafe(12)
        self.path = f"/{self.token}/"
        self.address = f"http://{HOST}:{self.server_address[1]}{self.path}"
        png = bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1])
        self.files = {f"{self.path}image.png": ("image/png", png)}
        for name, kind in (("", "html"), ("js", "javascript"), ("css", "css")):
            file = (TEMPLATES / page).with_suffix(f".{name or kind}")
            self.files[f"{self.path}{file.name if name else name}"] = f"text/{kind}; charset=utf-8", file.read_bytes()
        self._take = take
        self.answers: list[T] = []
        self.answered = threading.Event()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle is no error."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)

    def take(self, content: bytes) -> str:
        """Take the answer; what is wrong with it, or nothing."""
        try:
            self.answers.append(self._take(json_of(content, "the page", "an answer")))
        except RequestError as error:
            return str(error)
        return ""


class _Handler(BaseHTTPRequestHandler):
    """Answers the page's requests."""

    server: _Server[Any]
    # Who connects and says nothing does not stay.
    timeout = SILENT

    def do_GET(self) -> None:
        """The page, and its image."""
        served = self.server.files.get(self.path)
        if not self._refused():
            self._answer(200, *served) if served else self._answer(404, TEXT, b"nothing here")

    def do_POST(self) -> None:
        if self._refused():
            return
        if self.path != f"{self.server.path}answer":
            self._answer(404, TEXT, b"nothing here")
            return
        length = self.headers.get("Content-Length", "")
        if not length.isascii() or not length.isdecimal() or not 0 < float(length) <= LONGEST:
            self._answer(400, TEXT, b"expected a short request in JSON")
            return
        wrong = self.server.take(self.rfile.read(int(length)))
        self._answer(400 if wrong else 200, TEXT, wrong.encode(errors="replace"))
        if not wrong:
            self.server.answered.set()

    def _refused(self) -> bool:
        headers = {name.lower(): value for name, value in self.headers.items()}
        reason = refusal(self.path, headers, self.server.token, self.server.server_address[1])
        if reason:
            self._answer(403, TEXT, reason.encode())
        return bool(reason)

    def _answer(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": kind, "Content-Length": str(len(content))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are not logged."""
