"""People in video from a drone, and what they do: found, described, recognised, linked.

`track_drone` and the command `tsuiseki track drone` are made of the same parts: `DroneModels` and `link`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.association.learnt_costs import CostChanges, CostNetwork
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.drone.models import DroneMethod, DroneModels, as_detections
from tsuiseki.tracking.drone.observations import Observation, observe
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker, acting_track
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike
from tsuiseki.tracking.people.inputs import GivenDetections
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.people.tracker import FrameLog, shifted
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.result import StageTimes
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video.source import Source, open_source

METHODS: tuple[DroneMethod, ...] = ("flow", "flow-saf", "flow-maf")


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
    threads: int = 0,
    device: Device = "auto",
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
        affinity: file of costs learnt on whole tracks; by default those of the settings.
        frames: this stretch only, counted from 1 with both ends, such as ``"301-400"``.
        settings: of flow, alternation and output.
        threads: CPU threads of the networks; 0 takes all.
        device: what networks that are given as files run on, see `opened_on`.
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
    given: Any = {"detections": detections, "detector": detector}
    finding = FindingOptions(**given, threads=threads, device=device, view="auto")
    streams = None if actions is None else [Path(path) for path in actions]
    models = DroneModels.choose(opened, method, finding, appearance, streams)
    times = StageTimes()
    changes = None if affinity is None else CostNetwork(affinity, threads)
    observations = observe(opened.frames(), models.observers, times)
    return link(observations, opened, models, method, settings, times, changes)


@dataclass(frozen=True)
class DroneResult:
    """People and what they do; going through it gives one `ActingTrack` after the other.

    Attributes:
        people: with their actions, frames as the video counts them.
        names: of the actions.
        log: what happened in each frame.
        facts: what ``run.json`` tells of the tracker; empty where tracks were given.
    """

    people: list[ActingTrack]
    names: tuple[str, ...]
    log: FrameLog
    facts: Mapping[str, Any]

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
    source: Source,
    models: DroneModels,
    method: DroneMethod,
    settings: DroneSettings,
    times: StageTimes,
    changes: CostChanges | None = None,
) -> DroneResult:
    """The people of a video out of what was observed in its frames.

    Args:
        observations: of consecutive frames.
        source: the video.
        models: what observed them.
        method: how people are linked.
        settings: of the tracker.
        times: gets the seconds of linking.
        changes: by how much learnt costs differ from the settings'; by default not at all.

    Raises:
        RunError: there is no frame.
    """
    if models.given is not None:
        return _named(observations, models, models.given, settings, source.frame_rate)
    size = getattr(source, "size", None)
    size = size if size and min(size) > 0 else None
    tracker = DroneTracker(suited(settings, method), source.frame_rate, size, changes)
    log = FrameLog()
    for one in observations:
        log.add(one.frame, one.detections)
        actions = None if one.actions is None or method == "flow" else averaged(one.actions)
        with times.measure("link"):
            tracker.update(replace(one.detections, actions=actions), one.motion)
    if not log.frames:
        raise RunError("expected frames, got none")
    with times.measure("link"):
        people = tracker.people()
    numbered = [replace(one, track=shifted(one.track, log.frames[0])) for one in people]
    return DroneResult(numbered, models.names, log, tracker.facts())


def suited(settings: DroneSettings, method: DroneMethod) -> DroneSettings:
    """The settings with the action features of the method: none, of single frames, or as they are."""
    costs = settings.flow.costs
    action = costs.link.action
    if method == "flow":
        action = None
    elif method == "flow-saf":
        action = replace(action or ActionCost(), features="single")
    elif action is None or not action.averaged:
        raise RequestError(
            "flow-maf averages the features of actions along tracks, got settings of links that do not: choose the "
            "method flow or flow-saf, or action features centred or one-sided"
        )
    return replace(settings, flow=replace(settings.flow, costs=replace(costs, link=replace(costs.link, action=action))))


def _named(
    observations: Iterable[Observation],
    models: DroneModels,
    given: Sequence[Track],
    settings: DroneSettings,
    frame_rate: float,
) -> DroneResult:
    """Given tracks with what the observations of their boxes say that people do."""
    log, parts = FrameLog(), []
    for one in observations:
        log.add(one.frame, one.detections)
        parts.append(np.empty((0, len(models.names))) if one.actions is None else averaged(one.actions))
    if not log.frames:
        raise RunError("expected frames, got none")
    boxes, labels = as_detections(given)
    first = sum(len(found) for found in boxes[: log.frames[0]])
    labels = labels[first : first + sum(log.detections)]
    rows = rows_of(boxes[log.frames[0] : log.frames[-1] + 1] or [Detections.empty()], log.frames[0], 0)
    actions, half = np.concatenate(parts), round(settings.window / 2 * frame_rate)
    people = []
    for number, piece in enumerate(long_tracks(labels), start=1):
        track = Track(number, rows.frames[piece], rows.boxes[piece], np.nan_to_num(rows.scores[piece]))
        people.append(acting_track(track, actions[piece], half))
    return DroneResult(people, models.names, log, {})
