"""What cameras and other sensors found, brought to one floor and one clock."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.cameras.camera_files import AnyCamera, CameraOverFloor
from tsuiseki.tracking.cameras.multicamera import StandingPeople
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.floor.foot_points import FootNoise, on_floor
from tsuiseki.tracking.floor.sensors import FloorPoints, SensorRates, SensorView, shares
from tsuiseki.tracking.formats.world_tables import FloorPositions, check_names
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance

MARGIN = 1.0
"""Metres beyond the plan within which somebody is still followed."""
APART = 0.5


@dataclass(frozen=True)
class CameraFeed:
    """One camera and what it found.

    Attributes:
        placed: the camera.
        times: ``(T,)`` seconds of its frames.
        found: T of them.
    """

    placed: CameraOverFloor
    times: FloatArray
    found: Sequence[StandingPeople]


@dataclass(frozen=True)
class MeasuredFloor:
    """Everything that was measured.

    Attributes:
        moments: frames that belong together.
        points: on the floor.
        views: what the sensors see, cameras first.
        names: of the sensors.
        feeds: the cameras.
        floor: ``(4,)`` of the plan.
        outside: detections beyond it, by sensor.
    """

    moments: Sequence[Moment]
    points: FloorPoints
    views: Sequence[SensorView]
    names: Sequence[str]
    feeds: Sequence[CameraFeed]
    floor: FloatArray
    outside: dict[str, int] = field(default_factory=dict)

    @property
    def times(self) -> FloatArray:
        """``(T,)`` seconds."""
        return np.array([moment.time for moment in self.moments])

    @property
    def rates(self) -> SensorRates:
        """Of the sensors before anything is known."""
        count = len(self.views)
        return SensorRates.first(np.full(count, 0.8), np.full(count, 1.0))


def check_feeds(feeds: Sequence[CameraFeed]) -> None:
    """Refuse cameras that cannot be of one floor and one time.

    Raises:
        RequestError: a camera stands on or under the floor or looks away from it, one has no frames, or clocks run
            apart.
    """
    for feed in feeds:
        camera, name = feed.placed.camera, feed.placed.name
        if not camera.position[2] > 0:
            raise RequestError(
                f"{name}: expected a camera over the floor z = 0, got a height of {camera.position[2]:g} m"
            )
        rows = np.linspace(0.02, 0.98, 15)
        pixels = np.stack(np.meshgrid(rows * camera.width, rows * camera.height), axis=-1).reshape(-1, 2)
        if not np.isfinite(camera.ground(pixels)).all(axis=1).any():
            raise RequestError(
                f"{name}: expected a camera that sees the floor, got a pose that puts it behind or above"
            )
        if not len(feed.times):
            raise RequestError(f"{name}: expected frames as of the other cameras, got none")
    if len(feeds) < 2:
        return
    first, last = max(feed.times[0] for feed in feeds), min(feed.times[-1] for feed in feeds)
    longest = max(feed.times[-1] - feed.times[0] for feed in feeds)
    if longest > 0 and last - first < APART * longest:
        ends = "; ".join(f"{f.placed.name} {f.times[0]:.1f} to {f.times[-1]:.1f} s" for f in feeds)
        raise RequestError(f"expected cameras that run at one time, got {ends}; give `offsets` or `timestamps`")


def measured_floor(
    feeds: Sequence[CameraFeed],
    positions: Sequence[FloorPositions],
    floor: FloatArray | None,
    noise: FootNoise,
    tolerance: float | None,
) -> MeasuredFloor:
    """All measurements on one floor.

    Args:
        feeds: the cameras.
        positions: of other sensors.
        floor: ``(4,)`` of the plan; by default what the measurements span.
        noise: of the detections.
        tolerance: seconds within which frames count as taken together.

    Raises:
        RequestError: see `check_feeds` and `check_names`; or all that a sensor measured lies outside the plan.
    """
    check_feeds(feeds)
    scans = [np.unique(one.times) for one in positions]
    stamps = [feed.times for feed in feeds] + scans
    slack = default_tolerance(stamps) if tolerance is None else tolerance
    check_names(list(positions), slack)
    moments = align(stamps, slack)
    parts = [_of_camera(feed, noise) for feed in feeds] + [_of_positions(one) for one in positions]
    names = [feed.placed.name for feed in feeds] + [str(one.path) for one in positions]
    plan = _spanned([part.places for part in parts]) if floor is None else floor
    low, high = plan[:2] - MARGIN, plan[2:] + MARGIN
    kept, views, outside = [], [], {}
    for sensor, part in enumerate(parts):
        with np.errstate(invalid="ignore"):
            inside = np.asarray((part.places >= low).all(axis=1) & (part.places <= high).all(axis=1))
        if not inside.all():
            outside[names[sensor]] = int((~inside).sum())
            _tell_outside(names[sensor], inside, plan, sensor >= len(feeds))
        at = _moment_of(moments, sensor, len(stamps[sensor]))
        part = part.select(np.flatnonzero(inside & (at[part.frames] >= 0)))
        looked = np.zeros(len(moments), dtype=np.bool_)
        looked[at[at >= 0]] = True
        part = replace(
            part, frames=at[part.frames], spread=np.nan_to_num(part.spread, nan=1.0 / float(np.prod(high - low)))
        )
        kept.append(part)
        camera = feeds[sensor].placed.camera if sensor < len(feeds) else None
        views.append(_view(camera, looked, part))
    return MeasuredFloor(moments, _joined(kept, views, feeds), views, names, feeds, plan, outside)


@dataclass(frozen=True)
class _Measured:
    """N measurements of one sensor; `frames` are its own, then moments."""

    frames: IntArray
    rows: IntArray
    places: FloatArray
    covariances: FloatArray
    spread: FloatArray
    names: IntArray
    boxes: FloatArray
    features: FloatArray | None = None

    def select(self, which: IntArray) -> _Measured:
        features = None if self.features is None else self.features[which]
        return _Measured(
            self.frames[which], self.rows[which], self.places[which], self.covariances[which], self.spread[which],
            self.names[which], self.boxes[which], features,
        )  # fmt: skip


def _of_camera(feed: CameraFeed, noise: FootNoise) -> _Measured:
    counts = [len(each) for each in feed.found]
    boxes = np.concatenate([np.empty((0, 4)), *(each.detections.boxes for each in feed.found)])
    feet = np.concatenate([np.empty((0, 2)), *(each.feet for each in feed.found)])
    people = StandingPeople(Detections(boxes, np.ones(len(boxes))), feet)
    camera = feed.placed.camera
    places, covariances, density = on_floor(camera, people, noise)
    frames = np.repeat(np.arange(len(counts)), counts)
    rows = np.concatenate([np.empty(0, np.int64), *(np.arange(count) for count in counts)])
    described = [each.detections.features for each in feed.found if len(each)]
    features = None
    if described and all(one is not None for one in described):
        features = np.concatenate([one for one in described if one is not None])
    spread = density / (camera.width * camera.height)
    return _Measured(frames, rows, places, covariances, spread, np.full(len(rows), -1), boxes, features)


def _of_positions(one: FloorPositions) -> _Measured:
    frames = np.unique(one.times, return_inverse=True)[1]
    covariances = np.square(one.deviations)[:, None, None] * np.eye(2)
    count = len(frames)
    empty = np.full((count, 4), np.nan)
    return _Measured(frames, np.arange(count), one.places, covariances, np.full(count, np.nan), one.names, empty)


def _tell_outside(name: str, inside: BoolArray, plan: FloatArray, told: bool) -> None:
    """Refuse a sensor all of whose measurements lie outside the plan; say how many of another's do."""
    shown = ",".join(f"{value:g}" for value in plan)
    if not inside.any():
        raise RequestError(f"{name}: expected people on the plan {shown}, got all {len(inside)} outside; check `floor`")
    if told:
        warnings.warn(
            f"{name}: {(~inside).sum()} of {len(inside)} positions lie outside the plan {shown} and are left out",
            InputWarning,
            stacklevel=2,
        )


