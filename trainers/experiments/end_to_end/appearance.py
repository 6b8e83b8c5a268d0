"""The Siamese network, or a projection of what it says, trained on through the flow, against its own loss alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import torch

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fitted
from tsuiseki.trainers.association.graphs import DetectedVideo
from tsuiseki.trainers.association.starting import siamese_of
from tsuiseki.trainers.association.training import AppearanceLearning, AssociationTraining
from tsuiseki.trainers.association.windows import FLOWS, TrackerName, WindowImages
from tsuiseki.trainers.experiments.end_to_end.pictured import (
    Stretch,
    gap_links,
    graphs_of_video,
    read_filmed,
    read_stretch,
    sums_of,
    tracks_on,
)
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining

Way = Literal["as it ships", "its own loss", "through the flow", "projected, its own loss", "projected, the flow"]
WAYS: tuple[Way, ...] = get_args(Way)
STEPS, SECONDS, RATE = 40, 1.5, 0.05
# Numbers that are left of a feature.
KEPT = 32
READ: dict[TrackerName, Callable[[Stretch], DetectedVideo]] = {"people": read_stretch, "drone": read_filmed}


def appearance_sums(
    train: tuple[Stretch, ...], tests: tuple[Stretch, ...], start: Path, way: Way, tracker: TrackerName
) -> list[FloatArray]:
    """For each test ``(85,)``: sums of scores, then links over gaps, and those of them that the tracks have.

    Args:
        train: what is learnt from.
        tests: what is tracked.
        start: exported Siamese network.
        way: how it is trained on; ``projected`` leaves it as it is, and trains a projection of its features.
        tracker: whose costs are taken.
    """
    settings, read, projects = FLOWS[tracker], READ[tracker], way.startswith("projected")
    torch.manual_seed(0)
    siamese, _ = siamese_of(start)
    module = AssociationTraining(
        appearance=AppearanceLearning(
            None if projects else start, RATE, contrast=0.3, projection=KEPT if projects else 0
        ),
        joins=0.0,
    )
    if way != "as it ships":
        # The costs stay as they are, so that what is gained is the appearance's.
        module.network.requires_grad_(False)
        module.link_cost = settings.costs.link
        graphs = [graphs_of_video(looked_at(read(one), siamese), settings) for one in train]
        fit = Fit(steps=STEPS, seconds=SECONDS, flow=0.0 if way.endswith("its own loss") else 1.0)
        size = siamese.card.input_height, siamese.card.input_width
        fitted(module, graphs, fit, WindowImages(crops=None if projects else size))
    sums = []
    for one in tests:
        video = looked_at(read(one), module.siamese or siamese)
        tracks = tracks_on(video, [NetworkChanges(module.network).projected(f) for f in video.detections], settings)
        sums.append(np.concatenate([sums_of(video, tracks), gap_links(video, tracks)]))
    return sums


def looked_at(video: DetectedVideo, siamese: AppearanceTraining) -> DetectedVideo:
    """The stretch with what its detections look like to the network."""
    siamese.eval()
    card, found = siamese.card, []
    for detections, path in zip(video.detections, video.images, strict=True):
        crops = crop_boxes(read_image(path), detections.boxes, card.input_height, card.input_width)
        with torch.no_grad():
            features = siamese(torch.as_tensor(crops)) if len(crops) else torch.empty(0, card.feature_length)
        found.append(detections.with_features(features.double().numpy()))
    return replace(video, detections=found)
