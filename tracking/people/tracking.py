"""People through a video: detected, described and linked, by the shipped models or by anybody's own.

`track_people` gives the tracks of a whole video, `follow_people` those of each frame while it comes. The command
`tsuiseki track people` and both calls go through `open_people`.
"""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np

from tsuiseki.tracking.association.clutter import above_floor, score_choice
from tsuiseki.tracking.association.inference_times import stride_of
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.association.solved_network import NETWORK_FILE, SolvedNetwork, network_of_tracks
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import InputWarning, RequestError, a_path
from tsuiseki.tracking.features.camera_path import CameraPath, line_on_camera
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.view_choice import ViewedDetector, devices_of, inner_detector, knows_scores
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.interchange import BadBoxes
from tsuiseki.tracking.options import Seed
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.inputs import (
    GivenDetections,
    PeopleInputs,
    frames_with_inference,
    ground_of,
    people_describer,
    people_detect,
    threads_of_a_call,
)
from tsuiseki.tracking.people.methods import (
    APPEARANCE,
    ByClass,
    LearntCosts,
    MotionCompensated,
    cost_of_scores,
    inner_tracker,
    people_affinity,
    people_tracker,
    score_scale,
    straddles,
)
from tsuiseki.tracking.people.printed_flow import PrintedFlow
from tsuiseki.tracking.people.settings import METHODS, Ground, Linking, PeopleFinding, PeopleMethod, PeoplePreset
from tsuiseki.tracking.people.sort import DeepSort
from tsuiseki.tracking.people.tracker import FirstDetections, PeopleTracker, run_trackers, skipped
from tsuiseki.tracking.result import Result, Writer
from tsuiseki.tracking.runs.progress import progress
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame, Targets, Track
from tsuiseki.tracking.types.class_choice import called
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import targets_at
from tsuiseki.tracking.video.source import Source, SourceLike, named, open_source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR


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
    corrections: str | Path | None


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


@dataclass(frozen=True)
class OpenedPeople:
    """A video whose people can be tracked: everything is opened and checked, and no frame is read.

    Attributes:
        inputs: where frames and detections come from.
        tracker: a fresh one.
        floor: score under which given detections were left out, see `above_floor`; None for none.
        bad: counts the boxes that are none; None where networks find all, or a file is read.
        corrections: of an earlier result, which are done again; None for none.
    """

    inputs: PeopleInputs
    tracker: PeopleTracker
    floor: float | None = None
    bad: BadBoxes | None = None
    corrections: Path | None = None


def open_people(
    source: Source, finding: PeopleFinding, linking: Linking, seed: int, inferred: Iterable[int] | None = None
) -> OpenedPeople:
    """All models and files opened and checked.

    Args:
        source: the video.
        finding: the options; in Python also what `PeopleKeywords` allow instead of files.
        linking: likewise; its method may be a tracker.
        seed: of the tracker's random numbers.
        inferred: numbers from 0 of the frames with inference of given detections; by default measured.

    Raises:
        RequestError: something cannot be used; the message says what and why.
    """
    if linking.moving_camera and not source.has_images:
        raise RequestError(f"{source.name} has no images to tell how the camera moves; leave `moving_camera` out")
    if linking.corrections is not None:
        check_corrections(linking.corrections, source)
    threads = threads_of_a_call(source, finding.threads)
    floor: float | None = None
    detect, chosen = people_detect(source, finding, PEOPLE_DETECTOR, threads), finding.chosen
    bad = getattr(inner_detector(detect), "bad", None)
    if isinstance(detect, list) and linking.method == "flow" and finding.score_range is None and chosen is None:
        detect, floor = above_floor(detect, source.frame_rate)
    scale = score_scale(detect, linking.method, linking, source) if finding.score_range is None else None
    if scale is not None and isinstance(detect, list):
        detect = scale.every(detect)
    method: Any = linking.method
    compared = method in APPEARANCE if isinstance(method, str) else isinstance(method, FlowTracker | DeepSort)
    given, more = finding.appearance, finding.appearance_options
    describe = people_describer(source, compared, given, threads, more, finding.device)
    # The flow sees for itself where the camera stands still.
    camera = CameraPath() if linking.moving_camera else StandingCamera() if method == "flow" else None
    ground = ground_of(detect, finding.ground, source)
    taken = frames_with_inference(detect, source, inferred)
    unknown = finding.score_threshold is None and not source.live
    choice = score_choice(detect, ground) if unknown else None
    inputs = PeopleInputs(
        source, detect, describe, finding.batch_size, camera, finding.threads, ground, taken, choice, scale
    )
    apart = chosen is not None and not chosen.across
    fresh: Callable[[], PeopleTracker]
    if isinstance(linking.method, str):
        # The shipped costs know the scores of the shipped networks, not those of other people's detectors.
        known = knows_scores(detect)
        printed = linking.preset == "printed"
        learnt = people_affinity(linking.method, linking.affinity, finding.threads, known_scores=known, printed=printed)
        fresh = partial(_fresh_tracker, inputs, linking, learnt, seed)
    else:
        fresh = partial(_own_tracker, inputs, linking, apart)
    tracker = ByClass(fresh, chosen.plain) if chosen is not None and apart else fresh()
    return OpenedPeople(inputs, tracker, floor, bad, linking.corrections)


