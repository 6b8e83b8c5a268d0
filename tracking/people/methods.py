"""The methods that link people, by name, and what each needs besides detections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Literal, get_args

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.association.costs import ProbabilityCost, ScoreCost
from tsuiseki.tracking.association.flow.cost_network import CostNetwork
from tsuiseki.tracking.association.tracklets.straddling import EXPLAINED
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.motion.camera_path import CameraPath
from tsuiseki.tracking.features.motion.standing_camera import StandingCamera
from tsuiseki.tracking.features.networks.exported import Detector
from tsuiseki.tracking.features.view_choice import inner_detector, scores_are_probabilities
from tsuiseki.tracking.onnx import kind_of
from tsuiseki.tracking.options import Shared
from tsuiseki.tracking.people.bytetrack import ByteTrack, ByteTrackSettings
from tsuiseki.tracking.people.compensated import MotionCompensated
from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.people.finding import NONE
from tsuiseki.tracking.people.flow import FlowSettings, FlowTracker
from tsuiseki.tracking.people.ocsort import OcSort, OcSortSettings
from tsuiseki.tracking.people.sort import Sort, SortSettings
from tsuiseki.tracking.people.tracker import PeopleTracker
from tsuiseki.tracking.video.image_folder import DEFAULT_FRAME_RATE
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import shipped

PeopleMethod = Literal["flow", "deepsort", "sort", "bytetrack", "ocsort"]
METHODS: tuple[PeopleMethod, ...] = get_args(PeopleMethod)
APPEARANCE = ("flow", "deepsort")
# What `--affinity` takes: costs learnt on pairs, or on whole tracks.
LearntCosts = Affinity | CostNetwork
# Mean logit that a track's detections need where scores are probabilities: 0.62. Somebody far away is found with 0.65
# in every frame, which the flow's own 1.0, or 0.73, of learnt costs takes for clutter.
_PROBABLE = 0.5


@dataclass(frozen=True)
class MethodSettings(Shared):
    """The settings of every method.

    Attributes:
        sort: settings of --method sort.
        deepsort: settings of --method deepsort.
        bytetrack: settings of --method bytetrack.
        ocsort: settings of --method ocsort.
        flow: settings of --method flow.
    """

    sort: SortSettings = field(default_factory=SortSettings)
    deepsort: DeepSortSettings = field(default_factory=DeepSortSettings)
    bytetrack: ByteTrackSettings = field(default_factory=ByteTrackSettings)
    ocsort: OcSortSettings = field(default_factory=OcSortSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)


def people_tracker(
    method: PeopleMethod,
    settings: MethodSettings | None = None,
    affinity: LearntCosts | None = None,
    seed: int = 0,
    source: Source | None = None,
    camera: CameraPath | StandingCamera | None = None,
    delay: float | None = None,
    scores: ScoreCost | None = None,
    straddling: float = 0.0,
) -> PeopleTracker:
    """A fresh tracker; the flow has hand-set costs where there is no affinity.

    Args:
        method: its name.
        settings: of all methods.
        affinity: learnt costs of the flow.
        seed: of all chance.
        source: the video, for the flow's times and the border of its images.
        camera: gets the frames before the tracker gets their detections, where the movement of the camera matters; one
            that only tells where it stands still is for the flow.
        delay: seconds after which the flow answers a frame; None answers at the end.
        scores: what scores cost the flow where no ``affinity`` says so; None lets the video tell.
        straddling: see `FlowSettings`, where ``settings`` leave it open; `straddling_of` says it of a detector.

    Raises:
        RequestError: there is no such method, or another than the flow shall have a delay.
    """
    if delay is not None and method != "flow":
        raise RequestError(f"expected `delay` with the method flow, got it with {method}, which answers at once")
    if delay is not None and not 0 <= delay < inf:
        raise RequestError(f"expected `delay` of 0 seconds or more, got {delay:g}")
    settings = settings or MethodSettings()
    pairs = affinity if isinstance(affinity, Affinity) else None
    changes = affinity if isinstance(affinity, CostNetwork) else None
    observation = scores if pairs is None else pairs.observation
    rate, size = DEFAULT_FRAME_RATE if source is None else source.frame_rate, getattr(source, "size", None)
    size = size if size and min(size) > 0 else None
    flow = _flow_settings(settings.flow, observation)
    if delay is not None and flow.straddling:
        raise RequestError("`flow.straddling` needs the whole video; leave it or `delay` out")
    flow = replace(flow, straddling=straddling) if flow.straddling is None else flow
    makers: dict[PeopleMethod, Callable[[], PeopleTracker]] = {
        "flow": lambda: FlowTracker(flow, pairs, observation, rate, size, camera, seed, changes, delay),
        "deepsort": lambda: DeepSort(settings.deepsort, seed),
        "sort": lambda: Sort(settings.sort, seed),
        "bytetrack": lambda: ByteTrack(settings.bytetrack, seed),
        "ocsort": lambda: OcSort(settings.ocsort, seed),
    }
    if method not in makers:
        raise RequestError(f"expected the method {', '.join(makers)} or a tracker, got {method!r}")
    tracker = makers[method]()
    if not isinstance(camera, CameraPath) or method == "flow":
        return tracker
    return MotionCompensated(tracker, camera)


def camera_for(method: PeopleMethod | PeopleTracker, *, moving: bool) -> CameraPath | StandingCamera | None:
    """What looks at the pictures for a method: how the camera moves, for the flow where it stands still, or nothing."""
    if moving:
        return CameraPath()
    return StandingCamera() if method == "flow" else None


def _flow_settings(given: FlowSettings, observation: ScoreCost | None) -> FlowSettings:
    """The settings, and what they leave at its default where scores are probabilities."""
    if isinstance(observation, ProbabilityCost) and given.least == FlowSettings().least:
        return replace(given, least=_PROBABLE)
    return given


def compares_appearance(method: PeopleMethod | PeopleTracker) -> bool:
    """Whether the method looks at more than boxes."""
    return method in APPEARANCE if isinstance(method, str) else isinstance(method, FlowTracker | DeepSort)


def cost_of_scores(detect: object) -> ProbabilityCost | None:
    """What the scores of ``detect`` cost where they are probabilities of its camera; None where nobody says so."""
    return ProbabilityCost() if scores_are_probabilities(detect) else None


def straddling_of(detect: object) -> float:
    """From which share on tracks of what ``detect`` finds are explained by others.

    This toolkit's detectors find somebody more between two people who walk together, often enough for a track. Of the
    boxes of others, and of those that are given, nothing is known: 0, all tracks are kept.
    """
    return EXPLAINED if isinstance(inner_detector(detect), Detector) else 0.0


def people_affinity(
    method: str, affinity: str | Path | LearntCosts | None, threads: int = 0, *, known_scores: bool
) -> LearntCosts | None:
    """Learnt link costs, where the method uses them.

    Args:
        method: of the tracker; only ``flow`` uses them.
        affinity: a file or the costs themselves, learnt on pairs or on whole tracks; None takes the shipped ones where
            they know the scores.
        threads: CPU threads of the network.
        known_scores: the detections come from a detector of this toolkit, whose scores the shipped costs take.

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
        learnt_on_tracks = kind_of(affinity) == "association"
        affinity = CostNetwork(affinity, threads) if learnt_on_tracks else Affinity(affinity, threads)
    if "action" in affinity.card.class_names:
        raise RequestError(
            "expected `affinity` without actions, which nothing recognises here, got costs that ask for them; use "
            "track_drone"
        )
    return affinity
