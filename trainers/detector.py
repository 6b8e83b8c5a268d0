"""Fitting detectors to labelled boxes: those of the SSD family, and any `DetectorNetwork`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.ops import batched_nms

from tsuiseki.datamodules.detector import DetectionBatch, DetectionData
from tsuiseki.models import losses
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.detector import BranchedDetector
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.preprocessing import fit_image
from tsuiseki.tracking.types import Detections, FloatArray, ImageArray, IntArray
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.detector_network import (
    Architecture,
    Normalisation,
    SoftTeacher,
    Teacher,
    begin_branch,
    begin_network,
    built,
    detector_parts,
)
from tsuiseki.trainers.exporting.exported_weights import restore_normalisations
from tsuiseki.trainers.exporting.written_networks import model_file, write_detector
from tsuiseki.trainers.metrics.detections import AveragePrecision
from tsuiseki.trainers.network_module import (
    NetworkModule,
    Optimisation,
    first_samples,
    normalised,
    plain_hyperparameters,
)
from tsuiseki.trainers.own_network import card_of_network, refuse_parts, try_detector

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


_BRANCHED = "a branched detector needs model.start and a model.optimisation.features_rate of 1"
# Arguments that a network of one's own decides itself, where nobody gives them.
_OTHERS = {"loss": "quality", "teacher": Teacher(), "optimisation.features_rate": 1.0, "optimisation.box_weight": 2.0}
# Scores that are reported, as of an exported detector.
SCORE_THRESHOLD = 0.3
# Overlaps that COCO averages AP over.
OVERLAPS = tuple(percent / 100 for percent in range(50, 100, 5))


@dataclass(frozen=True)
class DetectorOptimisation(Optimisation):
    """How the training of a detector moves weights.

    Attributes:
        features_rate: learning rate of all but the heads, as a share of the learning rate; a small one keeps what the
            starting weights know of other places.
        box_weight: of the box loss against the class loss; 2 suits complete IoU.
    """

    warmup_steps: int = 50
    features_rate: float = 1.0
    box_weight: float = 2.0


class PredictedDetections(Detections):
    """Detections that pass through Lightning's prediction loop: what is on no device stays as it is."""

    def to(self, device: torch.device, non_blocking: bool = False) -> PredictedDetections:
        """Themselves."""
        del device, non_blocking
        return self


