"""Fitting detectors of the SSD family to labelled boxes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.ops import batched_nms

from tsuiseki.datamodules.detector import PERSON_ALONE, DetectionBatch
from tsuiseki.models import losses
from tsuiseki.models.anchors import decode
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.detector import BranchedDetector
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.detection import evaluate_classes
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.types import Detections, FloatArray, IntArray
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.detector_network import (
    COCO_NORMALISATIONS,
    Architecture,
    Normalisation,
    Resize,
    SoftTeacher,
    Teacher,
    begin_branch,
    build_detector,
    detector_card,
    take_over,
)
from tsuiseki.trainers.exporting.exported_weights import restore_normalisations
from tsuiseki.trainers.network_module import NetworkModule, Optimisation, normalised, plain_hyperparameters

# Widths and heights of people in street views, in pixels of a 640x480 input, at strides 8, 16, 32 and 64.
STREET_ANCHORS: list[list[tuple[float, float]]] = [
    [(9.0, 22.0), (13.0, 32.0), (18.0, 46.0)],
    [(25.0, 64.0), (36.0, 92.0)],
    [(52.0, 132.0), (78.0, 190.0)],
    [(120.0, 280.0)],
]
DetectionLossName = Literal["multibox", "quality"]
# What scores and boxes learn by.
LOSSES: dict[DetectionLossName, tuple[losses.ScoreTerm, losses.BoxTerm]] = {
    "multibox": (losses.mined_entropy, losses.smooth_l1),
    "quality": (losses.overlap_focal, losses.complete_iou),
}
# Boxes of an image with the best scores, which suppression chooses from.
_CANDIDATES = 300
# Pictures that tell the normalisations of an exported network their statistics.
_NORM_EXAMPLES = 32


@dataclass(frozen=True)
class DetectorOptimisation(Optimisation):
    """How the training of a detector moves weights.

    Attributes:
        features_rate: learning rate of all but the heads, as a share of the learning rate; a small one keeps what the
            starting weights know of other places.
    """

    features_rate: float = 1.0


class Detector(NetworkModule):
    """A detector of people or other classes, its loss and its schedule; validates by AP50, its mean over the classes.

    Args:
        classes: names of what is detected, as the labels call them.
        architecture: ``people`` (stride 8, any input), ``ssdlite320``, ``ssd300`` or ``ssd512``; or ``branched``: the
            ``people`` detector of ``start``, which stays as it is, and a branch that learns boxes of other shapes.
        trunk: of ``people`` and ``branched``.
        weights: start from torchvision's ``imagenet`` trunk, its ``coco`` detector, or null for scratch.
        start: checkpoint of another detector training, exported detector, or name of a shipped one, whose weights are
            taken over where their shapes fit.
        height: of the input, pixels.
        width: of the input, pixels.
        resize: how images are fitted into the input.
        normalisation: of the channels; null is what the starting weights were trained with.
        anchors: of ``people``: for strides 8, 16, 32 and maybe 64 the ``[width, height]`` of its anchors in input
            pixels; `tsuiseki.models.anchors.propose_anchors` fits them to labels. Of ``branched``: those of ``start``
            at strides 8, 16 and 32, and then those of the branch.
        channels: of the top-down path of ``people``, or of the branch.
        loss: ``multibox`` (smooth L1 on boxes, scores by hard negatives) or ``quality`` (complete IoU, scores that are
            to be the overlap).
        box_weight: of the box loss against the class loss; 2 suits complete IoU.
        teacher: another detector, from whose scores and boxes the network learns beside the labels.
        optimisation: how weights are moved.
    """

    optimisation: DetectorOptimisation

    def __init__(
        self,
        classes: list[str] = PERSON_ALONE,
        architecture: Architecture = "people",
        trunk: TrunkName = "mobilenet_v3_large",
        weights: Literal["imagenet", "coco"] | None = None,
        start: Path | None = None,
        height: int = 384,
        width: int = 512,
        resize: Resize = "letterbox",
        normalisation: Normalisation | None = None,
        anchors: list[list[tuple[float, float]]] = STREET_ANCHORS,
        channels: int = 96,
        loss: DetectionLossName = "multibox",
        box_weight: float = 1.0,
        teacher: Teacher = Teacher(),  # noqa: B008
        optimisation: DetectorOptimisation = DetectorOptimisation(warmup_steps=200),
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        plain_hyperparameters(self)
        self.network = build_detector(architecture, trunk, weights, (height, width), anchors, channels, len(classes))
        self._foreign_norms = False
        if start is not None:
            file = shipped_or_file("detector", start)
            self._foreign_norms = file.suffix == ".onnx"
            if isinstance(self.network, BranchedDetector):
                begin_branch(self.network, file, anchors)
            else:
                take_over(self.network, file)
        name = f"{architecture}-{trunk}" if architecture in ("people", "branched") else architecture
        if normalisation is None:
            normalisation = COCO_NORMALISATIONS[architecture] if weights == "coco" else "imagenet"
        # A checkpoint is loaded without its starting weights, which must not change its normalisation.
        self.hparams["normalisation"] = normalisation
        self.card = detector_card(name, (height, width), resize, normalisation, classes)
        self.loss = losses.DetectionLoss(*LOSSES[loss], box_weight=box_weight)
        if teacher.file is not None and len(classes) > 1:
            raise RequestError("expected one class with a `teacher`, which knows people alone")
        self.teacher = None if teacher.file is None else SoftTeacher(teacher.file, self.network, self.card)
        self.teacher_weight = teacher.weight
        self.optimisation = optimisation
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Raw heads of ``(B, H, W, 3)`` uint8 images; see `Detector.forward`."""
        logits, offsets = self.network(normalised(images, self.card))
        return logits, offsets

    def on_fit_start(self) -> None:
        """Weights of an exported file get their normalisations back; a training that goes on has all it needs."""
        if self.trainer.ckpt_path is not None:
            return
        if self._foreign_norms:
            examples = [self.trainer.datamodule.training[n] for n in range(_NORM_EXAMPLES)]  # type: ignore[attr-defined]
            images = torch.stack([torch.from_numpy(e.image) for e in examples]).to(self.device)
            restore_normalisations(self.network, normalised(images, self.card))
        if isinstance(self.network, BranchedDetector):
            if self.hparams["start"] is None or self.optimisation.features_rate != 1:
                raise RequestError("a branched detector needs model.start and a model.optimisation.features_rate of 1")
            self.network.begin()
        self.network.train()

    def training_step(self, batch: DetectionBatch, batch_index: int) -> Tensor:
        del batch_index
        images = normalised(batch.images, self.card)
        logits, offsets = self.network(images)
        class_loss, box_loss = self.loss(logits, offsets, self.network.anchors, batch.boxes, batch.labels)
        terms = {"train/class_loss": class_loss, "train/box_loss": box_loss}
        total: Tensor = class_loss + box_loss
        if self.teacher is not None:
            soft = losses.distillation_loss(logits, offsets, self.network.anchors, self.teacher.targets(images))
            terms["train/teacher_loss"] = self.teacher_weight * (soft[0] + self.loss.box_weight * soft[1])
            total = total + terms["train/teacher_loss"]
        self.log_dict(terms, on_step=False, on_epoch=True, sync_dist=True)
        return total

    def validation_step(self, batch: DetectionBatch, batch_index: int) -> None:
        """Keep the detections of a batch, and its labels."""
        del batch_index
        logits, offsets = self(batch.images)
        truth = zip(batch.boxes.double().cpu().numpy(), batch.labels.cpu().numpy(), strict=True)
        batch_detections = detections(logits, offsets, self.network.anchors, self.card)
        for (boxes, labels), detected in zip(truth, batch_detections, strict=True):
            real = labels != losses.PADDING
            self.validated.append((boxes[real], labels[real], detected))

    def scores(self, rows: list[tuple[FloatArray, IntArray, Detections]]) -> dict[str, float]:
        """AP50 and F1, their means over the classes, and AP50 of each of several."""
        names = self.card.class_names
        boxes, labels, detected = zip(*rows, strict=True)
        by_class = evaluate_classes(boxes, labels, detected, names)
        means = [(of_class.average_precision, of_class.best_f1) for of_class in by_class.values()]
        precision, f1 = np.mean(means, axis=0).tolist()
        apart = (
            {f"ap50_{name}": of_class.average_precision for name, of_class in by_class.items()}
            if len(names) > 1
            else {}
        )
        return {"ap50": precision, "f1": f1, **apart}

    def parameter_groups(self) -> list[dict[str, Any]]:
        """What learns, and how fast."""
        if self.optimisation.features_rate == 1:
            return super().parameter_groups()
        heads = nn.ModuleList([self.network.class_heads, self.network.box_heads])
        features = self.optimisation.groups(self.network.features, self.optimisation.features_rate)
        return features + self.optimisation.groups(heads)


