"""The Siamese network trained on through the flow, against as many steps by its own loss alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.data import FLOWS, TrackerName, WindowImages
from tsuiseki.trainers.association.fitting import Fit, fitted
from tsuiseki.trainers.association.graphs import DetectedVideo
from tsuiseki.trainers.association.training import AssociationTraining
from tsuiseki.trainers.experiments.end_to_end.pictured import (
    Stretch,
    gap_links,
    graphs_of_video,
    read_filmed,
    read_stretch,
    sums_of,
    tracks_on,
)
from tsuiseki.trainers.networks.appearance import AppearanceTraining

Way = Literal["as it ships", "its own loss", "through the flow"]
WAYS: tuple[Way, ...] = ("as it ships", "its own loss", "through the flow")
STEPS, SECONDS, RATE = 40, 1.5, 0.05
READ: dict[TrackerName, Callable[[Stretch], DetectedVideo]] = {"people": read_stretch, "drone": read_filmed}


def appearance_sums(
    train: tuple[Stretch, ...], tests: tuple[Stretch, ...], start: Path, way: Way, tracker: TrackerName
) -> list[FloatArray]:
    """For each test ``(85,)``: sums of scores, then links over gaps, and those of them that the tracks have.

    Args:
        train: what is learnt from.
        tests: what is tracked.
        start: exported Siamese network.
        way: how it is trained on.
        tracker: whose costs are taken.
    """
    settings, read = FLOWS[tracker], READ[tracker]
    torch.manual_seed(0)
    module = AssociationTraining(appearance=start, appearance_rate=RATE, contrast=0.3, joins=0.0)
    siamese = module.siamese
    assert siamese is not None
    if way != "as it ships":
        # The costs stay as they are, so that what is gained is the Siamese network's.
        module.network.requires_grad_(False)
        module.link_cost = settings.costs.link
        graphs = [graphs_of_video(looked_at(read(one), siamese), settings) for one in train]
        fit = Fit(steps=STEPS, seconds=SECONDS, flow=0.0 if way == "its own loss" else 1.0)
        fitted(module, graphs, fit, WindowImages(crops=(siamese.card.input_height, siamese.card.input_width)))
    sums = []
    for one in tests:
        video = looked_at(read(one), siamese)
        tracks = tracks_on(video, video.detections, settings)
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
