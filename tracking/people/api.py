"""People through a video: detected, described and linked, by the shipped models or by anybody's own.

`track_people` gives the tracks of a whole video, `follow_people` those of each frame while it comes. The command
`tsuiseki track people` and both calls go through `open_people`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.features.gallery import Gallery
from tsuiseki.tracking.fields import refused
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.following import check_followed, followed
from tsuiseki.tracking.people.given_detections import GivenDetections
from tsuiseki.tracking.people.opening import OpenedPeople, compares_appearance, open_people
from tsuiseki.tracking.people.people_result import people_result
from tsuiseki.tracking.people.recogniser import Recogniser
from tsuiseki.tracking.people.settings import Ground, Linking, PeopleFinding, PeopleMethod, PeoplePreset
from tsuiseki.tracking.people.several import people_in_sources
from tsuiseki.tracking.people.tracker_choice import LearntCosts
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.runs.options import Seed
from tsuiseki.tracking.runs.progress import progress as watched
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Frame, Targets, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.live import PeopleInFrame
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.several import SeveralSources, open_several
from tsuiseki.tracking.video.source import SourceLike, named, open_source


def track_people(
    source: SourceLike,
    method: PeopleMethod | PeopleTracker = "flow",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | LearntCosts | None = None,
    detector_options: DetectorOptions | None = None,
    appearance_options: AppearanceOptions | None = None,
    score_threshold: float | None = None,
    view: str | int = "auto",
    frames: str | None = None,
    frame_rate: float | None = None,
    inference_frames: Iterable[int] | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    device: Device = "auto",
    delay: float | None = None,
    preset: PeoplePreset = "default",
    ground: Ground = "auto",
    classes: Sequence[int | str] | None = None,
    across_classes: bool = False,
    second_opinion: DetectorLike | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Result[Track]:
    """Everyone in a video, each with an id.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images ``(H, W, 3)`` uint8 RGB in a
            list or as they come; a webcam's number or a stream's address together with ``frames``, since it does not
            end by itself.
        method: ``flow`` links the whole video at once, which is the most accurate; ``deepsort``, ``sort``,
            ``bytetrack`` and ``ocsort`` go frame by frame; or a tracker with settings of one's own, such as
            ``Sort(max_age=30)``.
        detections: use these instead of a detector: a file, or one entry a frame of whatever `as_detections` takes.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; by default the
            shipped one, ``"none"`` for none.
        affinity: exported link costs for ``flow``, or the costs themselves; ``"none"`` takes hand-set costs.
        detector_options: what the file of another project's detector leaves open.
        appearance_options: likewise for an appearance network.
        score_threshold: least score of a detection, from 0 to 1; by default 0.3, none for ``detections`` and
            functions, and for another project's network what the beginning of the video tells.
        view: overlapping tiles of a frame for the detector: ``"auto"``, as many as detect more people; tiles across
            such as 2; across and down such as ``"3x2"``.
        frames: only these frames, such as ``"301-400"``, counted from 1 with both ends as on the command line; all
            other numbers of frames in Python count from 0.
        frame_rate: frames a second, where the source does not say it, as images do not, or is wrong.
        inference_frames: numbers, counted from 0, of the frames that a detector runs on, such as
            ``range(0, 300, 10)``; by default all, or the stride of ``detections``. Nobody is missed in others.
        moving_camera: estimate how the camera moves and link people as if it stood still; ``flow`` needs it rarely.
        threads: CPU cores of the networks; 0 takes all.
        device: what the networks run on: ``"cpu"``, ``"cuda"``, or ``"auto"``.
        delay: seconds after which ``flow`` decides on a frame for good.
        preset: ``"printed"`` makes of ``flow`` the thesis's, see `PrintedFlow`.
        ground: ``"auto"`` lowers the scores of boxes that are not as high as people on one ground; ``"off"`` none.
        classes: numbers or names, such as ``["person", "car"]``. Each track has its ``class_id``, and each target its
            ``detection``.
        across_classes: one track may go through several ``classes``; by default each is tracked apart.
        second_opinion: another detector, whose boxes are put together with those of the first.
        seed: of the tracker's random numbers.
        progress: show on the terminal how far the run is.

    Returns:
        The tracks by id, whose frames count from 0 at the beginning of the video, with what is known of the run.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    keywords = locals()
    opened = _opened(keywords)
    video = opened.inputs.source
    if video.endless:
        raise RequestError(f"{video.name} does not end by itself; give frames, or use follow_people")
    times = StageTimes()
    steps = opened.inputs.detections(times=times)
    steps = watched(steps, "tracking", video.frames_expected) if progress else steps
    result, _ = people_result(opened, steps, times, _recorded(keywords))
    if why := result.facts.get("detections_without_track"):
        warnings.warn(why, InputWarning, stacklevel=2)
    return result


