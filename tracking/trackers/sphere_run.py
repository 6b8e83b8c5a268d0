"""A ball through several videos: alignment, search at the start and after a loss, and what is kept of each moment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from tsuiseki.tracking.cameras.files import PlacedCamera
from tsuiseki.tracking.cameras.volume import in_sight
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.synchronise import Moment, moments_with_images
from tsuiseki.tracking.timing import StageTimes
from tsuiseki.tracking.trackers.sphere import Glance, SphereState, SphereTracker
from tsuiseki.tracking.types import FloatArray, Frame, ImageArray, Position

Seen: TypeAlias = tuple[Moment, list[ImageArray | None]]

# Frames of different length at the end of two videos that are still taken for the same recording.
SLACK_FRAMES = 2


@dataclass(frozen=True)
class Start:
    """Where the ball is looked for first.

    Attributes:
        position: ``(3,)`` metres; None searches the volume.
        spread: standard deviation around it, m.
        volume: ``(2, 3)`` corners in which a lost ball is searched, m.
        particles: how many.
    """

    position: FloatArray | None
    spread: float
    volume: FloatArray
    particles: int


@dataclass
class SphereLog:
    """What a run keeps.

    Attributes:
        positions: one a moment.
        moments: which frames they are of.
        searches: indices of the moments at which the volume was searched.
    """

    positions: list[Position] = field(default_factory=list)
    moments: list[Moment] = field(default_factory=list)
    searches: list[int] = field(default_factory=list)


def check_start(position: FloatArray, cameras: Sequence[PlacedCamera]) -> None:
    """Refuse a start that no two cameras can see.

    Raises:
        RequestError: it lies behind a camera, or in fewer than two images.
    """
    depths = [float(placed.camera.to_camera(position[None])[0, 2]) for placed in cameras]
    seen = sum(bool(in_sight(placed.camera, position[None])[0]) for placed in cameras)
    shown = ",".join(f"{v:g}" for v in position)
    behind = [placed.name for placed, depth in zip(cameras, depths, strict=True) if depth <= 0]
    if behind and seen < 2:
        raise RequestError(f"expected the ball before the cameras, but {shown} lies behind {behind[0]}; check --start")
    if seen < 2:
        raise RequestError(f"expected a start that two cameras see, but {shown} is in {seen} of {len(cameras)} images")


def check_lengths(times: Sequence[FloatArray], names: Sequence[str]) -> None:
    """Refuse videos that cannot have been recorded side by side, frame for frame.

    Raises:
        RequestError: they end more than `SLACK_FRAMES` frames apart.
    """
    ends = np.array([t[-1] for t in times])
    step = max(float(np.median(np.diff(t))) if len(t) > 1 else 0.0 for t in times)
    first, last = int(ends.argmin()), int(ends.argmax())
    if ends[last] - ends[first] > SLACK_FRAMES * step + 1e-9:
        raise RequestError(
            f"expected videos of one length, but {names[first]} ends at {ends[first]:.2f} s and {names[last]} at "
            f"{ends[last]:.2f} s; say how they lie in time with --timestamps or --offsets"
        )


def run_sphere(
    tracker: SphereTracker,
    start: Start,
    moments: Sequence[Moment],
    videos: Sequence[Iterator[Frame]],
    rng: np.random.Generator,
    times: StageTimes,
    watch: Callable[[Iterable[Seen]], Iterable[Seen]],
) -> SphereLog:
    """Track through all moments; a ball that is lost is searched in the volume again.

    Args:
        tracker: the filter.
        start: where to look first.
        moments: in order of time.
        videos: the frames of each camera.
        rng: random numbers.
        times: gets the seconds of each stage.
        watch: passes the moments through, for progress and interruption.

    Raises:
        RunError: no moment had an image.
    """
    log = SphereLog()
    state: SphereState | None = None
    for moment, images in watch(moments_with_images(moments, videos)):
        glance = Glance(moment.time, images)
        if state is None:
            state = _begin(tracker, start, glance, rng, times, log)
        elif state.unseen > tracker.patience and sum(image is not None for image in images) >= 2:
            with times.measure("search"):
                unseen = state.unseen
                state = tracker.search(start.volume, glance, start.particles, rng)
                state = SphereState(state.particles, state.time, state.open, unseen)
            log.searches.append(len(log.positions))
        with times.measure("filter"):
            state, info = tracker.step(state, glance, rng)
        log.positions.append(info.position)
        log.moments.append(moment)
    if not log.positions:
        raise RunError("expected frames in all videos, got none")
    return log


def _begin(
    tracker: SphereTracker,
    start: Start,
    glance: Glance,
    rng: np.random.Generator,
    times: StageTimes,
    log: SphereLog,
) -> SphereState:
    if start.position is not None:
        views = len(glance.views)
        return tracker.start_at(start.position, start.spread, start.particles, views, rng, glance.time)
    log.searches.append(0)
    with times.measure("search"):
        return tracker.search(start.volume, glance, start.particles, rng)
