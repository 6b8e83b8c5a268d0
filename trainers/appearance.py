"""Learning appearance: the LightningModule around the Siamese network and its metric loss."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn

from tsuiseki.datamodules.appearance import APART, AppearanceBatch
from tsuiseki.models.appearance import AppearanceNetwork, contrastive_loss, softmax_contrastive_loss, triplet_loss
from tsuiseki.models.backbones import TrunkName
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.exporting.exported_weights import Normalisation, opened_onnx, unfold
from tsuiseki.trainers.exporting.written_networks import model_file, write_appearance
from tsuiseki.trainers.metrics.reidentification import ReIdentification
from tsuiseki.trainers.network_module import (
    NetworkModule,
    Optimisation,
    first_samples,
    normalised,
    plain_hyperparameters,
    read_checkpoint,
)
from tsuiseki.trainers.own_network import appearance_card, refuse_parts, try_appearance
from tsuiseki.trainers.start import begin_network, completed

LossName = Literal["softmax", "triplet", "contrastive"]
LOSSES = {"softmax": softmax_contrastive_loss, "triplet": triplet_loss, "contrastive": contrastive_loss}
# Pictures that tell the normalisations of an exported network their statistics.
_NORM_EXAMPLES = 64


class Appearance(NetworkModule):
    """An appearance network, its loss and its schedule; validates by rank-1 and mean average precision.

    With a ``start`` trunk, feature length and size are taken from its file.

    Args:
        start: name of a shipped appearance network, exported network, or checkpoint of another training, whose weights
            are taken over.
        trunk: of the network; by default ``mobilenet_v3_small``.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features; by default 128.
        dropout: share of the pooled values left out in training, in [0, 1).
        height: of the input, pixels; by default 128.
        width: of the input, pixels; by default 64.
        loss: ``softmax`` compares all views of a batch and is the one to start from scratch with; ``triplet`` and
            ``contrastive`` compare the hardest ones.
        margin: of ``triplet`` and ``contrastive``; the temperature of ``softmax``.
        learning_rate: at the end of the warm-up.
        optimisation: optimiser and schedule.
        network: any `AppearanceTrunk`, which decides trunk, feature length, dropout and size.

    Raises:
        RequestError: an argument contradicts the ``start`` or the ``network``, there is no such trunk, or the
            ``network`` is no `AppearanceTrunk`.
    """

    kind = "appearance"

    def __init__(
        self,
        start: str | Path | None = None,
        trunk: TrunkName | None = None,
        weights: Literal["imagenet"] | None = None,
        feature_length: int | None = None,
        dropout: float = 0.0,
        height: int | None = None,
        width: int | None = None,
        loss: LossName = "softmax",
        margin: float = 0.1,
        learning_rate: float = 2e-3,
        optimisation: Optimisation = Optimisation(),  # noqa: B008
        network: nn.Module | None = None,
    ) -> None:
        super().__init__()
        # A checkpoint holds plain values alone, so of a network that a command builds how, and no other.
        own, network = network, None
        self.save_hyperparameters()
        asked = {"trunk": trunk, "feature_length": feature_length, "height": height, "width": width}
        self._folded: list[Normalisation] = []
        if own is None:
            self._build(asked, weights, dropout, None if start is None else shipped_or_file("appearance", start))
            self.card = appearance_card(self.network, self.network.feature_length)
        else:
            refuse_parts({"start": start, "weights": weights, **asked, "dropout": dropout}, {"dropout": 0.0})
            self.network = own
            self.bring(own)
            self.card = try_appearance(own)
        plain_hyperparameters(self)
        self.loss, self.margin = LOSSES[loss], margin
        self.learning_rate, self.optimisation = learning_rate, optimisation
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)
        self.example_input_array = torch.zeros(1, self.card.input_height, self.card.input_width, 3, dtype=torch.uint8)

    def _build(
        self, asked: dict[str, Any], weights: Literal["imagenet"] | None, dropout: float, file: Path | None
    ) -> None:
        """The network that is asked for, with the weights of the ``file``."""
        if file is not None and weights is not None:
            raise RequestError("expected one of `start` and `weights`, got both")
        held = None if file is None else parts_of(file)
        parts = completed(asked, USUAL, held, file, fixed=("trunk", "feature_length"))
        self.hparams.update(parts)
        length, size = parts["feature_length"], (parts["height"], parts["width"])
        try:
            self.network = AppearanceNetwork(parts["trunk"], weights, length, dropout, size)
        except (ValueError, ConnectionError) as error:
            raise RequestError(str(error)) from error
        self._folded = [] if file is None else begin_network(self.network, file, "appearance")

    def on_fit_start(self) -> None:
        """Weights of an exported file get their normalisations back; a training that goes on has all it needs."""
        if self._folded and self.trainer.ckpt_path is None:
            images = first_samples(self, _NORM_EXAMPLES, lambda batch: batch.images)
            unfold(self.network, self._folded, normalised(images.to(self.device), self.card))
            self.network.train()
        self._folded = []

    def predict_step(self, batch: AppearanceBatch | Tensor, batch_index: int) -> FloatArray:
        """``(B, D)`` unit-length features of a batch of crops; a tensor is ``(B, H, W, 3)`` uint8."""
        del batch_index
        features = self(batch if isinstance(batch, Tensor) else batch.images)
        return np.asarray(features.double().cpu().numpy())

    def export(self, out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False) -> float:
        """Write the network as ONNX, and check that it gives what torch gives; as `Detector.export`."""
        return write_appearance(self.network, self.card, model_file(out, training_data, float16, overwrite))

    def forward(self, images: Tensor) -> Tensor:
        """``(B, D)`` unit-length features of ``(B, H, W, 3)`` uint8 RGB crops."""
        features: Tensor = self.network(normalised(images, self.card, self.dtype))
        return features

    def training_step(self, batch: AppearanceBatch, batch_index: int) -> Tensor:
        """The loss of a P x K batch."""
        del batch_index
        # Distances of close features cancel in half precision.
        loss = self.loss(self(batch.images).float(), batch.ids, self.margin)
        self.log("train/loss", loss, on_step=False, on_epoch=True, prog_bar=True, sync_dist=True)
        return loss

    def validation_step(self, batch: AppearanceBatch, batch_index: int) -> None:
        """Describe a batch; the scores need all of them."""
        del batch_index
        rows = (self(batch.images).float(), batch.ids, batch.frames, batch.query)
        self.validated += zip(*(values.cpu().numpy() for values in rows), strict=True)

    def scores(self, rows: list[tuple[np.ndarray, ...]]) -> dict[str, float]:
        """Rank-1 and mean average precision of the queries against the gallery."""
        features, ids, frames, query = (np.stack(x) for x in zip(*rows, strict=True))
        # The rows are those of all devices.
        metric = ReIdentification(apart=APART, sync_on_compute=False)
        metric.update(features, ids, query, frames=frames)
        scores = metric.compute()
        return {name: scores[name].item() for name in ("rank1", "map") if not scores[name].isnan()}


# What a network is built of without a start.
USUAL = {"trunk": "mobilenet_v3_small", "feature_length": 128, "height": 128, "width": 64}


def parts_of(path: Path) -> dict[str, Any]:
    """What the appearance network at ``path`` is built of.

    Raises:
        RequestError: the file is missing or of another network.
    """
    if path.suffix != ".onnx":
        held = read_checkpoint(path, "hyper_parameters")
        if not held.keys() >= USUAL.keys() or held["trunk"] is None:
            raise RequestError(
                f"{path}: expected a checkpoint of `tsuiseki train appearance`, got one of another network"
            )
        return {name: held[name] for name in USUAL}
    _, card = opened_onnx(path)
    if card.kind != "appearance":
        raise RequestError(f"{path}: expected an appearance network, got one of kind {card.kind!r}")
    size = {"height": card.input_height, "width": card.input_width}
    return {"trunk": card.name, "feature_length": card.feature_length, **size}
