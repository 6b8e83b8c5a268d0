"""The methods that link people, by name; and trackers around others: for a moving camera, and for several classes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import ProbabilityCost, ScoreCost
from tsuiseki.tracking.association.learnt_costs import Affinity, CostNetwork
from tsuiseki.tracking.association.video_evidence import ScoreScale
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_motion import undone
from tsuiseki.tracking.features.camera_path import CameraPath, move_boxes
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.view_choice import inner_detector, scores_are_probabilities
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.onnx import kind_of
from tsuiseki.tracking.people.bytetrack import ByteTrack
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.ocsort import OcSort
from tsuiseki.tracking.people.settings import METHODS, NONE, MethodSettings, PeopleMethod
from tsuiseki.tracking.people.sort import DeepSort, Sort
from tsuiseki.tracking.people.tracker import FirstDetections, PeopleTracker, skipped, updated
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray, Targets, Track
from tsuiseki.tracking.types.class_choice import called
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import shipped

APPEARANCE = ("flow", "deepsort")
# Methods that answer at once, from their settings and a seed.
ONLINE: Mapping[PeopleMethod, Callable[[Any, int], PeopleTracker]] = {
    "deepsort": DeepSort, "sort": Sort, "bytetrack": ByteTrack, "ocsort": OcSort,
}  # fmt: skip
# What `--affinity` takes: costs learnt on pairs, or on whole tracks.
LearntCosts = Affinity | CostNetwork
# Overlap of boxes that show one thing, and the share of a track's detections that are nearly all.
_SAME_PLACE, _NEARLY = 0.5, 0.8


def people_tracker(
    method: PeopleMethod,
    settings: MethodSettings | None = None,
    affinity: LearntCosts | None = None,
    seed: int = 0,
    source: Source | None = None,
    camera: CameraPath | StandingCamera | None = None,
    delay: float | None = None,
    scores: ScoreCost | None = None,
    drop_straddling: bool = False,
    stride: float = 1.0,
) -> PeopleTracker:
    """A fresh tracker; the flow has hand-set costs where there is no affinity.

    Args:
        method: its name.
        settings: of all methods.
        affinity: learnt costs of the flow.
        seed: of all random numbers.
        source: the video, for the flow's times and the border of its images.
        camera: gets the frames before the tracker gets their detections, where the movement of the camera matters; one
            that only tells where it stands still is for the flow.
        delay: seconds after which the flow answers a frame; None answers at the end.
        scores: what scores cost the flow where no ``affinity`` says so; None learns it from the video.
        drop_straddling: see `FlowTracker`; `straddles` says it of a detector.
        stride: frames from one inference to the next.

    Raises:
        RequestError: there is no such method, or another than the flow shall have a delay.
    """
    if delay is not None and method != "flow":
        raise RequestError(f"expected `delay` with the method flow, got it with {method}, which answers at once")
    if delay is not None and not 0 <= delay < inf:
        raise RequestError(f"expected `delay` of 0 seconds or more, got {delay:g}")
    if method not in METHODS:
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    settings = settings or MethodSettings()
    if method == "flow":
        pairs = affinity if isinstance(affinity, Affinity) else None
        changes = affinity if isinstance(affinity, CostNetwork) else None
        observation = scores if pairs is None else pairs.observation
        rate, size = (DEFAULT_FRAME_RATE, None) if source is None else (source.frame_rate, source.size)
        return FlowTracker(
            settings.flow, pairs, observation, rate, size, camera, seed, changes, delay, drop_straddling, stride
        )
    tracker = ONLINE[method](getattr(settings, method), seed)
    return MotionCompensated(tracker, camera) if isinstance(camera, CameraPath) else tracker


def cost_of_scores(detect: object) -> ProbabilityCost | None:
    """What the scores of ``detect`` cost where they are probabilities of its camera; None where that is unknown."""
    return ProbabilityCost() if scores_are_probabilities(detect) else None


def score_scale(detect: object, method: object, settings: MethodSettings, source: Source) -> ScoreScale | None:
    """What turns scores of unknown scale for an online method; None where the method takes any, or the user says more.

    Args:
        detect: networks give probabilities; functions and given detections anything.
        method: its name, or a tracker with settings of one's own.
        settings: of all methods; a `start_score` of one's own, and a method without one, take scores as they are.
        source: the video.
    """
    if method not in METHODS or method == "flow" or isinstance(inner_detector(detect), Detector | ForeignDetector):
        return None
    lives = [getattr(getattr(each, str(method)), "lifecycle", None) for each in (settings, MethodSettings())]
    start, usual = (None if life is None else life.start_score for life in lives)
    return ScoreScale(source.frame_rate, start) if start is not None and start == usual else None


def straddles(detect: object) -> bool:
    """Whether tracks of what ``detect`` finds may lie on those of others, and are no further people.

    This toolkit's detectors find one more box between two people who walk together, often enough for a track. Of the
    boxes of other detectors, and of those that are given, nothing is known: all their tracks are kept.
    """
    return isinstance(inner_detector(detect), Detector)


def people_affinity(
    method: str,
    affinity: str | Path | LearntCosts | None,
    threads: int = 0,
    *,
    known_scores: bool,
    printed: bool = False,
) -> LearntCosts | None:
    """Learnt link costs, where the method uses them.

    Args:
        method: of the tracker; only ``flow`` uses them.
        affinity: a file or the costs themselves, learnt on pairs or on whole tracks; None takes the shipped ones where
            they know the scores.
        threads: CPU threads of the network.
        known_scores: the detections come from a detector of this toolkit, whose scores the shipped costs take.
        printed: those of the thesis's flow, see `PrintedFlow`.

    Raises:
        RequestError: another method; or they ask for actions, which nothing recognises here.
    """
    if method != "flow":
        if affinity is not None:
            raise RequestError(f"expected `affinity` with the method flow only, which alone uses it, got {method}")
        return None
    if affinity is None and printed:
        affinity = shipped("affinity_printed_people")
    if affinity is None:
        affinity = shipped("affinity_people") if known_scores else NONE
    if isinstance(affinity, str | Path):
        if str(affinity) == NONE:
            return None
        learnt_on_tracks = kind_of(affinity) == "association"
        affinity = CostNetwork(affinity, threads) if learnt_on_tracks else Affinity(affinity, threads)
    if "action" in affinity.card.class_names:
        preset = "" if isinstance(affinity, CostNetwork) else " --preset printed"
        raise RequestError(
            f"expected `affinity` without actions, which nothing recognises here, got costs that ask for them; use "
            f"track drone{preset}"
        )
    return affinity


class MotionCompensated:
    """Moves detections into the first frame's pixels for ``tracker``, and its tracks back.

    So overlaps, distances and filled gaps are those of a camera that stands still; where it does, nothing changes.

    Args:
        tracker: a fresh one.
        path: gets each frame before its detections come here.
    """

    def __init__(self, tracker: PeopleTracker, path: CameraPath) -> None:
        self.tracker, self.path = tracker, path
        self._frame = 0

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets | None:
        """Take the detections of the next frame; what the tracker answers, in pixels of the frame it is about."""
        given = as_detections(detections)
        boxes = move_boxes(given.boxes, self.path.transforms[self._frame])
        self._frame += 1
        return self._returned(updated(self.tracker, replace(given, boxes=boxes), time))

    def skip(self) -> Targets | None:
        """The detector does not run on the next frame."""
        self._frame += 1
        return self._returned(skipped(self.tracker))

    def _returned(self, targets: Targets | None) -> Targets | None:
        if targets is None:
            return None
        return replace(targets, boxes=move_boxes(targets.boxes, undone(self.path.transforms[targets.frame])))

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, in pixels of their own frames."""
        back = [undone(transform) for transform in self.path.transforms]
        tracks = self.tracker.tracks()
        return [replace(t, boxes=move_boxes(t.boxes, np.stack([back[n] for n in t.frames.tolist()]))) for t in tracks]


