"""A fresh tracker by the name of its method, with the costs that suit what detects."""

from __future__ import annotations

from pathlib import Path

from tsuiseki.tracking.association.costs import ProbabilityCost, ScoreCost
from tsuiseki.tracking.association.learnt_costs import Affinity, CostNetwork
from tsuiseki.tracking.association.video_evidence import ScoreScale
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.view_choice import inner_detector, scores_are_probabilities
from tsuiseki.tracking.onnx import kind_of
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.motion_compensated import MotionCompensated
from tsuiseki.tracking.people.settings import METHODS, NONE, ONLINE, MethodSettings, PeopleMethod
from tsuiseki.tracking.video.frame_source import DEFAULT_FRAME_RATE
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import shipped

APPEARANCE = ("flow", "deepsort")
# What `--affinity` takes: costs learnt on pairs, or on whole tracks.
LearntCosts = Affinity | CostNetwork


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
        RequestError: another method than the flow shall have a delay.
    """
    if delay is not None and method != "flow":
        raise RequestError(f"expected `delay` with the method flow, got it with {method}, which answers at once")
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
    start, usual = (getattr(getattr(s, str(method)), "start_score", None) for s in (settings, MethodSettings()))
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
    if not isinstance(affinity, Affinity | CostNetwork):
        raise RequestError(f"`affinity`: expected a path or learnt costs, got {type(affinity).__name__}")
    if "action" in affinity.card.class_names:
        preset = "" if isinstance(affinity, CostNetwork) else " --preset printed"
        raise RequestError(
            f"expected `affinity` without actions, which nothing recognises here, got costs that ask for them; use "
            f"track drone{preset}"
        )
    return affinity
