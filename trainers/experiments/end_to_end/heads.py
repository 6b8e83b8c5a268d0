"""The detector's heads trained on through the flow, against as many steps by the detector's own loss alone.

Tracked are both with the costs that they learnt through, which take all places of starts and ends alike.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.tracking.evaluation.detection import evaluate_detections, labelled_boxes
from tsuiseki.tracking.features.exported import Detector
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray
from tsuiseki.trainers.association.fitting import Fit, fitted
from tsuiseki.trainers.association.flow_loss import FlowLoss
from tsuiseki.trainers.association.graphs import DetectedVideo
from tsuiseki.trainers.association.training import AssociationTraining, HeadsLearning
from tsuiseki.trainers.association.window_detector import FrozenTrunk
from tsuiseki.trainers.association.windows import FLOWS, WindowImages
from tsuiseki.trainers.experiments.end_to_end.pictured import (
    Stretch,
    graphs_of_video,
    read_stretch,
    sums_of,
    tracks_on,
)
from tsuiseki.trainers.networks.detector_training import DetectorTraining, detections

WAYS = ("as it ships", "its own loss", "the flow's loss", "both losses")
STEPS, SECONDS, RATE, OWN = 20, 0.6, 0.1, 0.3
# The heads learn from what the detector doubts, too; tracked is what `tsuiseki track people` takes.
LEARNT_FROM, TRACKED_FROM = 0.1, 0.3
# Of which the maps of the trunk are kept: 1 GB.
MOST_IMAGES = 400


def heads_sums(
    train: tuple[Stretch, ...], tests: tuple[Stretch, ...], start: Path, steps: int = STEPS
) -> list[list[FloatArray]]:
    """For each of `WAYS` and each test ``(84,)``: sums of scores, then AP50.

    Args:
        train: what is learnt from.
        tests: what is tracked.
        start: exported detector.
        steps: windows that are looked at.
    """
    found, trunk = Detector(start, LEARNT_FROM, threads=1), FrozenTrunk(MOST_IMAGES)
    graphs = [graphs_of_video(read_stretch(one, found)) for one in train]
    videos = [read_stretch(one) for one in tests]
    sums = []
    for way in WAYS:
        torch.manual_seed(0)
        own = 0.0 if way == "the flow's loss" else OWN
        module = AssociationTraining(
            loss=FlowLoss("fenchel_young"), detector=HeadsLearning(start, RATE, own), joins=0.0
        )
        module.trunk = trunk
        # The costs stay as they are, so that what is gained is the detector's.
        module.network.requires_grad_(False)
        if way != "as it ships":
            fit = Fit(steps=steps, seconds=SECONDS, flow=0.0 if way == "its own loss" else 1.0)
            fitted(module, graphs, fit, WindowImages(frames=found.model.card))
        assert module.detector is not None
        sums.append([_scored(video, module.detector, trunk) for video in videos])
    return sums


def _scored(video: DetectedVideo, detector: DetectorTraining, trunk: FrozenTrunk) -> FloatArray:
    every = [_found(read_image(path), detector, trunk) for path in video.images]
    precision = evaluate_detections(labelled_boxes(video.truth, range(len(every))), every).average_precision
    sure = [Detections(f.boxes[f.scores >= TRACKED_FROM], f.scores[f.scores >= TRACKED_FROM]) for f in every]
    return np.append(sums_of(video, tracks_on(video, sure, FLOWS["people"])), precision)


@torch.no_grad()
def _found(image: ImageArray, detector: DetectorTraining, trunk: FrozenTrunk) -> Detections:
    """All that the detector finds in an image, however unsure."""
    fitted_image, scale = fit_image(image, detector.card)
    heads = trunk.heads(detector, torch.from_numpy(fitted_image)[None])
    (found,) = detections(*heads, detector.network.anchors, detector.card)
    boxes = clip_boxes(found.boxes / np.tile(scale, 2), image.shape[1], image.shape[0])
    whole = ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
    return Detections(boxes[whole], found.scores[whole])
