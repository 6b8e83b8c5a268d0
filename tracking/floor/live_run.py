"""`tsuiseki track floor` on cameras that run, written down meanwhile; see `runs.rolling`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.camera_files import CameraOverFloor, read_cameras
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.features.exported import Describe, Detect, as_describer, as_detector
from tsuiseki.tracking.fisheye.unrolled import ceiling_detector
from tsuiseki.tracking.floor.delayed_floor import DelayedFloor
from tsuiseki.tracking.floor.live_floor import FloorLoop
from tsuiseki.tracking.floor.measured_floor import CameraFeed, check_feeds, plan_of
from tsuiseki.tracking.formats.track_tables import covariance_names
from tsuiseki.tracking.people.settings import NONE, Detecting
from tsuiseki.tracking.runs.options import Output
from tsuiseki.tracking.runs.rolling import LiveOptions, RollingFolder, Watch, unwatched
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.live import CameraOutage, LiveEvent, PeopleOnFloor
from tsuiseki.tracking.video.frame_source import Source
from tsuiseki.tracking.video.live import LiveSource
from tsuiseki.tracking.video.several import SeveralSources, open_several
from tsuiseki.tracking.weights import shipped

# Seconds of delay where nothing is said.
DELAY = 3.0
# Hours of each part of the result where nothing is said.
HOURS = 1.0
# Of the shortest time between frames: cameras of one rate have a frame each in all moments but the first.
HALF = 0.5
# Names of the columns of a covariance on the floor.
COVARIANCE = covariance_names(2)


@dataclass(frozen=True)
class LiveFloor:
    """Cameras over a floor, opened and checked, and what detects people in them.

    Attributes:
        placed: the cameras.
        videos: one of each.
        detect: likewise.
        describe: adds features; None for none.
        floor: ``(4,)`` of the plan.
        delay: seconds.
        tolerance: seconds within which frames count as taken together.
    """

    placed: Sequence[CameraOverFloor]
    videos: Sequence[Source]
    detect: Sequence[Detect]
    describe: Describe | None
    floor: np.ndarray
    delay: float
    tolerance: float

    def events(self, sources: SeveralSources, ids: int = 0, with_images: bool = False) -> Iterator[LiveEvent]:
        """What happens in the videos, which are the ``sources``; ids go on after ``ids``."""
        solver = DelayedFloor(self.placed, self.floor, self.delay, ids)
        loop = FloorLoop(
            self.placed, sources, self.videos, self.detect, self.describe, solver, self.tolerance, with_images
        )
        return loop.events()


def open_live_floor(
    sources: Sequence[Any],
    cameras: str | Path | None,
    detecting: Detecting,
    delay: float | None = None,
    tolerance: float | None = None,
    floor: Sequence[float] | None = None,
    give_up: float | None = None,
    frames: FrameRange = EVERY_FRAME,
) -> LiveFloor:
    """Everything opened and checked; a live camera that is not there yet is waited for.

    Raises:
        RequestError: something of this cannot be used; the message says what and why.
    """
    if cameras is None:
        raise RequestError("`cameras`: expected cameras.yaml with the sources, got none")
    placed = read_cameras(a_path(cameras, "cameras"))
    if len(sources) != len(placed):
        raise RequestError(
            f"expected one source for each camera, got {len(sources)} and {len(placed)} cameras in {cameras}; give "
            "them in the order of its entries"
        )
    plan = plan_of(placed, floor)
    if plan is None:
        raise RequestError("`floor`: expected X1,Y1,X2,Y2 of the plan, or `floor` in cameras.yaml, got neither")
    check_feeds([CameraFeed(entry, np.zeros(1), []) for entry in placed])
    videos = [
        replace(video, size=(entry.camera.width, entry.camera.height), awaited=True)
        if isinstance(video, LiveSource)
        else video
        for video, entry in zip(open_several(sources, frames, give_up=give_up), placed, strict=True)
    ]
    detector = as_detector(
        detecting.detector or shipped("detector_people"), detecting.threshold, detecting.threads,
        device=detecting.device,
    )  # fmt: skip
    detect = [
        detector if isinstance(entry.camera, PinholeCamera) else ceiling_detector(detector, entry.camera, "unrolled")
        for entry in placed
    ]
    describe = None
    if str(detecting.appearance) != NONE:
        network = detecting.appearance or shipped("appearance_people")
        describe = as_describer(network, detecting.threads, device=detecting.device)
    fastest = max(entry.frame_rate or video.frame_rate for entry, video in zip(placed, videos, strict=True))
    return LiveFloor(
        placed, videos, detect, describe, plan, DELAY if delay is None else delay,
        HALF / fastest if tolerance is None else tolerance,
    )  # fmt: skip


def floor_live(
    output: Output,
    opened: LiveFloor,
    live: LiveOptions,
    watch: Watch = unwatched,
) -> int:
    """Follow people until the cameras or the user end it; the rows of each moment are written at once.

    Args:
        output: where to.
        opened: see `open_live_floor`.
        live: hours of each part of the result.
        watch: gives who gets each event after it was written.

    Returns:
        The number of people.

    Raises:
        RequestError: see `RollingFolder.opened`.
        RunError: a camera is given up, or a recording breaks off.
    """
    rate = max(video.frame_rate for video in opened.videos)
    table = ("world.csv", ("frame", "time", "id", "x", "vx", "y", "vy", *COVARIANCE, "existence", "cameras"))
    about = {"source": opened.videos[0].address, "frame_rate": rate, "size": opened.videos[0].size}
    folder = RollingFolder(output, live.roll or HOURS, table, rate, about)
    sources = SeveralSources(opened.videos, folder.stopped)
    folder.states = sources.states
    with folder.opened(), watch(sources.states) as observers:
        for event in opened.events(sources, folder.ids, bool(observers)):
            if sources.live:
                folder.check_clock(sources.clock.wall(), sources.clock.monotonic())
            if isinstance(event, PeopleOnFloor):
                _write(folder, event, [entry.name for entry in opened.placed])
            elif isinstance(event, CameraOutage):
                folder.camera_outage(event)
            for observe in observers:
                observe(event)
        return folder.ids


def _write(folder: RollingFolder, event: PeopleOnFloor, names: Sequence[str]) -> None:
    upper = np.triu_indices(4)

    def rows(number: int) -> list[list[object]]:
        return [
            [
                number, f"{event.time:.3f}", int(event.ids[k]),
                *(f"{v:.5g}" for pair in zip(event.places[k], event.velocities[k], strict=True) for v in pair),
                *(f"{v:.5g}" for v in event.covariances[k][upper]), f"{event.existence[k]:.4g}",
                " ".join(name for name, detected in zip(names, event.detected[k], strict=True) if detected),
            ]
            for k in range(len(event.ids))
        ]  # fmt: skip

    folder.add(event.time, event.moment, event.ids.tolist(), rows)