class Detector(NetworkModule):
    """A detector of people or other classes, its loss and its schedule; validates by AP, AP50 and AP75.

    AP is COCO's: the mean over the overlaps 0.5, 0.55, … 0.95. Each is a mean over the classes.

    With a ``start`` all that its file says is taken from there: trunk, anchors, channels, size, normalisation, classes.

    Args:
        start: name of a shipped detector, exported detector, or checkpoint of another training, whose weights are taken
            over. One of people alone may start other ``classes``. A branch is taken over only where the
            ``architecture`` asks for it.
        classes: names of what is detected, as the labels call them; by default people.
        architecture: by default ``people`` (stride 8, any input); or ``ssdlite320``, ``ssd300``, ``ssd512``; or
            ``branched``: the ``people`` detector of ``start``, which stays as it is, and a branch that learns boxes of
            other shapes.
        trunk: of ``people`` and ``branched``; by default ``mobilenet_v3_large``.
        weights: begin with torchvision's ``imagenet`` trunk, its ``coco`` detector, or null for scratch.
        height: of the input, pixels; by default 384.
        width: of the input, pixels; by default 512.
        normalisation: of the channels; null is what the starting weights were trained with.
        anchors: of ``people``: for strides 8, 16, 32 and maybe 64 the ``[width, height]`` of its anchors in input
            pixels; `tsuiseki.models.anchors.propose_anchors` fits them to labels. Of ``branched``: those of ``start``
            at strides 8, 16 and 32, then those of the branch at 16, 32 and 64. By default for people in a street.
        channels: of the top-down path of ``people``, or of the branch; by default 96.
        loss: ``multibox`` (smooth L1 on boxes, scores by hard negatives) or ``quality`` (complete IoU, scores that are
            to be the overlap).
        teacher: another detector, from whose scores and boxes the network learns beside the labels.
        learning_rate: at the end of the warm-up.
        optimisation: optimiser and schedule.
        network: any `DetectorNetwork`, which decides all else but ``learning_rate`` and ``optimisation``.

    Raises:
        RequestError: an argument contradicts the ``start`` or the ``network``, weights or parts do not fit together, or
            the ``network`` is no `DetectorNetwork`.
    """

    kind = "detector"
    optimisation: DetectorOptimisation

    def __init__(
        self,
        start: str | Path | None = None,
        classes: list[str] | None = None,
        architecture: Architecture | None = None,
        trunk: TrunkName | None = None,
        weights: Literal["imagenet", "coco"] | None = None,
        height: int | None = None,
        width: int | None = None,
        normalisation: Normalisation | None = None,
        anchors: list[list[tuple[float, float]]] | None = None,
        channels: int | None = None,
        loss: DetectionLossName = "quality",
        teacher: Teacher = Teacher(),  # noqa: B008
        learning_rate: float = 1e-3,
        optimisation: DetectorOptimisation = DetectorOptimisation(),
        network: nn.Module | None = None,
    ) -> None:
        super().__init__()
        # A checkpoint holds plain values alone, so of a network that a command builds how, and no other.
        own, network = network, None
        self.save_hyperparameters()
        asked: dict[str, Any] = {"architecture": architecture, "trunk": trunk, "anchors": anchors, "channels": channels}
        asked |= {
            "height": height,
            "width": width,
            "normalisation": normalisation,
            "classes": classes,
        }
        self._foreign_norms = False
        if own is None:
            self._build(asked, weights, None if start is None else shipped_or_file("detector", start))
            self.network.criterion = losses.DetectionLoss(*LOSSES[loss], box_weight=optimisation.box_weight)
            self.card = card_of_network(self.network, "detector")
        else:
            others: dict[str, Any] = {"loss": loss, "teacher": teacher}
            others |= {f"optimisation.{name}": getattr(optimisation, name) for name in ("features_rate", "box_weight")}
            refuse_parts({"start": start, "weights": weights, **asked, **others}, _OTHERS)
            self.network = own
            self.bring(own)
            self.card = try_detector(own)
        plain_hyperparameters(self)
        if teacher.file is not None and len(self.card.class_names) > 1:
            raise RequestError("expected one class with a `teacher`, which knows people alone")
        self.teacher = None if teacher.file is None else SoftTeacher(teacher.file, self.network, self.card)
        self.teacher_weight = teacher.weight
        self.learning_rate, self.optimisation = learning_rate, optimisation
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)
        self.example_input_array = torch.zeros(1, self.card.input_height, self.card.input_width, 3, dtype=torch.uint8)

    def _build(self, asked: dict[str, Any], weights: Literal["imagenet", "coco"] | None, file: Path | None) -> None:
        """The network of `detector_parts`, with the weights of the ``file``."""
        parts = detector_parts(asked, weights, file)
        # A checkpoint is loaded without its starting weights, which must not change its parts.
        self.hparams.update(parts)
        self.network = built(parts, weights)
        self._foreign_norms = file is not None and file.suffix == ".onnx"
        self._begun = False
        if file is not None and isinstance(self.network, BranchedDetector):
            self._begun = begin_branch(self.network, file, parts["anchors"])
        elif file is not None:
            begin_network(self.network, file)

    def forward(self, images: Tensor) -> Any:
        """Outputs for ``(B, H, W, 3)`` uint8 images; see `DetectorNetwork.forward`."""
        return self.network(normalised(images, self.card, self.dtype))

    @torch.no_grad()
    def detect(self, images: Sequence[ImageArray], score_threshold: float = SCORE_THRESHOLD) -> list[Detections]:
        """What is detected in images of any size, each ``(H, W, 3)`` uint8 RGB, in their pixels.

        Args:
            images: any number.
            score_threshold: detections below it are left out; in [0, 1].
        """
        if not len(images):
            return []
        fitted, scales = zip(*(fit_image(image, self.card) for image in images), strict=True)
        batch = torch.from_numpy(np.stack(fitted)).to(self.device)
        names = dict(enumerate(self.card.class_names, start=1))
        decoded = self.network.decode(self(batch))
        of_input = detections(decoded[0], decoded[1], self.card)
        result = list[Detections]()
        for detected, scale, image in zip(of_input, scales, images, strict=True):
            boxes = clip_boxes(detected.boxes / np.tile(scale, 2), image.shape[1], image.shape[0])
            usable = (detected.scores >= score_threshold) & ((boxes[:, 2:] - boxes[:, :2]) >= 1).all(axis=1)
            in_image = PredictedDetections(boxes[usable], detected.scores[usable])
            if len(names) > 1:
                in_image = replace(in_image, classes=np.asarray(detected.classes)[usable], names=names)
            result.append(in_image)
        return result

    def predict_step(self, batch: Sequence[ImageArray] | Tensor, batch_index: int) -> Detections | list[Detections]:
        """The `detect` of an image, or a list of them of several; a tensor is ``(B, H, W, 3)`` uint8."""
        del batch_index
        images = list(batch.cpu().numpy()) if isinstance(batch, Tensor) else batch
        detected = self.detect(images)
        return detected[0] if len(detected) == 1 else detected

    def export(self, out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False) -> float:
        """Write the detector as ONNX, and check that it gives what torch gives.

        Args:
            out: file to write.
            training_data: what it was trained on, in words; kept in the file.
            float16: store weights as 16-bit numbers, half the size.
            overwrite: replace an existing file.

        Returns:
            The largest difference to torch, as a share of the range of an output.

        Raises:
            RequestError: the file exists, or cannot be written.
            RunError: the file does not give what torch gives.
        """
        card = replace(self.card, training_data=training_data)
        return write_detector(self.network, card, model_file(out, training_data, float16, overwrite))

    def on_fit_start(self) -> None:
        """Weights of an exported file get their normalisations back; a training that goes on has all it needs."""
        if self.trainer.ckpt_path is not None:
            return
        if self._foreign_norms:
            restore_normalisations(self.network, normalised(self._examples().to(self.device), self.card))
            self._foreign_norms = False
        if isinstance(self.network, BranchedDetector):
            if self.hparams["start"] is None:
                raise RequestError(_BRANCHED)
            if not self._begun:
                self.network.begin()
            self._begun = True
        self.network.train()

    def _examples(self) -> Tensor:
        """``(N, H, W, 3)`` uint8 pictures to learn from, for the statistics of the normalisations."""
        data = getattr(self.trainer, "datamodule", None)
        if isinstance(data, DetectionData):
            return torch.stack([torch.from_numpy(data.training[n].image) for n in range(_NORM_EXAMPLES)])
        return first_samples(self, _NORM_EXAMPLES, lambda batch: batch.images)

    def training_step(self, batch: DetectionBatch, batch_index: int) -> Tensor:
        del batch_index
        images = normalised(batch.images, self.card, self.dtype)
        outputs = self.network(images)
        terms = dict(self.network.loss(outputs, batch.boxes, batch.labels))
        if self.teacher is not None:
            logits, offsets = outputs
            soft = losses.distillation_loss(logits, offsets, self.network.anchors, self.teacher.targets(images))
            terms["teacher_loss"] = self.teacher_weight * (soft[0] + self.network.criterion.box_weight * soft[1])
        logged = {f"train/{name}": value for name, value in terms.items()}
        self.log_dict(logged, on_step=False, on_epoch=True, sync_dist=True)
        total: Tensor = reduce(torch.add, terms.values())
        return total

    def validation_step(self, batch: DetectionBatch, batch_index: int) -> None:
        """Keep the detections of a batch, and its labels."""
        del batch_index
        decoded = self.network.decode(self(batch.images))
        truth = zip(batch.boxes.double().cpu().numpy(), batch.labels.cpu().numpy(), strict=True)
        batch_detections = detections(decoded[0], decoded[1], self.card)
        for (boxes, labels), detected in zip(truth, batch_detections, strict=True):
            real = labels != losses.PADDING
            self.validated.append((boxes[real], labels[real], detected))

    def scores(self, rows: list[tuple[FloatArray, IntArray, Detections]]) -> dict[str, float]:
        """AP, AP50, AP75 and F1 at 0.5, their means over the classes, and AP50 of each of several."""
        boxes, labels, detected = zip(*rows, strict=True)
        truth = [{"boxes": b, "labels": k, "ignored": k == losses.IGNORED} for b, k in zip(boxes, labels, strict=True)]
        values: dict[str, float] = {}
        for overlap in OVERLAPS:
            # The rows are those of all devices.
            metric = AveragePrecision(overlap, self.card.class_names, sync_on_compute=False)
            metric.update(detected, truth)
            values |= {name: value.item() for name, value in metric.compute().items()}
        mean = float(np.mean([values[f"ap{100 * overlap:g}"] for overlap in OVERLAPS]))
        at_half = {name: value for name, value in values.items() if name.startswith("ap50")}
        return {"ap": mean, **at_half, "ap75": values["ap75"], "f1": values["f1_50"]}

    def parameter_groups(self) -> list[dict[str, Any]]:
        """What learns, and how fast."""
        if self.optimisation.features_rate == 1:
            return super().parameter_groups()
        if isinstance(self.network, BranchedDetector):
            raise RequestError(_BRANCHED)
        heads = nn.ModuleList([self.network.class_heads, self.network.box_heads])
        rate = self.optimisation.features_rate * self.learning_rate
        return self.optimisation.groups(self.network.features, rate) + self.optimisation.groups(
            heads, self.learning_rate
        )


