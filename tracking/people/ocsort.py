"""OC-SORT: people followed online, with more weight on observations than on predictions.

Cao et al., "Observation-Centric SORT: rethinking SORT for robust multi-object tracking", CVPR 2023. The prediction of a
Kalman filter drifts during a gap, and its velocity is its noisiest part. Three additions to SORT use the observations z
instead:

* ORU, observation-centric re-update (section 4.1): a track detected at t₁ and again at t₂ is filtered once more
  from t₁ on, along the virtual observations z̃_t = z_t₁ + (t − t₁)/(t₂ − t₁) · (z_t₂ − z_t₁).
* OCM, observation-centric momentum (section 4.2): the cost of a match is C = C_IoU + λ C_v. C_v compares two
  directions: that of the track between two of its observations Δt frames apart, and that from its last observation to
  the detection.
* OCR, observation-centric recovery (section 4.3): unmatched detections are matched to unmatched tracks by the overlap
  with the track's last observation. This finds people who stopped, or who come back where they were hidden.

The paper leaves these points open; here:

* C_IoU is 1 − IoU with the prediction. A pair with an IoU below ``min_iou`` is never matched, whatever its direction.
* C_v = Δθ/π − 1/2 lies in [−1/2, 1/2], with Δθ in [0, π] the angle between the two directions. It is 0 where one of
  them is unknown.
* Where a track has no observation exactly Δt frames before its last one, its earliest within Δt frames is taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field, NonNegativeFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.bounds import SETTINGS, Age, PositiveShare, changed
from tsuiseki.tracking.filters.kalman import (
    BoxBelief,
    BoxMotion,
    per_longer_frame,
    predict_boxes,
    start_boxes,
    update_boxes,
)
from tsuiseki.tracking.geometry import centres, iou_matrix
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.people.lifecycle import LifecycleSettings, LifecycleTracker, ReportedBox, Survivors, matched
from tsuiseki.tracking.types import Columns, Detections, FloatArray, IntArray, Targets


@pydantic_dataclass(frozen=True, config=SETTINGS)
class OcSortSettings(LifecycleSettings):
    """Settings of OC-SORT.

    Attributes:
        min_score: score below which a detection is not used, in the detector's units.
        min_iou: least overlap of a match with the prediction or with the last observation, in (0, 1].
        direction_weight: λ of OCM, at least 0.
        direction_span: Δt of OCM, frames between the two observations that give a track's direction.
    """

    max_age: Age = 30
    start_score: float = 0.6
    min_score: float = 0.6
    min_iou: PositiveShare = 0.3
    direction_weight: NonNegativeFloat = 0.2
    direction_span: Annotated[int, Field(ge=1, le=1000)] = 3


OCSORT = OcSortSettings()


class OcSort(LifecycleTracker[OcSortSettings]):
    """Each frame: predict, match by overlap and direction (OCM), recover what is left over (OCR), update (ORU).

    Args:
        settings: all of them.
        seed: taken as by all trackers; nothing is drawn.

    Any setting can be given by its name as well, which goes before ``settings``. Without settings ``start_score`` is
    ``min_score``, where that is given.

    Somebody hidden for ten frames who then walks on is one track:

    >>> tracker = OcSort()
    >>> for time in range(30):
    ...     people = tracker.update([] if 10 <= time < 20 else [[time, 0, time + 20, 50, 0.9]])
    >>> people.ids, people.status
    (array([1]), array(['tracking'], dtype='<U9'))
    >>> [len(track) for track in tracker.tracks()]
    [20]
    """

    def __init__(
        self,
        settings: OcSortSettings = OCSORT,
        seed: int = 0,
        *,
        min_score: float | None = None,
        min_iou: float | None = None,
        direction_weight: float | None = None,
        direction_span: int | None = None,
        min_hits: int | None = None,
        max_age: int | None = None,
        start_score: float | None = None,
        boxes: ReportedBox | None = None,
        motion: BoxMotion | None = None,
    ) -> None:
        if start_score is None and settings is OCSORT:
            start_score = min_score
        settings = changed(settings, OcSortSettings, locals())
        super().__init__(settings, seed)
        columns, none = self.settings.direction_span + 1, start_boxes(np.empty((0, 4)), self.settings.motion)
        self._history = History(none, none.boxes, np.empty((0, columns, 2)), np.empty((0, columns)))

    def update(self, detections: DetectionsLike, time: float | None = None) -> Targets:
        """Take the detections of the next frame; its people. A detection without a score takes part."""
        detections = as_detections(detections, counted=self.bad)
        sure = detections.select(~(detections.scores < self.settings.min_score))
        predicted, misses = self._predict(time), self._misses
        if self._longer != 1:
            belief = per_longer_frame(self._history.belief, self._longer)
            self._history = replace(self._history, belief=belief)
        paired, detected = self._match(predicted, sure)
        paired, detected = self._recover(sure, paired, detected)
        passed = np.array(self._clock.passed)
        again = re_updated(self._history, paired, misses[paired], sure.boxes[detected], self.settings.motion, passed)
        unmatched = np.setdiff1d(np.arange(len(misses)), paired)
        order = np.argsort(np.concatenate([paired, unmatched]))
        self._belief = again.and_then(self._belief.select(unmatched)).select(order)
        targets, parts = self._advance(paired, detected, sure)
        self._history = _continued(self._history, parts, misses, sure.boxes, self._belief)
        return targets

    def _match(self, predicted: FloatArray, detections: Detections) -> tuple[IntArray, IntArray]:
        """The first matching, by C = C_IoU + λ C_v."""
        overlaps = iou_matrix(predicted, detections.boxes)
        weight = self.settings.direction_weight
        # The least cost 1 - IoU + λ C_v is the most of IoU - λ C_v, which is never below -λ.
        gains = overlaps - weight * direction_costs(self._history, centres(detections.boxes))
        near = overlaps >= self.settings.min_iou / self._slack
        return assign_overlaps(np.where(near, gains, -np.inf), -weight)

    def _recover(self, detections: Detections, paired: IntArray, detected: IntArray) -> tuple[IntArray, IntArray]:
        """The matches so far and those with last observations among what they left."""
        last, least = self._history.boxes, self.settings.min_iou / self._slack
        tracks = np.setdiff1d(np.arange(len(last)), paired)
        free = np.setdiff1d(np.arange(len(detections)), detected)
        recovered_tracks, recovered_detections = matched(last, detections.boxes, tracks, free, least)
        return np.concatenate([paired, recovered_tracks]), np.concatenate([detected, recovered_detections])


@dataclass(frozen=True)
class History(Columns):
    """What was observed of N tracks.

    Attributes:
        belief: of the filter right after the last observation.
        boxes: ``(N, 4)`` the last observation.
        trail: ``(N, Δt + 1, 2)`` centres of the last observations, the newest first.
        ages: ``(N, Δt + 1)`` by how many frames each is older than the newest; infinite where there is none.
    """

    belief: BoxBelief
    boxes: FloatArray
    trail: FloatArray
    ages: FloatArray


def _continued(history: History, parts: Survivors, misses: IntArray, boxes: FloatArray, belief: BoxBelief) -> History:
    """The history after a frame with detections ``boxes`` ``(M, 4)``; ``misses`` ``(N,)`` are those before it."""
    paired, coasting = parts.matched, parts.coasting
    now = boxes[np.concatenate([parts.detected, parts.started])]
    columns = history.ages.shape[1]
    trail, ages = np.zeros((len(now), columns, 2)), np.full((len(now), columns), np.inf)
    trail[:, 0], ages[:, 0] = centres(now), 0
    trail[: len(paired), 1:] = history.trail[paired, :-1]
    ages[: len(paired), 1:] = history.ages[paired, :-1] + (misses[paired] + 1)[:, None]
    # In the order of the tracks: matched, coasting, started.
    order = np.concatenate(
        [np.arange(len(paired)), len(now) + np.arange(len(coasting)), np.arange(len(paired), len(now))]
    )
    observed = np.concatenate([np.arange(len(paired)), len(paired) + len(coasting) + np.arange(len(parts.started))])
    return History(belief.select(observed), now, trail, ages).and_then(history.select(coasting)).select(order)


def direction_costs(history: History, detected: FloatArray) -> FloatArray:
    """``(N, M)`` C_v of OCM, in [-1/2, 1/2]: how much each track would have to turn to reach each detection.

    Args:
        history: of N tracks.
        detected: ``(M, 2)`` centres of the detections.
    """
    earliest = np.where(history.ages < history.ages.shape[1], history.ages, -1).argmax(axis=1)
    last = history.trail[:, 0]
    moved = (last - history.trail[np.arange(len(last)), earliest])[:, None]
    intended = detected[None] - last[:, None]
    across = moved[..., 0] * intended[..., 1] - moved[..., 1] * intended[..., 0]
    along = (moved * intended).sum(axis=2)
    both_move = moved.any(axis=2) & intended.any(axis=2)
    return np.where(both_move, np.arctan2(np.abs(across), along) / np.pi - 0.5, 0.0)


def re_updated(
    history: History,
    which: IntArray,
    misses: IntArray,
    detected: FloatArray,
    motion: BoxMotion,
    passed: FloatArray,
) -> BoxBelief:
    """ORU: what tracks detected again predict for this frame, had they been detected on the straight way there.

    Args:
        history: of all tracks.
        which: ``(K,)`` the tracks that were matched.
        misses: ``(K,)`` inferences since each was detected; the filter is run through as many virtual observations.
        detected: ``(K, 4)`` the detections they were matched to.
        motion: noise of the filter.
        passed: ``(L,)`` frames of the filter before each of the last inferences, the newest last; more than of
            ``misses``.
    """
    belief, start = history.belief.select(which), history.boxes[which]
    times = np.append(0, np.cumsum(passed))
    last = len(passed) - 1 - misses
    step = (detected - start) / np.maximum(times[-1] - times[last], 1e-9)[:, None]
    for count in range(1, int(misses.max(initial=0)) + 1):
        hidden, visible = np.flatnonzero(misses >= count), np.flatnonzero(misses < count)
        now = last[hidden] + count
        virtual = start[hidden] + (times[now] - times[last[hidden]])[:, None] * step[hidden]
        again = update_boxes(predict_boxes(belief.select(hidden), motion, passed[now - 1]), virtual, motion)
        belief = again.and_then(belief.select(visible)).select(np.argsort(np.concatenate([hidden, visible])))
    return predict_boxes(belief, motion, passed[-1])
