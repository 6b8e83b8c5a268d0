"""Who is in each frame of a video: given, or detected and described by models."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from threading import Thread

from tsuiseki.tracking.association.clutter import ScoreChoice
from tsuiseki.tracking.association.video_evidence import ScoreScale
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import (
    Appearance,
    AppearanceLike,
    Describe,
    Detect,
    Detector,
    ForeignAppearance,
    as_describer,
    as_detector,
)
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.foreign_options import AppearanceOptions, DetectorOptions
from tsuiseki.tracking.features.ground_plane import GroundPlane
from tsuiseki.tracking.features.second_opinion import SecondOpinion
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector, inner_detector
from tsuiseki.tracking.formats.label_checks import BoxCheck
from tsuiseki.tracking.onnx import cores_of
from tsuiseki.tracking.people.given_detections import GivenRows, given_detections
from tsuiseki.tracking.people.settings import NONE, FindingOptions, Ground, PeopleFinding
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame
from tsuiseki.tracking.types.inference_frames import ALL_INFERRED, InferenceFrames
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped

DETECTOR = "the detector"


@dataclass(frozen=True)
class PeopleInputs:
    """Where frames, detections and features come from.

    Attributes:
        source: the video.
        detect: a detector, or the detections of each frame.
        describe: an appearance model, if the method compares appearance.
        batch_size: frames of one call of the detector.
        camera: gets the frames, where the movement of the camera matters; one that only tells where the camera stands
            still gets those that are decoded anyway.
        threads: cores that networks may use; 0 for all. Functions of other people are called one at a time, and live
            sources are never read ahead.
        ground: weighs the detections, in the order of the video.
        inferred: frames that a detector runs on.
        choice: of the threshold of a network whose scores are not known; None where it is given.
        scale: turns scores that are no probabilities, those of a list beforehand; None where the method takes any.
    """

    source: Source
    detect: Detect | Sequence[Detections]
    describe: Describe | None = None
    batch_size: int = 4
    camera: CameraPath | StandingCamera | None = None
    threads: int = 1
    ground: GroundPlane | None = None
    inferred: InferenceFrames = ALL_INFERRED
    choice: ScoreChoice | None = None
    scale: ScoreScale | None = None

    @property
    def workers(self) -> int:
        """Batches that are worked on at a time."""
        networks = isinstance(self.detect, ViewedDetector | Detector | ForeignDetector | SecondOpinion | Sequence)
        described = self.describe is None or isinstance(self.describe, Appearance | ForeignAppearance)
        return cores_of(self.threads) if networks and described and not self.source.live else 1

    @property
    def needs_images(self) -> bool:
        """Whether the frames themselves must be decoded."""
        moving = isinstance(self.camera, CameraPath)
        decoded = self.describe is not None or moving or not isinstance(self.detect, Sequence)
        return decoded or (self.source.length is None and self.source.has_images)

    def detections(
        self, frames: Iterable[Frame] | None = None, times: StageTimes | None = None, pictured: bool = False
    ) -> Iterator[tuple[int, Detections]]:
        """Frame numbers with their detections; frames are decoded only where they are needed.

        Args:
            frames: of the source, where somebody watches them; by default they are read.
            times: gets the seconds of each stage.
            pictured: somebody needs to see the frames.

        Raises:
            RunError: the video breaks off.
        """
        if self.needs_images or pictured:
            yield from ((frame.index, detections) for frame, detections in self.with_frames(frames, times))
            return
        assert isinstance(self.detect, Sequence)
        # A sequence that is text only, and does not say how long it is, ends with its detections.
        frame_range = self.source.frames_wanted.within(self.source.length or len(self.detect))
        assert frame_range.last is not None
        for index in range(frame_range.first, frame_range.last + 1):
            yield index, self.detect[index] if index < len(self.detect) else Detections.empty()

    def with_frames(
        self, frames: Iterable[Frame] | None = None, times: StageTimes | None = None
    ) -> Iterator[tuple[Frame, Detections]]:
        """The frames themselves with the detections there; see `detections`."""
        times = times or StageTimes()
        images = self.source.frames() if frames is None else frames
        yield from self.in_order(self._streamed(images, times), times)

    def in_order(
        self, detected: Iterable[tuple[Frame, Detections]], times: StageTimes
    ) -> Iterator[tuple[Frame, Detections]]:
        """What networks detect in each frame, with what only the frames before tell: the ground, and the camera."""
        last, check = -1, self._box_check()
        for frame, detections in detected:
            if last < 0 and self.workers > 1:
                # Trackers use it late; loaded while networks run on the next frames it takes no time.
                Thread(target=_load_parts, name="tsuiseki-load").start()
            last = frame.index
            if check is not None and check.what == DETECTOR:
                check.size = frame.image.shape[1], frame.image.shape[0]
                check.add(detections.boxes)
            if self.scale is not None and not isinstance(self.detect, list):
                detections = self.scale.next(detections)
            if self.ground is not None:
                with times.measure("ground"):
                    detections = self.ground.weighed(detections, frame.image.shape[0])
            with times.measure("camera") if self.camera is not None else nullcontext():
                if isinstance(self.camera, CameraPath):
                    self.camera.add(frame.image, detections.boxes)
                elif self.camera is not None:
                    self.camera.add(frame.image)
            yield frame, detections
        if check is not None:
            check.tell()
        self._check_all_used(last)

    def _streamed(self, images: Iterable[Frame], times: StageTimes) -> Iterator[tuple[Frame, Detections]]:
        how = (self.describe, self.batch_size, times, self.workers, self.inferred)
        if self.choice is None:
            yield from stream(images, self.detect, *how)
            return
        detected = self.choice.choose(self.source, self.batch_size, self.workers, times, self.inferred)
        frames = iter(images)
        first = [detected.get(number, Detections.empty()) for number in range(max(detected, default=-1) + 1)]
        yield from stream(itertools.islice(frames, len(detected)), first, *how)
        yield from stream(frames, self.detect, *how)

    def _box_check(self) -> BoxCheck | None:
        """What compares boxes with pictures, where a function or somebody else's network finds them."""
        network = inner_detector(self.detect)
        if isinstance(network, ForeignDetector):
            return network.check
        return None if isinstance(network, Detector | Sequence) else BoxCheck(DETECTOR)

    def _check_all_used(self, last: int) -> None:
        """Say that a video turned out to be shorter than its detections."""
        if not isinstance(self.detect, Sequence) or self.source.frames_wanted.last is not None:
            return
        if self.source.length is None and len(self.detect) > last + 1:
            unused = sum(map(len, self.detect[last + 1 :]))
            warnings.warn(
                f"{unused} detection(s) after the last frame of {self.source.name}, {last + 1}, are left out",
                InputWarning,
                stacklevel=2,
            )


