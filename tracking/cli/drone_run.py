"""A run of `tsuiseki track drone`: observe, link, write."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.association.action_refinement import Prices
from tsuiseki.tracking.cli.drone_models import DroneModels, Method
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.video_observations import video_observations
from tsuiseki.tracking.formats.acting_tracks import write_acting_tracks
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.output import RunRecord
from tsuiseki.tracking.report.actions import ActionReport, action_page, captions_of
from tsuiseki.tracking.report.overlay import write_overlay
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.drone import DroneSettings, DroneTracker
from tsuiseki.tracking.trackers.given import as_detections
from tsuiseki.tracking.trackers.run import FrameLog, shifted
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video import Source

TRACKS_FILE, ACTING_FILE, REPORT_FILE, OVERLAY_FILE = "tracks.txt", "tracks.json", "report.html", "overlay.webm"


@dataclass(frozen=True)
class DroneRun:
    """A finished run.

    Attributes:
        people: with their actions, frames as the video counts them.
        names: of the actions.
        log: what happened in each frame.
    """

    people: list[ActingTrack]
    names: tuple[str, ...]
    log: FrameLog


def run_drone(
    source: str,
    opened: Source,
    models: DroneModels,
    method: Method,
    settings: DroneSettings,
    prices: Prices,
    cache: Path | None,
    times: StageTimes,
) -> DroneRun:
    """Track a video; see `tsuiseki track drone --help`."""
    given, labels = (None, None) if models.given is None else as_detections(models.given)
    tracker = DroneTracker(_suited(settings, method, given=given is not None), prices)
    uses_actions = method != "flow" or given is not None
    log = FrameLog()
    seen = video_observations(source, models.observers, models.key, cache, opened.frames_wanted, times, models.richer)
    for one in progress(seen, "tracking", _expected(opened)):
        log.add(one.frame, one.detections)
        actions = None if one.actions is None else averaged(one.actions)
        with times.measure("link"):
            tracker.update(one.detections, actions if uses_actions else None, one.motion)
    if not log.frames:
        raise RunError(f"{opened.name}: expected frames, got none")
    with times.measure("link"):
        if labels is not None:
            first = sum(len(found) for found in (given or [])[: log.frames[0]])
            people = tracker.people_with(labels[first : first + sum(log.detections)])
        else:
            people = tracker.people()
    numbered = [replace(one, track=shifted(one.track, log.frames[0])) for one in people]
    return DroneRun(numbered, models.names, log)


def write_drone_run(
    folder: Path, run: DroneRun, record: RunRecord, source: Source, threshold: float, *, overlay: bool
) -> None:
    """Write tracks, actions, report, ``run.json`` and, with ``overlay``, the video."""
    tracks = [person.track for person in run.people]
    write_tracks(folder / TRACKS_FILE, tracks)
    write_acting_tracks(folder / ACTING_FILE, run.people, run.names)
    if overlay:
        captions = captions_of(run.people, run.names, threshold)
        write_overlay(folder / OVERLAY_FILE, source.frames(), tracks, source.frame_rate, captions, 0.0)
    report = ActionReport(source.name, run.people, run.names, run.log.frames, threshold, source.frame_rate)
    video = folder / OVERLAY_FILE if overlay else None
    (folder / REPORT_FILE).write_text(action_page(report, video, record.seconds), encoding="utf-8")
    record.frames = run.log.columns(tracks)
    record.write(folder)


def _suited(settings: DroneSettings, method: Method, *, given: bool) -> DroneSettings:
    """The settings with as many iterations as the method has; given tracks stay as they are."""
    if given:
        return replace(settings, min_detections=1, gaps=None, smoothing=None, chunk=None)
    if method == "flow-maf":
        return settings
    return replace(settings, refinement=replace(settings.refinement, iterations=1))


def _expected(source: Source) -> int | None:
    if source.length is None:
        return None
    stretch = source.frames_wanted.within(source.length)
    assert stretch.last is not None
    return stretch.last - stretch.first + 1
