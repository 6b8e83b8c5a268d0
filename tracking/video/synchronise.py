"""Several videos as one sequence of moments: frames of different cameras that were taken together come together."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray


@dataclass(frozen=True)
class Moment:
    """Frames taken within the tolerance of each other.

    Attributes:
        time: seconds, the mean over the frames.
        frames: one 0-based frame number a video; None where a video has no frame now.
    """

    time: float
    frames: tuple[int | None, ...]


def align(times: Sequence[FloatArray], tolerance: float) -> list[Moment]:
    """Moments in order of time, each frame of each video in exactly one.

    A moment begins with the earliest frame not yet taken and holds the frames of other videos that follow within
    ``tolerance`` seconds; so videos may differ in rate and start, and may lack frames.

    Args:
        times: of the frames of each video, ``(T,)`` seconds, increasing.
        tolerance: seconds.
    """
    stamps = np.concatenate(times)
    videos = np.repeat(np.arange(len(times)), [len(t) for t in times])
    numbers = np.concatenate([np.arange(len(t)) for t in times])
    moments: list[Moment] = []
    group: dict[int, int] = {}
    begin, total = 0.0, 0.0
    for k in np.argsort(stamps, kind="stable"):
        video, stamp = int(videos[k]), float(stamps[k])
        if group and (video in group or stamp - begin > tolerance):
            moments.append(_moment(group, total, len(times)))
            group, total = {}, 0.0
        if not group:
            begin = stamp
        group[video] = int(numbers[k])
        total += stamp
    if group:
        moments.append(_moment(group, total, len(times)))
    return moments


def _moment(group: dict[int, int], total: float, videos: int) -> Moment:
    return Moment(total / len(group), tuple(group.get(v) for v in range(videos)))


def default_tolerance(times: Sequence[FloatArray]) -> float:
    """A quarter of the shortest usual time between two frames: at most one frame a video, and no gap missed."""
    steps = [float(np.median(np.diff(t))) for t in times if len(t) > 1]
    return 0.25 * min(steps) if steps else 0.0


def read_timestamps(path: Path) -> FloatArray:
    """``(T,)`` seconds from a text file: one number a line (or the first column of a CSV), a header line allowed.

    Raises:
        RequestError: a line is no number, or times do not increase.
    """
    try:
        rows = [row for row in csv.reader(path.read_text(encoding="utf-8-sig").splitlines()) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise RequestError(f"{path}: expected a text file with one time a line, cannot read it") from error
    times = []
    for number, row in enumerate(rows):
        try:
            times.append(float(row[0]))
        except ValueError as error:
            if number > 0:
                raise RequestError(f"{path}: line {number + 1}: expected seconds, got {row[0]!r}") from error
    if not times or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise RequestError(f"{path}: expected increasing times in seconds, got {len(times)} that are not")
    return np.array(times)


def moments_with_images(
    moments: Sequence[Moment], videos: Sequence[Iterator[Frame]]
) -> Iterator[tuple[Moment, list[ImageArray | None]]]:
    """Each moment with its images; every video is read once, front to back, one frame held at a time."""
    for moment in moments:
        images: list[ImageArray | None] = []
        for video, wanted in zip(videos, moment.frames, strict=True):
            image = None
            while wanted is not None:
                frame = next(video, None)
                if frame is None:
                    return
                if frame.index == wanted:
                    image = frame.image
                    break
            images.append(image)
        yield moment, images
