"""The models for people seen from a drone: those that are given, or those that ship with the toolkit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from tsuiseki.tracking.drone.observation_cache import file_digest
from tsuiseki.tracking.drone.observations import Observers
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.action_inputs import STREAMS
from tsuiseki.tracking.features.motion.camera_motion import CameraMotionSettings
from tsuiseki.tracking.features.networks.exported import Detect
from tsuiseki.tracking.features.networks.own_models import AppearanceLike, DetectorLike, as_describer
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.people.bridging import BridgingSettings
from tsuiseki.tracking.people.finding import NONE, GivenDetections, people_detect
from tsuiseki.tracking.people.given_tracks import as_detections, read_given_tracks
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.weights import DRONE_DETECTOR, shipped, shipped_or_file

DroneMethod = Literal["flow", "flow-saf", "flow-maf"]


class Finds(Protocol):
    """How people are found; files among it become part of the key of what is kept."""

    @property
    def detections(self) -> GivenDetections | None: ...
    @property
    def detector(self) -> DetectorLike | None: ...
    @property
    def score_threshold(self) -> float: ...
    @property
    def score_range(self) -> tuple[float, float] | None: ...
    @property
    def batch_size(self) -> int: ...
    @property
    def threads(self) -> int: ...
    @property
    def how(self) -> Mapping[str, str]: ...

    def detect(self, source: Source, default: str, /) -> Detect | list[Detections]:
        """The given detections, or what finds people; ``default`` names the shipped detector to take otherwise."""


@dataclass(frozen=True)
class Finding:
    """How people are found, from Python.

    Attributes:
        detections: see `given_detections`.
        detector: see `as_detector`.
        score_threshold: of a detector that is read from a file, in [0, 1].
        score_range: smallest and largest score that the rows of a file of detections may have; None is any.
        batch_size: frames of one call of the detector.
        threads: CPU threads of the networks; 0 takes all.
    """

    detections: GivenDetections | None = None
    detector: DetectorLike | None = None
    score_threshold: float = 0.3
    score_range: tuple[float, float] | None = None
    batch_size: int = 4
    threads: int = 0

    @property
    def how(self) -> Mapping[str, str]:
        """Nothing that a file does not tell."""
        return {}

    def detect(self, source: Source, default: str) -> Detect | list[Detections]:
        """See `Finds`."""
        return people_detect(
            source,
            self.detections,
            self.detector,
            shipped(default),
            self.score_threshold,
            self.score_range,
            self.threads,
        )


@dataclass(frozen=True)
class DroneModels:
    """The models of a run, and the key of their observations.

    Attributes:
        observers: networks and estimates.
        names: of the actions; empty without action recognition.
        key: plain values that identify the models and their settings, for the cache.
        given: tracks to use instead of tracking; None tracks.
        superset_key: for runs without actions, the key of the same observations with actions.
    """

    observers: Observers
    names: tuple[str, ...]
    key: Mapping[str, Any]
    given: Sequence[Track] | None = None
    superset_key: Mapping[str, Any] | None = None

    @classmethod
    def choose(
        cls,
        source: Source,
        method: DroneMethod,
        finding: Finds,
        appearance: AppearanceLike | None = None,
        actions: Sequence[Path] | None = None,
        tracks: Path | None = None,
        *,
        camera_motion: bool = True,
        bridging: BridgingSettings | None,
    ) -> DroneModels:
        """The models for a video; see `track_drone`.

        Args:
            tracks: file of tracks that are right already; only actions are named.

        Raises:
            RequestError: something of this cannot be used; the message says what and why.
        """
        if tracks is not None and (finding.detections is not None or finding.detector is not None):
            raise RequestError("expected one of `detections`, `detector` and `tracks`, got several")
        paths: dict[str, Path | None] = {"detections": _file(finding.detections), "tracks": tracks}
        given = None if tracks is None else read_given_tracks(tracks, source)
        detect = finding.detect(source, DRONE_DETECTOR) if given is None else as_detections(given)[0]
        if isinstance(detect, ViewedDetector):
            # Who is seen from a drone is small to begin with: enlarged tiles find people in every bush.
            detect.enlarge = False
        if not isinstance(detect, list):
            paths["detector"] = _detector_file(finding.detector)
        looked = shipped("appearance_people") if appearance is None else appearance
        used = given is None and not (isinstance(looked, str | Path) and str(looked) == NONE)
        paths["appearance"] = _file(looked) if used else None
        describe = as_describer(looked, finding.threads) if used else None
        streams = _streams(method, actions, needed=given is not None)
        recognise = ActionRecogniser(streams, finding.threads) if streams else None
        camera = CameraMotionSettings() if camera_motion and given is None else None
        key = {name: None if path is None else file_digest(path) for name, path in paths.items()}
        bridging = bridging if given is None else None
        key |= _streams_key(streams) | {"motion": repr(camera), "bridging": repr(bridging)}
        key |= {"score_threshold": str(finding.score_threshold), "score_range": str(finding.score_range)}
        key |= finding.how
        observers = Observers(detect, describe, recognise, camera, finding.batch_size, bridging)
        spare = [] if streams else _streams("flow-maf", actions, needed=True)
        superset_key = key | _streams_key(spare) if spare and all(path.is_file() for path in spare) else None
        return cls(observers, recognise.names if recognise else (), key, given, superset_key)


def _streams(method: DroneMethod, actions: Sequence[Path] | None, *, needed: bool) -> list[Path]:
    """The files of the action streams that a method needs."""
    if method == "flow" and not needed:
        return []
    return list(actions) if actions is not None else [shipped(f"action_drone_{name}") for name in STREAMS]


def _file(given: object) -> Path | None:
    """The file that is given, where it is one."""
    return Path(given) if isinstance(given, str | Path) else None


def _detector_file(given: DetectorLike | None) -> Path | None:
    """The file of the detector: the shipped one by default, or that of a shipped one's name; None of a function."""
    if given is None:
        return shipped(DRONE_DETECTOR)
    file = _file(given)
    return None if file is None else shipped_or_file("detector", file)


def _streams_key(streams: Sequence[Path]) -> dict[str, str | None]:
    return {f"action {number}": file_digest(path) for number, path in enumerate(streams)}
