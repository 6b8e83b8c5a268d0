"""Detections of cameras and other sensors on one floor and one clock, and each sensor's probability of detection."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsuiseki.tracking.cameras.camera_files import AnyCamera, CameraOverFloor
from tsuiseki.tracking.cameras.multicamera import StandingPeople
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.floor.foot_points import expected_boxes, on_floor
from tsuiseki.tracking.formats.world_tables import FloorPositions, check_names
from tsuiseki.tracking.geometry import intersections
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.video.synchronise import Moment, align, default_tolerance

# Around the plan, in which people are still followed, metres.
MARGIN = 1.0
# Share of the places on each side that are beyond the plan, where none is given.
FARTHEST = 0.005
# Share of the longest recording for which all cameras must run at one time.
APART = 0.5
# Of the visible share of a person, each with a probability of detection.
STEPS = 5
# Visible share of a person from which they may be detected.
LEAST_VISIBLE = 0.05
# Weight of a sensor's former probabilities of detection, in people of each step.
PRIOR = 10.0
# Added to the false positives a moment, which are never none.
LEAST_FALSE = 0.02
# People whose visible share is computed at a time, so that memory stays small.
CHUNK = 4_000
# Largest share of a person that others hide.
HIDDEN_BY = 0.95
# Least difference in distance of a person who hides another, metres.
NEARER = 0.5


@dataclass(frozen=True)
class FloorPoints:
    """All that was measured on the floor, ordered by moment.

    Attributes:
        moment: ``(N,)`` number of the moment, from 0.
        sensor: ``(N,)`` number of the camera or sensor.
        row: ``(N,)`` row in the sensor's detections of that moment.
        places: ``(N, 2)`` positions on the floor, metres.
        covariances: ``(N, 2, 2)`` of the positions, square metres.
        spread: ``(N,)`` density of a false positive there, per square metre.
        visible: ``(N, S)`` share in [0, 1] of each sensor's detection probability that a person there would have.
        names: ``(N,)`` certain identity; -1 where it is not known.
        features: ``(N, D)`` of unit length, zero where there is none; or None.
        facing: ``(N, 2)`` horizontal viewing direction, a unit vector; or None.
    """

    moment: IntArray
    sensor: IntArray
    row: IntArray
    places: FloatArray
    covariances: FloatArray
    spread: FloatArray
    visible: FloatArray
    names: IntArray
    features: FloatArray | None = None
    facing: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.moment)


@dataclass(frozen=True)
class SensorRates:
    """How well each of S sensors detects.

    Attributes:
        detection: ``(S, B)`` probability of detecting a person, for B equal steps of the visible share from 0 to 1.
        false: ``(S,)`` false positives a moment.
    """

    detection: FloatArray
    false: FloatArray

    def detected(self, share: FloatArray) -> FloatArray:
        """``(E, S)`` probabilities of shares ``(E, S)``."""
        chance = self.detection[np.arange(share.shape[1]), _step_of(share)]
        return np.asarray(np.where(share > LEAST_VISIBLE, chance, 1e-6))

    def learnt(self, share: FloatArray, hit: BoolArray, false: FloatArray) -> SensorRates:
        """Rates estimated from tracks.

        Args:
            share: ``(E, S)`` visible share of the tracked people, in [0, 1].
            hit: ``(E, S)`` whether the sensors detected them.
            false: ``(S,)`` false positives a moment.
        """
        detection = np.empty_like(self.detection)
        for sensor in range(share.shape[1]):
            in_view = share[:, sensor] > LEAST_VISIBLE
            step = _step_of(share[in_view, sensor])
            hits = np.bincount(step, hit[in_view, sensor], STEPS) + PRIOR * self.detection[sensor]
            detection[sensor] = hits / (np.bincount(step, minlength=STEPS) + PRIOR)
        return SensorRates(np.asarray(np.clip(detection, 0.02, 0.98)), false + LEAST_FALSE)


def _step_of(share: FloatArray) -> IntArray:
    """Into which of `STEPS` equal parts of [0, 1] each share falls."""
    return np.minimum((share * STEPS).astype(np.int64), STEPS - 1)


@dataclass(frozen=True)
class SensorView:
    """The view of one sensor on the floor, over time.

    Attributes:
        camera: None for a sensor that covers the whole floor, or only the people whom it names.
        measured: ``(T,)`` whether it measured at each moment.
        boxes: ``(T, M, 4)`` boxes of its detections, pixels, NaN where there are fewer.
        nearness: ``(T, M)`` distances of the detections from the camera, metres.
        names: whether it only reports people whom it names.
    """

    camera: AnyCamera | None
    measured: BoolArray
    boxes: FloatArray
    nearness: FloatArray
    names: bool = False

    def share(self, moment: IntArray, places: FloatArray) -> FloatArray:
        """``(E,)`` visible share of a person at ``(E, 2)`` places, in [0, 1]: in the image, not behind others."""
        if self.camera is None:
            return np.where(self.measured[moment], 0.0 if self.names else 1.0, 0.0)
        edges = range(0, len(moment), CHUNK)
        parts = [self._part(moment[k : k + CHUNK], places[k : k + CHUNK]) for k in edges]
        return np.concatenate([np.empty(0), *parts])

    def _part(self, moment: IntArray, places: FloatArray) -> FloatArray:
        camera = self.camera
        assert camera is not None
        expected = expected_boxes(camera, places)
        distance = np.linalg.norm(places - camera.position[:2], axis=1)
        area = np.prod(expected[:, 2:] - expected[:, :2], axis=1)
        inside = np.clip(expected, 0.0, [camera.width, camera.height] * 2)
        in_view = np.prod(inside[:, 2:] - inside[:, :2], axis=1)
        nearer = self.nearness[moment] < distance[:, None] - NEARER
        shared = intersections(inside[:, None], self.boxes[moment]) * nearer
        with np.errstate(invalid="ignore", divide="ignore"):
            hidden = np.minimum(np.nan_to_num(shared).sum(axis=1) / np.maximum(in_view, 1e-9), HIDDEN_BY)
            share = np.nan_to_num(in_view / area) * (1.0 - np.nan_to_num(hidden))
        return np.asarray(self.measured[moment] * share)


def shares(views: Sequence[SensorView], moment: IntArray, places: FloatArray) -> FloatArray:
    """``(E, S)`` of every sensor."""
    return np.stack([view.share(moment, places) for view in views], axis=1)


@dataclass(frozen=True)
class CameraFeed:
    """One camera and its detections.

    Attributes:
        placed: the camera.
        times: ``(T,)`` seconds of its frames.
        people: T of them.
    """

    placed: CameraOverFloor
    times: FloatArray
    people: Sequence[StandingPeople]


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
        """Of the sensors before anything is known: people in full view are detected, others less."""
        count = len(self.views)
        return SensorRates(np.full((count, 1), 0.8) * np.linspace(0.4, 1.0, STEPS), np.full(count, 1.0))

    def inside(self, places: FloatArray) -> BoolArray:
        """``(N,)`` whether ``(N, 2)`` places are on the plan."""
        return np.asarray(((places >= self.floor[:2]) & (places <= self.floor[2:])).all(axis=1))


# Of one sensor the columns of `FloorPoints`, boxes, and features where there are some; the moment is first the frame.
_Columns = dict[str, Any]


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
    floor: FloatArray | None = None,
    tolerance: float | None = None,
) -> MeasuredFloor:
    """All measurements on one floor.

    Args:
        feeds: the cameras.
        positions: of other sensors.
        floor: ``(4,)`` of the plan; by default what the measurements span.
        tolerance: seconds within which frames count as taken together; by default as `default_tolerance` says.

    Raises:
        RequestError: see `check_feeds` and `check_names`; or all that a sensor measured lies outside the plan.
    """
    check_feeds(feeds)
    scans = [np.unique(reports.times) for reports in positions]
    stamps = [feed.times for feed in feeds] + scans
    slack = default_tolerance(stamps) if tolerance is None else tolerance
    check_names(list(positions), slack)
    moments = align(stamps, slack)
    parts = [_of_camera(feed) for feed in feeds] + [_of_positions(reports) for reports in positions]
    names = [feed.placed.name for feed in feeds] + [str(reports.path) for reports in positions]
    plan = around([part["places"] for part in parts]) if floor is None else floor
    measured = on_one_floor(feeds, moments, plan, names, parts)
    for sensor, name in enumerate(names):
        left, count, bounds = measured.outside.get(name, 0), len(parts[sensor]["moment"]), _bounds(plan)
        if left and left == count:
            raise RequestError(f"{name}: expected people on the plan {bounds}, got all {left} outside; check `floor`")
        if left and sensor >= len(feeds):
            message = f"{name}: {left} of {count} positions lie outside the plan {bounds} and are left out"
            warnings.warn(message, InputWarning, stacklevel=2)
    return measured


def _bounds(plan: FloatArray) -> str:
    return ",".join(f"{value:g}" for value in plan)


def measured_moments(
    placed: Sequence[CameraOverFloor],
    times: Sequence[float],
    people: Sequence[Sequence[StandingPeople | None]],
    floor: FloatArray,
) -> MeasuredFloor:
    """What cameras measured in some moments.

    Args:
        placed: S cameras.
        times: of the T moments, seconds.
        people: of each moment what each camera detected; None of one that has no frame then.
        floor: ``(4,)`` of the plan.
    """
    feeds, frames = [], np.full((len(times), len(placed)), -1)
    for camera, entry in enumerate(placed):
        there = [moment for moment, row in enumerate(people) if row[camera] is not None]
        frames[there, camera] = np.arange(len(there))
        standing = [entry_people for row in people if (entry_people := row[camera]) is not None]
        feeds.append(CameraFeed(entry, np.asarray(times)[there], standing))
    moments = [
        Moment(time, tuple(None if number < 0 else number for number in row))
        for time, row in zip(times, frames.tolist(), strict=True)
    ]
    return on_one_floor(feeds, moments, floor, [entry.name for entry in placed], [_of_camera(feed) for feed in feeds])


def on_one_floor(
    feeds: Sequence[CameraFeed],
    moments: Sequence[Moment],
    plan: FloatArray,
    names: Sequence[str],
    parts: list[_Columns],
) -> MeasuredFloor:
    """Measurements of sensors, cameras first, on one plan; their ``parts`` hold the frame of each of them."""
    parts = [{**part} for part in parts]
    low, high = plan[:2] - MARGIN, plan[2:] + MARGIN
    views, outside = list[SensorView](), dict[str, int]()
    for sensor, part in enumerate(parts):
        with np.errstate(invalid="ignore"):
            inside = np.asarray((part["places"] >= low).all(axis=1) & (part["places"] <= high).all(axis=1))
        if not inside.all():
            outside[names[sensor]] = int((~inside).sum())
        of_moments = np.array([-1 if m.frames[sensor] is None else m.frames[sensor] for m in moments], dtype=np.int64)
        measured = of_moments >= 0
        at = np.full(max(int(of_moments.max(initial=-1)), int(part["moment"].max(initial=-1))) + 1, -1)
        at[of_moments[measured]] = np.flatnonzero(measured)
        part["moment"] = at[part["moment"]]
        rows = np.flatnonzero(inside & (part["moment"] >= 0))
        parts[sensor] = part = {name: column[rows] for name, column in part.items()}
        part["spread"] = np.nan_to_num(part["spread"], nan=1.0 / float(np.prod(high - low)))
        part["sensor"] = np.full(len(rows), sensor)
        camera = feeds[sensor].placed.camera if sensor < len(feeds) else None
        views.append(_view(camera, measured, part))
    return MeasuredFloor(moments, _joined(parts, views, feeds), views, list(names), feeds, plan, outside)


def _of_camera(feed: CameraFeed) -> _Columns:
    counts, camera = [len(standing) for standing in feed.people], feed.placed.camera
    boxes = np.concatenate([np.empty((0, 4)), *(standing.detections.boxes for standing in feed.people)])
    feet = np.concatenate([np.empty((0, 2)), *(standing.feet for standing in feed.people)])
    places, covariances, density = on_floor(camera, StandingPeople(Detections(boxes, np.ones(len(boxes))), feet))
    described = [standing.detections.features for standing in feed.people if len(standing)]
    features = [matrix for matrix in described if matrix is not None]
    rows = np.concatenate([np.empty(0, np.int64), *map(np.arange, counts)])
    columns = _columns(np.repeat(np.arange(len(counts)), counts), rows, places, covariances)
    columns |= {"spread": density / (camera.width * camera.height), "boxes": boxes}
    return columns | ({"features": np.concatenate(features)} if features and len(features) == len(described) else {})


def _of_positions(positions: FloorPositions) -> _Columns:
    frames = np.unique(positions.times, return_inverse=True)[1]
    covariances = np.square(positions.deviations)[:, None, None] * np.eye(2)
    return _columns(frames, np.arange(len(frames)), positions.places, covariances) | {"names": positions.names}


def _columns(frames: IntArray, rows: IntArray, places: FloatArray, covariances: FloatArray) -> _Columns:
    count = len(frames)
    unknown = {"spread": np.full(count, np.nan), "names": np.full(count, -1), "boxes": np.full((count, 4), np.nan)}
    return {"moment": frames, "row": rows, "places": places, "covariances": covariances, **unknown}


def plan_of(placed: Sequence[CameraOverFloor], chosen: Sequence[float] | None) -> FloatArray | None:
    """``(4,)`` of the plan that was chosen, or that the cameras have, where there is one."""
    if chosen is not None:
        return np.array(chosen)
    return next((camera.floor for camera in placed if camera.floor is not None), None)


def around(places: Sequence[FloatArray]) -> FloatArray:
    """``(4,)`` about places ``(N, 2)`` of several, without the `FARTHEST` on each side, and `MARGIN` more."""
    measured = np.concatenate(list(places))
    measured = measured[np.isfinite(measured).all(axis=1)]
    if not len(measured):
        raise RequestError("expected somebody on the floor, got no detection that lies on it; check the camera file")
    low, high = np.quantile(measured, [FARTHEST, 1 - FARTHEST], axis=0)
    return np.concatenate([low - MARGIN, high + MARGIN])


def _view(camera: AnyCamera | None, measured: BoolArray, part: _Columns) -> SensorView:
    """The view of a sensor, with its detections as possible occluders."""
    order = np.argsort(part["moment"], kind="stable")
    moment = part["moment"][order]
    place = np.arange(len(moment)) - np.searchsorted(moment, moment)
    shape = len(measured), int(place.max(initial=-1)) + 1
    boxes, nearness = np.full((*shape, 4), np.nan), np.full(shape, np.nan)
    boxes[moment, place] = part["boxes"][order]
    if camera is not None:
        nearness[moment, place] = np.linalg.norm(part["places"][order] - camera.position[:2], axis=1)
    return SensorView(camera, measured, boxes, nearness, camera is None and bool((part["names"] >= 0).all()))


def _joined(parts: Sequence[_Columns], views: Sequence[SensorView], feeds: Sequence[CameraFeed]) -> FloorPoints:
    """The measurements of all sensors, by moment."""
    order = np.argsort(np.concatenate([part["moment"] for part in parts]), kind="stable")
    names = ("moment", "sensor", "row", "places", "covariances", "spread", "names")
    columns = {name: np.concatenate([part[name] for part in parts])[order] for name in names}
    moment, places = columns["moment"], columns["places"]
    width = {part["features"].shape[1] for part in parts if "features" in part}
    if len(width) == 1:
        blank = np.zeros((1, width.pop()))
        features = [part.get("features", np.repeat(blank, len(part["row"]), axis=0)) for part in parts]
        unseen = [[np.nan] * 2] * (len(parts) - len(feeds))
        stands = np.array([feed.placed.camera.position[:2] for feed in feeds] + unseen)
        away = places - stands[columns["sensor"]]
        facing = np.nan_to_num(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))
        columns |= {"features": np.concatenate(features)[order], "facing": facing}
    return FloorPoints(visible=shares(views, moment, places), **columns)
