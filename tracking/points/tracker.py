"""Several targets from measured points or boxes, by the PHD filter or the labelled multi-Bernoulli filter.

Boxes are points of four coordinates: centre and size. Their model is made from the first measurements, in units of a
typical box, so that it needs no setting for another image size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.base import Filter, Running, SetInfo, TargetEstimates
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import LabelledMultiBernoulliFilter
from tsuiseki.tracking.filters.finite_sets.models import GaussianSensor, PointModel
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter
from tsuiseki.tracking.filters.motion.points import DriftingBox
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.points.estimated_tracks import EstimatedTracks
from tsuiseki.tracking.types import Detections, FloatArray, Targets, Track

PointMethod = Literal["labelled", "phd"]
COLUMNS = 6
FILTERS: dict[PointMethod, Callable[[PointModel, MeasurementBirths, int], Filter[Any, FloatArray, SetInfo]]] = {
    "labelled": LabelledMultiBernoulliFilter,
    "phd": PhdFilter,
}


@dataclass(frozen=True)
class PointSettings:
    """Settings; lengths are in heights of a typical box, times in frames.

    Attributes:
        method: ``labelled`` or ``phd``.
        survival: probability that a target goes on, in [0, 1].
        detection: probability that it is measured, in [0, 1].
        clutter: expected false measurements a frame, >= 0.
        births: expected new targets a frame, > 0.
        place_error: standard deviation of a measured centre.
        size_error: standard deviation of a measured width or height.
        acceleration: standard deviation of the change of velocity.
        speed: standard deviation of a new target's velocity, along each axis.
        growth: standard deviation of the change of size.
        particles: of each target.
        min_length: a track of fewer frames is not reported.
        min_score: detections below it are not used.
        box: width and height in pixels of points without a size.
    """

    method: PointMethod = "labelled"
    survival: float = 0.99
    detection: float = 0.85
    clutter: float = 1.0
    births: float = 0.05
    place_error: float = 0.06
    size_error: float = 0.08
    acceleration: float = 0.015
    speed: float = 0.1
    growth: float = 0.01
    particles: int = 500
    min_length: int = 3
    min_score: float = 0.0
    box: tuple[float, float] = (20.0, 20.0)

    def __post_init__(self) -> None:
        if self.method not in ("labelled", "phd"):
            raise RequestError(f"expected the method labelled or phd, got {self.method!r}")
        for name in ("survival", "detection"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise RequestError(f"expected the probability of {name} in [0, 1], got {getattr(self, name)}")
        for name in ("births", "place_error", "size_error", "acceleration", "speed", "growth"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise RequestError(f"expected {name} above 0, got {getattr(self, name)}")
        if not 0.0 <= self.clutter < np.inf or self.particles < 1 or min(self.box) <= 0:
            raise RequestError("expected clutter >= 0, at least one particle and a box of positive size")


def box_of(particles: FloatArray) -> FloatArray:
    """Centres and sizes ``(N, 4)`` of states ``(N, 6)``."""
    return particles[:, [0, 2, 4, 5]]


def box_model(
    settings: PointSettings, extent: tuple[float, float], unit: float
) -> tuple[PointModel, MeasurementBirths]:
    """The model of boxes about ``unit`` pixels high in an image of ``extent`` pixels."""
    place, size = settings.place_error * unit, settings.size_error * unit
    sensor = GaussianSensor(box_of, np.array([place, place, size, size]))
    # False boxes lie anywhere in the image, their sides within about half of a typical one.
    volume = extent[0] * extent[1] * (0.5 * unit) * unit
    motion = DriftingBox(settings.acceleration * unit, settings.growth * unit)
    model = PointModel(motion, sensor, settings.survival, settings.detection, settings.clutter / volume)

    def complete(measurements: FloatArray, rng: np.random.Generator) -> FloatArray:
        states = np.empty((len(measurements), COLUMNS))
        states[:, [0, 2, 4, 5]] = measurements
        states[:, [1, 3]] = settings.speed * unit * rng.standard_normal((len(measurements), 2))
        return states

    return model, MeasurementBirths(settings.births / volume, sensor, complete, COLUMNS)


def points_as_boxes(points: FloatArray, box: tuple[float, float]) -> Detections:
    """Detections of a width and height ``box`` about points ``(M, 2)``, all of score 1."""
    half = np.asarray(box) / 2
    return Detections(np.concatenate([points - half, points + half], axis=1), np.ones(len(points)))


class PointTracker:
    """Feeds a filter with the detections of one frame after the other.

    Args:
        settings: of the filter and its model.
        extent: width and height of the image, pixels.
        seed: of the particles.
    """

    def __init__(self, settings: PointSettings, extent: tuple[float, float], seed: int = 0) -> None:
        self.settings = settings
        self.extent = extent
        self.rng = np.random.default_rng(seed)
        self.record = EstimatedTracks(settings.min_length)
        self._running: Running[Any, FloatArray, SetInfo] | None = None

    def update(self, detections: DetectionsLike) -> Targets:
        """Take the detections of the next frame; its targets."""
        found = as_detections(detections)
        used = found.boxes[found.scores >= self.settings.min_score]
        centres = (used[:, :2] + used[:, 2:]) / 2
        return self._advance(np.concatenate([centres, used[:, 2:] - used[:, :2]], axis=1))

    def forget(self) -> None:
        """See `OnlineTracker`."""
        self.record.forget()

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id."""
        return self.record.tracks()

    def _advance(self, measurements: FloatArray) -> Targets:
        running = self._running
        estimates = self._first(measurements) if running is None else running.step(measurements).estimates
        size = np.maximum(estimates.states[:, 4:6], 1.0)
        centres = estimates.states[:, [0, 2]]
        boxes = np.concatenate([centres - size / 2, centres + size / 2], axis=1)
        return self.record.add(estimates.ids, boxes, estimates.weights)

    def _first(self, measurements: FloatArray) -> TargetEstimates:
        """Nothing until something was measured; that gives the unit of length."""
        if len(measurements) == 0:
            return TargetEstimates(np.empty(0, dtype=np.int64), np.empty((0, COLUMNS)), np.empty(0))
        unit = float(np.median(measurements[:, 3]))
        model, births = box_model(self.settings, self.extent, unit)
        chosen = FILTERS[self.settings.method](model, births, self.settings.particles)
        self._running = Running(chosen, chosen.init(np.empty((0, COLUMNS))), self.rng)
        return self._running.step(measurements).estimates
