"""`tsuiseki track blobs`: several targets that are coloured regions or measured points."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import count, frames_expected
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.pipelines.finding_options import check_score_range
from tsuiseki.tracking.trackers.blobs import BlobPreset
from tsuiseki.tracking.trackers.points import PointMethod

if TYPE_CHECKING:
    from tsuiseki.tracking.trackers.blobs import BlobTracker, SingleBlobTracker

SIZE = (32.0, 32.0)


def blobs(
    video: Video,
    output: SeededOutput,
    colour: str | None = None,
    colour_box: tuple[float, float, float, float] | None = None,
    detections: Path | None = None,
    preset: BlobPreset = "calibrated",
    method: PointMethod = "labelled",
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
    from tsuiseki.tracking.formats.sensors.points import write_point_tracks
    from tsuiseki.tracking.pipelines.blobs import (
        blob_result,
        chosen_colour,
        colour_tracker,
        extent_of,
        read_measurements,
        said_of_counts,
    )
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.points import PointSettings, PointTracker

    if sum(choice is not None for choice in (colour, colour_box, detections)) != 1:
        raise RequestError("expected one of `colour`, `colour_box` and `detections`")
    corners = None
    if colour_box is not None:
        x, y, wide, high = colour_box
        if wide <= 0 or high <= 0:
            raise RequestError(f"`colour_box`: expected X,Y,W,H with a width and height above 0, got {colour_box}")
        corners = (x, y, x + wide, y + high)
    check_score_range(score_range)
    source = video.open(images=detections is None)
    width, height = extent = extent_of(source)
    if not (0 < size[0] <= max(width, SIZE[0]) and 0 < size[1] <= max(height, SIZE[1])):
        raise RequestError(
            f"`size`: expected at most the {width:g}x{height:g} pixels of a frame, got {size[0]:g},{size[1]:g}"
        )
    tracker: BlobTracker | SingleBlobTracker | PointTracker
    if detections is None:
        settings = BlobSettings(preset=preset, particles=particles, size=size, smallest=smallest)
        tracker = colour_tracker(chosen_colour(source, colour or corners or ""), settings, output.seed)
        measured = None
    else:
        points = PointSettings(method=method, particles=particles, detection=detection, clutter=clutter, box=size)
        tracker = PointTracker(points, extent, output.seed)
        measured = read_measurements(source, detections, size, score_range)
    update: Callable[[Any], object] = tracker.update
    with output.run() as run:
        seen: Iterable[Any] = run.frames(source, record=video.overlay) if measured is None else measured
        for frame in run.steps(seen, total=frames_expected(source) if measured is None else len(measured)):
            with run.times.measure("track"):
                update(frame)
        tracks, run.columns = blob_result(tracker, source.frames_wanted.first, run.count)
        run.write("tracks.txt", lambda path: write_tracks(path, tracks))
        run.write("points.csv", lambda path: write_point_tracks(path, tracks))
        video.draw(run, source, lambda path, again: write_overlay(path, again, tracks, source.frame_rate))
        objects = count(len(tracks), "object", "objects")
        summary = f"{objects} in {run.count} frames: {output.out / 'tracks.txt'}"
        run.done("\n".join([summary, *said_of_counts(run.columns.get("expected_count"), preset)]))
    return run.status
