"""`tsuiseki track blobs`: several targets that are coloured regions or measured points."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from tsuiseki.tracking.likelihoods.colour_region import ColourRange
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.points import PointSettings
    from tsuiseki.tracking.types import Detections, Track
    from tsuiseki.tracking.video import Source

Preset = Literal["calibrated", "paper", "single"]
Method = Literal["labelled", "phd"]
Followed: TypeAlias = "tuple[list[Track], dict[str, list[Any]]]"


def track(
    source: str,
    out: Path,
    colour: str | None = None,
    colour_box: tuple[float, float, float, float] | None = None,
    detections: Path | None = None,
    preset: Preset = "calibrated",
    method: Method = "labelled",
    frames: str | None = None,
    particles: int = 500,
    size: tuple[float, float] = (32.0, 32.0),
    smallest: float = 12.0,
    detection: float = 0.85,
    false: float = 1.0,
    score_range: tuple[float, float] = (0.0, 1.0),
    overlay: bool = False,
    overwrite: bool = False,
    seed: int = 0,
) -> int:
    """Track every object of a colour, or every measured point or box, each with an id.

    Give one of --colour, --colour-box and --detections. DIR gets tracks.txt (MOTChallenge text), points.csv, run.json
    and, with --overlay, overlay.webm.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, the number of a webcam or an address.
        out: folder for the results.
        colour: red, orange, yellow, green, cyan, blue, magenta, black, white, or H1-H2,S1-S2,V1-V2 with hues in
            degrees.
        colour_box: X,Y,W,H in 0-based pixels of an object in the first frame, whose colour is taken.
        detections: measurements: MOTChallenge boxes (det.txt), or points as CSV with the columns frame,x,y.
        preset: for colours: calibrated follows any number; paper uses the likelihood as printed, whose expected count
            means nothing; single follows one.
        method: for measurements: labelled multi-Bernoulli filter, or phd.
        frames: track this stretch only, counted from 1 with both ends, such as 301-400.
        particles: of each target.
        size: width and height in pixels, of objects that appear with paper and single, and of points.
        smallest: least side in pixels of an object, and of a patch of colour that may be a new one.
        detection: for measurements: probability that a target is measured, from 0 to 1.
        false: for measurements: expected false ones in a frame.
        score_range: smallest and largest score that the rows of --detections may have.
        overlay: also write a video with the tracks drawn in.
        overwrite: replace an earlier result in the folder.
        seed: of the particles.
    """
    given = dict(locals())
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.formats.points import write_point_tracks
    from tsuiseki.tracking.frame_range import parse_frames
    from tsuiseki.tracking.output import RunRecord, check_output_folder, output_folder
    from tsuiseki.tracking.report.overlay import write_overlay
    from tsuiseki.tracking.timing import StageTimes
    from tsuiseki.tracking.trackers.blobs import BlobSettings
    from tsuiseki.tracking.trackers.points import PointSettings
    from tsuiseki.tracking.video import open_source

    if sum(choice is not None for choice in (colour, colour_box, detections)) != 1:
        raise RequestError("expected one of --colour, --colour-box and --detections")
    check_output_folder(out, overwrite)
    opened = open_source(source, parse_frames(frames) if frames else None)
    if overlay and (opened.live or not opened.has_images):
        raise RequestError(f"expected a video that can be played again for --overlay, got {opened.name}")
    times = StageTimes()
    if detections is None:
        wanted = _colour(opened, colour, colour_box)
        settings = BlobSettings(preset=preset, particles=particles, size=size, smallest=smallest)
        tracks, columns = _follow_colour(opened, wanted, settings, seed, times)
    else:
        points = PointSettings(method=method, particles=particles, detection=detection, false=false, box=size)
        tracks, columns = _follow_measurements(opened, detections, points, score_range, seed, times)
    with output_folder(out, overwrite) as work:
        write_tracks(work / "tracks.txt", tracks)
        write_point_tracks(work / "points.csv", tracks)
        if overlay:
            write_overlay(work / "overlay.webm", opened.frames(), tracks, opened.frame_rate)
        shown = {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
        RunRecord(["tsuiseki", "track", "blobs"], shown, seed, times.seconds, columns).write(work)
    what = "object" if len(tracks) == 1 else "objects"
    print(f"{len(tracks)} {what} in {len(columns['frame'])} frames: {out / 'tracks.txt'}")
    if columns.get("expected_count"):
        print(_expected(columns["expected_count"], preset))
    return 0


def _expected(counts: list[float], preset: Preset) -> str:
    mean = sum(counts) / len(counts)
    if preset == "paper":
        return f"sum of the weights {mean:.2g} in a frame: the printed likelihood can only shrink it, so it is no count"
    return f"expected number of objects {mean:.2f} in a frame"


def _colour(source: Source, named: str | None, box: tuple[float, float, float, float] | None) -> ColourRange:
    import numpy as np

    from tsuiseki.tracking.likelihoods.colour_region import colour_of_box, parse_colour

    if named is not None:
        return parse_colour(named)
    assert box is not None
    x, y, width, height = box
    if width <= 0 or height <= 0:
        raise RequestError(f"--colour-box: expected X,Y,W,H with a width and height above 0, got {box}")
    first = next(iter(source.frames()))
    return colour_of_box(first.image, np.array([x, y, x + width, y + height]))


def _follow_colour(
    source: Source, colour: ColourRange, settings: BlobSettings, seed: int, times: StageTimes
) -> Followed:
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.trackers.blobs import BlobTracker, SingleBlobTracker

    frames: list[int] = []
    tracker = (
        SingleBlobTracker(colour, settings, seed)
        if settings.preset == "single"
        else BlobTracker(colour, settings, seed)
    )
    for frame in progress(source.frames(), "tracking", source.length):
        with times.measure("track"):
            tracker.update(frame)
        frames.append(frame.index)
    first = frames[0] if frames else 0
    columns: dict[str, list[Any]] = {"frame": [index + 1 for index in frames]}
    if isinstance(tracker, SingleBlobTracker):
        columns |= {"score": [e.score for e in tracker.estimates], "status": [e.status for e in tracker.estimates]}
        return tracker.tracks(), columns
    columns["expected_count"] = [round(count, 4) for count in tracker.expected]
    return _shifted(tracker.tracks(), first), columns


def _follow_measurements(
    source: Source, path: Path, settings: PointSettings, score_range: tuple[float, float], seed: int, times: StageTimes
) -> Followed:
    from tsuiseki.tracking.cli.people_run import given_detections
    from tsuiseki.tracking.cli.progress import progress
    from tsuiseki.tracking.formats.points import is_point_file, read_points
    from tsuiseki.tracking.trackers.points import PointTracker, points_as_boxes

    tracker = PointTracker(settings, _extent(source), seed)
    found: list[Detections]
    if is_point_file(path):
        found = [points_as_boxes(points, settings.box) for points in read_points(path, source.length)]
    else:
        found = given_detections(path, source, score_range)
    wanted = source.frames_wanted.within(source.length or len(found))
    last = len(found) - 1 if wanted.last is None else min(wanted.last, len(found) - 1)
    for measured in progress(found[wanted.first : last + 1], "tracking", last + 1 - wanted.first):
        with times.measure("track"):
            tracker.update(measured)
    columns: dict[str, list[Any]] = {"frame": list(range(wanted.first + 1, last + 2))}
    return _shifted(tracker.tracks(), wanted.first), columns


def _extent(source: Source) -> tuple[float, float]:
    """Width and height of the images; a usual size where a sequence is text only."""
    if not source.has_images:
        return 640.0, 480.0
    height, width = next(iter(source.frames())).image.shape[:2]
    return float(width), float(height)


def _shifted(tracks: list[Track], first: int) -> list[Track]:
    from tsuiseki.tracking.trackers.run import shifted

    return [shifted(track, first) for track in tracks]
