"""`tsuiseki track blobs`: several targets that are coloured regions or measured points."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from tsuiseki.tracking.cli.options import SeededOutput, Video
from tsuiseki.tracking.cli.run import count, frames_expected
from tsuiseki.tracking.points.blob_choice import BlobChoice


def blobs(video: Video, output: SeededOutput, choice: BlobChoice) -> int:
    """Track every object of a colour, or every measured point or box, each with an id.

    Give one of --colour, --colour-box and --detections. DIR gets tracks.txt (MOTChallenge text), points.csv, run.json
    and, with --overlay, overlay.webm.

    Args:
        seed: of the particles.
    """
    from tsuiseki.tracking.formats.mot import write_tracks
    from tsuiseki.tracking.formats.sensed_points import write_point_tracks
    from tsuiseki.tracking.points.tracking import blob_result, said_of_counts
    from tsuiseki.tracking.report.overlay import write_overlay

    source = video.open(images=choice.detections is None)
    tracker, measured = choice.opened(source, output.seed)
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
        run.done("\n".join([summary, *said_of_counts(run.columns.get("expected_count"), choice.preset)]))
    return run.status
