"""The contract of trackers, on one page.

A tracker of many is fed the detections of one frame after the other, frames without any included:

* ``tracker = Method(settings, seed=0)``. Settings are one frozen dataclass with defaults. All random numbers come
  from ``numpy.random.default_rng(seed)``; a method that draws none takes ``seed`` all the same, so that methods can be
  exchanged. The same input and seed give the same tracks.
* ``update(detections)`` takes the next frame. What it takes is whatever `as_detections` understands, and is never
  written to. An `OnlineTracker` answers with the `Targets` of this very frame, in time that does not grow with the
  length of the video. A tracker with a delay of d frames answers with those of the frame d before, and with None as
  long as there is none, in time and memory that do not grow either; its answers are final. One that decides at the end
  always answers None.
* ``tracks()`` gives the tracks of all frames so far, as they are if the video ends here. It may be asked at any time
  and changes nothing. Of a tracker with a delay it repeats what was answered, and adds the frames that were not.
* ``update(detections, time=seconds)`` also takes the time of the frame, with every frame or with none. Filters then
  step by it: frames may be dropped, and rates change. What counts in frames, such as an age, counts calls.
* ``skip()`` takes a frame without inference, so that no person is missed in it.

Frames count from 0, the first ``update`` or ``skip``. IDs count from 1, live in the tracker, and are never given
twice: two trackers in one process share nothing. An id that was answered stays that target's id, also in ``tracks()``.

What the status of a target says:

* ``tracking``: something in this frame supports its box, a detection or the image.
* ``searching``: nothing does; its box is where it is expected, and its score is 0.
* ``lost``: it is given up in this frame, and its id does not come back. A target that ends is not always announced.

A target is reported from the frame on in which its tracker confirms it. The ``tracks()`` of an online tracker may
begin earlier, with the detections before that.

`run_trackers` feeds a video to one or several of them and logs each frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Targets, Track


class PeopleTracker(Protocol):
    """Turns the detections of a video into tracks."""

    def update(self, detections: DetectionsLike) -> Targets | None:
        """Take the next frame; the targets of a frame, where one is decided."""

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id."""


class OnlineTracker(PeopleTracker, Protocol):
    """A tracker that answers at once."""

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the next frame; its targets."""

    def skip(self) -> Targets:
        """The detector does not run on the next frame; where its targets are expected."""

    def forget(self) -> None:
        """Drop what is kept for ``tracks()``, which then begins with the next frame that is answered; ids go on.

        A run without end needs this: a tracker that is online or has a delay holds nothing else that grows with the
        video.
        """


# Detections that are kept for the report.
KEPT = 2000
# Pixels below which a box shows no person; and overlap with the next detection below which online methods link nothing.
TINY, LEAST_OVERLAP = 2.0, 0.2


@dataclass
class FirstDetections:
    """The first detections of a run, and how many there were.

    Attributes:
        count: of all inferences.
        first: those of the first inferences.
    """

    count: int = 0
    first: list[Detections] = field(default_factory=list)
    _kept: int = 0

    def add(self, detections: Detections) -> None:
        """Take the detections of the next inference."""
        self.count += len(detections)
        if self._kept < KEPT:
            self._kept += len(detections)
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
        scores = np.concatenate([each.scores for each in self.first])
        sides = np.concatenate([each.boxes[:, 2:] - each.boxes[:, :2] for each in self.first])
        least = getattr(getattr(settings, "lifecycle", None), "start_score", -np.inf)
        if np.mean(scores < least) > 0.5:
            low, high = np.nanmin(scores), np.nanmax(scores)
            return f"scores are from {low:.3g} to {high:.3g}, and a track starts from {least:g} on, its start_score"
        width, height = np.median(sides, axis=0)
        if min(width, height) < TINY:
            return f"boxes are {width:.2g} x {height:.2g} pixels; expected pixels, not shares or metres"
        if sum(len(each) > 0 for each in self.first) < 3:
            return "they are in fewer than three frames"
        if least > -np.inf and np.median(self._overlaps()) < LEAST_OVERLAP:
            return "boxes hardly overlap those of the next frame; detect in more frames, or take the method flow"
        return "too rarely detected again"

    def _overlaps(self) -> FloatArray:
        """``(N,)`` of each box the largest overlap with the next detections."""
        pairs = [iou_matrix(one.boxes, other.boxes) for one, other in pairwise(self.first) if len(one)]
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
        numbers = np.asarray(self.frames, dtype=np.int64)
        rows = np.concatenate([np.empty(0, np.int64), *(track.frames for track in tracks)])
        scores = np.concatenate([np.empty(0), *(track.scores for track in tracks)])
        size = int(max(numbers.max(initial=-1), rows.max(initial=-1))) + 1
        counts = np.bincount(rows, minlength=size)[numbers]
        sums = np.bincount(rows, weights=scores, minlength=size)[numbers]
        means = sums / np.maximum(counts, 1)
        return {
            "frame": numbers.tolist(),
            "detections": list(self.detections),
            "detection_score": [None if np.isnan(s) else round(s, 4) for s in self.scores],
            "people": counts.tolist(),
            "people_score": [round(m, 4) if c else None for m, c in zip(means.tolist(), counts.tolist(), strict=True)],
        }


def run_trackers(
    frames: Iterable[tuple[int, Detections]],
    trackers: Mapping[str, PeopleTracker],
    times: StageTimes,
    inferred: BoolArray | None = None,
) -> tuple[dict[str, list[Track]], FrameLog]:
    """Feed the same detections to every tracker.

    Args:
        frames: consecutive 0-based frame numbers, from any on, and the detections there.
        trackers: fresh ones, by name.
        times: gets the seconds of each tracker under its name.
        inferred: ``(F,)`` by frame number, where a detector was run; None for everywhere.

    Returns:
        The tracks of each tracker, numbered as the frames are, and what happened in each frame.
    """
    log = FrameLog()
    for index, detections in frames:
        log.add(index, detections)
        detects = inferred is None or inferred[index : index + 1].any()
        if detects:
            log.first.add(detections)
        for name, tracker in trackers.items():
            with times.measure(name):
                if detects:
                    tracker.update(detections)
                else:
                    skipped(tracker)
    first = log.frames[0] if log.frames else 0
    tracks = {}
    for name, tracker in trackers.items():
        with times.measure(name):
            tracks[name] = [shifted(track, first) for track in tracker.tracks()]
    return tracks, log


def updated(tracker: PeopleTracker, detections: Detections, time: float | None) -> Targets | None:
    """Feed a tracker, which need not know of times where there are none."""
    return tracker.update(detections) if time is None else tracker.update(detections, time=time)  # type: ignore[call-arg]


def skipped(tracker: PeopleTracker) -> Targets | None:
    """Tell a tracker that the detector does not run on the next frame; one without `skip` takes it as empty."""
    skip = getattr(tracker, "skip", None)
    answer: Targets | None = tracker.update(Detections.empty()) if skip is None else skip()
    return answer


def shifted(track: Track, frames: int) -> Track:
    """``track`` as many frames later."""
    return replace(track, frames=track.frames + frames) if frames else track


def run_tracker(detections: Iterable[DetectionsLike], tracker: PeopleTracker) -> list[Track]:
    """The tracks of a whole video.

    Args:
        detections: of each frame in order, frames without any included.
        tracker: it goes on from its earlier frames.
    """
    for given in detections:
        tracker.update(given)
    return tracker.tracks()
