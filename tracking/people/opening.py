"""Everything that tracks people in a video, opened and checked before the first frame."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import dataclass
from functools import partial
from typing import Any

from tsuiseki.tracking.association.clutter import above_floor, score_choice
from tsuiseki.tracking.association.inference_times import named_frames
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import Describe, Detect
from tsuiseki.tracking.features.second_opinion import SecondOpinion
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.view_choice import inner_detector, knows_scores
from tsuiseki.tracking.interchange import BadBoxes
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.detections import (
    PeopleInputs,
    ground_of,
    people_describer,
    people_detect,
    second_detect,
    threads_of_a_call,
)
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.given_detections import frames_with_inference
from tsuiseki.tracking.people.motion_compensated import MotionCompensated
from tsuiseki.tracking.people.printed_flow import PrintedFlow
from tsuiseki.tracking.people.settings import METHODS, Linking, PeopleFinding
from tsuiseki.tracking.people.sort import DeepSort
from tsuiseki.tracking.people.tracker_choice import (
    APPEARANCE,
    LearntCosts,
    cost_of_scores,
    people_affinity,
    people_tracker,
    score_scale,
    straddles,
)
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.inference_frames import InferenceFrames
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR


@dataclass(frozen=True)
class OpenedPeople:
    """A video whose people can be tracked: everything is opened and checked, and no frame is read.

    Attributes:
        inputs: where frames and detections come from.
        tracker: a fresh one.
        floor: score under which given detections were left out, see `above_floor`; None for none.
        bad: counts the boxes that are none; None where networks find all, or a file is read.
    """

    inputs: PeopleInputs
    tracker: PeopleTracker
    floor: float | None = None
    bad: BadBoxes | None = None


def open_people(
    source: Source, finding: PeopleFinding, linking: Linking, seed: int, inferred: Iterable[int] | None = None
) -> OpenedPeople:
    """All models and files opened and checked.

    Args:
        source: the video.
        finding: the options; in Python also what `track_people` takes instead of files.
        linking: likewise; its method may be a tracker.
        seed: of the tracker's random numbers.
        inferred: numbers from 0 of the frames with inference; by default those of ``finding``, and the pattern of given
            detections.

    Raises:
        RequestError: something cannot be used; the message says what and why.
    """
    if linking.moving_camera and not source.has_images:
        raise RequestError(f"{source.name} has no images to tell how the camera moves; leave `moving_camera` out")
    threads = threads_of_a_call(source, finding.threads)
    floor: float | None = None
    (detect, inferences), chosen = _detecting(source, finding, threads, inferred), finding.chosen
    bad = getattr(inner_detector(detect), "bad", None)
    if isinstance(detect, list) and linking.method == "flow" and finding.score_range is None and chosen is None:
        detect, floor = above_floor(detect, source.frame_rate)
    scale = score_scale(detect, linking.method, linking, source) if finding.score_range is None else None
    if scale is not None and isinstance(detect, list):
        detect = scale.every(detect)
    method: Any = linking.method
    describe = people_describer(
        source, compares_appearance(method), finding.appearance, threads, finding.appearance_options, finding.device
    )
    if method == "deepsort" or isinstance(method, DeepSort):
        _say_without_appearance(detect, describe, source, finding)
    # The flow sees for itself where the camera stands still.
    camera = CameraPath() if linking.moving_camera else StandingCamera() if method == "flow" else None
    ground = ground_of(detect, finding.ground, source)
    if isinstance(detect, list) and inferred is None:
        inferences = frames_with_inference(detect, source)
    unknown = finding.score_threshold is None and not source.live
    choice = score_choice(detect, ground) if unknown else None
    inputs = PeopleInputs(
        source, detect, describe, finding.batch_size, camera, finding.threads, ground, inferences, choice, scale
    )
    apart = chosen is not None and not chosen.across
    fresh: Callable[[], PeopleTracker]
    if isinstance(linking.method, str):
        # The shipped costs know the scores of the shipped networks, not those of other people's detectors.
        learnt = people_affinity(
            linking.method,
            linking.affinity,
            finding.threads,
            known_scores=knows_scores(detect),
            printed=linking.preset == "printed",
        )
        fresh = partial(_fresh_tracker, inputs, linking, learnt, seed)
    else:
        fresh = partial(_own_tracker, inputs, linking, apart)
    tracker = ByClass(fresh, chosen.plain) if chosen is not None and apart else fresh()
    return OpenedPeople(inputs, tracker, floor, bad)


def _detecting(
    source: Source, finding: PeopleFinding, threads: int, numbers: Iterable[int] | None
) -> tuple[Detect | list[Detections], InferenceFrames]:
    """What detects people, or given detections, and the frames that a detector runs on; see `open_people`."""
    inferred = InferenceFrames.every(finding.detect_every, source.frames_wanted.first)
    if numbers is not None:
        inferred = named_frames(numbers)
    detect = people_detect(source, finding, PEOPLE_DETECTOR, threads, inferred.stride)
    if finding.second_opinion is not None and not isinstance(detect, list):
        detect = SecondOpinion(detect, second_detect(source, finding, threads, inferred.stride))
    return detect, inferred


def compares_appearance(method: str | PeopleTracker) -> bool:
    """Whether a method compares people by appearance."""
    return method in APPEARANCE if isinstance(method, str) else isinstance(method, FlowTracker | DeepSort)


def _say_without_appearance(detect: object, describe: Describe | None, source: Source, finding: PeopleFinding) -> None:
    """Say that DeepSORT goes by boxes alone, where nobody has asked for that: it is another method then."""
    described = isinstance(detect, list) and any(rows.features is not None for rows in detect)
    if describe is None and finding.appearance is None and not described:
        warnings.warn(
            f"{source.name} has no images, so deepsort compares boxes alone and no appearance; give `appearance` none "
            "to say so, or a source with images",
            InputWarning,
            stacklevel=3,
        )


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
    return people_tracker(
        linking.method,
        linking,
        learnt,
        seed,
        inputs.source,
        inputs.camera,
        linking.delay,
        scores,
        drop,
        inputs.inferred.stride,
    )
