"""`tsuiseki review`: review a result on a page in the browser, and correct it."""

from __future__ import annotations

import hmac
import importlib.util
import os
import secrets
import sys
import threading
from contextlib import suppress
from pathlib import Path

from tsuiseki.tracking.errors import RequestError, RunError

# A result has a port of its own, of these, so that its page stays where it is.
PORTS = range(20_000, 30_000)
# Bytes of tracks and network from which it is said that they are being opened.
LARGE = 5_000_000


def review(result: Path, *, video: Path | None = None) -> int:
    """Review a result on a page in the browser, and correct it.

    What you say goes to corrections.jsonl in the result at once; the corrected tracks follow. Ctrl-C ends it.

    Args:
        result: folder of a result.
        video: what was tracked in; by default what the result names. Without it boxes are on a plain background.
    """
    from tsuiseki.tracking.association.solved_network import NETWORK_FILE
    from tsuiseki.tracking.report.drawing import show_page
    from tsuiseki.tracking.review.session import Session

    if missing := [name for name in ("starlette", "uvicorn") if importlib.util.find_spec(name) is None]:
        needs = " and ".join(missing)
        raise RequestError(f"reviewing needs {needs}; install the extra: pip install 'tsuiseki[review]'")
    import uvicorn

    from tsuiseki.tracking.report.local_page import HOST
    from tsuiseki.tracking.review.reviewed import Reviewed
    from tsuiseki.tracking.review.server import JpegFrames, application, listening

    size = sum(file.stat().st_size for file in result.glob("*") if file.name in (NETWORK_FILE, "tracks.txt"))
    if size > LARGE:
        print(f"opening {size / 1e6:.0f} MB of {result}, which takes some seconds", file=sys.stderr, flush=True)
    session = Session(result, video)
    try:
        pictures, note = None, "Boxes are on a plain background, for the video is not there; --video names it."
        if session.source is not None:
            pictures, note = JpegFrames(session.source, session.n_frames), ""
        reviewed, token = Reviewed(session, result.resolve().name, note), token_of(result)
        opened = listening(PORTS[int(token, 16) % len(PORTS)])
        port = opened.getsockname()[1]
        app = application(reviewed, pictures, token, port)
        server = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off"))
        thread = threading.Thread(target=server.run, args=([opened],), daemon=True)
        thread.start()
        show_page(f"http://{HOST}:{port}/{token}/", "review the result")
        with suppress(KeyboardInterrupt):
            while thread.is_alive():
                thread.join(0.2)
            raise RunError("the server of the page ended by itself; start the command again")
        server.should_exit = True
        thread.join(0.5)
    finally:
        session.close()
    print(f"{session.answered} answers: {result}")
    return 0


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
