"""The page on which a reviewer corrects a result: one reviewer, one result, this computer only.

Who may ask, and what its answers forbid: see `report.local_page`.

The page takes pictures of a video in any order, as JPEG; a frame has the number that it has when the video is played.
"""

from __future__ import annotations

import mimetypes
import threading
from functools import lru_cache
from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.report.page_server import guard, jpeg_of
from tsuiseki.tracking.review.reviewed import Reviewed
from tsuiseki.tracking.types import Frame, ImageArray
from tsuiseki.tracking.video.image_folder import ImageFolder
from tsuiseki.tracking.video.source import SeekableVideo, UnfitIndexError, VideoFile, open_source

# Pixels of the longer side of a picture.
LARGEST = 1280
# Pictures that stay in memory, about 100 kB each.
CACHED = 400
# Up to so many frames on a video is decoded on; farther away it begins anew.
NEAR = 30


class JpegFrames:
    """JPEG pictures by frame, for any thread.

    Args:
        source: folder of images or video file.
        frames: how many there must be at least.

    Attributes:
        length: number of frames.

    Raises:
        RequestError: ``source`` has no pictures that can be played again, or too few.
    """

    def __init__(self, source: str | Path, frames: int = 1) -> None:
        opened = open_source(source)
        if not opened.has_images or not isinstance(opened, ImageFolder | VideoFile):
            raise RequestError(f"{opened.name} has no pictures that can be played again; give a `video` that has")
        self._video, self._seekable = opened, SeekableVideo.of(opened)
        # A raw stream has no times: it is played from the start.
        self.length = sum(1 for _ in opened.frames()) if self._seekable is None else len(self._seekable.times)
        if self.length < frames:
            raise RequestError(f"{source}: expected {frames} frames as in the result, got {self.length}")
        self._next, self._frames = self.length, iter(list[Frame]())
        self._lock, self.jpeg = threading.Lock(), lru_cache(CACHED)(self._jpeg)
        self._image(0)

    def _jpeg(self, frame: int) -> bytes:
        with self._lock:
            image = self._image(frame)
        return jpeg_of(image, LARGEST)

    def _image(self, frame: int) -> ImageArray:
        if not self._next <= frame < self._next + NEAR:
            film = self._seekable
            self._frames = self._video.frames() if film is None else film.frames(frame, self.length - 1)
        try:
            for decoded in self._frames:
                self._next = decoded.index + 1
                if decoded.index == frame:
                    return decoded.image
        except UnfitIndexError:
            self._seekable, self._next = None, self.length
            return self._image(frame)
        except RunError:
            self._next = self.length  # where frames break off the next one is read anew
            raise
        self._next = self.length
        raise RunError(f"{self._video.name}: frame {frame + 1} cannot be decoded")


# Bytes of a request.
LONGEST = 100_000
# What a computer calls them is not certain.
mimetypes.add_type("text/javascript", ".js")


def application(reviewed: Reviewed, pictures: JpegFrames | None, token: str, port: int) -> Starlette:
    """The page and its data, for ``http://127.0.0.1:PORT/TOKEN/``."""

    async def data(_: Request) -> Response:
        return JSONResponse(reviewed.state)

    async def version(_: Request) -> Response:
        return JSONResponse(reviewed.state["version"])

    async def boxes(request: Request) -> Response:
        number = number_in(request.path_params["number"])
        return Response(reviewed.chunk(number), media_type="application/octet-stream")

    async def picture(request: Request) -> Response:
        frame = number_in(request.path_params["frame"])
        if pictures is None or frame >= pictures.length:
            raise HTTPException(404)
        return Response(await run_in_threadpool(pictures.jpeg, frame), media_type="image/jpeg")

    async def change(request: Request) -> Response:
        size = request.headers.get("content-length", "")
        short = size.isascii() and size.isdecimal() and 0 < float(size) <= LONGEST
        # Only a page of this server can send JSON.
        if request.headers.get("content-type") != "application/json" or not short:
            raise RequestError("expected a short request in JSON")
        try:
            content = dict(await request.json())
        except (ValueError, TypeError, RecursionError) as error:
            raise RequestError("expected a JSON object") from error
        return JSONResponse(await run_in_threadpool(reviewed.change, request.path_params["what"], content))

    routes = [
        Route("/data", data),
        Route("/version", version),
        Route("/boxes/{number}", boxes),
        Route("/picture/{frame}", picture),
        Route("/change/{what}", change, methods=["POST"]),
        Mount("/", StaticFiles(directory=Path(__file__).parent / "static", html=True)),
    ]
    return Starlette(
        routes=[Mount(f"/{token}", routes=routes)],
        middleware=[guard(token, port)],
        exception_handlers={
            404: lambda *_: PlainTextResponse("There is nothing at this address.", 404),
            RequestError: lambda _, error: PlainTextResponse(str(error), 400),
            RunError: lambda _, error: PlainTextResponse(str(error), 500),
        },
    )


def number_in(text: str) -> int:
    """The number in an address; raises HTTPException (404) where there is none, or one that no video reaches."""
    if not (text.isascii() and text.isdecimal() and len(text) < 10):
        raise HTTPException(404)
    return int(text)
