"""People through a video: found, described, linked, by the shipped models or by anybody's own.

`track_people` gives the tracks of a whole video, `follow_people` those of each frame while it comes. The command
`tsuiseki track people` is made of the same parts: `PeopleInputs`, `people_inputs` and `people_tracker`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeAlias, get_args

import numpy as np

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_motion import CameraPath
from tsuiseki.tracking.features.networks import Describe, Detect, Detector, stream
from tsuiseki.tracking.features.own_models import AppearanceLike, DetectorLike, as_describer, as_detector
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.base import PeopleTracker
from tsuiseki.tracking.trackers.compensated import MotionCompensated
from tsuiseki.tracking.trackers.deepsort import DeepSort
from tsuiseki.tracking.trackers.flow import FlowTracker
from tsuiseki.tracking.trackers.run import shifted
from tsuiseki.tracking.trackers.sort import Sort
from tsuiseki.tracking.types import Detections, Frame, Targets, Track
from tsuiseki.tracking.video import Source, VideoFile, open_source
from tsuiseki.tracking.weights import shipped

Method = Literal["flow", "deepsort", "sort"]
METHODS: tuple[Method, ...] = get_args(Method)
GivenDetections: TypeAlias = str | Path | Sequence[DetectionsLike]
NONE = "none"


def track_people(
    source: str | Path | int,
    method: Method | PeopleTracker = "flow",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | Affinity | None = None,
    frames: str | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    seed: int = 0,
) -> list[Track]:
    """Everyone in a video, each with an id.

    Args:
        source: a video file, a folder of images, or a MOTChallenge sequence folder; a webcam's number or a stream's
            address together with ``frames``, since it does not end by itself.
        method: ``flow`` links the whole video at once, which is the most accurate; ``deepsort`` and ``sort`` go frame
            by frame; or a tracker of one's own making, such as ``Sort(SortSettings(min_iou=0.2))``.
        detections: use these instead of a detector: a file (MOTChallenge ``det.txt``), or one entry a frame of
            whatever `as_detections` understands.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows, for ``flow`` and
            ``deepsort``; by default the shipped one; ``"none"`` does without.
        affinity: exported link costs for ``flow``; by default the shipped ones after the shipped detector, hand-set
            costs otherwise; ``"none"`` takes hand-set costs always.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        moving_camera: estimate how the camera moves and link people as if it stood still.
        threads: CPU threads of the networks; 0 takes all.
        seed: of the tracker's random numbers.

    Returns:
        The tracks by id; their frames count from 0 at the beginning of the video.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    inputs, tracker = _prepared(
        source, method, detections, detector, appearance, affinity, frames, moving_camera, threads, seed
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
    method: Method | PeopleTracker = "sort",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    affinity: str | Path | Affinity | None = None,
    frames: str | None = None,
    moving_camera: bool = False,
    threads: int = 0,
    seed: int = 0,
) -> Iterator[tuple[Frame, Targets]]:
    """Each frame with the people in it, while the video comes.

    Args:
        source: as in `track_people`; a webcam is followed until the loop ends.
        method: ``sort``, ``deepsort``, or a tracker that answers while it runs, also one with a delay, whose frames
            come as late as it answers.
        detections: see `track_people`, as for all that follow.
        detector: …
        appearance: …
        affinity: …
        frames: …
        moving_camera: …
        threads: …
        seed: …

    Returns:
        An iterator over all frames in order, each with its image and the people in it.

    Raises:
        RequestError: see `track_people`; or the method answers at the end only.
        RunError: the video breaks off.
    """
    inputs, tracker = _prepared(
        source, method, detections, detector, appearance, affinity, frames, moving_camera, threads, seed
    )
    if not inputs.source.has_images:
        raise RequestError(f"{inputs.source.name} has no images to follow people in; use track_people")
    if not _answers_while_it_runs(tracker):
        raise RequestError(
            "expected a method that answers while it runs, sort or deepsort, got one that decides at the end; "
            "use track_people"
        )
    batch_size = 1 if inputs.source.live else inputs.batch_size
    return _followed(replace(inputs, batch_size=batch_size), tracker)


