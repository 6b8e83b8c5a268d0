"""What cameras and other sensors say of the floor: points with covariances, and how surely they see a spot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.floor.foot_points import expected_boxes
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

STEPS, LEAST_SEEN = 5, 0.05
"""Steps in which detection grows with what is seen of somebody, and the share below which nobody is detected."""
PRIOR, LEAST_FALSE = 10.0, 0.02
CHUNK = 4_000
HIDDEN_BY, NEARER = 0.95, 0.5
"""Most of a person that nearer ones hide; metres by which somebody must be nearer."""


@dataclass(frozen=True)
class FloorPoints:
    """All that was measured on the floor, ordered by moment.

    Attributes:
        moment: ``(N,)`` its number.
        sensor: ``(N,)`` number of the camera or sensor.
        row: ``(N,)`` row in what the sensor found at that moment.
        places: ``(N, 2)`` metres.
        covariances: ``(N, 2, 2)``.
        spread: ``(N,)`` density of false ones there, of one in all, a square metre.
        visible: ``(N, S)`` how surely each sensor would find somebody there, of its detection probability, [0, 1].
        names: ``(N,)`` who it is, for certain; -1 where that is not known.
        features: ``(N, D)`` of unit length, zero where there is none; or None.
        facing: ``(N, 2)`` horizontal direction in which each was looked at; or None.
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
        detection: ``(S, B)`` probability of somebody by how much of them is seen, in B equal steps from 0 to 1.
        false: ``(S,)`` false ones a moment.
    """

    detection: FloatArray
    false: FloatArray

    @classmethod
    def first(cls, detection: FloatArray, false: FloatArray) -> SensorRates:
        """Before anything is known: so many ``(S,)`` of those in full view, and less of others."""
        return cls(detection[:, None] * np.linspace(0.4, 1.0, STEPS), false)

    def detected(self, share: FloatArray) -> FloatArray:
        """``(E, S)`` probabilities of shares ``(E, S)``."""
        found: FloatArray = self.detection[np.arange(share.shape[1]), step_of(share)]
        return np.asarray(np.where(share > LEAST_SEEN, found, 1e-6))

    def learnt(self, share: FloatArray, hit: BoolArray, nobody: FloatArray) -> SensorRates:
        """As people of tracks were detected.

        Args:
            share: ``(E, S)`` that sensors saw of them.
            hit: ``(E, S)`` whether they detected them.
            nobody: ``(S,)`` detections of nobody a moment.
        """
        detection = np.empty_like(self.detection)
        for sensor in range(share.shape[1]):
            open_ = share[:, sensor] > LEAST_SEEN
            step = step_of(share[open_, sensor])
            hits = np.bincount(step, hit[open_, sensor], STEPS) + PRIOR * self.detection[sensor]
            detection[sensor] = hits / (np.bincount(step, minlength=STEPS) + PRIOR)
        return SensorRates(np.asarray(np.clip(detection, 0.02, 0.98)), nobody + LEAST_FALSE)


def step_of(share: FloatArray) -> IntArray:
    """The step of each share."""
    return np.minimum((share * STEPS).astype(np.int64), STEPS - 1)


@dataclass(frozen=True)
class SensorView:
    """What one sensor sees of the floor, and when.

    Attributes:
        camera: None for a sensor that sees the whole floor, or, where it names people, only those.
        looked: ``(T,)`` moments at which it measured.
        boxes: ``(T, M, 4)`` that it found at each, NaN where there are fewer.
        nearness: ``(T, M)`` their distances, metres.
        names: whether it only tells of people whom it names.
    """

    camera: AnyCamera | None
    looked: BoolArray
    boxes: FloatArray
    nearness: FloatArray
    names: bool = False

    def share(self, moment: IntArray, places: FloatArray) -> FloatArray:
        """``(E,)`` of somebody at ``(E, 2)`` places: the share in the image that no detected nearer person hides."""
        if self.camera is None:
            return np.where(self.looked[moment], 0.0 if self.names else 1.0, 0.0)
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
        seen = np.prod(inside[:, 2:] - inside[:, :2], axis=1)
        boxes = self.boxes[moment]
        low = np.maximum(inside[:, None, :2], boxes[..., :2])
        high = np.minimum(inside[:, None, 2:], boxes[..., 2:])
        shared = np.prod(np.maximum(high - low, 0.0), axis=2) * (self.nearness[moment] < distance[:, None] - NEARER)
        with np.errstate(invalid="ignore", divide="ignore"):
            hidden = np.minimum(np.nan_to_num(shared).sum(axis=1) / np.maximum(seen, 1e-9), HIDDEN_BY)
            share = np.nan_to_num(seen / area) * (1.0 - np.nan_to_num(hidden))
        return np.asarray(self.looked[moment] * share)


def shares(views: Sequence[SensorView], moment: IntArray, places: FloatArray) -> FloatArray:
    """``(E, S)`` of every sensor."""
    return np.stack([view.share(moment, places) for view in views], axis=1)