def _own_tracker(inputs: PeopleInputs, linking: Linking, copied: bool) -> PeopleTracker:
    """The tracker that a call has given in place of a method's name; a copy of it where each class has one."""
    method: Any = deepcopy(linking.method) if copied else linking.method
    if isinstance(method, type) or not (hasattr(method, "update") and hasattr(method, "tracks")):
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    for name in ("affinity", "delay"):
        if getattr(linking, name) is not None:
            raise RequestError(
                f"expected `{name}` with the method's name, got it beside a tracker; give it to the tracker"
            )
    return MotionCompensated(method, inputs.camera) if isinstance(inputs.camera, CameraPath) else method


def _fresh_tracker(inputs: PeopleInputs, linking: Linking, learnt: LearntCosts | None, seed: int) -> PeopleTracker:
    """A tracker by the method's name, for the detections of ``inputs``."""
    if linking.preset == "printed":
        if not isinstance(learnt, Affinity):
            raise RequestError("expected costs of pairs with the preset printed: `affinity` of train affinity")
        flow = PrintedFlow(learnt)
        return MotionCompensated(flow, inputs.camera) if isinstance(inputs.camera, CameraPath) else flow
    scores, drop = cost_of_scores(inputs.detect), straddles(inputs.detect)
    stride = 1.0 if inputs.inferred is None else stride_of(inputs.inferred)
    return people_tracker(
        linking.method, linking, learnt, seed, inputs.source, inputs.camera, linking.delay, scores, drop, stride
    )


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
    if given.get("corrections") is not None:
        given["corrections"] = a_path(given["corrections"], "corrections")
    own = {one.name for one in fields(Linking)}
    linking = Linking(method=method, **{name: value for name, value in given.items() if name in own})
    linking.check()
    Seed(seed).check()
    video = open_source(source, parse_frames(frames), frame_rate)
    finding = PeopleFinding(**{name: value for name, value in given.items() if name not in own})
    finding.check()
    return open_people(video, finding, linking, seed, inference_frames)


def people_result(
    opened: OpenedPeople, steps: Iterable[tuple[int, Detections]], times: StageTimes, settings: Mapping[str, Any]
) -> tuple[Result[Track], list[str]]:
    """The result of a run, and what of its facts is worth a line to the user.

    Args:
        opened: what runs.
        steps: 0-based frame numbers and the detections there, consecutive.
        times: of the run.
        settings: of the run; those named ``method`` and ``source`` are shown on its page.
    """
    from tsuiseki.tracking.answers.page import with_page
    from tsuiseki.tracking.report.overlay import Overlay

    video, name = opened.inputs.source, settings["method"]
    every, log = run_trackers(steps, {name: opened.tracker}, times, opened.inputs.inferred)
    tracks = every[name]
    facts, lines = facts_of(opened, 1000 * times.seconds.get("detect", 0.0) / max(len(log.frames), 1))
    network = opened.tracker.network() if isinstance(opened.tracker, FlowTracker) else None
    if network is not None and log.frames:
        network = replace(network, frames=network.frames + log.frames[0])
    tracks, files, known, more = correction_files(tracks, network, opened.corrections, video, log.frames)
    facts, lines = facts | known, lines + more
    if names := {str(n): name for track in tracks for n, name in track.names.items() if name and n == track.class_id}:
        facts["classes"] = names
    if unused := _lines_on_unused(opened, log.first, tracks):
        facts["detections_without_track"] = "; ".join(unused)

    result: Result[Track] = Result.of(
        video,
        tracks,
        settings=settings,
        facts=facts,
        seconds=times.seconds,
        frames=log.columns(tracks),
        files={
            "tracks.txt": lambda path, _: write_tracks(path, tracks),
            **files,
        },
        painter=Overlay(tracks, video.frame_rate).draw,
    )
    return with_page(result), [*lines, *unused]


