"""What a run gives: the tracks of people, and what is known of how they came to be."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from tsuiseki.tracking.association.solved_network import NETWORK_FILE
from tsuiseki.tracking.features.camera_path import line_on_camera
from tsuiseki.tracking.features.view_choice import ViewedDetector, devices_of
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.people.by_class import ByClass
from tsuiseki.tracking.people.contract import PeopleTracker
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.motion_compensated import inner_tracker
from tsuiseki.tracking.people.opening import OpenedPeople
from tsuiseki.tracking.people.run_log import FirstDetections, run_trackers
from tsuiseki.tracking.result import PageContent, Result, Writer
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Targets, Track
from tsuiseki.tracking.types.class_choice import called


def people_result(
    opened: OpenedPeople,
    steps: Iterable[tuple[int, Detections]],
    times: StageTimes,
    settings: Mapping[str, Any],
    observe: Callable[[Targets], object] | None = None,
) -> tuple[Result[Track], list[str]]:
    """The result of a run, and what of its facts is worth a line to the user.

    Args:
        opened: what runs.
        steps: 0-based frame numbers and the detections there, consecutive.
        times: of the run.
        settings: of the run; those named ``method`` and ``source`` are shown on its page.
        observe: gets what the tracker answers while it runs.
    """
    from tsuiseki.tracking.report.overlay import Overlay

    video, name = opened.inputs.source, settings["method"]
    tracks_by_name, log = run_trackers(steps, {name: opened.tracker}, times, opened.inputs.inferred, observe)
    tracks = tracks_by_name[name]
    facts, lines = facts_of(opened, 1000 * times.seconds.get("detect", 0.0) / max(len(log.frames), 1))
    network = opened.tracker.network() if isinstance(opened.tracker, FlowTracker) else None
    if network is not None and log.frames:
        network = replace(network, frames=network.frames + log.frames[0])
    files: dict[str, Writer] = {"tracks.txt": lambda path, _: write_tracks(path, tracks)}
    if network is not None:
        files[NETWORK_FILE] = lambda path, _: network.write(path)
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
        files=files,
        painter=Overlay.of_people(tracks, video.frame_rate, video.size, max([-1, *log.frames]) + 1),
        page=PageContent(quality=True),
        network=None if network is None else lambda: network,
    )
    return result, [*lines, *unused]


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
        flows = {number: flow for number, flow in tracker.trackers.items() if isinstance(flow, FlowTracker)}
        if flows:
            facts["flow"] = {str(number): flow.facts() for number, flow in flows.items()}
        lines += [f"class {number}: {line}" for number, flow in flows.items() for line in _lines_on_flow(flow)]
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
        groups = {number: (tracker.first[number], inner_tracker(linker)) for number, linker in tracker.trackers.items()}
    for number, (detections, linker) in groups.items():
        ours = [track for track in tracks if number == -1 or track.class_id in called(number, track.names)]
        line = detections.line(sum(int(t.observed.sum()) for t in ours), len(ours), getattr(linker, "settings", None))
        lines += [] if line is None else [line if number == -1 else f"class {number}: {line}"]
    return lines
