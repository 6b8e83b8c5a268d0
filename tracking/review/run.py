"""`tsuiseki review`: review a result on a page in the browser, and correct it."""

from __future__ import annotations

import sys
from contextlib import suppress
from pathlib import Path

from tsuiseki.tracking.errors import RunError

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
    from tsuiseki.tracking.report.page_server import check_packages, listening, serving
    from tsuiseki.tracking.review.session import Session

    check_packages("reviewing")
    from tsuiseki.tracking.report.local_page import HOST, port_of, token_of
    from tsuiseki.tracking.review.reviewed import Reviewed
    from tsuiseki.tracking.review.server import JpegFrames, application
    from tsuiseki.tracking.runs.following import count

    size = sum(file.stat().st_size for file in result.glob("*") if file.name in (NETWORK_FILE, "tracks.txt"))
    if size > LARGE:
        print(f"opening {size / 1e6:.0f} MB of {result}, which takes some seconds", file=sys.stderr, flush=True)
    session = Session(result, video)
    try:
        pictures, note = None, "Boxes are on a plain background, for the video is not there; --video names it."
        if session.source is not None:
            pictures, note = JpegFrames(session.source, session.n_frames), ""
        reviewed, token = Reviewed(session, result.resolve().name, note), token_of(result)
        opened = listening(port_of(token))
        port = opened.getsockname()[1]
        app = application(reviewed, pictures, token, port)
        with serving(app, opened) as thread, suppress(KeyboardInterrupt):
            show_page(f"http://{HOST}:{port}/{token}/", "review the result")
            while thread.is_alive():
                thread.join(0.2)
            raise RunError("the server of the page ended by itself; start the command again")
    finally:
        session.close()
    print(f"{count(session.answered, 'answer', 'answers')}; the tracks are in {result}")
    return 0