def facts_of(opened: OpenedPeople, milliseconds: float) -> tuple[dict[str, Any], list[str]]:
    """Facts of a finished run by name, and which are worth a line; the detector took so many milliseconds a frame."""
    inputs, tracker = opened.inputs, opened.tracker
    facts: dict[str, Any] = {**devices_of(inputs.detect, inputs.describe)}
    lines: list[str] = []
    if opened.bad is not None and opened.bad.bad:
        facts["bad_boxes"] = opened.bad.bad
    if isinstance(tracker, FlowTracker):
        facts["flow"] = tracker.facts()
        lines += _lines_on_flow(tracker)
    elif isinstance(tracker, ByClass):
        flows = {number: one for number, one in tracker.trackers.items() if isinstance(one, FlowTracker)}
        if flows:
            facts["flow"] = {str(number): one.facts() for number, one in flows.items()}
        lines += [f"class {number}: {line}" for number, one in flows.items() for line in _lines_on_flow(one)]
    if isinstance(inputs.detect, ViewedDetector) and inputs.detect.summary:
        timed = any(choice.milliseconds is not None for choice in inputs.detect.choices.values())
        cost = "" if timed else f", about {milliseconds:.0f} ms a frame"
        facts["view"] = f"{inputs.detect.summary}{cost}"
        lines.append(f"detected in {facts['view']}; --view sets the tiles")
    if opened.floor is not None:
        facts["score_threshold"] = opened.floor
        lines.append(
            f"detections that score under {opened.floor:.2f} left out, by what moves; --score-range says others"
        )
    if inputs.scale is not None and inputs.scale.used:
        facts["scores"] = str(inputs.scale)
        lines.append(f"{inputs.scale}; --score-range takes them as they are")
    if inputs.choice is not None:
        facts["score_threshold"] = inputs.choice.threshold
        lines.append(str(inputs.choice))
    if inputs.ground is not None and inputs.ground.frames:
        facts["ground"] = inputs.ground.facts()
        if inputs.ground.used:
            lines.append(f"{inputs.ground}; --ground off leaves all scores as they are")
    return facts, lines


def _lines_on_flow(tracker: FlowTracker) -> list[str]:
    """What of the facts of a flow is worth a line."""
    lines = []
    camera = tracker.camera
    if camera.lost:
        lines.append(line_on_camera(tracker.numbers_of(camera.lost), camera.source))
    if tracker.duplicates:
        boxes = "1 box" if tracker.duplicates == 1 else f"{tracker.duplicates} boxes"
        lines.append(f"{boxes} left out that lay on another")
    return lines


def _lines_on_unused(opened: OpenedPeople, first: FirstDetections, tracks: Sequence[Track]) -> list[str]:
    """Why most detections, of each class, belong to no track."""
    tracker, lines = inner_tracker(opened.tracker), []
    groups: dict[int | str, tuple[FirstDetections, PeopleTracker]] = {-1: (first, tracker)}
    if isinstance(tracker, ByClass):
        groups = {number: (tracker.first[number], inner_tracker(one)) for number, one in tracker.trackers.items()}
    for number, (given, one) in groups.items():
        ours = [track for track in tracks if number == -1 or track.class_id in called(number, track.names)]
        line = given.line(sum(int(t.observed.sum()) for t in ours), len(ours), getattr(one, "settings", None))
        lines += [] if line is None else [line if number == -1 else f"class {number}: {line}"]
    return lines


def answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """One that may have a delay has one, or else it can forget; see `people.tracker`."""
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


def check_corrections(path: Path, source: Source) -> None:
    """Refuse corrections of another video before one is tracked, as far as it tells its size and length.

    Raises:
        RequestError: they are, or cannot be read.
    """
    from tsuiseki.tracking.review.correction_log import CorrectedVideo, read_corrections

    wanted = source.frames_wanted
    frames = wanted.last + 1 if wanted.last is not None else source.likely_length or 0
    video = CorrectedVideo(Path(source.name).name, source.size, frames)
    read_corrections(path, video, getattr(source, "slack", 0.0) if wanted.last is None else 0.0)


def correction_files(
    tracks: list[Track],
    network: SolvedNetwork | None,
    corrections: Path | None,
    source: Source,
    frames: Sequence[int],
) -> tuple[list[Track], dict[str, Writer], dict[str, Any], list[str]]:
    """Tracks under the corrections of an earlier result, and what keeps them open to more.

    Args:
        tracks: of a run.
        network: that they were chosen from; None where the method has none.
        corrections: file; None for none.
        source: the video.
        frames: numbers of those that were tracked in.

    Returns:
        The tracks, files of the result, its facts, and lines for the user.

    Raises:
        RequestError: the corrections cannot be read, or speak of another video.
    """
    files: dict[str, Writer] = {} if network is None else {NETWORK_FILE: lambda path, _: network.write(path)}
    if corrections is None:
        return tracks, files, {}, []
    from tsuiseki.tracking.review.corrected_tracks import replayed
    from tsuiseki.tracking.review.correction_log import CORRECTIONS_FILE, CorrectedVideo, append
    from tsuiseki.tracking.review.session import FILL, SOLVED_FILE

    last = max([*frames, *(int(track.frames[-1]) for track in tracks)], default=-1)
    video = CorrectedVideo(Path(source.name).name, source.size, last + 1)
    rate = source.frame_rate
    known = network_of_tracks(tracks, round(FILL * rate), rate) if network is None else network
    again = replayed(tracks, known, corrections, video)
    files |= {
        SOLVED_FILE: lambda path, _: write_tracks(path, tracks),
        CORRECTIONS_FILE: lambda path, _: append(path, again.done, video),
    }
    facts: Mapping[str, Any] = {"corrections": len(again.done), "track_names": again.names}
    every, lost = again.given, len(again.left_out)
    lines = [f"corrections: {every - lost} of {every} done again"]
    return list(again.tracks), files, dict(facts), [*lines, *(f"left out: {line}" for line in again.left_out)]
