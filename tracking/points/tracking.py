"""Any number of coloured objects, or of measured points, through a video."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import ColourRange, colour_of_box, parse_colour
from tsuiseki.tracking.formats.sensed_points import is_point_file, read_points
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.inputs import given_detections
from tsuiseki.tracking.people.tracker import shifted
from tsuiseki.tracking.points.blob_tracker import BlobPreset, BlobSettings, BlobTracker, SingleBlobTracker
from tsuiseki.tracking.points.tracker import PointSettings, PointTracker, points_as_boxes
from tsuiseki.tracking.types import Detections, Frame, Targets, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import Source, open_source

USUAL_EXTENT = (640.0, 480.0)
ColourLike: TypeAlias = str | ColourRange | ArrayLike


def track_blobs(
    source: str | Path | int,
    colour: ColourLike,
    *,
    settings: BlobSettings | None = None,
    frames: str | None = None,
    seed: int = 0,
) -> list[Track]:
    """Every object of a colour in a video, each with an id.

    Args:
        source: a video file, a folder of images, or a MOTChallenge sequence folder.
        colour: ``red``, ``orange``, ``yellow``, ``green``, ``cyan``, ``blue``, ``magenta``, ``black``, ``white``;
            ``"H1-H2,S1-S2,V1-V2"`` with hues in degrees; or the ``(4,)`` box of an object in the first frame, x1, y1,
            x2, y2, whose colour is taken.
        settings: see `BlobSettings`.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        seed: of the particles.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    opened, tracker = _prepared(source, colour, settings, frames, seed)
    if opened.live and opened.frames_wanted.last is None:
        raise RequestError(f"{opened.name} does not end by itself; give frames, or use follow_blobs")
    first: int | None = None
    for frame in opened.frames():
        first = frame.index if first is None else first
        tracker.update(frame)
    # The tracker of a single one counts frames as the video does.
    return [shifted(t, 0 if isinstance(tracker, SingleBlobTracker) else first or 0) for t in tracker.tracks()]


