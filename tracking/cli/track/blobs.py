"""`tsuiseki track blobs`: several targets that are coloured regions or measured points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import Run, frames_expected
from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.likelihoods.colour_region import ColourRange
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.points import PointSettings
    from tsuiseki.tracking.types import Detections, Track
    from tsuiseki.tracking.video import Source

Preset = Literal["calibrated", "paper", "single"]
Method = Literal["labelled", "phd"]
SIZE = (32.0, 32.0)
Followed: TypeAlias = "tuple[list[Track], dict[str, list[Any]]]"


def blobs(
    video: Video,
    output: SeededOutput,
    colour: str | None = None,
    colour_box: tuple[float, float, float, float] | None = None,
    detections: Path | None = None,
    preset: Preset = "calibrated",
    method: Method = "labelled",
    particles: int = 500,
    size: tuple[float, float] = SIZE,
    smallest: float = 12.0,
    detection: float = 0.85,
    clutter: float = 1.0,
    score_range: tuple[float, float] = (0.0, 1.0),
) -> int:
    """Track every object of a colour, or every measured point or box, each with an id.

    Give one of --colour, --colour-box and --detections. DIR gets tracks.txt (MOTChallenge text), points.csv, run.json
    and, with --overlay, overlay.webm.

    Args:
        colour: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with hues in
            degrees.
        colour_box: X,Y,W,H in 0-based pixels of an object in the first frame, whose colour is taken.
        detections: measurements: MOTChallenge boxes (det.txt), or points as CSV with the columns frame,x,y.
        preset: for colours: calibrated follows any number; paper uses the likelihood as printed, whose expected count
            means nothing; single follows one.
        method: for measurements: labelled multi-Bernoulli filter, or phd.
        particles: of each target.
        size: width and height in pixels, of objects that appear with paper and single, and of points.
        smallest: least side in pixels of an object, and of a patch of colour that may be a new one.
        detection: for measurements: probability that a target is measured, from 0 to 1.
        clutter: for measurements: expected false ones in a frame.
        score_range: smallest and largest score that the rows of --detections may have.
        seed: of the particles.
    """
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.formats.points import write_point_tracks
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.points import PointSettings

    if sum(choice is not None for choice in (colour, colour_box, detections)) != 1:
        raise RequestError("expected one of `colour`, `colour_box` and `detections`")
    source = video.open(images=detections is None)
    width, height = _extent(source)
    if not (0 < size[0] <= max(width, SIZE[0]) and 0 < size[1] <= max(height, SIZE[1])):
        raise RequestError(
            f"`size`: expected at most the {width:g}x{height:g} pixels of a frame, got {size[0]:g},{size[1]:g}"
        )
    with output.run() as run:
        if detections is None:
            wanted = _colour(source, colour, colour_box)
            settings = BlobSettings(preset=preset, particles=particles, size=size, smallest=smallest)
            tracks, run.columns = _follow_colour(run, source, wanted, settings, output.seed, record=video.overlay)
        else:
            points = PointSettings(method=method, particles=particles, detection=detection, clutter=clutter, box=size)
            measured = _measurements(source, detections, size, score_range)
            tracks, run.columns = _follow_measurements(run, source, measured, points, output.seed)
        run.write("tracks.txt", lambda path: write_tracks(path, tracks))
        run.write("points.csv", lambda path: write_point_tracks(path, tracks))
        if video.overlay:
            run.draw(
                video.overlay_file, lambda path: write_overlay(path, run.replay(source), tracks, source.frame_rate)
            )
        what = "object" if len(tracks) == 1 else "objects"
        summary = f"{len(tracks)} {what} in {run.count} frames: {output.out / 'tracks.txt'}"
        counts = run.columns.get("expected_count")
        run.done(summary + (f"\n{_expected(counts, preset)}" if counts else ""))
    return run.status


def _expected(counts: Sequence[float], preset: Preset) -> str:
    mean = sum(counts) / len(counts)
    if preset == "paper":
        return f"sum of the weights {mean:.2g} in a frame: the printed likelihood can only shrink it, so it is no count"
    return f"expected number of objects {mean:.2f} in a frame"


def _colour(source: Source, named: str | None, box: tuple[float, float, float, float] | None) -> ColourRange:
    from tsuiseki.tracking.pipelines.blobs import chosen_colour

    if box is None:
        return chosen_colour(source, named or "")
    x, y, width, height = box
    if width <= 0 or height <= 0:
        raise RequestError(f"`colour_box`: expected X,Y,W,H with a width and height above 0, got {box}")
    return chosen_colour(source, (x, y, x + width, y + height))


def _follow_colour(
    run: Run, source: Source, colour: ColourRange, settings: BlobSettings, seed: int, *, record: bool
) -> Followed:
    from tsuiseki.tracking.trackers.blobs import BlobTracker, SingleBlobTracker

    frames: list[int] = []
    tracker = (
        SingleBlobTracker(colour, settings, seed)
        if settings.preset == "single"
        else BlobTracker(colour, settings, seed)
    )
    for frame in run.steps(run.frames(source, record), total=frames_expected(source)):
        with run.times.measure("track"):
            tracker.update(frame)
        frames.append(frame.index)
    columns: dict[str, list[Any]] = {"frame": [index + 1 for index in frames]}
    if isinstance(tracker, SingleBlobTracker):
        columns |= {"score": [e.score for e in tracker.estimates], "status": [e.status for e in tracker.estimates]}
        return tracker.tracks(), columns
    columns["expected_count"] = [round(count, 4) for count in tracker.expected]
    return _shifted(tracker.tracks(), frames[0]), columns


def _measurements(
    source: Source, path: Path, size: tuple[float, float], score_range: tuple[float, float]
) -> list[Detections]:
    from tsuiseki.tracking.cli.track.finding import check_score_range
    from tsuiseki.tracking.formats.points import is_point_file, read_points
    from tsuiseki.tracking.pipelines.finding import given_detections
    from tsuiseki.tracking.trackers.points import points_as_boxes

    if is_point_file(path):
        return [points_as_boxes(points, size) for points in read_points(path, source.length)]
    check_score_range(score_range)
    return given_detections(path, source, score_range)


def _follow_measurements(
    run: Run, source: Source, found: list[Detections], settings: PointSettings, seed: int
) -> Followed:
    from tsuiseki.tracking.trackers.points import PointTracker

    tracker = PointTracker(settings, _extent(source), seed)
    wanted = source.frames_wanted.within(source.length or len(found))
    last = len(found) - 1 if wanted.last is None else min(wanted.last, len(found) - 1)
    for measured in run.steps(found[wanted.first : last + 1], total=last + 1 - wanted.first):
        with run.times.measure("track"):
            tracker.update(measured)
    columns: dict[str, list[Any]] = {"frame": list(range(wanted.first + 1, wanted.first + run.count + 1))}
    return _shifted(tracker.tracks(), wanted.first), columns


def _extent(source: Source) -> tuple[float, float]:
    """Width and height of the images; a usual size where a sequence is text only."""
    if not source.has_images:
        return 640.0, 480.0
    height, width = next(iter(source.frames())).image.shape[:2]
    return float(width), float(height)


def _shifted(tracks: list[Track], first: int) -> list[Track]:
    from tsuiseki.tracking.trackers.people.run import shifted

    return [shifted(track, first) for track in tracks]
