"""The scores of the detections of a window, with gradients into the heads of the detector that reported them.

The tracker takes a score s for the probability p that the video's own calibration gives it, and logit p, times a
weight, is what a detection is worth. That calibration is a staircase without a useful slope. So a step takes the
tracker's cost where the training began, and from there on a straight line: with ℓ the logit of s at the detection's
anchor and ℓ₀ what it was at first,

    Δ logit p = slope · (ℓ − ℓ₀),      Δ cost = κ · Δ logit p,

slope that of the line which fits logit p to ℓ over the sequence, κ < 0 the cost of a logit. Both features of the
network of costs that hold them change likewise. Boxes, and how well they are measured, are held fixed within a step.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from tsuiseki.datamodules.augmentation import Example
from tsuiseki.datamodules.detection_data import DetectionBatch, collate
from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.tracking.association.evidence import DETECTION_FEATURES
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import IntArray
from tsuiseki.trainers.association.graphs import Graph
from tsuiseki.trainers.networks.detector_training import DetectorTraining
from tsuiseki.trainers.networks.modules import normalised

COST, LOGIT = (DETECTION_FEATURES.index(name) for name in ("cost", "logit"))


@dataclass(frozen=True)
class WindowFrames:
    """The images of a window.

    Attributes:
        batch: T images fitted into the detector, with the labels of their people.
        which: ``(N,)`` image of each detection.
    """

    batch: DetectionBatch
    which: IntArray


def frames_of(graph: Graph, card: ModelCard) -> WindowFrames:
    """The images of a window's frames, from the first to the last one with a detection.

    Raises:
        RequestError: nothing says where the detections come from.
    """
    if graph.origin is None:
        raise RequestError(f"{graph.name}: expected detections of --data.detector, whose heads are to learn")
    frames = range(int(graph.frames.min(initial=0)), int(graph.frames.max(initial=-1)) + 1)
    examples, truth = [], graph.origin.truth
    for frame in frames:
        image, scale = fit_image(read_image(graph.images[frame]), card)
        people = truth.between(frame, frame)
        people = people.select(people.evaluated | people.ignored)
        examples.append(Example(image, people.boxes * np.tile(scale, 2), ~people.evaluated))
    nothing = torch.empty(0, card.input_height, card.input_width, 3, dtype=torch.uint8)
    none = DetectionBatch(nothing, torch.empty(0, 0, 4), torch.empty(0, 0, dtype=torch.int64))
    return WindowFrames(collate(examples) if examples else none, graph.frames - frames.start)


class FrozenTrunk:
    """The maps that a trunk which does not learn makes of images: those of the latest images are kept.

    Args:
        most: images that are kept; one of 640 by 480 pixels takes about 2.5 MB.
    """

    def __init__(self, most: int = 320) -> None:
        self.most = most
        # Each image's place in the maps, the latest last. One block a level: many small ones would scatter the memory.
        self._place: OrderedDict[bytes, int] = OrderedDict()
        self._levels: list[Tensor] = []

    def heads(self, detector: DetectorTraining, images: Tensor) -> tuple[Tensor, Tensor]:
        """Raw heads of ``(T, H, W, 3)`` uint8 images; all normalisations keep the statistics they were trained with.

        Raises:
            RequestError: there are more images than are kept.
        """
        if len(images) > self.most:
            raise RequestError(f"expected windows of at most {self.most} frames for the detector, got {len(images)}")
        detector.eval()
        places = [self._placed(detector, image) for image in images]
        logits, offsets = detector.network.heads([level[places] for level in self._levels])
        return logits, offsets

    def _placed(self, detector: DetectorTraining, image: Tensor) -> int:
        key = hashlib.blake2b(image.cpu().numpy().tobytes(), digest_size=16).digest()
        if key not in self._place:
            with torch.no_grad():
                maps = detector.network.features(normalised(image[None].to(detector.device), detector.card))
            if not self._levels:
                self._levels = [one.new_empty(self.most, *one.shape[1:]) for one in maps]
            full = len(self._place) == self.most
            place = self._place.popitem(last=False)[1] if full else len(self._place)
            for level, one in zip(self._levels, maps, strict=True):
                level[place] = one[0]
            self._place[key] = place
        self._place.move_to_end(key)
        return self._place[key]


def score_logits(logits: Tensor, frames: WindowFrames, graph: Graph) -> Tensor:
    """``(N,)`` logits of the scores of a window's detections, from the raw heads ``(T, A, 2)`` of its images."""
    assert graph.origin is not None
    which, anchors = (torch.as_tensor(part, device=logits.device) for part in (frames.which, graph.origin.anchors))
    chosen = logits[which, anchors]
    return chosen[:, 1] - chosen[:, 0]


def rescored(rows: Tensor, found: Tensor, graph: Graph) -> tuple[Tensor, Tensor]:
    """Features of the detections at other scores, and by how much that changes the default's costs.

    Args:
        rows: ``(N, G)`` features at the scores where the training began.
        found: ``(N,)`` logits of the scores now.
        graph: the window.
    """
    origin = graph.origin
    assert origin is not None
    surer = origin.slope * (found - torch.as_tensor(origin.logits, dtype=found.dtype, device=found.device))
    columns = list(rows.unbind(dim=1))
    columns[LOGIT] = columns[LOGIT] + surer
    columns[COST] = columns[COST] + origin.cost_slope * surer
    return torch.stack(columns, dim=1), origin.cost_slope * surer


def own_loss(detector: DetectorTraining, outputs: tuple[Tensor, Tensor], frames: WindowFrames) -> Tensor:
    """The loss that the detector is trained by apart, on the images of a window."""
    boxes, labels = (part.to(detector.device) for part in frames.batch[1:])
    class_loss, box_loss = detector.loss(*outputs, detector.network.anchors, boxes, labels)
    total: Tensor = class_loss + box_loss
    return total
