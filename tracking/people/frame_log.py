"""A run of people trackers over a video, with what there is to tell about it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.types import Detections, Track


@dataclass
class FrameLog:
    """What happened in each frame, for ``run.json``.

    Attributes:
        frames: 0-based numbers.
        detections: number of detections.
        scores: mean of the detections' scores, NaN where there are none.
    """

    frames: list[int] = field(default_factory=list)
    detections: list[int] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)

    def add(self, frame: int, found: Detections) -> None:
        """Note a frame and its detections."""
        self.frames.append(frame)
        self.detections.append(len(found))
        scores = found.scores[~np.isnan(found.scores)]
        self.scores.append(float(scores.mean()) if len(scores) else float("nan"))

    def columns(self, tracks: Sequence[Track]) -> dict[str, list[Any]]:
        """One list a column: frame from 1, detections and their mean score, people tracked and their mean score."""
        numbers = np.asarray(self.frames, dtype=np.int64)
        rows = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
        scores = np.concatenate([np.empty(0), *(track.scores for track in tracks)])
        size = int(max(numbers.max(initial=-1), rows.max(initial=-1))) + 1
        counts = np.bincount(rows, minlength=size)[numbers]
        sums = np.bincount(rows, weights=scores, minlength=size)[numbers]
        means = sums / np.maximum(counts, 1)
        return {
            "frame": (numbers + 1).tolist(),
            "detections": list(self.detections),
            "detection_score": [None if np.isnan(s) else round(s, 4) for s in self.scores],
            "people": counts.tolist(),
            "people_score": [round(m, 4) if c else None for m, c in zip(means.tolist(), counts.tolist(), strict=True)],
        }


def run_trackers(
    frames: Iterable[tuple[int, Detections]], trackers: Mapping[str, PeopleTracker], times: StageTimes
) -> tuple[dict[str, list[Track]], FrameLog]:
    """Feed the same detections to every tracker.

    Args:
        frames: consecutive 0-based frame numbers, from any on, and what was found there.
        trackers: fresh ones, by name.
        times: gets the seconds of each tracker under its name.

    Returns:
        The tracks of each tracker, numbered as the frames are, and what happened in each frame.
    """
    log = FrameLog()
    for index, found in frames:
        log.add(index, found)
        for name, tracker in trackers.items():
            with times.measure(name):
                tracker.update(found)
    first = log.frames[0] if log.frames else 0
    tracks = {}
    for name, tracker in trackers.items():
        with times.measure(name):
            tracks[name] = [shifted(track, first) for track in tracker.tracks()]
    return tracks, log


def shifted(track: Track, frames: int) -> Track:
    """``track`` as many frames later."""
    return Track(track.id, track.frames + frames, track.boxes, track.scores, track.observed) if frames else track