def inner_tracker(tracker: PeopleTracker) -> PeopleTracker:
    """What links, also where the movement of the camera is taken out before."""
    return tracker.tracker if isinstance(tracker, MotionCompensated) else tracker


def without_flicker(tracks: Sequence[Track]) -> list[Track]:
    """The tracks but for those that another class has only because a detector took one thing for another now and then.

    Nearly all detections of such a track lie on a track of another class with more detections, in frames in which that
    was not detected.
    """
    if len({track.class_id for track in tracks}) < 2:
        return list(tracks)
    owner = np.repeat(np.arange(len(tracks)), [track.frames[-1] - track.frames[0] + 1 for track in tracks])
    frames, boxes, detected = (np.concatenate(column) for column in zip(*map(_without_gaps, tracks), strict=True))
    classes, counts = (
        np.array([track.class_id for track in tracks]),
        np.bincount(owner[detected], minlength=len(tracks)),
    )
    shared = np.zeros((len(tracks), len(tracks)), dtype=np.int64)
    for frame in np.unique(frames[~detected]).tolist():
        there, filled = (np.flatnonzero((frames == frame) & (detected == one)) for one in (True, False))
        i, j = np.nonzero(iou_matrix(boxes[there], boxes[filled]) >= _SAME_PLACE)
        np.add.at(shared, (owner[there[i]], owner[filled[j]]), 1)
    shared *= (classes[:, None] != classes) & (counts[:, None] < counts)
    return [
        track for track, count, most in zip(tracks, counts, shared.max(axis=1), strict=True) if most < _NEARLY * count
    ]


