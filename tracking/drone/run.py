"""People in video from a drone, and what they do: in one call, and by `tsuiseki track drone`.

Both are made of the same parts, which the demo of a drone shares: `DroneModels` and `link`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.costs import ActionCost
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.association.learnt_costs import Affinity, CostNetwork
from tsuiseki.tracking.association.solved_network import NETWORK_FILE
from tsuiseki.tracking.bounds import SETTINGS, Share, as_settings
from tsuiseki.tracking.devices import Device
from tsuiseki.tracking.drone.drone_models import DroneMethod, DroneModels, tracks_as_detections
from tsuiseki.tracking.drone.observations import Observation, observe, video_observations
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker, acting_track
from tsuiseki.tracking.errors import RequestError, RunError, a_path, check_choice
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.camera_path import line_on_camera
from tsuiseki.tracking.features.exported import AppearanceLike, DetectorLike
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.view_choice import devices_of, report_blank, report_models
from tsuiseki.tracking.fields import HIDDEN, Commas, refused, showing
from tsuiseki.tracking.formats.acting_tracks import write_acting_tracks
from tsuiseki.tracking.formats.mot import detection_lines, write_tracks
from tsuiseki.tracking.onnx import kind_of
from tsuiseki.tracking.people.contract import shifted
from tsuiseki.tracking.people.given_detections import GivenDetections
from tsuiseki.tracking.people.printed_flow import ITERATIONS, PrintedFlow
from tsuiseki.tracking.people.run_log import FrameLog
from tsuiseki.tracking.people.settings import FindingOptions
from tsuiseki.tracking.people.tracker_choice import straddles
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.result import PageContent, Result, Writer
from tsuiseki.tracking.runs.following import Video, count, open_checked
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video.source import Source, SourceLike, named
from tsuiseki.tracking.weights import shipped

# Probability above which an action is named.
NAMED = 0.4
DronePreset = Literal["default", "printed"]
DRONE = DroneSettings()
SHOWN = showing(
    "drone", "window", "flow", "input", "detection", "offset", "costs", "link", "action", "weight",
    "neutral", "entry", "exit", "min_time", "fill",
)  # fmt: skip


@pydantic_dataclass(frozen=True, kw_only=True, config=SETTINGS)
class DroneFinding(FindingOptions):
    """Where the detections come from, under a drone."""

    score_range: Annotated[Commas[tuple[float, float] | None], HIDDEN] = None
    detector_options: Annotated[DetectorOptions, HIDDEN] = field(default_factory=DetectorOptions)


FINDING = DroneFinding()


def track_drone(
    source: SourceLike,
    method: DroneMethod = "flow-maf",
    *,
    detections: GivenDetections | None = None,
    detector: DetectorLike | None = None,
    appearance: AppearanceLike | None = None,
    actions: Sequence[str | Path] | None = None,
    affinity: str | Path | None = None,
    preset: DronePreset = "default",
    frames: str | None = None,
    settings: DroneSettings | None = None,
    threads: int = 0,
    device: Device = "auto",
    seed: int = 0,
) -> DroneResult:
    """Everyone in a video from a drone, each with an id and with what they do.

    Args:
        source: a video file, a folder of images, a MOTChallenge sequence folder, or images in a list.
        method: ``flow`` links by place and appearance; ``flow-saf`` also by actions of single frames; ``flow-maf``
            averages actions along the tracks, links again and repeats.
        detections: use these instead of a detector: a file (MOTChallenge ``det.txt``), or one entry a frame of
            whatever `as_detections` understands.
        detector: an exported detector's file, a `Detector`, or a function from an image to detections; by default the
            shipped one.
        appearance: an exported network's file, an `Appearance`, or a function from crops to rows; by default the
            shipped one; ``"none"`` does without.
        actions: files of exported action streams; by default the shipped ones. Not used by ``flow``.
        affinity: file of costs learnt on whole tracks; by default those of the settings. With the preset printed, of
            costs learnt on pairs by the features ``thesis`` or, but for ``flow``, ``thesis_action``.
        preset: ``printed`` links as the thesis prints it, see `PrintedFlow`: MCF, MHT-SAF, MHT-MAF.
        frames: these only, counted from 1 with both ends, such as ``"301-400"``.
        settings: of flow, alternation and output.
        threads: CPU threads of the networks; 0 takes all.
        device: what networks that are given as files run on, see `opened_on`.
        seed: draws nothing; the methods here are exact.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
        RunError: the video breaks off.
    """
    check_choice(method, get_args(DroneMethod), "method")
    check_choice(preset, get_args(DronePreset), "preset")
    settings = as_settings(settings, DroneSettings)
    opened = open_checked(source, frames, images=True, replayable=True)
    detector_options: Any = {"detections": detections, "detector": detector}
    with refused():
        finding = FindingOptions(**detector_options, threads=threads, device=device, view="auto")
    streams = None if actions is None else [a_path(path, "actions") for path in actions]
    moving = preset == "default"
    models = DroneModels.choose(opened, method, finding, appearance, streams, camera_motion=moving)
    times = StageTimes()
    costs = link_costs(affinity, preset, method, threads)
    observations = observe(opened.frames(), models.observers, times)
    run_settings = {"method": method, "source": named(source), "seed": seed}
    return link(observations, opened, models, method, settings, times, run_settings, costs)


def link_costs(
    affinity: str | Path | None, preset: DronePreset, method: DroneMethod, threads: int
) -> CostNetwork | PrintedFlow | None:
    """Costs learnt on whole tracks, or the flow of the preset printed, which learns its costs on pairs.

    Raises:
        RequestError: the file holds costs of the other kind, or of other features than the method has.
    """
    if preset == "printed":
        chosen = (
            shipped("affinity_printed_drone" if method == "flow" else "affinity_printed_drone_action")
            if affinity is None
            else affinity
        )
        pairs = Affinity(chosen, threads)
        if method != "flow" and pairs.features != "thesis_action":
            raise RequestError(f"expected costs by the features thesis_action with {method}, got {pairs.features}")
        return PrintedFlow(pairs, 1 if method == "flow-saf" else ITERATIONS)
    if affinity is None:
        return None
    if kind_of(affinity) == "affinity":
        raise RequestError(
            f"{affinity}: expected costs learnt on whole tracks, got costs learnt on pairs; use `preset` printed, or "
            "learn them by train association --data.tracker drone"
        )
    return CostNetwork(affinity, threads)


@dataclass(frozen=True, eq=False, repr=False)
class DroneResult(Result[ActingTrack]):
    """People and what they do; an action is named where its probability is above the threshold."""

    threshold: float = NAMED

    @property
    def boxes(self) -> list[Track]:
        """The tracks without the actions."""
        return [person.track for person in self]


def link(
    observations: Iterable[Observation],
    source: Source,
    models: DroneModels,
    method: DroneMethod,
    settings: DroneSettings,
    times: StageTimes,
    run_settings: Mapping[str, Any],
    costs: CostNetwork | PrintedFlow | None = None,
    threshold: float = NAMED,
) -> DroneResult:
    """The people of a video out of what ``models`` observed in its frames.

    ``costs`` are by how much learnt costs differ from the settings', by default not at all, or the flow as printed. An
    action is named where its probability is above the ``threshold``. ``run_settings`` are kept with the result.

    Raises:
        RunError: there is no frame.
    """
    from tsuiseki.tracking.drone.page import action_timelines, captions_of
    from tsuiseki.tracking.report.overlay import Overlay

    watching, log = models.observers, FrameLog()
    facts = dict[str, Any](devices_of(watching.detect, watching.describe, watching.recognise))
    logged, network = _logged(observations, log), None
    if models.right_tracks is not None:
        people = _named(logged, models, models.right_tracks, settings, source.frame_rate, log)
    else:
        tracker = DroneTracker(
            suited(settings, method),
            source.frame_rate,
            source.size,
            costs,
            pictures=watching.camera,
            drop_straddling=straddles(watching.detect),
        )
        people = _linked(logged, tracker, method, times, log)
        facts["flow"], network = tracker.facts(), tracker.network()
    tracks = [person.track for person in people]
    files: dict[str, Writer] = {"tracks.txt": lambda path, _: write_tracks(path, tracks)}
    files["tracks.json"] = lambda path, _: write_acting_tracks(path, people, models.names)
    if network is not None:
        moved = replace(network, frames=network.frames + log.frames[0])
        files[NETWORK_FILE] = lambda path, _: moved.write(path)
    result: DroneResult = DroneResult.of(
        source,
        people,
        settings=run_settings,
        facts=facts,
        seconds=times.seconds,
        frames=log.columns(tracks),
        files=files,
        painter=Overlay(tracks, source.frame_rate, captions_of(people, models.names, threshold), 0.0).draw,
        names=models.names,
        threshold=threshold,
    )
    return replace(result, page=PageContent(sections=lambda: [action_timelines(result, threshold)]))


def _linked(
    observations: Iterable[Observation], tracker: DroneTracker, method: DroneMethod, times: StageTimes, log: FrameLog
) -> list[ActingTrack]:
    """The people whom ``tracker`` finds."""
    for observation in observations:
        actions = None if observation.actions is None or method == "flow" else averaged(observation.actions)
        with times.measure("link"):
            tracker.update(replace(observation.detections, actions=actions), observation.motion)
    with times.measure("link"):
        return [replace(person, track=shifted(person.track, log.frames[0])) for person in tracker.people()]


def _logged(observations: Iterable[Observation], log: FrameLog) -> Iterator[Observation]:
    """The observations, noted in ``log``; raises RunError where there is none."""
    for observation in observations:
        log.add(observation.frame, observation.detections)
        yield observation
    if not log.frames:
        raise RunError("expected frames, got none")


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
    tracks: Sequence[Track],
    settings: DroneSettings,
    frame_rate: float,
    log: FrameLog,
) -> list[ActingTrack]:
    """``tracks`` with what the observations of their boxes say that people do."""
    unknown = np.empty((0, len(models.names)))
    parts = [unknown if observation.actions is None else averaged(observation.actions) for observation in observations]
    boxes, labels = tracks_as_detections(tracks)
    first = sum(len(frame_boxes) for frame_boxes in boxes[: log.frames[0]])
    labels = labels[first : first + sum(log.detections)]
    rows = rows_of(boxes[log.frames[0] : log.frames[-1] + 1] or [Detections.empty()], log.frames[0], 0)
    actions, half = np.concatenate(parts), round(settings.window / 2 * frame_rate)
    people = []
    for number, piece in enumerate(long_tracks(labels), start=1):
        track = Track(number, rows.frames[piece], rows.boxes[piece], np.nan_to_num(rows.scores[piece]))
        people.append(acting_track(track, actions[piece], half))
    return people


def drone(
    video: Video,
    *,
    output: Output,
    finding: DroneFinding = FINDING,
    method: DroneMethod = "flow-maf",
    actions: Commas[list[Path] | None] = None,
    tracks: Path | None = None,
    affinity: Path | None = None,
    preset: DronePreset = "default",
    keep_camera_motion: bool = False,
    threshold: Share = NAMED,
    cache: Path | None = None,
    drone: Annotated[DroneSettings, SHOWN] = DRONE,
) -> int:
    """Track the people in a video from a drone, and name what each is doing.

    People are detected, described and their actions recognised by the models that ship with the toolkit; a minimum-cost
    flow links them. DIR gets tracks.txt (MOTChallenge text), tracks.json (with actions), report.html with its
    plots and numbers in report/, run.json and, with --overlay, overlay.webm.

    Args:
        method: flow links by place, motion and appearance; flow-saf also by actions of single frames; flow-maf averages
            actions along the tracks, links again and repeats.
        finding.detector: detector as ONNX, or the name of a shipped one; by default drone_larger. One of other projects
            is recognised as by track people.
        actions: exported action streams, separated by commas; by default the four shipped ones. Method flow
            uses them with --tracks alone.
        tracks: right tracks (gt.txt, tracks.txt) or Okutama-Action labels; then only actions are named.
        affinity: costs learnt on whole tracks as ONNX (train association with --data.tracker drone); by default those
            of --drone. With --preset printed, costs learnt on pairs (train affinity --features thesis_action).
        preset: printed links as the thesis prints it, by the overlap, appearance and actions of pairs: flow is MCF,
            flow-saf MHT-SAF and flow-maf MHT-MAF.
        keep_camera_motion: estimate the camera's motion from the boxes instead of the pictures.
        threshold: an action is named above this probability, 0 to 1.
        cache: folder that keeps the outputs of the networks, so that a second run with another method or --drone takes
            seconds.
        drone: settings of the flow and of what is reported.
    """
    costs = link_costs(affinity, preset, method, finding.threads)
    source, moving = video.open(images=True, replayable=True), not keep_camera_motion and preset == "default"
    models = DroneModels.choose(source, method, finding, finding.appearance, actions, tracks, camera_motion=moving)
    with output.run() as run:
        run.facts |= report_models(models.observers.detect, models.observers.describe, models.observers.recognise)
        if cache is None:
            observed = observe(run.frames(source), models.observers, run.times)
        else:
            observed = video_observations(source, models.observers, models.keys, cache, run.times)
        line = None if finding.detections or cache else lambda number, here: detection_lines(number, here.detections)
        saved = run.kept("detections.txt", ((observation.frame, observation) for observation in observed), line)
        steps = run.steps(observation for _, observation in saved)
        result = link(steps, source, models, method, drone, run.times, output.settings, costs, threshold)
        if unknown := result.facts.get("flow", {}).get("camera_unknown"):
            print(line_on_camera(unknown))
        report_blank(models.observers.detect)
        run.save(result, lambda: video.draw(run, source, result))
        run.done(f"{count(len(result), 'person', 'people')} in {run.count} frames: {output.out / 'tracks.txt'}")
    return run.status
