"""Files of one camera that follow each other, tracked as one video: who is in two of them keeps the id.

The files lie where they began, by the times in their names or in a manifest; without any they follow each other without
a gap. What two files show twice is tracked in the first of them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.batch.jobs import Job
from tsuiseki.tracking.batch.segments import PLAN, Again, SegmentPlan, standing
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.formats.track_tables import table_of, tracks_of
from tsuiseki.tracking.interchange import DetectionsLike
from tsuiseki.tracking.openers.arrays import read_arrays
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.opening import OpenedPeople, open_people
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Track

# 20260131_235959, 2026-01-31T23-59-59 and the like.
WHEN = re.compile(r"(?<!\d)(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_.T ]?(\d\d)[-_.:h]?(\d\d)[-_.:m]?(\d\d)(?!\d)")
# Seconds without pictures that are all alike to whoever links people: none are as long.
LONGEST_GAP = 60.0


def start_of(job: Job) -> float | None:
    """Seconds at which a file begins: what the manifest says, or its name."""
    match = WHEN.search(job.source.rpartition("/")[2])
    if job.start is not None or match is None:
        return job.start
    try:
        return datetime(*map(int, match.groups()), tzinfo=UTC).timestamp()  # type: ignore[arg-type, misc]
    except ValueError:
        return None


def in_order(jobs: Sequence[Job]) -> list[Job]:
    """The files by their start, where it is known of all; as they stand where it is known of none.

    Raises:
        RequestError: it is known of some.
    """
    starts = {job.name: start_of(job) for job in jobs}
    unknown = [name for name, start in starts.items() if start is None]
    if len(unknown) == len(jobs):
        return [*jobs]
    if unknown:
        raise RequestError(
            f"`continuous`: expected the start of all files or of none, got none of {unknown[0]}; give a manifest with "
            "a column `start`, in seconds"
        )
    return sorted((replace(job, start=starts[job.name]) for job in jobs), key=lambda job: job.start or 0.0)


class GivenTracks:
    """A tracker whose answer is there before it begins: these tracks."""

    def __init__(self, tracks: list[Track]) -> None:
        self._tracks = tracks

    def update(self, detections: DetectionsLike) -> None:
        """Take the next frame, which changes nothing."""

    def tracks(self) -> list[Track]:
        return self._tracks


def join_files(jobs: Sequence[Job], sources: Sequence[str], states: Sequence[Path]) -> None:
    """Track files in order, which are detected, as one video, and leave the tracks of each with what is kept of it.

    Raises:
        RequestError: their rates or sizes differ, or the camera moves.
    """
    first: OpenedPeople | None = None
    camera, places, size, end, shift = StandingCamera(), list[tuple[int, int, int]](), None, 0, 0
    for job, source, state in zip(jobs, sources, states, strict=True):
        arguments, plan = job.request(source, state).arguments.arguments, SegmentPlan.read(state / PLAN)
        opened = open_people(arguments["video"].open(), arguments["finding"], arguments["linking"], 0)
        if isinstance(opened.inputs.camera, CameraPath):
            raise RequestError("`continuous`: expected a camera that stands still, got `moving_camera`")
        rate = opened.inputs.source.frame_rate
        files = sorted(state.glob("[0-9]*.npz"))
        video = Again(plan, files, opened, StageTimes())
        if first is None:
            first = opened
            if isinstance(first.tracker, FlowTracker):
                first.tracker.follow(camera)
        still = standing(plan.parts[0][0], files)
        begin = end
        if job.start is not None and jobs[0].start is not None:
            begin = round((job.start - jobs[0].start) * first.inputs.source.frame_rate) - shift
        gap = max(begin - end, 0)
        longest = round(LONGEST_GAP * rate)
        shift, begin = (shift + gap - longest, begin - gap + longest) if gap > longest else (shift, begin)
        for _ in range(begin - end):
            camera.take(False)
            first.tracker.update(Detections.empty())
        pairs = opened.inputs.in_order(((frame, video.detections) for frame in video.frames()), StageTimes())
        count = 0
        for count, (frame, detections) in enumerate(pairs, 1):
            form = frame.image.shape[:2], round(rate, 3)
            size = size or form
            if form != size:
                raise RequestError(f"{job.name}: expected frames and a rate as of {jobs[0].name}, {size}, got {form}")
            if begin + count > end:
                # The first frame of a file has nothing to be compared with.
                camera.take(still is not None and bool(still[count - 1]))
                first.tracker.update(detections)
        places.append((begin, max(begin, end), max(begin + count, end)))
        end = places[-1][2]
    assert first is not None
    tracks = first.tracker.tracks()
    for place, state in zip(places, states, strict=True):
        _write(state / "joined.npz", tracks, *place)


def _write(path: Path, tracks: Sequence[Track], begin: int, first: int, end: int) -> None:
    """Write what lies in the frames from ``first`` up to ``end``, in those of a file that begins at ``begin``."""
    parts = []
    for track in tracks:
        inside = (track.frames >= first) & (track.frames < end)
        if (inside & track.observed).any():
            rows = track.frames[inside] - begin, track.boxes[inside], track.scores[inside], track.observed[inside]
            parts.append(Track(track.id, *rows, track.origin[inside], track.names))
    table: dict[str, Any] = table_of(parts)
    with whole_file(path) as file:
        np.savez(file, **table)


def joined_tracks(path: Path) -> list[Track]:
    """The tracks of one of the files, by id."""
    return tracks_of(read_arrays(path, "tracks of a part"))
