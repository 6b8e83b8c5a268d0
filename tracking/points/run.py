"""Any number of objects that are coloured or measured in a video: in one call, and by `tsuiseki track blobs`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.bounds import as_settings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import ColourRange, colour_of_box, parse_colour
from tsuiseki.tracking.formats.measurement_tables import is_point_file, read_points, write_point_tracks
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.contract import shifted
from tsuiseki.tracking.people.detections import network_detections
from tsuiseki.tracking.people.given_detections import given_detections
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.points.settings import SIZE, BlobChoice, BlobSettings, PointSettings
from tsuiseki.tracking.points.tracker import BlobTracker, PointTracker, SingleBlobTracker
from tsuiseki.tracking.result import PageContent, Result, Writer
from tsuiseki.tracking.runs.following import Video, count, open_checked
from tsuiseki.tracking.runs.options import SeededOutput
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Frame, Targets, Track
from tsuiseki.tracking.video.source import Source, SourceLike, named

AnyBlobTracker: TypeAlias = BlobTracker | SingleBlobTracker | PointTracker
# Width and height of the images where there are none, pixels.
USUAL_EXTENT = (640.0, 480.0)
ColourLike: TypeAlias = str | ColourRange | ArrayLike


def track_blobs(
    source: SourceLike,
    colour: ColourLike,
    *,
    settings: BlobSettings | None = None,
    frames: str | None = None,
    seed: int = 0,
) -> Result[Track]:
    """Every object of a colour in a video, each with an id.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images in a list.
        colour: ``red``, ``orange``, ``yellow``, ``green``, ``cyan``, ``blue``, ``magenta``, ``black``, ``white``;
            ``"H1-H2,S1-S2,V1-V2"`` with hues in degrees; or the ``(4,)`` box of an object in the first frame, x1, y1,
            x2, y2, whose colour is taken.
        settings: see `BlobSettings`.
        frames: these only, counted from 1 with both ends, such as ``"301-400"``.
        output.seed: of the particles.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    opened, tracker = _prepared(source, colour, settings, frames, seed, ", or use follow_blobs")
    return blob_result(opened, tracker, opened.frames(), StageTimes(), {"source": named(source), "seed": seed})


def follow_blobs(
    source: SourceLike,
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
) -> Result[Track]:
    """Targets behind measured points or boxes, each with an id.

    Args:
        measured: of each frame in order, points ``(M, 2)`` in pixels, or whatever `as_detections` understands.
        extent: width and height of the image, pixels.
        settings: see `PointSettings`; points are taken as boxes of its ``box``.
        output.seed: of the particles.

    Raises:
        RequestError: a frame is neither; the message says what was expected.
    """
    tracker = PointTracker(as_settings(settings, PointSettings), extent, seed)
    steps = (as_measured(of_frame, tracker.settings.box) for of_frame in measured)
    return blob_result(None, tracker, steps, StageTimes(), {"seed": seed})


def follow_points(
    measured: Iterable[ArrayLike | DetectionsLike],
    extent: tuple[float, float],
    *,
    settings: PointSettings | None = None,
    seed: int = 0,
) -> Iterator[Targets]:
    """The targets of each frame, while the measurements come; see `track_points`."""
    tracker = PointTracker(as_settings(settings, PointSettings), extent, seed)
    for of_frame in measured:
        yield tracker.update(as_measured(of_frame, tracker.settings.box))
        tracker.forget()


def as_measured(measured: ArrayLike | DetectionsLike, box: tuple[float, float]) -> Detections:
    """Points ``(M, 2)`` as boxes of the width and height ``box``; anything else by `as_detections`.

    Raises:
        RequestError: see `as_detections`; or a point is not finite.
    """
    points = np.asarray(measured, dtype=np.float64) if isinstance(measured, list | tuple | np.ndarray) else None
    if points is None or points.ndim != 2 or points.shape[1] != 2:
        return as_detections(measured)
    if not np.isfinite(points).all():
        raise RequestError("expected finite points, got NaN or infinity")
    return points_as_boxes(points, box)


def points_as_boxes(points: FloatArray, box: tuple[float, float]) -> Detections:
    """Detections of a width and height ``box`` about points ``(M, 2)``, all of score 1."""
    half = np.asarray(box) / 2
    return Detections(np.concatenate([points - half, points + half], axis=1), np.ones(len(points)))


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
    source: SourceLike,
    colour: ColourLike,
    settings: BlobSettings | None,
    frames: str | None,
    seed: int,
    ends: str | None = None,
) -> tuple[Source, BlobTracker | SingleBlobTracker]:
    opened = open_checked(source, frames, images=True, ends=ends)
    settings = as_settings(settings, BlobSettings)
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
        detections = [points_as_boxes(points, box) for points in read_points(path, source.length)]
    else:
        detections = given_detections(path, source, score_range)
    frame_range = source.frames_wanted.within(source.length or len(detections))
    last = len(detections) - 1 if frame_range.last is None else frame_range.last
    return detections[frame_range.first : last + 1]