def follow_people(
    source: SourceLike | Sequence[str | Path | int],
    method: PeopleMethod | PeopleTracker = "sort",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | LearntCosts | None = None,
    detector_options: DetectorOptions | None = None,
    appearance_options: AppearanceOptions | None = None,
    score_threshold: float | None = None,
    view: str | int = "auto",
    frames: str | None = None,
    frame_rate: float | None = None,
    inference_frames: Iterable[int] | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    device: Device = "auto",
    delay: float | None = None,
    preset: PeoplePreset = "default",
    ground: Ground = "auto",
    classes: Sequence[int | str] | None = None,
    across_classes: bool = False,
    second_opinion: DetectorLike | None = None,
    gallery: str | Path | Gallery | None = None,
    seed: int = 0,
    progress: bool = False,
) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, while the video comes.

    Args:
        source: as in `track_people`; a webcam is followed until the loop ends. Or a list of several files, webcams or
            streams: each has a tracker of its own, and the frames say their ``camera``.
        method: any, ``flow`` with a ``delay``; or a tracker that answers while it runs, also one with a delay, whose
            frames come as late as it answers.
        detections: use these instead of a detector: a file, or one entry a frame of whatever `as_detections` takes.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; by default the
            shipped one, ``"none"`` for none.
        affinity: exported link costs for ``flow``, or the costs themselves; ``"none"`` takes hand-set costs.
        detector_options: what the file of another project's detector leaves open.
        appearance_options: likewise for an appearance network.
        score_threshold: least score of a detection, from 0 to 1; by default 0.3, none for ``detections`` and
            functions, and for another project's network what the beginning of the video tells.
        view: overlapping tiles of a frame for the detector: ``"auto"``, as many as detect more people; tiles across
            such as 2; across and down such as ``"3x2"``.
        frames: only these frames, such as ``"301-400"``, counted from 1 with both ends as on the command line; all
            other numbers of frames in Python count from 0.
        frame_rate: frames a second, where the source does not say it, as images do not, or is wrong.
        inference_frames: numbers, counted from 0, of the frames that a detector runs on, such as
            ``range(0, 300, 10)``; by default all, or the stride of ``detections``. Nobody is missed in others.
        moving_camera: estimate how the camera moves and link people as if it stood still; ``flow`` needs it rarely.
        threads: CPU cores of the networks; 0 takes all.
        device: what the networks run on: ``"cpu"``, ``"cuda"``, or ``"auto"``.
        delay: seconds after which ``flow`` decides on a frame for good; each frame comes so much later.
        preset: ``"printed"`` makes of ``flow`` the thesis's, see `PrintedFlow`.
        ground: ``"auto"`` lowers the scores of boxes that are not as high as people on one ground; ``"off"`` none.
        classes: numbers or names, such as ``["person", "car"]``. Each track has its ``class_id``, and each target its
            ``detection``.
        across_classes: one track may go through several ``classes``; by default each is tracked apart.
        second_opinion: another detector, whose boxes are put together with those of the first.
        gallery: people to recognise, as `tsuiseki gallery` keeps them: each target has its ``identity``.
        seed: of the tracker's random numbers.
        progress: show on the terminal how far the run is.

    Returns:
        An iterator over all frames in order, each with its image and the people in it.

    Raises:
        RequestError: as of `track_people`; or the method answers at the end only.
        RunError: the video breaks off.
    """
    keywords = locals()
    if gallery is not None and not compares_appearance(method):
        # It is for the gallery alone.
        keywords["appearance"] = None
    if isinstance(source, list | tuple) and source and all(isinstance(one, str | Path | int) for one in source):
        return _several(source, keywords, gallery, appearance)
    recogniser = None if gallery is None else Recogniser(gallery, appearance)
    opened = _opened(keywords)
    inputs = opened.inputs
    check_followed(opened)
    people = followed(replace(inputs, batch_size=1 if inputs.source.live else inputs.batch_size), opened.tracker)
    if recogniser is not None:
        people = recogniser.recognised(people)
    return watched(people, "following", inputs.source.frames_expected) if progress else people


def _several(
    sources: Sequence[str | Path | int],
    keywords: Mapping[str, Any],
    gallery: str | Path | Gallery | None,
    appearance: AppearanceLike | None,
) -> Iterator[tuple[Frame, Targets]]:
    """`follow_people` of several sources, opened and checked at the call."""
    for name in ("detections", "inference_frames"):
        if keywords[name] is not None:
            raise RequestError(f"`{name}`: expected it with one source, got it with {len(sources)}; leave it out")
    videos = open_several(sources, parse_frames(keywords["frames"]), keywords["frame_rate"])
    opened = [_opened(keywords, video) for video in videos]
    for people in opened:
        check_followed(people)
    events = people_in_sources(opened, SeveralSources(videos))
    steps: Iterator[tuple[Frame, Targets]] = (
        (event.frame, event.people) for event in events if isinstance(event, PeopleInFrame)
    )
    if gallery is not None:
        steps = Recogniser(gallery, appearance).recognised(steps)
    return watched(steps, "following", None) if keywords["progress"] else steps


def _opened(keywords: Mapping[str, Any], video: Source | None = None) -> OpenedPeople:
    """`open_people` by the arguments of a call, most of which are those of `Linking` and `PeopleFinding`."""
    there = {name: value for name, value in keywords.items() if value is not None}
    with refused():
        linking = Linking(**{option.name: there[option.name] for option in fields(Linking) if option.name in there})
        options = [option.name for option in fields(PeopleFinding) if option.name in there]
        finding = PeopleFinding(**{name: there[name] for name in options})
        Seed(seed=keywords["seed"])
    if video is None:
        video = open_source(keywords["source"], parse_frames(keywords["frames"]), keywords["frame_rate"])
    return open_people(video, finding, linking, keywords["seed"], keywords["inference_frames"])


def _recorded(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """What ``run.json`` keeps of a call: the source, the method, the seed, and what is plain and not as usual."""
    usual = {option.name: option.default for kind in (Linking, PeopleFinding) for option in fields(kind)}
    plain = {
        name: value
        for name, value in keywords.items()
        if name in {*usual, "frames", "frame_rate"} and isinstance(value, str | int | float | Path)
        if value != usual.get(name)
    }
    method = keywords["method"]
    method_name = method if isinstance(method, str) else type(method).__name__
    return {"source": named(keywords["source"]), "seed": keywords["seed"], **plain, "method": method_name}
