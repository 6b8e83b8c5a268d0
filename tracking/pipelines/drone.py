"""People in video from a drone, and what they do: found, described, recognised, linked.

`track_drone` and the command `tsuiseki track drone` are made of the same parts: `DroneModels`, `prices_of` and `link`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.association.tracklets.action_refinement import Prices
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.networks.own_models import AppearanceLike, DetectorLike
from tsuiseki.tracking.frame_range import parse_frames
from tsuiseki.tracking.pipelines.drone_models import DroneMethod, DroneModels, Finding, prices_of
from tsuiseki.tracking.pipelines.finding import GivenDetections
from tsuiseki.tracking.pipelines.observations import Observation, observe
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.drone import DroneSettings, DroneTracker
from tsuiseki.tracking.trackers.people.bridging import BridgingSettings
from tsuiseki.tracking.trackers.people.given_tracks import as_detections
from tsuiseki.tracking.trackers.people.run import FrameLog, shifted
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video import open_source

METHODS = ("flow", "flow-saf", "flow-maf")
BRIDGING = BridgingSettings()


def track_drone(
    source: str | Path,
    method: DroneMethod = "flow-maf",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    actions: Sequence[str | Path] | None = None,
    affinity: str | Path | None = None,
    frames: str | None = None,
    settings: DroneSettings | None = None,
    bridging: BridgingSettings | None = BRIDGING,
    threads: int = 0,
    seed: int = 0,
) -> DroneResult:
    """Everyone in a video from a drone, each with an id and with what they do.

    Args:
        source: a video file, a folder of images or a MOTChallenge sequence folder.
        method: ``flow`` links by place and appearance; ``flow-saf`` also by actions of single frames; ``flow-maf``
            averages actions along the tracks, links again and repeats.
        detections: use these instead of a detector: a file (MOTChallenge ``det.txt``), or one entry a frame of
            whatever `as_detections` understands.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; by default the
            shipped one; ``"none"`` does without.
        actions: files of exported action streams; by default the shipped ones. Not used by ``flow``.
        affinity: exported link costs; by default those shipped for the method, hand-set ones with ``detections`` or a
            detector that is a function; ``"none"`` takes hand-set ones always.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        settings: of flow, alternation and output.
        bridging: how correlation filters follow people whom the detector misses for a few frames; None switches them
            off.
        threads: CPU threads of the networks; 0 takes all.
        seed: draws nothing; the methods here are exact.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    del seed
    if method not in METHODS:
        raise RequestError(f"expected the method {', '.join(METHODS)}, got {method!r}")
    opened, settings = open_source(source, parse_frames(frames)), settings or DroneSettings()
    if not opened.has_images:
        raise RequestError(f"{opened.name} has no images to look at; expected them in its folder img1/")
    if opened.live:
        raise RequestError("expected a video that can be played again, got a live source; record it first")
    finding = Finding(detections, detector, threads=threads)
    streams = None if actions is None else [Path(path) for path in actions]
    models = DroneModels.choose(opened, method, finding, appearance, streams, bridging=bridging)
    known = detections is None and isinstance(detector, str | Path | None)
    windows = settings.refinement.windows
    prices = prices_of(method, affinity, None, threads, scores_known=known, windows=windows)
    times = StageTimes()
    return link(observe(opened.frames(), models.observers, times), models, method, settings, prices, times)


@dataclass(frozen=True)
class DroneResult:
    """People and what they do; going through it gives one `ActingTrack` after the other.

    Attributes:
        people: with their actions, frames as the video counts them.
        names: of the actions.
        log: what happened in each frame.
    """

    people: list[ActingTrack]
    names: tuple[str, ...]
    log: FrameLog

    def __len__(self) -> int:
        return len(self.people)

    def __iter__(self) -> Iterator[ActingTrack]:
        return iter(self.people)

    @property
    def tracks(self) -> list[Track]:
        """Without the actions."""
        return [person.track for person in self.people]


def link(
    observations: Iterable[Observation],
    models: DroneModels,
    method: DroneMethod,
    settings: DroneSettings,
    prices: Prices,
    times: StageTimes,
) -> DroneResult:
    """The people of a video out of what was observed in its frames.

    Args:
        observations: of consecutive frames.
        models: what observed them.
        method: how people are linked.
        settings: of the tracker.
        prices: of links.
        times: gets the seconds of linking.

    Raises:
        RunError: there is no frame.
    """
    given, labels = (None, None) if models.given is None else as_detections(models.given)
    tracker = DroneTracker(_suited(settings, method, given=given is not None), prices)
    uses_actions = method != "flow" or given is not None
    log = FrameLog()
    for one in observations:
        log.add(one.frame, one.detections)
        actions = None if one.actions is None else averaged(one.actions)
        with times.measure("link"):
            tracker.update(replace(one.detections, actions=actions if uses_actions else None), one.motion)
    if not log.frames:
        raise RunError("expected frames, got none")
    with times.measure("link"):
        if labels is not None:
            first = sum(len(found) for found in (given or [])[: log.frames[0]])
            people = tracker.people_with(labels[first : first + sum(log.detections)])
        else:
            people = tracker.people()
    numbered = [replace(one, track=shifted(one.track, log.frames[0])) for one in people]
    return DroneResult(numbered, models.names, log)


def _suited(settings: DroneSettings, method: DroneMethod, *, given: bool) -> DroneSettings:
    """The settings with as many iterations as the method has; given tracks stay as they are."""
    if given:
        return replace(settings, min_detections=1, gaps=None, smoothing=None, chunk=None)
    if method == "flow-maf":
        return settings
    return replace(settings, refinement=replace(settings.refinement, iterations=1))
