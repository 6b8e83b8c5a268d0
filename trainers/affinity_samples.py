"""Labelled pairs of detections for the affinity: who is who among the detections, and which pairs the tracker asks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.association.affinity import FeatureSet, feature_rows
from tsuiseki.tracking.association.costs import pair_features
from tsuiseki.tracking.association.gating import GateSettings, candidate_pairs
from tsuiseki.tracking.formats.mot import GroundTruth
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray

NOBODY = -1
RIGHT_OVERLAP = 0.5
# A badly placed box still shows its person: links through it are right, though the box itself counts as wrong.
SAME_OVERLAP = 0.25


@dataclass(frozen=True)
class LabelledDetections:
    """All detections of a stretch of video and whom they show.

    Attributes:
        frames: ``(N,)`` frame numbers.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` of the detector.
        features: ``(N, D)`` appearance, or None.
        ids: ``(N,)`` identities, `NOBODY` where a detection shows no labelled person.
        right: ``(N,)`` whether the box lies right, with an IoU of at least 0.5.
    """

    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None
    ids: IntArray
    right: BoolArray

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True)
class PairSamples:
    """Pairs within the gate.

    Attributes:
        rows: ``(P, F)`` float32 features.
        same: ``(P,)`` whether both show the same person.
        gap: ``(P,)`` frames between the two.
        group: ``(P,)`` number of the stretch and the part of it; pairs of one group are not independent.
    """

    rows: FloatArray
    same: BoolArray
    gap: IntArray
    group: IntArray


def label_detections(detections: Sequence[Detections], truth: GroundTruth, first: int) -> LabelledDetections:
    """Match the detections of every frame to the labels: first those with an IoU of 0.5, then what is left with 0.25.

    Detections that only an ignored label explains are left out: nobody says whether they are right.

    Args:
        detections: of the frames from ``first`` on.
        truth: labels.
        first: 0-based frame of the first entry.
    """
    ids, right, kept = [np.empty(0, np.int64)], [np.empty(0, np.bool_)], []
    for frame, found in enumerate(detections, start=first):
        rows = truth.between(frame, frame)
        people, ignored = rows.select(rows.evaluated), rows.select(rows.ignored)
        person, lies_right = match_boxes(found.boxes, people.boxes)
        hidden = (iou_matrix(found.boxes, ignored.boxes) >= RIGHT_OVERLAP).any(axis=1) & (person < 0)
        names = np.append(people.ids, NOBODY)[person]
        ids.append(names[~hidden])
        right.append(lies_right[~hidden])
        kept.append(found.select(~hidden))
    described = [d.features for d in kept if d.features is not None]
    return LabelledDetections(
        np.repeat(np.arange(first, first + len(kept)), [len(d) for d in kept]),
        np.concatenate([np.empty((0, 4)), *(d.boxes for d in kept)]),
        np.concatenate([np.empty(0), *(d.scores for d in kept)]),
        np.concatenate(described) if described else None,
        np.concatenate(ids),
        np.concatenate(right),
    )


def match_boxes(found: FloatArray, labelled: FloatArray) -> tuple[IntArray, BoolArray]:
    """``(N,)`` index of the label that each found box shows, -1 for none, and whether the box lies right."""
    overlaps = iou_matrix(found, labelled)
    person = _assign(overlaps, RIGHT_OVERLAP)
    right = person >= 0
    # What is matched already takes no further part.
    overlaps[right] = 0
    overlaps[:, person[right]] = 0
    return np.maximum(person, _assign(overlaps, SAME_OVERLAP)), right


def _assign(overlaps: FloatArray, least: float) -> IntArray:
    """``(N,)`` column assigned to each row, best total first (Hungarian), -1 where there is none."""
    result = np.full(len(overlaps), -1, dtype=np.int64)
    # Below the limit a match is worth nothing, so that it never pushes a valid one aside.
    i, j = linear_sum_assignment(np.where(overlaps >= least, overlaps, 0), maximize=True)
    valid = overlaps[i, j] >= least
    result[i[valid]] = j[valid]
    return result


def pair_samples(found: LabelledDetections, features: FeatureSet, gate: GateSettings, groups: int) -> PairSamples:
    """The pairs that the tracker would ask about, in ``groups`` stretches of equal length by the earlier detection.

    Pairs of two false detections are left out: that they are false is what their observation costs say, and a thing
    that is taken for a person again and again is one thing.
    """
    i, j, gap = candidate_pairs(found.frames, found.boxes, gate)
    kept = (found.ids[i] != NOBODY) | (found.ids[j] != NOBODY)
    i, j, gap = i[kept], j[kept], gap[kept]
    pairs = pair_features(found.boxes, found.features, i, j, gap)
    start, stop = (int(found.frames.min()), int(found.frames.max()) + 1) if len(found) else (0, 1)
    return PairSamples(
        feature_rows(pairs, features).astype(np.float64),
        found.ids[i] == found.ids[j],
        gap,
        (found.frames[i] - start) * groups // (stop - start),
    )


def join_samples(parts: Sequence[PairSamples]) -> PairSamples:
    """All pairs of ``parts``, whose groups stay apart."""
    groups, first = [], 0
    for part in parts:
        groups.append(part.group + first)
        first += int(part.group.max(initial=-1)) + 1
    return PairSamples(
        np.concatenate([part.rows for part in parts]),
        np.concatenate([part.same for part in parts]),
        np.concatenate([part.gap for part in parts]),
        np.concatenate(groups),
    )