def _without_gaps(track: Track) -> tuple[IntArray, FloatArray, BoolArray]:
    """All frames from the first to the last, the boxes there, on straight lines in gaps, and where one was detected."""
    frames = np.arange(track.frames[0], track.frames[-1] + 1)
    boxes = np.column_stack([np.interp(frames, track.frames, side) for side in track.boxes.T])
    return frames, boxes, np.isin(frames, track.frames[track.observed])


class ByClass:
    """A tracker of its own for every class; ids are unique over all of them.

    Args:
        make: gives a fresh tracker for a class.
        wanted: the classes to track, numbers or names in small letters. Detections of others are passed over.

    Attributes:
        trackers: by class.
        first: what they were given first, by class.

    >>> from tsuiseki.tracking.people.sort import Sort
    >>> tracker = ByClass(Sort, [1, 2])
    >>> for _ in range(4):
    ...     people = tracker.update([[0, 0, 20, 50, 0.9, 1], [1, 0, 21, 50, 0.9, 2]])
    >>> people.classes, [track.class_id for track in tracker.tracks()]
    (array([1, 2]), [1, 2])
    """

    def __init__(self, make: Callable[[], PeopleTracker], wanted: Sequence[int | str]) -> None:
        self.first = {number: FirstDetections() for number in wanted}
        self.trackers = {number: make() for number in wanted}
        self._ids: dict[tuple[int | str, int], int] = {}

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets | None:
        """Take the next frame; the targets of all classes, where every class has decided on the same frame."""
        given = as_detections(detections)
        classes = given.origin[:, 1]
        every = {one: given.select(np.isin(classes, called(one, given.names))) for one in self.trackers}
        for number, one in every.items():
            self.first[number].add(one)
        return self._joined([updated(tracker, every[number], time) for number, tracker in self.trackers.items()])

    def skip(self) -> Targets | None:
        """The detector does not run on the next frame."""
        return self._joined([skipped(tracker) for tracker in self.trackers.values()])

    def _joined(self, every: Sequence[Targets | None]) -> Targets | None:
        answers = [self._renumbered(number, one) for number, one in zip(self.trackers, every, strict=True)]
        known = [answer for answer in answers if answer is not None]
        if len(known) < len(answers) or len({answer.frame for answer in known}) != 1:
            return None
        names = {number: name for answer in known for number, name in answer.names.items()}
        ids, boxes, scores, status, origin = (
            np.concatenate([getattr(answer, name) for answer in known])
            for name in ("ids", "boxes", "scores", "status", "origin")
        )
        return Targets(known[0].frame, ids, boxes, scores, status, origin, names)

    def tracks(self) -> list[Track]:
        """The tracks of all classes, by id."""
        tracks = [
            replace(track, id=self._id(number, track.id))
            for number, tracker in self.trackers.items()
            for track in tracker.tracks()
        ]
        return sorted(without_flicker(tracks), key=lambda track: track.id)

    def forget(self) -> None:
        """See `OnlineTracker`."""
        for tracker in self.trackers.values():
            inner_tracker(tracker).forget()  # type: ignore[attr-defined]

    def _renumbered(self, number: int | str, targets: Targets | None) -> Targets | None:
        if targets is None:
            return None
        return replace(targets, ids=np.array([self._id(number, one) for one in targets.ids.tolist()], dtype=np.int64))

    def _id(self, number: int | str, inner: int) -> int:
        """The id over all classes; what was reported once stays."""
        return self._ids.setdefault((number, inner), len(self._ids) + 1)
