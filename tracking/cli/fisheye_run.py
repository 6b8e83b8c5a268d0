"""The run of `tsuiseki track fisheye` over one camera, and what it writes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.floor_files import CameraOverFloor
from tsuiseki.tracking.cli.people_run import plain
from tsuiseki.tracking.cli.progress import progress
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.features.networks import Detect
from tsuiseki.tracking.formats.mot import write_tracks
from tsuiseki.tracking.formats.world import write_world
from tsuiseki.tracking.output import RunRecord
from tsuiseki.tracking.pipelines.ceiling import CeilingView
from tsuiseki.tracking.report.floor import dwell_figure, floor_figure, floor_page, write_floor_overlay
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.fisheye import (
    FisheyeSettings,
    FisheyeTracker,
    FloorDetections,
    FloorFlowSettings,
    flow_on_floor,
)
from tsuiseki.tracking.trackers.run import FrameLog
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.types.tracks import FloorTrack
from tsuiseki.tracking.video import Source


@dataclass(frozen=True)
class Chosen:
    """The method, and the settings of both."""

    method: str
    hungarian: FisheyeSettings
    flow: FloorFlowSettings


@dataclass(frozen=True)
class CameraRun:
    """What came of one camera."""

    camera: CameraOverFloor
    floor: FloatArray
    source: Source
    frame_rate: float
    tracks: list[FloorTrack]
    log: FrameLog


def run_camera(
    camera: CameraOverFloor,
    floor: FloatArray,
    source: Source,
    detect: Detect | None,
    given: Sequence[Detections] | None,
    view: CeilingView,
    chosen: Chosen,
    times: StageTimes,
) -> CameraRun:
    """Track one source to its end.

    Raises:
        RunError: the video has no frame.
    """
    rate = camera.frame_rate or source.frame_rate
    log = FrameLog()
    online = FisheyeTracker(rate, chosen.hungarian)
    kept: list[FloorDetections] = []
    for index, found in progress(
        _located(source, detect, given, view, times), f"tracking {camera.name}", source.length
    ):
        log.add(index, found.detections)
        if chosen.method == "flow":
            kept.append(found)
            continue
        with times.measure("associate"):
            online.update(found)
    if not log.frames:
        raise RunError(f"{source.name}: expected frames, got none")
    with times.measure("associate"):
        tracks = flow_on_floor(kept, rate, chosen.flow) if chosen.method == "flow" else online.tracks()
    return CameraRun(camera, floor, source, rate, tracks, log)


def _located(
    source: Source,
    detect: Detect | None,
    given: Sequence[Detections] | None,
    view: CeilingView,
    times: StageTimes,
) -> Iterator[tuple[int, FloorDetections]]:
    if detect is None and view.appearance is None:
        assert given is not None
        for index in range(source.length if source.length is not None else len(given)):
            found = given[index] if index < len(given) else Detections.empty()
            yield index, view.locate(found, times)
        return
    for frame in source.frames():
        if detect is None:
            assert given is not None
            found = given[frame.index] if frame.index < len(given) else Detections.empty()
        else:
            with times.measure("detect"):
                found = detect.detect([frame.image])[0]
        yield frame.index, view.describe(frame.image, view.locate(found, times), times)


def write_fisheye_run(
    work: Path, out: Path, runs: Sequence[CameraRun], given: Mapping[str, Any], times: StageTimes, *, overlay: bool
) -> int:
    """Write everything into ``work``, which becomes ``out``; returns the exit status."""
    videos: list[Path] = []
    for run in runs:
        folder = work if len(runs) == 1 else work / run.camera.name
        folder.mkdir(exist_ok=True)
        write_tracks(folder / "tracks.txt", [t.track for t in run.tracks])
        write_world(folder / "world.csv", run.tracks, run.frame_rate)
        spot = run.camera.camera.position[None, :2]
        floor_figure(run.tracks, run.floor, spot).savefig(folder / "floor.png", dpi=120, facecolor="white")
        dwell_figure(run.tracks, run.floor, run.frame_rate).savefig(folder / "dwell.png", dpi=120, facecolor="white")
        if overlay:
            videos.append(folder / "overlay.webm")
            frames = progress(run.source.frames(), f"drawing {run.camera.name}", len(run.log.frames))
            write_floor_overlay(videos[-1], frames, run.tracks, run.frame_rate)
    settings = {name: plain(value) for name, value in given.items()}
    page = floor_page(
        [run.camera.name for run in runs],
        [run.tracks for run in runs],
        runs[0].floor,
        np.array([run.camera.camera.position[:2] for run in runs]),
        [run.frame_rate for run in runs],
        videos,
        times.seconds,
        {name: str(value) for name, value in settings.items() if value is not None},
    )
    (work / "report.html").write_text(page, encoding="utf-8")
    columns = runs[0].log.columns([t.track for t in runs[0].tracks]) if len(runs) == 1 else {}
    RunRecord(["tsuiseki", "track", "fisheye"], settings, int(given["seed"]), times.seconds, columns).write(work)
    for run in runs:
        print(f"{run.camera.name}: {len(run.tracks)} people in {len(run.log.frames)} frames")
    print(f"results: {out}")
    return 0