def _load_parts() -> None:
    """Load the parts of SciPy that trackers use, which SciPy itself loads on first use."""
    for part in ("linalg", "optimize", "sparse"):
        import_module(f"scipy.{part}")


def threads_of_a_call(source: Source, threads: int) -> int:
    """Threads of one call of a network: all for a live source, whose frames come one by one, else one a worker."""
    return threads if source.live else 1


def people_detect(
    source: Source, finding: FindingOptions, default: str, threads: int | None = None, stride: float = 1.0
) -> Detect | list[Detections]:
    """The given detections, or what detects people.

    Args:
        source: the video.
        finding: the options; in Python ``detections`` and ``detector`` may be whatever `given_detections` and
            `as_detector` take.
        default: name of the shipped detector to take where neither is given.
        threads: CPU threads of one call of a detector that is read from a file; by default those of ``finding``.
        stride: frames from one inference to the next.

    Returns:
        Networks take large frames in tiles; see `choose_view`.

    Raises:
        RequestError: the source has no images to find people in.
    """
    view = parse_view(str(finding.view))
    if finding.detections is not None:
        names = finding.detector_options.classes
        rows = given_detections(finding.detections, source, finding.score_range, finding.chosen, names)
        return GivenRows((entry.scoring(finding.score_threshold) for entry in rows), rows.bad)
    if not source.has_images:
        raise RequestError(f"{source.name} has no images to find people in; give `detections`")
    detector = shipped(default) if finding.detector is None else finding.detector
    threads = finding.threads if threads is None else threads
    options, chosen = finding.detector_options, finding.chosen
    detect = as_detector(detector, finding.score_threshold, threads, options, finding.device, classes=chosen)
    if view == (1, None) or not isinstance(detect, Detector | ForeignDetector):
        return detect
    return ViewedDetector(detect, view, frame_rate=source.frame_rate, sparing=True, stride=stride)


def second_detect(source: Source, finding: PeopleFinding, threads: int, stride: float) -> Detect:
    """What gives a second opinion: the detector of that name or file, as `people_detect` would take it alone.

    Raises:
        RequestError: see `as_detector`.
    """
    alone = replace(finding, detector=finding.second_opinion, second_opinion=None, detector_options=DetectorOptions())
    second = people_detect(source, alone, PEOPLE_DETECTOR, threads, stride)
    assert not isinstance(second, list)
    return second


def ground_of(detect: Detect | Sequence[Detections], ground: Ground, source: Source) -> GroundPlane | None:
    """What weighs the boxes of a network by people's heights on one ground; None where nothing shall.

    Args:
        detect: given detections, those of other people's functions, and other classes than people keep their scores.
        ground: ``auto`` weighs wherever one ground explains the detections, ``off`` never.
        source: the video.
    """
    network = inner_detector(detect.first if isinstance(detect, SecondOpinion) else detect)
    if ground == "off" or not isinstance(network, Detector | ForeignDetector) or not network.people_only:
        return None
    return GroundPlane(source.frame_rate, score_threshold=network.score_threshold)


def people_describer(
    source: Source,
    compared: bool,
    appearance: AppearanceLike | None,
    threads: int = 0,
    options: AppearanceOptions | None = None,
    device: Device = "auto",
) -> Describe | None:
    """What describes appearance, where it is compared and there are images.

    Args:
        source: the video.
        compared: the method compares appearance.
        appearance: a file, a network or a function; by default the shipped network; ``"none"`` for none.
        threads: CPU threads of the network.
        options: what a file of another project does not tell.
        device: of the network.

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
    return as_describer(shipped("appearance_people") if appearance is None else appearance, threads, options, device)


def network_detections(
    source: Source, finding: FindingOptions, frames: Iterable[Frame] | None = None
) -> Iterator[tuple[int, Detections]]:
    """Frame numbers with what a network detects there; the options are checked at the call.

    The frames are read, unless ``frames`` of the source are given.
    """
    detect = people_detect(source, finding, PEOPLE_DETECTOR)
    return PeopleInputs(source, detect, batch_size=finding.batch_size, threads=finding.threads).detections(frames)
