"""People through a video: detected, described and linked, by the shipped models or by anybody's own.

`track_people` gives the tracks of a whole video, `follow_people` those of each frame while it comes. The command
`tsuiseki track people` and both calls go through `open_people`.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.options import Seed
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.contract import PeopleTracker, skipped
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.given_detections import GivenDetections
from tsuiseki.tracking.people.motion_compensated import inner_tracker
from tsuiseki.tracking.people.opening import OpenedPeople, open_people
from tsuiseki.tracking.people.people_result import people_result
from tsuiseki.tracking.people.settings import Ground, Linking, PeopleFinding, PeopleMethod, PeoplePreset
from tsuiseki.tracking.people.tracker_choice import LearntCosts
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import targets_at
from tsuiseki.tracking.video.source import SourceLike, named, open_source


class PeopleKeywords(TypedDict, total=False):
    """What `track_people` and `follow_people` take beside the source and the method.

    Where the command takes a file, networks, functions and arrays do as well. What is not listed here is as in
    `PeopleFinding` and `Linking`, the options of the command.

    Attributes:
        detections: use these instead of a detector: a file, or one entry a frame of whatever `as_detections` takes.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; ``"none"`` for none.
        affinity: exported link costs for ``flow``, or the costs themselves; ``"none"`` takes hand-set costs.
        detector_options: what the file of another project's detector leaves open.
        appearance_options: likewise for an appearance network.
        frames: only these frames, such as ``"301-400"``, counted from 1 with both ends as on the command line; all
            other numbers of frames in Python count from 0.
        frame_rate: frames a second, where the source does not say it, as images do not, or is wrong.
        progress: show on the terminal how far the run is.
        inference_frames: numbers, counted from 0, of the frames with inference of ``detections``, such as
            ``range(0, 300, 10)``; by default the stride of the detections. No person is missed in other frames.
        seed: of the tracker's random numbers.
        delay: seconds after which ``flow`` decides on a frame for good; with `follow_people` each frame comes so much
            later.
        classes: numbers or names, such as ``["person", "car"]``. Each track has its ``class_id``, and each target its
            ``detection``.
    """

    detections: GivenDetections | None
    detector: DetectorLike | None
    appearance: AppearanceLike | None
    affinity: str | Path | LearntCosts | None
    detector_options: DetectorOptions
    appearance_options: AppearanceOptions
    score_threshold: float | None
    view: str | int
    frames: str | None
    frame_rate: float | None
    progress: bool
    inference_frames: Iterable[int] | None
    moving_camera: bool
    threads: int
    device: Device
    seed: int
    delay: float | None
    preset: PeoplePreset
    ground: Ground
    classes: Sequence[int | str] | None
    across_classes: bool


def track_people(
    source: SourceLike, method: PeopleMethod | PeopleTracker = "flow", **keywords: Unpack[PeopleKeywords]
) -> Result[Track]:
    """Everyone in a video, each with an id.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images ``(H, W, 3)`` uint8 RGB in a
            list or as they come; a webcam's number or a stream's address together with ``frames``, since it does not
            end by itself.
        method: ``flow`` links the whole video at once, which is the most accurate; ``deepsort``, ``sort``,
            ``bytetrack`` and ``ocsort`` go frame by frame; or a tracker with settings of one's own, such as
            ``Sort(max_age=30)``.
        keywords: see `PeopleKeywords`.

    Returns:
        The tracks by id, whose frames count from 0 at the beginning of the video, with what is known of the run.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    shown = keywords.pop("progress", False)
    opened = _opened(source, method, **keywords)
    video = opened.inputs.source
    if video.endless:
        raise RequestError(f"{video.name} does not end by itself; give frames, or use follow_people")
    name, times = method if isinstance(method, str) else type(method).__name__, StageTimes()
    plain = {key: value for key, value in keywords.items() if isinstance(value, str | int | float | Path)}
    made = {"method": name, "source": named(source), "seed": 0, **plain}
    steps = opened.inputs.detections(times=times)
    steps = progress(steps, "tracking", video.frames_expected) if shown else steps
    result, _ = people_result(opened, steps, times, made)
    if why := result.facts.get("detections_without_track"):
        warnings.warn(why, InputWarning, stacklevel=2)
    return result


