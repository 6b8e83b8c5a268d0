"""A ball through several videos: search at the start and after a loss, and what is kept of each moment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.camera_files import PlacedCamera
from tsuiseki.tracking.cameras.volume import in_sight
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.sphere.tracker import (
    START_SPEED,
    SphereState,
    SphereTracker,
    TimedViews,
    with_velocities,
)
from tsuiseki.tracking.sphere.views import Views
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import FloatArray, Position
from tsuiseki.tracking.video.source import Source
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance

Seen: TypeAlias = tuple[Moment, Views]

# A search takes frames of different cameras within so many seconds for one look.
RECENT = 0.15


@dataclass(frozen=True)
class Start:
    """Where the ball is looked for first.

    Attributes:
        position: ``(3,)`` metres; None searches the volume.
        spread: standard deviation around it, m.
        particles: how many.
        search: positions ``(particles, 3)`` after one look at everything: the start without a position, and for a ball
            that was lost.
        speed: standard deviation of the velocity of a ball that was just found, along each axis, m/s.
    """

    position: FloatArray | None
    spread: float
    particles: int
    search: Callable[[Views, np.random.Generator], FloatArray]
    speed: float = START_SPEED


@dataclass
class SphereLog:
    """What a run keeps.

    Attributes:
        positions: one a moment.
        moments: which frames they are of.
        searches: indices of the moments at which the volume was searched.
        last_search: its time, seconds.
    """

    positions: list[Position] = field(default_factory=list)
    moments: list[Moment] = field(default_factory=list)
    searches: list[int] = field(default_factory=list)
    last_search: float = -np.inf

    def forget(self) -> None:
        """Drop what happened; a run goes on as before."""
        self.positions.clear()
        self.moments.clear()
        self.searches.clear()

    def columns(self) -> dict[str, list[Any]]:
        """What happened at each moment, for ``run.json``: one list a column."""
        return {
            "time": [round(p.time, 6) for p in self.positions],
            "score": [round(p.score, 4) for p in self.positions],
            "status": [p.status for p in self.positions],
            "open": [[round(float(v), 3) for v in p.open] for p in self.positions],
            "frame_of_each_video": [list(m.frames) for m in self.moments],
        }


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
        raise RequestError(f"expected the ball before the cameras, but {shown} lies behind {behind[0]}; check `start`")
    if seen < 2:
        raise RequestError(f"expected a start that two cameras see, but {shown} is in {seen} of {len(cameras)} images")


def run_sphere(
    tracker: SphereTracker,
    start: Start,
    seen: Iterable[Seen],
    rng: np.random.Generator,
    times: StageTimes,
    watch: Callable[[Iterable[Seen]], Iterable[Seen]],
) -> SphereLog:
    """Track through all moments; a ball that is lost is searched in the volume again.

    Args:
        tracker: the filter.
        start: where to look first.
        seen: moments in order of time, each with an image or a measured pixel of every camera.
        rng: random numbers.
        times: gets the seconds of each stage.
        watch: passes the moments through, for progress and interruption.

    Raises:
        RunError: no moment had an image.
    """
    log = SphereLog()
    for _ in follow_ball(tracker, start, watch(seen), rng, times, log):
        pass
    if not log.positions:
        raise RunError("expected frames of two videos at about one time, got none; check `offsets` or `timestamps`")
    return log


def follow_ball(
    tracker: SphereTracker,
    start: Start,
    seen: Iterable[Seen],
    rng: np.random.Generator,
    times: StageTimes,
    log: SphereLog,
) -> Iterator[Position]:
    """Each position as soon as it is known; ``log`` gets what happens. See `run_sphere`."""
    state: SphereState | None = None
    recent = _Recent()
    for moment, views in seen:
        observation = TimedViews(moment.time, views)
        recent.add(observation)
        if state is None and start.position is not None:
            count = start.particles
            state = tracker.start_at(start.position, start.spread, count, len(views), rng, moment.time, start.speed)
        lost = state is None or state.unseen > tracker.patience
        if lost and recent.count() >= 2 and moment.time - log.last_search > tracker.patience:
            with times.measure("search"):
                positions = start.search(recent.views(), rng)
            unseen = 0.0 if state is None else state.unseen
            found = tracker.init(with_velocities(positions, start.speed, rng), len(views), moment.time)
            state = replace(found, unseen=unseen)
            log.searches.append(len(log.positions))
            log.last_search = moment.time
        if state is None:
            continue
        with times.measure("filter"):
            state, info = tracker.step(state, observation, rng)
        log.positions.append(info.position)
        log.moments.append(moment)
        yield info.position


class _Recent:
    """The newest frame of each camera, for a search: cameras that are out of step never have frames together."""

    def __init__(self) -> None:
        self._seen: dict[int, tuple[float, NDArray[Any]]] = {}
        self._now, self._cameras = 0.0, 0

    def add(self, observation: TimedViews) -> None:
        """Keep what is new."""
        self._now, self._cameras = observation.time, len(observation.views)
        self._seen |= {k: (observation.time, view) for k, view in enumerate(observation.views) if view is not None}
        self._seen = {k: seen for k, seen in self._seen.items() if self._now - seen[0] <= RECENT}

    def count(self) -> int:
        """Cameras with a recent frame."""
        return len(self._seen)

    def views(self) -> Views:
        """One image a camera, None where none is recent."""
        return [self._seen[k][1] if k in self._seen else None for k in range(self._cameras)]


Watched: TypeAlias = Callable[[Iterable[Seen]], Iterable[Seen]]


@dataclass(frozen=True)
class SphereRun:
    """Everything that a run needs, checked.

    Attributes:
        placed: the cameras.
        stamps: ``(T,)`` of each camera, the time of every frame, seconds; none of live cameras.
        tolerance: frames within so many seconds count as taken together; None takes a quarter of the shortest time
            between frames.
        tracker: the filter.
        start: where the ball is looked for first.
        seen: what the cameras see at these moments; of live ones, from now on.
        radius: of the ball, metres; 0 of a point.
        sources: the videos, where there are some.
    """

    placed: Sequence[PlacedCamera]
    stamps: Sequence[FloatArray]
    tolerance: float | None
    tracker: SphereTracker
    start: Start
    seen: Callable[[Sequence[Moment]], Iterable[Seen]]
    radius: float
    sources: Sequence[Source] = ()

    @property
    def length(self) -> int | None:
        """Frames of the longest video; None of live cameras."""
        return max(map(len, self.stamps)) if self.stamps else None

    def run(self, rng: np.random.Generator, times: StageTimes, watch: Watched = iter) -> SphereLog:
        """See `run_sphere`."""
        return run_sphere(self.tracker, self.start, self._moments(), rng, times, watch)

    def follow(self, rng: np.random.Generator) -> Iterator[Position]:
        """Each position as soon as it is known; nothing is kept."""
        log = SphereLog()
        for position in follow_ball(self.tracker, self.start, self._moments(), rng, StageTimes(), log):
            yield position
            log.forget()

    def _moments(self) -> Iterable[Seen]:
        stamps = list(self.stamps)
        if not stamps:
            return self.seen([])
        return self.seen(align(stamps, default_tolerance(stamps) if self.tolerance is None else self.tolerance))
