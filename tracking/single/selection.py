"""A box that the user draws with the mouse, on a page in the browser.

The page is served to this computer only, under an address that cannot be guessed. So it needs neither a display here
nor an OpenCV with windows: over a remote shell the port can be forwarded.
"""

from __future__ import annotations

import json
import os
import secrets
import sys
import threading
import webbrowser
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray

LONGEST = 1000  # bytes of an answer
LEAST_SIDE = 2.0  # pixels
_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Draw the target</title>
<style>
 body { font: 16px sans-serif; margin: 1rem; background: Canvas; color: CanvasText; color-scheme: light dark }
 #frame { position: relative; display: inline-block; touch-action: none; cursor: crosshair; user-select: none }
 img { display: block; max-width: 100%; max-height: 80vh; pointer-events: none }
 #box { position: absolute; outline: 2px solid #e8590c; background: #e8590c33; pointer-events: none }
 button { font: inherit; padding: .3rem 1rem }
</style>
<p>Draw a box round the target. <button disabled>Follow this</button> <span id="said" role="status"></span></p>
<div id="frame"><img src="image.png" alt="first frame of the video"><div id="box"></div></div>
<script>
 const frame = document.getElementById("frame"), image = document.querySelector("img");
 const box = document.getElementById("box"), button = document.querySelector("button");
 const said = document.getElementById("said");
 let from = null, drawn = null;
 function at(event) {
  const r = image.getBoundingClientRect(), share = (v, most) => Math.min(Math.max(v / most, 0), 1);
  return [share(event.clientX - r.left, r.width) * image.naturalWidth,
   share(event.clientY - r.top, r.height) * image.naturalHeight];
 }
 function show(to) {
  const [x, y] = [0, 1].map(k => Math.min(from[k], to[k])), [w, h] = [0, 1].map(k => Math.abs(from[k] - to[k]));
  const scale = image.clientWidth / image.naturalWidth;
  box.style.left = x * scale + "px"; box.style.top = y * scale + "px";
  box.style.width = w * scale + "px"; box.style.height = h * scale + "px";
  drawn = [x, y, w, h].map(v => Math.round(v * 10) / 10);
  button.disabled = w < 2 || h < 2;
  said.textContent = "x, y, width, height: " + drawn.join(", ");
 }
 frame.onpointerdown = event => { from = at(event); frame.setPointerCapture(event.pointerId); show(from); };
 frame.onpointermove = event => { if (from && event.buttons) show(at(event)); };
 button.onclick = async () => {
  const answer = await fetch("box", {method: "POST", body: JSON.stringify(drawn)});
  said.textContent = answer.ok ? "The target is being followed. This page can be closed." : await answer.text();
  button.disabled = answer.ok;
 };
</script></html>
"""


def select_box(image: ImageArray) -> FloatArray:
    """``(4,)`` corners of a box that the user draws on an image with the mouse.

    A line says where the page is; where there is a display it opens by itself.

    Raises:
        RequestError: the page cannot be served.
    """
    try:
        server = _Server(image)
    except OSError as error:
        raise RequestError(f"`select`: expected a free port for a page, got {error}; give `box` instead") from error
    thread = threading.Thread(target=server.serve_forever, args=(0.1,), daemon=True)
    thread.start()
    print(f"draw the box of the target at {server.address}", file=sys.stderr, flush=True)
    if _has_display():
        webbrowser.open(server.address)
    try:
        while not server.answered.wait(0.2):  # an endless wait would not hear an interrupt on every system
            pass
    finally:
        server.shutdown()
        server.server_close()
    assert server.box is not None
    return server.box


def _has_display() -> bool:
    """Whether a browser can open; without display it might be one that takes the terminal."""
    on_linux = sys.platform.startswith("linux")
    return not on_linux or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class _Server(ThreadingHTTPServer):
    """The page for one image.

    Attributes:
        address: of the page.
        image: as PNG.
        size: width and height, pixels.
        box: ``(4,)`` corners, once they are drawn.
        answered: is set then.
    """

    daemon_threads = True

    def __init__(self, image: ImageArray) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.path = f"/{secrets.token_urlsafe(12)}/"
        self.address = f"http://127.0.0.1:{self.server_address[1]}{self.path}"
        self.image = bytes(cv2.imencode(".png", np.ascontiguousarray(image[..., ::-1]))[1])
        self.size = (image.shape[1], image.shape[0])
        self.box: FloatArray | None = None
        self.answered = threading.Event()

    def take(self, content: bytes) -> str:
        """Take the drawn box; what is wrong with it, or nothing."""
        try:
            x, y, width, height = map(float, json.loads(content))
        except (TypeError, ValueError):
            return "expected four numbers x, y, width, height"
        corners = np.array([x, y, x + width, y + height])
        if not np.isfinite(corners).all():
            return "expected four numbers x, y, width, height"
        corners = np.clip(corners, 0, np.tile(self.size, 2))
        if (corners[2:] - corners[:2]).min() < LEAST_SIDE:
            return f"expected a box of at least {LEAST_SIDE:g} x {LEAST_SIDE:g} pixels inside the image"
        self.box = corners
        return ""


class _Handler(BaseHTTPRequestHandler):
    """Answers the page's requests."""

    server: _Server

    def do_GET(self) -> None:
        """The page, and its image."""
        found = {
            self.server.path: ("text/html; charset=utf-8", _PAGE.encode()),
            f"{self.server.path}image.png": ("image/png", self.server.image),
        }.get(self.path)
        self._answer(200, *found) if found else self._answer(404, "text/plain", b"nothing here")

    def do_POST(self) -> None:
        """The box."""
        if self.path != f"{self.server.path}box":
            self._answer(404, "text/plain", b"nothing here")
            return
        length = self.headers.get("Content-Length", "")
        wrong = self.server.take(self.rfile.read(min(int(length), LONGEST)) if length.isdecimal() else b"")
        self._answer(400 if wrong else 200, "text/plain; charset=utf-8", wrong.encode())
        if not wrong:
            self.server.answered.set()

    def _answer(self, status: int, kind: str, content: bytes) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Requests are nobody's concern."""