def detections(boxes: Tensor, scores: Tensor, card: ModelCard) -> list[Detections]:
    """The best boxes of each image after suppression at IoU 0.5, in input pixels, cut off at its border.

    Args:
        boxes: ``(B, N, 4)`` x1, y1, x2, y2 in input pixels.
        scores: ``(B, N, C)`` in [0, 1].
        card: says the size of the input.
    """
    images, each, count = scores.shape
    scores, place = scores.float().flatten(1).topk(min(_CANDIDATES, each), dim=1)
    which, kind = place // count, place % count + 1
    boxes = torch.gather(boxes.float(), 1, which[..., None].expand(-1, -1, 4))
    limit = torch.tensor([card.input_width, card.input_height] * 2, device=boxes.device)
    boxes = torch.minimum(boxes.clamp(min=0), limit)
    image = torch.arange(len(boxes), device=boxes.device)[:, None].expand_as(scores)
    real = (boxes[..., 2:] - boxes[..., :2]).amin(dim=-1) >= 1
    flat = [x[real] for x in (boxes, scores, image, kind)]
    order = batched_nms(flat[0], flat[1], flat[2] * count + flat[3], 0.5)
    corners, score, owner, kinds = (x[order].double().cpu().numpy() for x in flat)
    of_image = [owner == n for n in range(images)]
    return [Detections(corners[mine], score[mine], classes=kinds[mine].astype(np.int64)) for mine in of_image]
