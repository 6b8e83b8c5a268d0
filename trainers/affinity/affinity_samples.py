"""Labelled pairs of detections for the affinity: who is who among the detections, and which pairs the tracker asks."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.costs import action_distances, pair_features
from tsuiseki.tracking.association.learnt_costs import FeatureSet, feature_rows
from tsuiseki.tracking.association.pairwise_flow import GateSettings, candidate_pairs
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Appearance, Detector
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import MotSequence
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, Frame, IntArray
from tsuiseki.tracking.types.labels import GroundTruth

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
        actions: ``(N, A)`` probabilities, or None.
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
    acting = [d.actions for d in kept if d.actions is not None]
    return LabelledDetections(
        np.repeat(np.arange(first, first + len(kept)), [len(d) for d in kept]),
        np.concatenate([np.empty((0, 4)), *(d.boxes for d in kept)]),
        np.concatenate([np.empty(0), *(d.scores for d in kept)]),
        np.concatenate(described) if described else None,
        np.concatenate(ids),
        np.concatenate(right),
        np.concatenate(acting) if acting else None,
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
    rows, columns = assign_overlaps(overlaps, least)
    result[rows] = columns
    return result


def pair_samples(
    found: LabelledDetections,
    features: FeatureSet,
    gate: GateSettings,
    groups: int,
    actions: tuple[FloatArray, FloatArray] | None = None,
) -> PairSamples:
    """The pairs that the tracker would ask about, in ``groups`` stretches of equal length by the earlier detection.

    Pairs of two false detections are left out: that they are false is what their observation costs say, and a thing
    that is taken for a person again and again is one thing. ``actions`` are the action features ``(N, A)``
    of detections as the earlier and as the later one of a pair, if there are any.
    """
    i, j, gap = candidate_pairs(found.frames, found.boxes, gate)
    kept = (found.ids[i] != NOBODY) | (found.ids[j] != NOBODY)
    i, j, gap = i[kept], j[kept], gap[kept]
    pairs = pair_features(found.boxes, found.features, i, j, gap)
    if actions is not None:
        pairs = replace(pairs, action=action_distances(*actions, i, j))
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


def labelled_parts(
    sequence: MotSequence,
    frames: tuple[int, int] | None,
    find: Sequence[Detector] | Literal["given", "simulated"],
    models: Sequence[Appearance],
    faults: DetectorFaults,
    rng: np.random.Generator,
) -> Iterator[LabelledDetections]:
    """The labelled detections of a sequence, in as many equal stretches as there are networks of a kind.

    Args:
        sequence: labelled.
        frames: first and last one, counted from 1; None takes all.
        find: where detections come from; of several detectors each looks at its stretch.
        models: appearance networks, likewise; one describes all stretches, none describes nothing.
        faults: of simulated detections.
        rng: of those.
    """
    truth = read_ground_truth(sequence.ground_truth_path)
    given: list[Detections] = []
    if find == "given":
        given = read_detections(sequence.detections_path, sequence.length)
    elif find == "simulated":
        given = simulate_detections(rng, truth, sequence.length, sequence.width, sequence.height, faults)
    detectors: Sequence[Detector] = () if isinstance(find, str) else find
    for k, (start, stop) in enumerate(stretches(sequence, frames, max(len(models), len(detectors)))):
        model = models[k % len(models)] if models else None
        if not detectors and model is None:
            found = given[start:stop]
        else:
            detect = detectors[k % len(detectors)] if detectors else given
            found = [d for _, d in stream(_frames(sequence, start, stop), detect, model)]
        yield label_detections(found, truth, start)


def stretches(sequence: MotSequence, frames: tuple[int, int] | None, count: int) -> list[tuple[int, int]]:
    """First frame, from 0, and the one after the last of ``count`` equal stretches, at least one.

    Raises:
        RequestError: the sequence has no such frame.
    """
    first, last = (1, sequence.length) if frames is None else frames
    first, last = max(first, 1) - 1, min(last, sequence.length) - 1
    if first > last:
        raise RequestError(f"{sequence.folder}: no frame lies within {frames}; it has {sequence.length}")
    borders = np.linspace(first, last + 1, max(count, 1) + 1).round().astype(int)
    return list(itertools.pairwise(borders.tolist()))


def _frames(sequence: MotSequence, start: int, stop: int) -> Iterator[Frame]:
    if not sequence.images:
        raise RequestError(f"{sequence.folder}: expected images in img1/, found none; the appearance needs them")
    for index in range(start, stop):
        yield Frame(index, index / sequence.frame_rate, read_image(sequence.images[index]))


def every_nth(found: LabelledDetections, skip: int) -> LabelledDetections:
    """The detections of every ``skip``-th frame, as of a video with that much fewer frames."""
    kept = found.frames % skip == 0
    return LabelledDetections(
        found.frames[kept] // skip,
        found.boxes[kept],
        found.scores[kept],
        None if found.features is None else found.features[kept],
        found.ids[kept],
        found.right[kept],
        None if found.actions is None else found.actions[kept],
    )