def _spanned(places: Sequence[FloatArray]) -> FloatArray:
    """``(4,)`` about all but the farthest measurements."""
    every = np.concatenate(list(places))
    every = every[np.isfinite(every).all(axis=1)]
    if not len(every):
        raise RequestError("expected somebody on the floor, got no detection that lies on it; check the camera file")
    return np.concatenate([np.quantile(every, 0.005, axis=0) - MARGIN, np.quantile(every, 0.995, axis=0) + MARGIN])


def _moment_of(moments: Sequence[Moment], sensor: int, count: int) -> IntArray:
    """``(F,)`` moment of each frame of a sensor."""
    at = np.full(count, -1)
    for number, moment in enumerate(moments):
        frame = moment.frames[sensor]
        if frame is not None:
            at[frame] = number
    return at


def _view(camera: AnyCamera | None, looked: BoolArray, part: _Measured) -> SensorView:
    """What a sensor sees, with its detections as those that may hide others."""
    order = np.argsort(part.frames, kind="stable")
    moment = part.frames[order]
    place = np.arange(len(moment)) - np.searchsorted(moment, moment)
    shape = len(looked), int(place.max(initial=-1)) + 1
    boxes, nearness = np.full((*shape, 4), np.nan), np.full(shape, np.nan)
    boxes[moment, place] = part.boxes[order]
    if camera is not None:
        nearness[moment, place] = np.linalg.norm(part.places[order] - camera.position[:2], axis=1)
    return SensorView(camera, looked, boxes, nearness, camera is None and bool((part.names >= 0).all()))


def _joined(kept: Sequence[_Measured], views: Sequence[SensorView], feeds: Sequence[CameraFeed]) -> FloorPoints:
    """The measurements of all sensors, by moment."""
    sensor = np.repeat(np.arange(len(kept)), [len(part.frames) for part in kept])
    moment = np.concatenate([part.frames for part in kept])
    order = np.argsort(moment, kind="stable")
    columns = [
        np.concatenate([getattr(part, name) for part in kept])[order]
        for name in ("rows", "places", "covariances", "spread", "names")
    ]
    rows, places, covariances, spread, names = columns
    features = facing = None
    width = {part.features.shape[1] for part in kept if part.features is not None}
    if len(width) == 1:
        blank = np.zeros((1, width.pop()))
        own = [np.repeat(blank, len(p.frames), axis=0) if p.features is None else p.features for p in kept]
        features = np.concatenate(own)[order]
        stands = np.array(
            [feed.placed.camera.position[:2] for feed in feeds] + [[np.nan] * 2] * (len(kept) - len(feeds))
        )
        away = places - stands[sensor[order]]
        facing = np.nan_to_num(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))
    seen = shares(views, moment[order], places)
    return FloorPoints(moment[order], sensor[order], rows, places, covariances, spread, seen, names, features, facing)