@dataclass(frozen=True)
class PeopleInputs:
    """Where frames, detections and features come from.

    Attributes:
        source: the video.
        detect: a detector, or the detections of each frame.
        describe: an appearance model, if the method compares appearance.
        batch_size: frames of one call of the detector.
        camera: gets the frames, where the movement of the camera matters.
    """

    source: Source
    detect: Detect | Sequence[Detections]
    describe: Describe | None = None
    batch_size: int = 4
    camera: CameraPath | None = None

    @property
    def needs_images(self) -> bool:
        """Whether the frames themselves must be decoded."""
        looked_at = self.describe is not None or self.camera is not None or not isinstance(self.detect, Sequence)
        return looked_at or self.source.length is None

    def found(
        self, frames: Iterable[Frame] | None = None, times: StageTimes | None = None
    ) -> Iterator[tuple[int, Detections]]:
        """Frame numbers with who was found there; frames are decoded only where somebody looks at them.

        Args:
            frames: of the source, where somebody watches them; by default they are read.
            times: gets the seconds of each stage.

        Raises:
            RequestError: there are detections for frames that the video does not have.
            RunError: the video breaks off.
        """
        if self.needs_images:
            yield from ((frame.index, found) for frame, found in self.looked_at(frames, times))
            return
        assert isinstance(self.detect, Sequence)
        assert self.source.length is not None
        wanted = self.source.frames_wanted.within(self.source.length)
        assert wanted.last is not None
        for index in range(wanted.first, wanted.last + 1):
            yield index, self.detect[index] if index < len(self.detect) else Detections.empty()

    def looked_at(
        self, frames: Iterable[Frame] | None = None, times: StageTimes | None = None
    ) -> Iterator[tuple[Frame, Detections]]:
        """The frames themselves with who was found there; see `found`."""
        times, last = times or StageTimes(), -1
        images = self.source.frames() if frames is None else frames
        for frame, found in stream(images, self.detect, self.describe, self.batch_size, times):
            last = frame.index
            if self.camera is not None:
                with times.measure("camera"):
                    self.camera.add(frame.image, found.boxes)
            yield frame, found
        self._check_all_used(last)

    def _check_all_used(self, last: int) -> None:
        if not isinstance(self.detect, Sequence) or self.source.frames_wanted.last is not None:
            return
        if self.source.length is None and len(self.detect) > last + 1:
            raise RequestError(
                f"detection for frame {len(self.detect)}, but {self.source.name} has {last + 1} frames; "
                "are these the detections of another video?"
            )


def given_detections(
    given: GivenDetections, source: Source, score_range: tuple[float, float] = (0.0, 1.0)
) -> list[Detections]:
    """Detections that are there already, checked against the length of the video as far as it is known.

    Args:
        given: a file (MOTChallenge ``det.txt``), or one entry a frame.
        source: the video.
        score_range: smallest and largest score that the rows of a file may have.

    Raises:
        RequestError: see `read_detections` and `as_detections`; or the video is shorter.
    """
    if not isinstance(given, str | Path):
        if source.length is not None and len(given) > source.length:
            raise RequestError(
                f"expected detections for {source.length} frames, one entry a frame, got {len(given)}; are these the "
                "detections of another video?"
            )
        return [as_detections(entry) for entry in given]
    path = Path(given)
    found = read_detections(path, source.length, score_range)
    # The header of a video file only estimates its length; what it misses shows when the video has ended.
    if isinstance(source, VideoFile) and source.promised and len(found) > source.promised + source.slack:
        read_detections(path, source.promised, score_range)
    return found


def people_detect(
    source: Source,
    detections: GivenDetections | None,
    detector: DetectorLike | None,
    default: Path,
    score_threshold: float = 0.3,
    score_range: tuple[float, float] = (0.0, 1.0),
    threads: int = 0,
) -> Detect | list[Detections]:
    """The given detections, or what finds people.

    Args:
        source: the video.
        detections: see `given_detections`.
        detector: see `as_detector`.
        default: file of the detector where neither is given.
        score_threshold: of a detector that is read from a file.
        score_range: of detections that are read from a file.
        threads: CPU threads of a detector that is read from a file.

    Raises:
        RequestError: both are given, or the source has no images to find people in.
    """
    if detections is not None:
        if detector is not None:
            raise RequestError("expected `detections` or `detector`, got both; leave one out")
        return given_detections(detections, source, score_range)
    if not source.has_images:
        raise RequestError(f"{source.name} has no images to find people in; give `detections`")
    return as_detector(default if detector is None else detector, score_threshold, threads)