def follow_people(
    source: SourceLike, method: PeopleMethod | PeopleTracker = "sort", **keywords: Unpack[PeopleKeywords]
) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, while the video comes.

    Args:
        source: as in `track_people`; a webcam is followed until the loop ends.
        method: any, ``flow`` with a ``delay``; or a tracker that answers while it runs, also one with a delay, whose
            frames come as late as it answers.
        keywords: see `PeopleKeywords`.

    Returns:
        An iterator over all frames in order, each with its image and the people in it.

    Raises:
        RequestError: see `track_people`; or the method answers at the end only.
        RunError: the video breaks off.
    """
    shown = keywords.pop("progress", False)
    opened = _opened(source, method, **keywords)
    inputs = opened.inputs
    if not inputs.source.has_images:
        raise RequestError(f"{inputs.source.name} has no images to follow people in; use track_people")
    if not answers_while_it_runs(opened.tracker):
        raise RequestError(
            "expected a method that answers while it runs, such as sort, or flow with a `delay`, got one that decides "
            "at the end; use track_people"
        )
    shown_frames = followed(replace(inputs, batch_size=1 if inputs.source.live else inputs.batch_size), opened.tracker)
    return progress(shown_frames, "following", inputs.source.frames_expected) if shown else shown_frames


def _opened(
    source: SourceLike,
    method: Any,
    *,
    frames: str | None = None,
    frame_rate: float | None = None,
    inference_frames: Iterable[int] | None = None,
    seed: int = 0,
    **given: Any,
) -> OpenedPeople:
    """`open_people` by the keywords of a call, whose others are those of `Linking` and `PeopleFinding`."""
    if unknown := [name for name in given if name not in PeopleKeywords.__annotations__]:
        raise RequestError(f"expected the keywords of `PeopleKeywords`, got {unknown[0]!r}")
    own = {one.name for one in fields(Linking)}
    linking = Linking(method=method, **{name: value for name, value in given.items() if name in own})
    linking.check()
    Seed(seed).check()
    video = open_source(source, parse_frames(frames), frame_rate)
    finding = PeopleFinding(**{name: value for name, value in given.items() if name not in own})
    finding.check()
    return open_people(video, finding, linking, seed, inference_frames)


def answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `people.contract`."""
    inner = inner_tracker(tracker)
    if isinstance(inner, ByClass):
        return all(map(answers_while_it_runs, inner.trackers.values()))
    return inner.delay is not None if hasattr(inner, "delay") else hasattr(inner, "forget")


def followed(inputs: PeopleInputs, tracker: PeopleTracker) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, as late as the tracker answers."""
    forget = getattr(inner_tracker(tracker), "forget", None)
    waiting: deque[Frame] = deque()
    first, inferred = 0, inputs.inferred
    last = Targets.empty(0)
    for number, (frame, detections) in enumerate(inputs.with_frames()):
        first = frame.index - number
        waiting.append(frame)
        detects = inferred is None or inferred[frame.index : frame.index + 1].any()
        targets = tracker.update(detections) if detects else skipped(tracker)
        if targets is not None:
            while waiting[0].index - first < targets.frame:
                # With a delay, frames without inference are not answered by themselves.
                yield waiting[0], expected(last, waiting.popleft().index)
            last = replace(targets, frame=waiting[0].index)
            yield waiting.popleft(), last
        if forget is not None:
            forget()
    if waiting:
        tracks = tracker.tracks()
        yield from ((frame, targets_at(tracks, frame.index - first, frame.index)) for frame in waiting)


def expected(targets: Targets, frame: int) -> Targets:
    """The same people in a frame that nothing is known of."""
    people = targets.select(targets.status != "lost")
    nothing = np.column_stack([np.full(len(people), -1), people.classes])
    status = np.full(len(people), "searching")
    return replace(people, frame=frame, scores=np.zeros(len(people)), status=status, origin=nothing)
