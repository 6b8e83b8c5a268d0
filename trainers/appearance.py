"""Learning appearance: the LightningModule around the Siamese network and its metric loss."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from torch import Tensor

from tsuiseki.datamodules.appearance import AppearanceBatch
from tsuiseki.models.appearance import AppearanceNetwork, contrastive_loss, softmax_contrastive_loss, triplet_loss
from tsuiseki.models.backbones import TrunkName
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.reidentification import evaluate_retrieval
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.network_module import NetworkModule, Optimisation, normalised, plain_hyperparameters

LossName = Literal["softmax", "triplet", "contrastive"]
LOSSES = {"softmax": softmax_contrastive_loss, "triplet": triplet_loss, "contrastive": contrastive_loss}
# Frames that validation views of one person have to be apart to count.
APART = 25


class Appearance(NetworkModule):
    """An appearance network, its loss and its schedule; validates by rank-1 and mean average precision.

    Args:
        trunk: of the network.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features.
        dropout: share of the pooled values left out in training, in [0, 1).
        height: of the input, pixels.
        width: of the input, pixels.
        loss: ``softmax`` compares all views of a batch and is the one to start from scratch with; ``triplet`` and
            ``contrastive`` compare the hardest ones.
        margin: of ``triplet`` and ``contrastive``; the temperature of ``softmax``.
        optimisation: how weights are moved.
    """

    def __init__(
        self,
        trunk: TrunkName = "mobilenet_v3_small",
        weights: Literal["imagenet"] | None = None,
        feature_length: int = 128,
        dropout: float = 0.0,
        height: int = 128,
        width: int = 64,
        loss: LossName = "softmax",
        margin: float = 0.1,
        optimisation: Optimisation = Optimisation(),  # noqa: B008
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        plain_hyperparameters(self)
        try:
            self.network = AppearanceNetwork(trunk, weights, feature_length, dropout=dropout)
        except (ValueError, ConnectionError) as error:
            raise RequestError(str(error)) from error
        self.card = ModelCard(
            kind="appearance",
            name=trunk,
            input_height=height,
            input_width=width,
            feature_length=feature_length,
        )
        self.loss, self.margin = LOSSES[loss], margin
        self.optimisation = optimisation
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> Tensor:
        """``(B, D)`` unit-length features of ``(B, H, W, 3)`` uint8 RGB crops."""
        features: Tensor = self.network(normalised(images, self.card))
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
        described, ids, frames, query = (np.stack(x) for x in zip(*rows, strict=True))
        features = described.astype(np.float64)
        distances = 1 - features[query] @ features[~query].T
        # Views a moment apart look the same to anything; finding those says nothing.
        near = np.abs(frames[query][:, None] - frames[~query][None]) < APART
        junk = near & (ids[query][:, None] == ids[~query][None])
        retrieval = evaluate_retrieval(distances, ids[query], ids[~query], junk)
        return {"rank1": retrieval.rank1, "map": retrieval.mean_average_precision}