def people_describer(
    source: Source, compared: bool, appearance: AppearanceLike | None, threads: int = 0
) -> Describe | None:
    """What describes appearance, where it is compared and there are images.

    Args:
        source: the video.
        compared: the method compares appearance; see `compares_appearance`.
        appearance: a file, a network or a function; by default the shipped network; ``"none"`` for none.
        threads: CPU threads of the network.

    Raises:
        RequestError: the method does not compare appearance; see `as_describer`.
    """
    if not compared:
        if appearance is not None:
            raise RequestError("expected `appearance` with a method that compares it, flow or deepsort, got another")
        return None
    if isinstance(appearance, str | Path) and str(appearance) == NONE:
        return None
    if appearance is None and not source.has_images:
        return None
    return as_describer(shipped("appearance_people") if appearance is None else appearance, threads)


def compares_appearance(method: Method | PeopleTracker) -> bool:
    """Whether the method looks at more than boxes."""
    return method in ("flow", "deepsort") if isinstance(method, str) else isinstance(method, FlowTracker | DeepSort)


def people_affinity(
    method: str, affinity: str | Path | Affinity | None, threads: int = 0, *, known_scores: bool
) -> Affinity | None:
    """Learnt link costs, where the method uses them.

    Args:
        method: of the tracker; only ``flow`` uses them.
        affinity: a file or the costs themselves; None takes the shipped ones where they know the scores.
        threads: CPU threads of the network.
        known_scores: the detections come from a detector whose scores the shipped costs were fitted to.

    Raises:
        RequestError: another method; or they ask for actions, which nothing recognises here.
    """
    if method != "flow":
        if affinity is not None:
            raise RequestError(f"expected `affinity` with the method flow only, which alone uses it, got {method}")
        return None
    if affinity is None:
        affinity = shipped("affinity_people") if known_scores else NONE
    if isinstance(affinity, str | Path):
        if str(affinity) == NONE:
            return None
        affinity = Affinity(affinity, threads)
    if "action" in affinity.card.class_names:
        raise RequestError(
            "expected `affinity` without actions, which nothing recognises here, got costs that ask for them; use "
            "track_drone"
        )
    return affinity


def people_tracker(method: Method, affinity: Affinity | None = None, seed: int = 0) -> PeopleTracker:
    """A fresh tracker with its default settings; the flow has hand-set costs where there is no affinity.

    Raises:
        RequestError: there is no such method.
    """
    makers: dict[Method, Callable[[], PeopleTracker]] = {
        "flow": lambda: FlowTracker(None, affinity, affinity.observation if affinity else None, seed),
        "deepsort": lambda: DeepSort(seed=seed),
        "sort": lambda: Sort(seed=seed),
    }
    if method not in makers:
        raise RequestError(f"expected the method {', '.join(makers)} or a tracker, got {method!r}")
    return makers[method]()


def _prepared(
    source: str | Path | int,
    method: Method | PeopleTracker,
    detections: GivenDetections | None,
    detector: DetectorLike | None,
    appearance: AppearanceLike | None,
    affinity: str | Path | Affinity | None,
    frames: str | None,
    moving_camera: bool,
    threads: int,
    seed: int,
) -> tuple[PeopleInputs, PeopleTracker]:
    """Everything opened and checked before the first frame is read."""
    opened = open_source(str(source), parse_frames(frames))
    # The shipped costs know the scores of exported networks, not those of other people's detectors.
    known_scores = detections is None and isinstance(detector, str | Path | Detector | None)
    tracker = _tracker(method, affinity, known_scores, threads, seed)
    inputs = PeopleInputs(
        opened,
        people_detect(opened, detections, detector, shipped("detector_street"), threads=threads),
        people_describer(opened, compares_appearance(method), appearance, threads),
        camera=CameraPath() if moving_camera else None,
    )
    if inputs.camera is not None:
        if not opened.has_images:
            raise RequestError(f"{opened.name} has no images to tell how the camera moves")
        tracker = MotionCompensated(tracker, inputs.camera)
    return inputs, tracker


def _tracker(
    method: Method | PeopleTracker, affinity: str | Path | Affinity | None, known_scores: bool, threads: int, seed: int
) -> PeopleTracker:
    if isinstance(method, str):
        return people_tracker(method, people_affinity(method, affinity, threads, known_scores=known_scores), seed)
    if not (hasattr(method, "update") and hasattr(method, "tracks")):
        raise RequestError(f"expected the method {', '.join(METHODS)} or a tracker, got {method!r}")
    if affinity is not None:
        raise RequestError(
            "expected `affinity` with the method's name, got it beside a tracker; give it to the tracker"
        )
    return method


def _answers_while_it_runs(tracker: PeopleTracker) -> bool:
    """An online tracker can forget, and one with a delay has one; see `trackers.base`."""
    return hasattr(_inner(tracker), "forget") or getattr(_inner(tracker), "delay", None) is not None


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
