"""`tsuiseki review`: look through a result on a page in the browser, and correct it."""

from __future__ import annotations

import hmac
import os
import secrets
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.review.pictures import Pictures
    from tsuiseki.tracking.review.session import Session

PORT = 8760


def review(result: Path, /, video: Path | None = None) -> int:
    """Look through a result on a page in the browser, and correct it.

    What you say goes to corrections.jsonl in the result at once; the corrected tracks follow. Ctrl-C ends it.

    Args:
        result: folder of a result.
        video: what was tracked in; by default what the result names. Without it boxes are on a plain background.
    """
    from tsuiseki.tracking.cli.deadline import DEADLINE
    from tsuiseki.tracking.formats.track_tables import needed
    from tsuiseki.tracking.report.drawing import show_page
    from tsuiseki.tracking.review.session import Session

    for package in ("starlette", "uvicorn"):
        needed(package, "the page")
    from tsuiseki.tracking.review.reviewed import Reviewed
    from tsuiseki.tracking.review.server import Server, application

    session = Session(result, video)
    try:
        pictures, note = pictures_of(session, video)
        reviewed = Reviewed(session, result.resolve().name, note, pictures is not None)
        token = token_of(result)
        server = Server(lambda port: application(reviewed, pictures, token, port), (PORT, 0))
        # What is said last is still written when a signal comes.
        DEADLINE.keeps = True
        show_page(f"http://127.0.0.1:{server.port}/{token}/", "review the result")
        with suppress(KeyboardInterrupt):
            server.wait()
        server.stop()
        reviewed.save()
        print(f"{session.progress().answered} answers: {result}")
    finally:
        session.close()
    return 0


def pictures_of(session: Session, video: Path | None) -> tuple[Pictures | None, str]:
    """The pictures of what was tracked in, or why there are none.

    Raises:
        RequestError: ``video`` cannot be read; or the video is of another size, or shorter than the result.
    """
    from tsuiseki.tracking.review.pictures import Pictures

    source = video or session.source
    try:
        pictures = Pictures(source)
    except RequestError as error:
        if video is not None:
            raise
        return None, f"Boxes are on a plain background, for there is no video: {error}."
    if session.size and pictures.size != session.size:
        sizes = [f"{width}x{height}" for width, height in (session.size, pictures.size)]
        raise RequestError(f"{source}: expected pictures of {sizes[0]} pixels, as tracked, got {sizes[1]}")
    if pictures.length < session.n_frames:
        raise RequestError(f"{source}: expected {session.n_frames} frames, as tracked, got {pictures.length}")
    return pictures, ""


def token_of(result: Path) -> str:
    """Of the page of a result; it stays, so that an open page goes on when the server is started again."""
    from tsuiseki.tracking.weights.catalogue import cache_folder

    place, key = cache_folder().parent / "review.key", secrets.token_bytes(32)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        with suppress(FileExistsError):
            number = os.open(place, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            os.write(number, key)
            os.close(number)
        key = place.read_bytes() or key
    return hmac.new(key, str(result.resolve()).encode(), "sha256").hexdigest()[:32]
