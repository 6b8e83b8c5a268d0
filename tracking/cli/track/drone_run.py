"""What `tsuiseki track drone` and `tsuiseki demo --scene drone` share: observe, link, write."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from tsuiseki.tracking.association.action_refinement import Prices
from tsuiseki.tracking.cli.run import Run, frames_expected
from tsuiseki.tracking.cli.track.drone_models import DroneModels, Method
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.observations import Observation, observe
from tsuiseki.tracking.features.video_observations import video_observations
from tsuiseki.tracking.formats.acting_tracks import write_acting_tracks
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.report.actions import ActionReport, action_page, captions_of
from tsuiseki.tracking.report.overlay import write_overlay
from tsuiseki.tracking.trackers.drone import DroneSettings, DroneTracker
from tsuiseki.tracking.trackers.given import as_detections
from tsuiseki.tracking.trackers.run import FrameLog, shifted
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.tracking.video import Source


@dataclass(frozen=True)
class DroneResult:
    """People and what they do.

    Attributes:
        people: with their actions, frames as the video counts them.
        names: of the actions.
        log: what happened in each frame.
    """

    people: list[ActingTrack]
    names: tuple[str, ...]
    log: FrameLog

    @property
    def tracks(self) -> list[Track]:
        """Without the actions."""
        return [person.track for person in self.people]


def follow(
    run: Run,
    source: Source,
    models: DroneModels,
    method: Method,
    settings: DroneSettings,
    prices: Prices,
    cache: tuple[str, Path] | None = None,
) -> DroneResult:
    """Track a video.

    Args:
        run: gets its steps.
        source: the video.
        models: what looks at it.
        method: how people are linked.
        settings: of the tracker.
        prices: of links.
        cache: the name of the source, and the folder that keeps what the models say of it.
    """
    given, labels = (None, None) if models.given is None else as_detections(models.given)
    tracker = DroneTracker(_suited(settings, method, given=given is not None), prices)
    uses_actions = method != "flow" or given is not None
    log = FrameLog()
    for one in run.steps(_observations(run, source, models, cache), total=frames_expected(source)):
        log.add(one.frame, one.detections)
        actions = None if one.actions is None else averaged(one.actions)
        with run.times.measure("link"):
            tracker.update(one.detections, actions if uses_actions else None, one.motion)
    with run.times.measure("link"):
        if labels is not None:
            first = sum(len(found) for found in (given or [])[: log.frames[0]])
            people = tracker.people_with(labels[first : first + sum(log.detections)])
        else:
            people = tracker.people()
    numbered = [replace(one, track=shifted(one.track, log.frames[0])) for one in people]
    return DroneResult(numbered, models.names, log)


def _observations(
    run: Run, source: Source, models: DroneModels, cache: tuple[str, Path] | None
) -> Iterator[Observation]:
    if cache is None:
        return observe(run.frames(source), models.observers, run.times)
    name, folder = cache
    wanted = source.frames_wanted
    return video_observations(name, models.observers, models.key, folder, wanted, run.times, models.richer)


def write_result(
    run: Run, found: DroneResult, source: Source, threshold: float, folder: str = "", overlay: str | None = None
) -> None:
    """Write tracks, actions, report and, with the name ``overlay``, the video, into ``folder`` of the result."""
    run.columns = found.log.columns(found.tracks)
    run.write(f"{folder}tracks.txt", lambda path: write_tracks(path, found.tracks))
    run.write(f"{folder}tracks.json", lambda path: write_acting_tracks(path, found.people, found.names))
    drawn = None
    if overlay is not None:
        captions = captions_of(found.people, found.names, threshold)
        drawn = run.draw(
            f"{folder}{overlay}",
            lambda path: write_overlay(path, run.replay(source), found.tracks, source.frame_rate, captions, 0.0),
        )
    report = ActionReport(source.name, found.people, found.names, found.log.frames, threshold, source.frame_rate)
    page = action_page(report, drawn, run.times.seconds)
    run.write(f"{folder}report.html", lambda path: path.write_text(page, encoding="utf-8"))


def _suited(settings: DroneSettings, method: Method, *, given: bool) -> DroneSettings:
    """The settings with as many iterations as the method has; given tracks stay as they are."""
    if given:
        return replace(settings, min_detections=1, gaps=None, smoothing=None, chunk=None)
    if method == "flow-maf":
        return settings
    return replace(settings, refinement=replace(settings.refinement, iterations=1))
