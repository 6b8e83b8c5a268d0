"""People through a video: found, described, linked, by the shipped models or by anybody's own.

`track_people` gives the tracks of a whole video, `follow_people` those of each frame while it comes. The command
`tsuiseki track people` is made of the same parts, which lie in `finding` and `methods`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.motion.camera_path import CameraPath
from tsuiseki.tracking.features.motion.standing_camera import StandingCamera
from tsuiseki.tracking.features.networks.own_models import AppearanceLike, DetectorLike
from tsuiseki.tracking.features.view_choice import knows_scores
from tsuiseki.tracking.people.compensated import MotionCompensated
from tsuiseki.tracking.people.finding import (
    GivenDetections,
    Ground,
    PeopleInputs,
    ground_of,
    people_describer,
    people_detect,
    threads_of_a_call,
)
from tsuiseki.tracking.people.frame_log import shifted
from tsuiseki.tracking.people.methods import (
    METHODS,
    LearntCosts,
    PeopleMethod,
    camera_for,
    compares_appearance,
    cost_of_scores,
    people_affinity,
    people_tracker,
    straddling_of,
)
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import Source, open_source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped


def track_people(
    source: str | Path | int,
    method: PeopleMethod | PeopleTracker = "flow",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | LearntCosts | None = None,
    frames: str | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    seed: int = 0,
    delay: float | None = None,
    ground: Ground = "auto",
) -> list[Track]:
    """Everyone in a video, each with an id.

    Args:
        source: a video file, a folder of images, or a MOTChallenge sequence folder; a webcam's number or a stream's
            address together with ``frames``, since it does not end by itself.
        method: ``flow`` links the whole video at once, which is the most accurate; ``deepsort``, ``sort``,
            ``bytetrack`` and ``ocsort`` go frame by frame; or a tracker with settings of one's own, such as
            ``Sort(SortSettings(min_iou=0.2))``.
        detections: use these instead of a detector: a file (MOTChallenge ``det.txt``), or one entry a frame of
            whatever `as_detections` understands.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows, for ``flow`` and
            ``deepsort``; by default the shipped one; ``"none"`` does without.
        affinity: exported link costs for ``flow``; by default the shipped ones after an exported detector, hand-set
            costs otherwise; ``"none"`` takes hand-set costs always.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        moving_camera: estimate how the camera moves from its pictures and link people as if it stood still. Without it
            ``flow`` sees in them where the camera stands still, and takes the motion of the boxes elsewhere.
        threads: CPU threads of the networks; 0 takes all.
        seed: of the tracker's random numbers.
        delay: seconds after which ``flow`` decides on a frame for good, as in `follow_people`; by default it decides at
            the end.
        ground: ``auto`` lowers the scores of a network's boxes that are not as high as people on one ground are in
            their row, see `GroundPlane`; ``off`` leaves them as they are, like those of ``detections`` and functions.

    Returns:
        The tracks by id; their frames count from 0 at the beginning of the video.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    inputs, tracker = _prepared(
        source, method, detections, detector, appearance, affinity, frames, moving_camera, threads, seed, delay, ground
    )
    if inputs.source.live and inputs.source.frames_wanted.last is None:
        raise RequestError(f"{inputs.source.name} does not end by itself; give frames, or use follow_people")
    first = None
    for index, found in inputs.found():
        first = index if first is None else first
        tracker.update(found)
    return [shifted(track, first or 0) for track in tracker.tracks()]


