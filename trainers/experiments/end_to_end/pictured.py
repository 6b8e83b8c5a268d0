"""Stretches of video with pictures: what the Siamese network and the detector's heads learn from and are tracked on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.evaluation.multi import SequencePair
from tsuiseki.tracking.evaluation.resampling import score_sums
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.videos import detected_videos, filmed
from tsuiseki.trainers.association.windows import affordable
from tsuiseki.trainers.experiments.association.oracle import link_counts


@dataclass(frozen=True)
class Stretch:
    """A part of a sequence.

    Attributes:
        folder: of the sequence.
        first: its first frame, 1-based.
        last: its last frame, included.
    """

    folder: Path
    first: int
    last: int


def read_stretch(stretch: Stretch, detector: Detector | None = None) -> DetectedVideo:
    """The labels of a stretch with given detections, or with those of a detector."""
    (video,) = detected_videos([stretch.folder], detector or "given", (stretch.first, stretch.last))
    return video


def read_filmed(stretch: Stretch) -> DetectedVideo:
    """As `read_stretch`, with the camera's motion from the images."""
    return filmed(read_stretch(stretch))


def graphs_of_video(video: DetectedVideo, settings: FlowSettings | None = None) -> Graphs:
    """The networks of a stretch at the tracker's own costs."""
    graphs = sequence_graphs(video, settings)
    return Graphs(affordable(graphs.detections), graphs.tracklets, graphs.lost)


def tracks_on(video: DetectedVideo, found: Sequence[Detections], settings: FlowSettings | None = None) -> list[Track]:
    """The tracks that the flow gives, by default with its own costs."""
    tracker = FlowTracker(settings, frame_rate=video.frame_rate, size=video.size, camera=video.path())
    for one in found:
        tracker.update(one)
    return tracker.tracks()


def sums_of(video: DetectedVideo, tracks: list[Track]) -> FloatArray:
    """``(83,)`` see `score_sums`."""
    return score_sums(SequencePair(video.name, video.truth, tracks, len(video.detections)))


def gap_links(video: DetectedVideo, tracks: list[Track]) -> FloatArray:
    """``(2,)`` links of the labels over gaps of more than a frame, and how many of them the tracks have."""
    counts = link_counts(tracks, video.truth, video.frame_rate)
    return np.array([counts.right[1:].sum(), counts.made[1:].sum()], dtype=np.float64)
