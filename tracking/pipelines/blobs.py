"""Any number of coloured objects, or of measured points, through a video."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.likelihoods.colour_region import ColourRange, colour_of_box, parse_colour
from tsuiseki.tracking.trackers.blobs import BlobSettings, BlobTracker, SingleBlobTracker
from tsuiseki.tracking.trackers.people.run import shifted
from tsuiseki.tracking.trackers.points import PointSettings, PointTracker, points_as_boxes
from tsuiseki.tracking.types import Detections, Frame, Targets, Track
from tsuiseki.tracking.video import Source, open_source

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
    wanted = chosen_colour(opened, colour)
    maker = SingleBlobTracker if settings.preset == "single" else BlobTracker
    return opened, maker(wanted, settings, seed)
