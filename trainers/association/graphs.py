"""A labelled sequence with its detections, its flow networks, and the labelled flow x* in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, IntArray
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.association.flow_loss import Arcs, DifferenceWeights


@dataclass(frozen=True)
class DetectedVideo:
    """Detections and labels of one sequence.

    Attributes:
        name: for people to read.
        detections: of each frame.
        truth: labels, frames counted from 0.
        frame_rate: frames a second.
        size: width and height of the image; None where not known.
        images: files, one a frame; none where nothing looks at them.
        anchors: of each frame the ``(N,)`` anchors of a detector that its detections come from; none where unknown.
        camera: its step into each frame, from the images; none takes the boxes.
        given: file of detections beside the labels; None where there is none.
    """

    name: str
    detections: Sequence[Detections]
    truth: GroundTruth
    frame_rate: float
    size: tuple[int, int] | None
    images: tuple[Path, ...] = ()
    anchors: tuple[IntArray, ...] = ()
    camera: tuple[CameraStep, ...] = ()
    given: Path | None = None

    def path(self) -> CameraPath | None:
        """Where the frames lie, from the images; None where the boxes have to tell."""
        if not self.camera:
            return None
        path = CameraPath()
        for step in self.camera:
            path.follow(step)
        return path


@dataclass(frozen=True)
class Origin:
    """Where the detections of a network come from, for a detector to learn.

    Attributes:
        anchors: ``(N,)`` of the detector.
        logits: ``(N,)`` of its scores.
        slope: of the straight line that fits the logits of the probabilities, which the tracker takes scores for, to
            those of the scores.
        price: by how much a detection costs more a unit of the logit of its probability; below 0.
        truth: labels of the sequence.
    """

    anchors: IntArray
    logits: FloatArray
    slope: float
    price: float
    truth: GroundTruth

    def select(self, which: BoolArray) -> Origin:
        """That of some of the detections."""
        return replace(self, anchors=self.anchors[which], logits=self.logits[which])


@dataclass(frozen=True)
class Others:
    """Detections of tracks of which labels do not say whether they are right: appearance is averaged over them, too.

    Attributes:
        frames: ``(M,)``.
        boxes: ``(M, 4)`` where the image shows them, pixels.
        tracks: ``(M,)`` track of each by default.
        features: ``(M, D)`` as those of `Graph`; None where nothing described them.
    """

    frames: IntArray
    boxes: FloatArray
    tracks: IntArray
    features: FloatArray | None = None

    def select(self, which: BoolArray) -> Others:
        """Some of them."""
        features = None if self.features is None else self.features[which]
        return Others(self.frames[which], self.boxes[which], self.tracks[which], features)

    def and_more(self, more: Others) -> Others:
        """These, and ``more``; an empty one says nothing of features."""
        if not len(more.frames) or not len(self.frames):
            return self if len(self.frames) else more
        both = None
        if self.features is not None and more.features is not None:
            both = np.concatenate([self.features, more.features])
        frames, boxes, tracks = (
            np.concatenate([getattr(one, name) for one in (self, more)]) for name in ("frames", "boxes", "tracks")
        )
        return Others(frames, boxes, tracks, both)


def no_others() -> Others:
    """None of them."""
    return Others(np.empty(0, dtype=np.int64), np.empty((0, 4)), np.empty(0, dtype=np.int64))


@dataclass(frozen=True)
class Graph:
    """A network at the tracker's costs, its features, and the labelled flow.

    Attributes:
        name: of the sequence, and of the frames of a window.
        frame_rate: frames a second.
        frames: ``(N,)`` of the detections, or of the first ones of tracklets.
        owners: ``(N,)`` whose each is, below 0 for nobody's.
        boxes: ``(N, 4)`` where the image shows them, pixels.
        tracks: ``(N,)`` track of each by default, -1 for none.
        costs: ``(3 N + P,)`` by default: of use, starts, ends and links.
        fixed: ``(3 N,)`` those of use, starts and ends that are not learnt.
        detections: ``(N, G)`` features; without columns where those costs are fixed.
        tail: ``(P,)``.
        head: ``(P,)``.
        links: ``(P, F)`` features.
        labelled: ``(3 N + P,)`` x*.
        people: frames of the labelled boxes, those without a detection included.
        images: files of the sequence, one a frame; none where nothing looks at them.
        origin: where the detections come from; None where not known.
        features: ``(N, D)`` what the detections look like, of unit length, NaN where not known; None where nothing
            described them.
        others: detections that are in tracks and not in the network.
    """

    name: str
    frame_rate: float
    frames: IntArray
    owners: IntArray
    boxes: FloatArray
    tracks: IntArray
    costs: FloatArray
    fixed: BoolArray
    detections: FloatArray
    tail: IntArray
    head: IntArray
    links: FloatArray
    labelled: FloatArray
    people: IntArray
    images: tuple[Path, ...] = ()
    origin: Origin | None = None
    features: FloatArray | None = None
    others: Others = field(default_factory=no_others)

    def __len__(self) -> int:
        return len(self.frames)

    def arcs(self, weights: DifferenceWeights) -> Arcs:
        """The arcs with what Δ counts for them."""
        weight = weights.of(self.owners, self.tail, self.head, self.labelled)
        return Arcs(self.tail, self.head, self.labelled, weight)


@dataclass(frozen=True)
class Graphs:
    """The two levels of a sequence.

    Attributes:
        detections: links of detections.
        tracklets: joins of the tracklets that the flow over the detections gives.
    """

    detections: Graph
    tracklets: Graph
