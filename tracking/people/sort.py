"""Online tracking by one assignment a frame: SORT by position alone, DeepSORT by appearance first (thesis 2.3.2).

SORT (Bewley et al., "Simple online and realtime tracking", 2016) predicts each track by a Kalman filter and assigns
detections by overlap. DeepSORT assigns twice. The cost c(a, b) of every track a and detection b is C^feat, the cosine
distance of their appearance, and C^pos. A first assignment is solved on C^feat with the gate ε_feat; a second, on
C^pos with the gate ε_pos, only for the tracks that the first left unmatched and the detections it left free.

The thesis leaves these points of DeepSORT open; here:

* C^pos is 1 - IoU of the detection and the box that a Kalman filter of constant velocity predicts for the track.
* A track's appearance is the running mean of its features, weighted towards the recent ones and kept at unit length.
* Appearance alone would match two people in similar clothes across the whole image. So the first assignment has a
  gate on distance: the centre of the detection lies within ``reach`` heights of the prediction, and ``reach_growth``
  more for each frame without a detection.
* An unmatched detection starts a track. The track is confirmed after ``min_hits`` detections in a row and deleted
  after ``max_age`` frames without a detection. Unconfirmed tracks are matched like confirmed ones.
* A detection or a track without appearance (no feature, or a NaN in it) is matched by position only.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat
from pydantic.dataclasses import dataclass

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.bounds import SETTINGS, Age, CosineDistance, PositiveShare, changed
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.filters.kalman import BoxMotion
from tsuiseki.tracking.geometry import centres, iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleSettings, LifecycleTracker, ReportedBox
from tsuiseki.tracking.types import Detections, FloatArray, IntArray, Targets


@dataclass(frozen=True, config=SETTINGS)
class SortSettings(LifecycleSettings):
    """Settings of SORT.

    Attributes:
        min_iou: least overlap of a prediction and a detection that may be the same person, in (0, 1].
    """

    min_iou: PositiveShare = 0.3


SORT = SortSettings()


class Sort(LifecycleTracker[SortSettings]):
    """Each frame: predict every track, match predictions to detections by overlap, update what matched.

    The matching maximises the overlap (Hungarian method on 1 - IoU, gated).

    Args:
        settings: all of them.
        seed: taken as by all trackers; nothing is drawn.

    Any setting can be given by its name as well, which goes before ``settings``.

    >>> tracker = Sort()
    >>> for t in range(5):
    ...     people = tracker.update([[t, 0, t + 20, 50, 0.9]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [track.frames.tolist() for track in tracker.tracks()]
    [[0, 1, 2, 3, 4]]
    """

    def __init__(
        self,
        settings: SortSettings = SORT,
        seed: int = 0,
        *,
        min_iou: float | None = None,
        min_hits: int | None = None,
        max_age: int | None = None,
        start_score: float | None = None,
        boxes: ReportedBox | None = None,
        motion: BoxMotion | None = None,
    ) -> None:
        settings = changed(settings, SortSettings, locals())
        super().__init__(settings, seed)

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people."""
        detections = as_detections(detections, counted=self.bad)
        predicted = self._predict(time)
        least = self.settings.min_iou / self._slack
        matched, detected = assign(1 - iou_matrix(predicted, detections.boxes), 1 - least)
        return self._advance(matched, detected, detections)[0]


@dataclass(frozen=True, config=SETTINGS)
class DeepSortSettings(LifecycleSettings):
    """Settings of DeepSORT.

    Attributes:
        feature_gate: ε_feat, the largest cosine distance of a match by appearance, in [0, 2].
        position_gate: ε_pos, the largest 1 - IoU of a match by position, in [0, 1).
        memory: weight of the past in a track's running mean of features, in [0, 1).
        reach: distance from the prediction within which appearance may match, in heights.
        reach_growth: additional distance for every frame without a detection, in heights.
    """

    max_age: Age = 30
    feature_gate: CosineDistance = 0.3
    position_gate: Annotated[float, Field(ge=0, lt=1)] = 0.7
    memory: Annotated[float, Field(ge=0, lt=1)] = 0.9
    reach: NonNegativeFloat = 1.0
    reach_growth: NonNegativeFloat = 0.1


DEEPSORT = DeepSortSettings()


class DeepSort(LifecycleTracker[DeepSortSettings]):
    """Appearance first, then position, each with its own gate.

    Args:
        settings: all of them.
        seed: taken as by all trackers; nothing is drawn.

    Any setting can be given by its name as well, which goes before ``settings``.
    """

    def __init__(
        self,
        settings: DeepSortSettings = DEEPSORT,
        seed: int = 0,
        *,
        feature_gate: float | None = None,
        position_gate: float | None = None,
        memory: float | None = None,
        reach: float | None = None,
        reach_growth: float | None = None,
        min_hits: int | None = None,
        max_age: int | None = None,
        start_score: float | None = None,
        boxes: ReportedBox | None = None,
        motion: BoxMotion | None = None,
    ) -> None:
        settings = changed(settings, DeepSortSettings, locals())
        super().__init__(settings, seed)
        self._appearance = np.empty((0, 0))

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; those without features are matched by position.

        Returns:
            The people of the frame.

        Raises:
            RequestError: the features are of another length than those before.
        """
        detections = as_detections(detections, counted=self.bad)
        features = self._checked_features(detections)
        predicted = self._predict(time)
        paired, detected = assign(self._feature_costs(predicted, detections, features), self.settings.feature_gate)
        paired, detected = self._match_rest(predicted, detections, paired, detected)
        targets, parts = self._advance(paired, detected, detections)
        earlier, now = self._appearance[parts.matched], features[parts.detected]
        mean = running_mean(earlier, now, self.settings.memory, 1 - self.settings.memory)
        self._appearance = np.concatenate([mean, self._appearance[parts.coasting], features[parts.started]])
        return targets

    def _checked_features(self, detections: Detections) -> FloatArray:
        """``(M, D)`` the features, NaN where there are none."""
        length = self._appearance.shape[1]
        if detections.features is None:
            return np.full((len(detections), length), np.nan)
        if length == 0:
            self._appearance = np.full((len(self._appearance), detections.features.shape[1]), np.nan)
        elif detections.features.shape[1] != length and len(detections):
            got = detections.features.shape[1]
            raise RequestError(f"expected features of length {length} as before, got {got}; use one network")
        return detections.features.reshape(len(detections), self._appearance.shape[1])

    def _feature_costs(self, predicted: FloatArray, detections: Detections, features: FloatArray) -> FloatArray:
        """C^feat, infinite outside the gate on distance, NaN without appearance."""
        if features.size == 0 or self._appearance.size == 0:
            return np.full((len(predicted), len(detections)), np.nan)
        move = centres(predicted)[:, None] - centres(detections.boxes)[None]
        heights = detections.boxes[:, 3] - detections.boxes[:, 1]
        reach = self.settings.reach + self.settings.reach_growth * self._misses
        far = np.hypot(move[..., 0], move[..., 1]) > reach[:, None] * heights
        return np.where(far, np.inf, 1 - self._appearance @ features.T)

    def _match_rest(
        self, predicted: FloatArray, detections: Detections, paired: IntArray, detected: IntArray
    ) -> tuple[IntArray, IntArray]:
        """The matches so far and those by position, C^pos, among what they left."""
        tracks = np.setdiff1d(np.arange(len(predicted)), paired)
        free = np.setdiff1d(np.arange(len(detections)), detected)
        overlaps = iou_matrix(predicted[tracks], detections.boxes[free])
        rows, columns = assign(1 - overlaps, 1 - (1 - self.settings.position_gate) / self._slack)
        return np.concatenate([paired, tracks[rows]]), np.concatenate([detected, free[columns]])


def running_mean(earlier: FloatArray, now: FloatArray, old: float, new: float) -> FloatArray:
    """``(N, D)`` unit-length means of features, weighted by ``old`` and ``new``; the known one where one is NaN."""
    mean = old * earlier + new * now
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    # Two opposite features can cancel; the newer then stands alone, as it does where the older is not known.
    mean = np.where(length > 0, mean / np.where(length > 0, length, 1), now)
    return np.asarray(np.where(np.isnan(earlier), now, np.where(np.isnan(now), earlier, mean)))
