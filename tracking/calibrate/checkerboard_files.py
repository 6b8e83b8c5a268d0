"""Intrinsics from a folder or video of a checkerboard."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from tsuiseki.tracking.cameras.checkerboard import CheckerboardFit, Coefficients, find_corners, fit_checkerboards
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, Frame
from tsuiseki.tracking.video.source import open_source


def calibrate_from_checkerboards(
    source: str | Path,
    corners: tuple[int, int],
    coefficients: Coefficients = 5,
    every: int = 1,
    watch: Callable[[Iterable[Frame]], Iterable[Frame]] = iter,
) -> tuple[CheckerboardFit, list[int], int]:
    """The camera that took the pictures.

    Args:
        source: a folder of pictures or a video.
        corners: inner corners along a row and along a column of the board.
        coefficients: of the lens model.
        every: use every so many frames.
        watch: passes the frames through, for progress.

    Returns:
        The fit, the numbers of the pictures in which the board was found (from 1), and how many were looked at.

    Raises:
        RequestError: pictures differ in size, too few show the whole board, or they do not fix the camera.
    """
    found: list[FloatArray] = []
    used: list[int] = []
    size: tuple[int, int] | None = None
    seen = 0
    for frame in watch(open_source(str(source)).frames()):
        if frame.index % every:
            continue
        seen += 1
        height, width = frame.image.shape[:2]
        if size not in (None, (width, height)):
            raise RequestError(f"{source}: expected pictures of one size, got {size} and {(width, height)}")
        size = (width, height)
        places = find_corners(frame.image, corners)
        if places is not None:
            found.append(places)
            used.append(frame.index + 1)
    if size is None:
        raise RequestError(f"{source}: expected pictures, found none")
    return fit_checkerboards(found, corners, size, coefficients), used, seen
