"""The live page of a run and its health, for this computer only.

Who may ask, and what answers forbid: see `report.local_page`. ``/health`` and ``/metrics`` need no token: they have
numbers and names of cameras, no pictures, and programs ask for them at addresses that stay.
"""

from __future__ import annotations

from pathlib import Path

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from tsuiseki.tracking.monitor.board import Board
from tsuiseki.tracking.monitor.metrics import METRICS_TYPE, metrics_text
from tsuiseki.tracking.report.page_server import guard, jpeg_of

# Pixels of the longer side of a picture.
LARGEST = 960
# Cameras of one run at most.
MOST_CAMERAS = 1000


def application(board: Board, token: str, port: int) -> Starlette:
    """The page and its data at ``http://127.0.0.1:PORT/TOKEN/``, the health beside it."""

    async def state(_: Request) -> Response:
        return JSONResponse({"name": board.name, "cameras": board.cameras()})

    async def picture(request: Request) -> Response:
        number = request.path_params["camera"]
        image = await run_in_threadpool(board.picture, number) if number < MOST_CAMERAS else None
        if image is None:
            raise HTTPException(404)
        return Response(await run_in_threadpool(jpeg_of, image, LARGEST), media_type="image/jpeg")

    async def health(_: Request) -> Response:
        answer = board.health()
        return JSONResponse(answer, 503 if answer["status"] == "stalled" else 200)

    async def metrics(_: Request) -> Response:
        return Response(metrics_text(board), media_type=METRICS_TYPE)

    page = [
        Route("/state", state),
        Route("/picture/{camera:int}", picture),
        Mount("/", StaticFiles(directory=Path(__file__).parent / "static", html=True)),
    ]
    routes = [Route("/health", health), Route("/metrics", metrics), Mount(f"/{token}", routes=page)]
    return Starlette(
        routes=routes,
        middleware=[guard(token, port, ("/health", "/metrics"))],
        exception_handlers={404: lambda *_: PlainTextResponse("There is nothing at this address.", 404)},
    )
