"""What `tsuiseki track drone` and `tsuiseki demo --scene drone` share: observe, link, write."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tsuiseki.tracking.association.flow.cost_network import CostChanges
from tsuiseki.tracking.cli.options import Video
from tsuiseki.tracking.cli.run import Run, frames_expected
from tsuiseki.tracking.drone.models import DroneMethod, DroneModels
from tsuiseki.tracking.drone.observations import Observation, observe
from tsuiseki.tracking.drone.page import ActionReport, action_page, captions_of
from tsuiseki.tracking.drone.tracker import DroneSettings
from tsuiseki.tracking.drone.tracking import DroneResult, link
from tsuiseki.tracking.drone.video_observations import video_observations
from tsuiseki.tracking.formats.acting_tracks import write_acting_tracks
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.report.overlay import write_overlay
from tsuiseki.tracking.video.source import Source


def follow(
    run: Run,
    source: Source,
    models: DroneModels,
    method: DroneMethod,
    settings: DroneSettings,
    cache: tuple[str, Path] | None = None,
    changes: CostChanges | None = None,
) -> DroneResult:
    """Track a video.

    Args:
        run: gets its steps.
        source: the video.
        models: detector, networks and their key.
        method: how people are linked.
        settings: of the tracker.
        cache: the name of the source, and the folder that keeps what the models say of it.
        changes: by how much learnt costs differ from the settings'.
    """
    steps = run.steps(_observations(run, source, models, cache), total=frames_expected(source))
    return link(steps, source, models, method, settings, run.times, changes)


def _observations(
    run: Run, source: Source, models: DroneModels, cache: tuple[str, Path] | None
) -> Iterator[Observation]:
    if cache is None:
        return observe(run.frames(source), models.observers, run.times)
    name, folder = cache
    wanted = source.frames_wanted
    return video_observations(name, models.observers, models.key, folder, wanted, run.times, models.superset_key)


def write_result(
    run: Run, found: DroneResult, source: Source, threshold: float, folder: str = "", video: Video | None = None
) -> None:
    """Write tracks, actions, report and, as ``video`` asks, an overlay, into ``folder`` of the result."""
    run.columns = found.log.columns(found.tracks)
    run.write(f"{folder}tracks.txt", lambda path: write_tracks(path, found.tracks))
    run.write(f"{folder}tracks.json", lambda path: write_acting_tracks(path, found.people, found.names))
    drawn = None
    if video is not None:
        captions, rate = captions_of(found.people, found.names, threshold), source.frame_rate
        drawn = video.draw(
            run, source, lambda path, again: write_overlay(path, again, found.tracks, rate, captions, 0.0)
        )
    report = ActionReport(source.name, found.people, found.names, found.log.frames, threshold, source.frame_rate)
    page = action_page(report, drawn, run.times.seconds)
    run.write(f"{folder}report.html", lambda path: path.write_text(page, encoding="utf-8"))