def follow_people(
    source: str | Path | int,
    method: PeopleMethod | PeopleTracker = "sort",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | LearntCosts | None = None,
    frames: str | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    seed: int = 0,
    delay: float | None = None,
    ground: Ground = "auto",
) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, while the video comes.

    Args:
        source: as in `track_people`; a webcam is followed until the loop ends.
        method: any, ``flow`` with a ``delay``; or a tracker that answers while it runs, also one with a delay, whose
            frames come as late as it answers.
        detections, detector, appearance, affinity, frames, moving_camera, threads, seed, ground: see `track_people`.
        delay: seconds after which ``flow`` answers a frame for good; each frame comes so much later.

    Returns:
        An iterator over all frames in order, each with its image and the people in it.

    Raises:
        RequestError: see `track_people`; or the method answers at the end only.
        RunError: the video breaks off.
    """
    inputs, tracker = _prepared(
        source, method, detections, detector, appearance, affinity, frames, moving_camera, threads, seed, delay, ground
    )
    if not inputs.source.has_images:
        raise RequestError(f"{inputs.source.name} has no images to follow people in; use track_people")
    if not _answers_while_it_runs(tracker):
        raise RequestError(
            "expected a method that answers while it runs, such as sort, or flow with a `delay`, got one that decides "
            "at the end; use track_people"
        )
    batch_size = 1 if inputs.source.live else inputs.batch_size
    return _followed(replace(inputs, batch_size=batch_size), tracker)


def _prepared(
    source: str | Path | int,
    method: PeopleMethod | PeopleTracker,
    detections: GivenDetections | None,
    detector: DetectorLike | None,
    appearance: AppearanceLike | None,
    affinity: str | Path | LearntCosts | None,
    frames: str | None,
    moving_camera: bool,
    threads: int,
    seed: int,
    delay: float | None,
    ground: Ground,
) -> tuple[PeopleInputs, PeopleTracker]:
    """Everything opened and checked before the first frame is read."""
    opened = open_source(str(source), parse_frames(frames))
    call = threads_of_a_call(opened, threads)
    detect = people_detect(opened, detections, detector, shipped(PEOPLE_DETECTOR), threads=call)
    camera = camera_for(method, moving=moving_camera)
    tracker = _tracker(method, affinity, detect, threads, seed, opened, camera, delay)
    inputs = PeopleInputs(
        opened,
        detect,
        people_describer(opened, compares_appearance(method), appearance, call),
        camera=camera,
        threads=threads,
        ground=ground_of(detect, ground, opened),
    )
    if moving_camera and not opened.has_images:
        raise RequestError(f"{opened.name} has no images to tell how the camera moves")
    return inputs, tracker


def _tracker(
    method: PeopleMethod | PeopleTracker,
    affinity: str | Path | LearntCosts | None,
    detect: object,
    threads: int,
    seed: int,
    source: Source,
    camera: CameraPath | StandingCamera | None,
    delay: float | None,
) -> PeopleTracker:
    if isinstance(method, str):
        # The shipped costs know the scores of the shipped networks, not those of other people's detectors.
        learnt = people_affinity(method, affinity, threads, known_scores=knows_scores(detect))
        scores, straddling = cost_of_scores(detect), straddling_of(detect)
        return people_tracker(method, None, learnt, seed, source, camera, delay, scores, straddling)
    if not (hasattr(method, "update") and hasattr(method, "tracks")):
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    if affinity is not None:
        raise RequestError(
            "expected `affinity` with the method's name, got it beside a tracker; give it to the tracker"
        )
    if delay is not None:
        raise RequestError("expected `delay` with the method's name, got it beside a tracker; give it to the tracker")
    return MotionCompensated(method, camera) if isinstance(camera, CameraPath) else method


def _answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `trackers.base`."""
    inner = _inner(tracker)
    return inner.delay is not None if hasattr(inner, "delay") else hasattr(inner, "forget")


def _inner(tracker: PeopleTracker) -> PeopleTracker:
    return tracker.tracker if isinstance(tracker, MotionCompensated) else tracker


def _followed(inputs: PeopleInputs, tracker: PeopleTracker) -> Iterator[tuple[Frame, Targets]]:
    forget = getattr(_inner(tracker), "forget", None)
    waiting: deque[Frame] = deque()
    first = 0
    for number, (frame, found) in enumerate(inputs.looked_at()):
        first = frame.index - number
        waiting.append(frame)
        targets = tracker.update(found)
        if targets is not None:
            answered = waiting.popleft()
            yield answered, replace(targets, frame=answered.index)
        if forget is not None:
            forget()
    if waiting:
        tracks = tracker.tracks()
        yield from ((frame, targets_at(tracks, frame.index - first, frame.index)) for frame in waiting)


def targets_at(tracks: Iterable[Track], frame: int, number: int | None = None) -> Targets:
    """The targets of the 0-based ``frame``, out of finished tracks; ``number`` is another name of that frame."""
    rows = [(track, int(row)) for track in tracks for row in np.flatnonzero(track.frames == frame)]
    return Targets(
        frame if number is None else number,
        np.array([track.id for track, _ in rows], dtype=np.int64),
        np.array([track.boxes[row] for track, row in rows]).reshape(-1, 4),
        np.array([track.scores[row] if track.observed[row] else 0.0 for track, row in rows], dtype=np.float64),
        np.array(["tracking" if track.observed[row] else "searching" for track, row in rows], dtype="U9"),
    )
