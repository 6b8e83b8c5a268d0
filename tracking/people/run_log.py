"""Detections fed to trackers, and what happened in each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.contract import PeopleTracker, shifted, skipped
from tsuiseki.tracking.result import people_in
from tsuiseki.tracking.runs.steps import reported_to
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, FloatArray, Targets, Track
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames

# Detections that are kept for the report.
KEPT = 2000
# Side in pixels below which a box shows no person.
TINY = 2.0
# Overlap with the next detection below which online methods link nothing.
LEAST_OVERLAP = 0.2


@dataclass
class FirstDetections:
    """The first detections of a run, and how many there were.

    Attributes:
        count: of all inferences.
        first: those of the first inferences.
    """

    count: int = 0
    first: list[Detections] = field(default_factory=list)
    _stored: int = 0

    def add(self, detections: Detections) -> None:
        """Take the detections of the next inference."""
        self.count += len(detections)
        if self._stored < KEPT:
            self._stored += len(detections)
            self.first.append(Detections(detections.boxes, detections.scores))

    def line(self, used: int, tracks: int, settings: Any = None) -> str | None:
        """One line where most belong to no track; None where enough do.

        Args:
            used: detections that belong to tracks.
            tracks: how many there are.
            settings: of the tracker, which say from which score on a track starts.
        """
        if not self.count or (tracks and 2 * used >= self.count):
            return None
        return f"{self.count - used} of {self.count} detections belong to no track: {self.reason(settings)}"

    def reason(self, settings: Any = None) -> str:
        """What most of the kept detections have in common."""
        scores = np.concatenate([detections.scores for detections in self.first])
        sides = np.concatenate([detections.boxes[:, 2:] - detections.boxes[:, :2] for detections in self.first])
        least = getattr(settings, "start_score", -np.inf)
        if np.mean(scores < least) > 0.5:
            low, high = np.nanmin(scores), np.nanmax(scores)
            return f"scores are from {low:.3g} to {high:.3g}, and a track starts from {least:g} on, its start_score"
        width, height = np.median(sides, axis=0)
        if min(width, height) < TINY:
            return f"boxes are {width:.2g} x {height:.2g} pixels; expected pixels, not shares or metres"
        if sum(len(detections) > 0 for detections in self.first) < 3:
            return "they are in fewer than three frames"
        if least > -np.inf and np.median(self._overlaps()) < LEAST_OVERLAP:
            return "boxes hardly overlap those of the next frame; detect in more frames, or take the method flow"
        return "too rarely detected again"

    def _overlaps(self) -> FloatArray:
        """``(N,)`` of each box the largest overlap with the next detections."""
        pairs = [
            iou_matrix(detections.boxes, following.boxes)
            for detections, following in pairwise(self.first)
            if len(detections)
        ]
        return np.concatenate([np.zeros(1), *(overlap.max(axis=1, initial=0.0) for overlap in pairs)])


@dataclass
class FrameLog:
    """What happened in each frame, for ``run.json``.

    Attributes:
        frames: 0-based numbers.
        detections: number of detections.
        scores: mean of the detections' scores, NaN where there are none.
        first: the first detections.
    """

    frames: list[int] = field(default_factory=list)
    detections: list[int] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    first: FirstDetections = field(default_factory=FirstDetections)

    def add(self, frame: int, detections: Detections) -> None:
        """Note a frame and its detections."""
        self.frames.append(frame)
        self.detections.append(len(detections))
        scores = detections.scores[~np.isnan(detections.scores)]
        self.scores.append(float(scores.mean()) if len(scores) else float("nan"))

    def columns(self, tracks: Sequence[Track]) -> dict[str, list[Any]]:
        """One list a column: frame from 0, detections and their mean score, people tracked and their mean score."""
        return {
            "frame": list(self.frames),
            "detections": list(self.detections),
            "detection_score": [None if np.isnan(s) else round(s, 4) for s in self.scores],
            **people_in(self.frames, tracks),
        }


def run_trackers(
    frames: Iterable[tuple[int, Detections]],
    trackers: Mapping[str, PeopleTracker],
    times: StageTimes,
    inferred: InferenceFrames = ALL_INFERRED,
    observe: Callable[[Targets], object] | None = None,
) -> tuple[dict[str, list[Track]], FrameLog]:
    """Feed the same detections to every tracker.

    Args:
        frames: consecutive 0-based frame numbers, from any on, and the detections there.
        trackers: fresh ones, by name.
        times: gets the seconds of each tracker under its name.
        inferred: frames that a detector runs on.
        observe: gets what the trackers answer while they run, numbered as the frames are.

    Returns:
        The tracks of each tracker, numbered as the frames are, and what happened in each frame.
    """
    log = FrameLog()
    for index, detections in frames:
        detects = inferred.at(index)
        with reported_to(frames):
            for name, tracker in trackers.items():
                with times.measure(name):
                    targets = tracker.update(detections) if detects else skipped(tracker)
                if observe is not None and targets is not None:
                    observe(replace(targets, frame=targets.frame + (log.frames or [index])[0]))
            log.add(index, detections)
            if detects:
                log.first.add(detections)
    first = log.frames[0] if log.frames else 0
    tracks = {}
    for name, tracker in trackers.items():
        with times.measure(name):
            tracks[name] = [shifted(track, first) for track in tracker.tracks()]
    return tracks, log