def detections(logits: Tensor, offsets: Tensor, anchors: Tensor, card: ModelCard) -> list[Detections]:
    """The best boxes of each image after suppression at IoU 0.5, in input pixels, cut off at its border.

    Args:
        logits: ``(B, A, C + 1)``.
        offsets: ``(B, A, 4)``.
        anchors: ``(A, 4)`` centre form.
        card: says the size of the input.
    """
    count = logits.shape[-1] - 1
    scores, place = logits.float().softmax(dim=-1)[..., 1:].flatten(1).topk(min(_CANDIDATES, len(anchors)), dim=1)
    which, kind = place // count, place % count + 1
    chosen = torch.gather(offsets.float(), 1, which[..., None].expand(-1, -1, 4))
    boxes = decode(chosen, anchors[which])
    limit = torch.tensor([card.input_width, card.input_height] * 2, device=boxes.device)
    boxes = torch.minimum(boxes.clamp(min=0), limit)
    image = torch.arange(len(boxes), device=boxes.device)[:, None].expand_as(scores)
    real = (boxes[..., 2:] - boxes[..., :2]).amin(dim=-1) >= 1
    flat = [x[real] for x in (boxes, scores, image, kind)]
    order = batched_nms(flat[0], flat[1], flat[2] * count + flat[3], 0.5)
    corners, score, owner, kinds = (x[order].double().cpu().numpy() for x in flat)
    of_image = [owner == n for n in range(len(logits))]
    return [Detections(corners[mine], score[mine], classes=kinds[mine].astype(np.int64)) for mine in of_image]