def blob_result(
    source: Source | None, tracker: AnyBlobTracker, steps: Iterable[Any], times: StageTimes, settings: Mapping[str, Any]
) -> Result[Track]:
    """The result of a run of a fresh tracker, where ``steps`` are what it takes of each frame."""
    from tsuiseki.tracking.report.overlay import Overlay

    update: Callable[[Any], object] = tracker.update
    count, first = 0, 0 if source is None else source.frames_wanted.first
    for step in steps:
        with reported_to(steps), times.measure("track"):
            update(step)
            count += 1
    columns: dict[str, list[Any]] = {"frame": list(range(first, first + count))}
    if isinstance(tracker, SingleBlobTracker):
        # It counts frames as the video does.
        columns |= {"score": [e.score for e in tracker.estimates], "status": [e.status for e in tracker.estimates]}
        tracks = tracker.tracks()
    else:
        tracks = [shifted(track, first) for track in tracker.tracks()]
    if isinstance(tracker, BlobTracker):
        columns["expected_count"] = [round(number, 4) for number in tracker.expected]
    files: dict[str, Writer] = {
        "tracks.txt": lambda path, _: write_tracks(path, tracks),
        "points.csv": lambda path, _: write_point_tracks(path, tracks),
    }
    attributes: dict[str, Any] = {"settings": settings, "seconds": times.seconds, "frames": columns, "files": files}
    if source is None:
        return Result(tracks, **attributes)
    attributes["page"] = PageContent(("object", "objects"), "centre")
    return Result.of(source, tracks, **attributes, painter=Overlay(tracks, source.frame_rate).draw)


def opened_blobs(choice: BlobChoice, source: Source, seed: int) -> tuple[AnyBlobTracker, Sequence[Detections] | None]:
    """A fresh tracker, and the measurements of each frame, where it does not take the frames themselves.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    width, height = extent = extent_of(source)
    if not (0 < choice.size[0] <= max(width, SIZE[0]) and 0 < choice.size[1] <= max(height, SIZE[1])):
        size = f"{choice.size[0]:g},{choice.size[1]:g}"
        raise RequestError(f"`size`: expected at most the {width:g}x{height:g} pixels of a frame, got {size}")
    if choice.detections is not None or choice.detector is not None:
        points = PointSettings(
            method=choice.method,
            particles=choice.particles,
            detection=choice.detection,
            clutter=choice.clutter,
            box=choice.size,
        )
        tracker = PointTracker(points, extent, seed)
        if choice.detections is None:
            return tracker, None
        return tracker, read_measurements(source, choice.detections, choice.size, choice.score_range)
    settings = BlobSettings(
        preset=choice.preset,
        particles=choice.particles,
        size=choice.size,
        smallest=choice.smallest,
        confirm=choice.confirm,
    )
    if choice.colour_box is None:
        colour = chosen_colour(source, choice.colour or "")
    else:
        x, y, w, h = choice.colour_box
        colour = chosen_colour(source, (x, y, x + w, y + h))
    return colour_tracker(colour, settings, seed), None


BLOBS = BlobChoice()


def blobs(video: Video, *, output: SeededOutput, choice: BlobChoice = BLOBS) -> int:
    """Track objects of one colour, the detections of a network, or the measurements of a file, each with an id.

    Give one of --colour, --colour-box, --detections and --detector. DIR gets tracks.txt (MOTChallenge text),
    points.csv, report.html with its plots and numbers in report/, run.json and, with --overlay, overlay.webm.

    Args:
        output.seed: of the particles.
    """
    choice.check()
    source = video.open(images=choice.detections is None)
    tracker, measured = opened_blobs(choice, source, output.seed)
    with output.run() as run:
        steps_in: Iterable[Any] = run.frames(source, record=video.overlay) if measured is None else measured
        if choice.detector is not None:
            numbered = network_detections(source, FindingOptions(detector=choice.detector), steps_in)
            steps_in = (detections for _, detections in numbered)
        steps = run.steps(steps_in, total=None if measured is None else len(measured))
        result = blob_result(source, tracker, steps, run.times, output.settings)
        run.save(result, lambda: video.draw(run, source, result))
        lines = [f"{count(len(result), 'object', 'objects')} in {run.count} frames: {output.out / 'tracks.txt'}"]
        if counts := result.frames.get("expected_count"):
            mean, printed = sum(counts) / len(counts), "the printed likelihood can only shrink it, so it is no count"
            plain = f"expected number of objects {mean:.2f} in a frame"
            lines.append(f"sum of the weights {mean:.2g} in a frame: {printed}" if choice.preset == "paper" else plain)
        run.done("\n".join(lines))
    return run.status
