"""The pictures of a run in a window of OpenCV: one a camera, a few times a second."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable

import cv2

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.monitor.board import Board
from tsuiseki.tracking.types.live import LiveEvent, PeopleInFrame, PeopleOnFloor

# Seconds from one picture to the next.
EVERY = 0.2
# What ends the run: Escape and q, as in other programs.
QUIT = (27, ord("q"))
INSTEAD = "leave `show` out; `page` shows the same in the browser"


def check_window() -> None:
    """Refuse to open windows where there is no display, or OpenCV was built without; raises RequestError."""
    backend = next((line for line in cv2.getBuildInformation().splitlines() if line.strip().startswith("GUI:")), "")
    if not backend.split(":")[-1].strip() or "NONE" in backend:
        raise RequestError(
            "`show` needs an OpenCV that opens windows, and this one does not: give `pip uninstall -y "
            f"opencv-python-headless`, then `pip install opencv-python`; or {INSTEAD}"
        )
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RequestError(f"`show` needs a display, and there is none here; {INSTEAD}")


class Window:
    """An observer that shows what `Board` knows; it stands behind the board in the row of observers.

    Args:
        board: has the pictures.
        clock: seconds that never fall.
    """

    def __init__(self, board: Board, clock: Callable[[], float] = time.monotonic) -> None:
        self._board, self._clock, self._next = board, clock, 0.0

    def __call__(self, happening: LiveEvent) -> None:
        if not isinstance(happening, PeopleInFrame | PeopleOnFloor) or self._clock() < self._next:
            return
        self._next = self._clock() + EVERY
        for number, camera in enumerate(self._board.cameras()):
            image = self._board.picture(number)
            if image is not None:
                cv2.imshow(str(camera["name"]), image[..., ::-1])
        if cv2.waitKey(1) & 0xFF in QUIT:
            signal.raise_signal(signal.SIGINT)

    def close(self) -> None:
        """The run ends, and its windows with it."""
        cv2.destroyAllWindows()
