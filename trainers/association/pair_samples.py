"""Labelled pairs of detections for the affinity: who is who among the detections, and which pairs the tracker asks."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from tsuiseki.datamodules.simulated_detections import DetectorFaults
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.costs import pair_features
from tsuiseki.tracking.association.learnt_costs import FeatureSet, feature_rows
from tsuiseki.tracking.association.pairwise_flow import GateSettings, candidate_pairs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import UNMATCHED
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.exported import Describe
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.association.graphs import DetectedVideo, picked
from tsuiseki.trainers.association.videos import Find, acting, described, detected

RIGHT_OVERLAP = 0.5
# A badly placed box still shows its person: links through it are right, though the box itself counts as wrong.
SAME_OVERLAP = 0.25


@dataclass(frozen=True)
class LabelledDetections:
    """All detections of some frames of a video and whom they show.

    Attributes:
        frames: ``(N,)`` frame numbers.
        boxes: ``(N, 4)`` pixels.
        scores: ``(N,)`` of the detector.
        features: ``(N, D)`` appearance, or None.
        ids: ``(N,)`` identities, `UNMATCHED` where a detection shows no labelled person.
        right: ``(N,)`` whether the box lies right, with an IoU of at least 0.5.
        actions: ``(N, A)`` probabilities of actions, or None.
    """

    frames: IntArray
    boxes: FloatArray
    scores: FloatArray
    features: FloatArray | None
    ids: IntArray
    right: BoolArray
    actions: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.frames)


@dataclass(frozen=True)
class PairSamples:
    """Pairs within the gate.

    Attributes:
        rows: ``(P, F)`` float32 features.
        same: ``(P,)`` whether both show the same person.
        group: ``(P,)`` number of the sequence and the part of it; pairs of one group are not independent.
    """

    rows: FloatArray
    same: BoolArray
    group: IntArray


def labelled_parts(
    video: DetectedVideo,
    frames: tuple[int, int] | None,
    find: Find,
    networks: Sequence[Describe],
    faults: DetectorFaults,
    rng: np.random.Generator,
    recognise: ActionRecogniser | None = None,
) -> Iterator[LabelledDetections]:
    """The labelled detections of a sequence, in as many equal spans as there are networks.

    Args:
        video: labelled, without detections.
        frames: first and last one, counted from 1; None takes all.
        find: where detections come from.
        networks: of appearance, each for its span; one describes all spans, none describes nothing.
        faults: of simulated detections.
        rng: of those.
        recognise: tells what people do; None leaves it unknown.
    """
    every = spans(video, frames, len(networks))
    found = detected(video, find, rng, faults, frames)
    for k, (start, stop) in enumerate(every):
        here = described(found, networks[k] if networks else None, (start, stop))
        here = acting(here, recognise)
        yield label_detections(here.detections[start:stop], video.truth, start)


def spans(video: DetectedVideo, frames: tuple[int, int] | None, count: int) -> list[tuple[int, int]]:
    """First frame, from 0, and the one after the last of ``count`` equal spans, at least one.

    Raises:
        RequestError: the sequence has no such frame.
    """
    length = len(video.detections)
    first, last = (1, length) if frames is None else frames
    first, last = max(first, 1) - 1, min(last, length) - 1
    if first > last:
        raise RequestError(f"{video.name}: no frame lies within {frames}; it has {length}")
    borders = np.linspace(first, last + 1, max(count, 1) + 1).round().astype(int)
    return list(itertools.pairwise(borders.tolist()))


def label_detections(detections: Sequence[Detections], truth: GroundTruth, first: int) -> LabelledDetections:
    """Match the detections of every frame to the labels: first those with an IoU of 0.5, then what is left with 0.25.

    Detections that only an ignored label explains are left out: it is unknown whether they are right.

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
        names = np.append(people.ids, UNMATCHED)[person]
        ids.append(names[~hidden])
        right.append(lies_right[~hidden])
        kept.append(found.select(~hidden))
    features = [d.features for d in kept if d.features is not None]
    actions = [d.actions for d in kept if d.actions is not None]
    return LabelledDetections(
        np.repeat(np.arange(first, first + len(kept)), [len(d) for d in kept]),
        np.concatenate([np.empty((0, 4)), *(d.boxes for d in kept)]),
        np.concatenate([np.empty(0), *(d.scores for d in kept)]),
        np.concatenate(features) if features else None,
        np.concatenate(ids),
        np.concatenate(right),
        np.concatenate(actions) if actions else None,
    )


def match_boxes(found: FloatArray, labelled: FloatArray) -> tuple[IntArray, BoolArray]:
    """``(N,)`` index of the label that each detected box shows, -1 for none, and whether the box lies right."""
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
    rows, columns = assign_overlaps(overlaps, least)
    result[rows] = columns
    return result


def every_nth(found: LabelledDetections, skip: int) -> LabelledDetections:
    """The detections of every ``skip``-th frame, as of a video with that much fewer frames."""
    kept = found.frames % skip == 0
    return replace(picked(found, kept), frames=found.frames[kept] // skip)


def pair_samples(found: LabelledDetections, features: FeatureSet, gate: GateSettings, groups: int) -> PairSamples:
    """The pairs that the tracker would ask about, in ``groups`` spans of equal length by the earlier detection.

    Pairs of two false detections are left out: that they are false is what their observation costs say, and a thing
    that is taken for a person again and again is one thing.
    """
    i, j, gap = candidate_pairs(found.frames, found.boxes, gate)
    kept = (found.ids[i] != UNMATCHED) | (found.ids[j] != UNMATCHED)
    i, j, gap = i[kept], j[kept], gap[kept]
    pairs = pair_features(found.boxes, found.features, i, j, gap, found.actions)
    start, stop = (int(found.frames.min()), int(found.frames.max()) + 1) if len(found) else (0, 1)
    return PairSamples(
        feature_rows(pairs, features).astype(np.float64),
        found.ids[i] == found.ids[j],
        (found.frames[i] - start) * groups // (stop - start),
    )


def join_samples(parts: Sequence[PairSamples]) -> PairSamples:
    """All pairs of ``parts``, whose groups stay apart."""
    first = np.cumsum([0, *(int(part.group.max(initial=-1)) + 1 for part in parts)])
    return PairSamples(
        np.concatenate([part.rows for part in parts]),
        np.concatenate([part.same for part in parts]),
        np.concatenate([part.group + before for part, before in zip(parts, first, strict=False)]),
    )


def with_unknown(samples: PairSamples, column: int, share: float, rng: np.random.Generator) -> PairSamples:
    """A ``share`` of the pairs once more without the feature of a ``column``, so that trees weigh it unknown, too."""
    more = picked(samples, rng.random(len(samples.same)) < share)
    more.rows[:, column] = np.nan
    return PairSamples(*(np.concatenate([getattr(one, x.name) for one in (samples, more)]) for x in fields(samples)))