def follow_blobs(
    source: str | Path | int,
    colour: ColourLike,
    *,
    settings: BlobSettings | None = None,
    frames: str | None = None,
    seed: int = 0,
) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the objects of a colour in it, while the video comes; see `track_blobs`."""
    opened, tracker = _prepared(source, colour, settings, frames, seed)
    return ((frame, tracker.update(frame)) for frame in opened.frames())


def track_points(
    measured: Iterable[ArrayLike | DetectionsLike],
    extent: tuple[float, float],
    *,
    settings: PointSettings | None = None,
    seed: int = 0,
) -> list[Track]:
    """Targets behind measured points or boxes, each with an id.

    Args:
        measured: of each frame in order, points ``(M, 2)`` in pixels, or whatever `as_detections` understands.
        extent: width and height of the image, pixels.
        settings: see `PointSettings`; points are taken as boxes of its ``box``.
        seed: of the particles.

    Raises:
        RequestError: a frame is neither; the message says what was expected.
    """
    tracker = PointTracker(settings or PointSettings(), extent, seed)
    for found in measured:
        tracker.update(as_measured(found, tracker.settings.box))
    return tracker.tracks()


def follow_points(
    measured: Iterable[ArrayLike | DetectionsLike],
    extent: tuple[float, float],
    *,
    settings: PointSettings | None = None,
    seed: int = 0,
) -> Iterator[Targets]:
    """The targets of each frame, while the measurements come; see `track_points`."""
    tracker = PointTracker(settings or PointSettings(), extent, seed)
    for found in measured:
        yield tracker.update(as_measured(found, tracker.settings.box))
        tracker.forget()


def as_measured(found: ArrayLike | DetectionsLike, box: tuple[float, float]) -> Detections:
    """Points ``(M, 2)`` as boxes of the width and height ``box``; anything else by `as_detections`.

    Raises:
        RequestError: see `as_detections`; or a point is not finite.
    """
    points = np.asarray(found, dtype=np.float64) if isinstance(found, list | tuple | np.ndarray) else None
    if points is None or points.ndim != 2 or points.shape[1] != 2:
        return as_detections(found)
    if not np.isfinite(points).all():
        raise RequestError("expected finite points, got NaN or infinity")
    return points_as_boxes(points, box)


def chosen_colour(source: Source, colour: ColourLike) -> ColourRange:
    """The colour by its name, as it is, or of a box in the first frame.

    Raises:
        RequestError: see `parse_colour` and `colour_of_box`; or the box has no area.
    """
    if isinstance(colour, ColourRange):
        return colour
    if isinstance(colour, str):
        return parse_colour(colour)
    box = np.asarray(colour, dtype=np.float64)
    if box.shape != (4,) or not (box[2:] > box[:2]).all():
        raise RequestError(f"expected a `colour` by name, or a box x1, y1, x2, y2 with an area, got {colour}")
    return colour_of_box(next(iter(source.frames())).image, box)


def _prepared(
    source: str | Path | int, colour: ColourLike, settings: BlobSettings | None, frames: str | None, seed: int
) -> tuple[Source, BlobTracker | SingleBlobTracker]:
    opened, settings = open_source(str(source), parse_frames(frames)), settings or BlobSettings()
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
    return opened, colour_tracker(chosen_colour(opened, colour), settings, seed)


def colour_tracker(colour: ColourRange, settings: BlobSettings, seed: int = 0) -> BlobTracker | SingleBlobTracker:
    """The tracker of one object or of any number, as the preset says."""
    maker = SingleBlobTracker if settings.preset == "single" else BlobTracker
    return maker(colour, settings, seed)


def extent_of(source: Source) -> tuple[float, float]:
    """Width and height of the images, pixels; a usual size where a sequence is text only."""
    if not source.has_images:
        return USUAL_EXTENT
    height, width = next(iter(source.frames())).image.shape[:2]
    return float(width), float(height)


def read_measurements(
    source: Source, path: Path, box: tuple[float, float], score_range: tuple[float, float] | None = None
) -> list[Detections]:
    """What a file measured in the wanted frames of ``source``, an entry a frame.

    Args:
        source: the video.
        path: points as CSV with the columns frame,x,y, or MOTChallenge's det.txt.
        box: width and height that points are given, pixels.
        score_range: smallest and largest score that the rows of det.txt may have.

    Raises:
        RequestError: the file is missing or broken, or longer than the video.
    """
    if is_point_file(path):
        found = [points_as_boxes(points, box) for points in read_points(path, source.length)]
    else:
        found = given_detections(path, source, score_range)
    wanted = source.frames_wanted.within(source.length or len(found))
    last = len(found) - 1 if wanted.last is None else wanted.last
    return found[wanted.first : last + 1]


def blob_result(
    tracker: BlobTracker | SingleBlobTracker | PointTracker, first: int, count: int
) -> tuple[list[Track], dict[str, list[Any]]]:
    """The tracks in the frames of the video, and what happened in each of ``count`` frames from ``first``, 0-based."""
    columns: dict[str, list[Any]] = {"frame": list(range(first + 1, first + count + 1))}
    if isinstance(tracker, SingleBlobTracker):
        columns |= {"score": [e.score for e in tracker.estimates], "status": [e.status for e in tracker.estimates]}
        return tracker.tracks(), columns
    if isinstance(tracker, BlobTracker):
        columns["expected_count"] = [round(number, 4) for number in tracker.expected]
    return [shifted(track, first) for track in tracker.tracks()], columns


def said_of_counts(counts: Sequence[float] | None, preset: BlobPreset) -> list[str]:
    """A line on the expected number of objects in each frame, where the tracker has one."""
    if not counts:
        return []
    mean = sum(counts) / len(counts)
    if preset == "paper":
        return [
            f"sum of the weights {mean:.2g} in a frame: the printed likelihood can only shrink it, so it is no count"
        ]
    return [f"expected number of objects {mean:.2f} in a frame"]
