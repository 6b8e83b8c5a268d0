"""Learning appearance: a LightningModule around the Siamese network and its metric loss."""

from __future__ import annotations

import math
from typing import Any, Literal

import lightning
import numpy as np
import torch
from torch import Tensor

from tsuiseki.datamodules.appearance import AppearanceBatch
from tsuiseki.models.appearance import AppearanceNetwork
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.metric_losses import contrastive_loss, softmax_contrastive_loss, triplet_loss
from tsuiseki.tracking.evaluation.retrieval import Retrieval, evaluate_retrieval

LOSSES = {"triplet": triplet_loss, "contrastive": contrastive_loss, "softmax": softmax_contrastive_loss}


class AppearanceTrainer(lightning.LightningModule):
    """Fits an `AppearanceNetwork` so that views of one person lie close and those of two people apart.

    Validation logs ``val_rank1`` and ``val_map`` of a query set against the rest.

    Args:
        trunk: of the network.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features.
        stripes: horizontal stripes that are averaged apart.
        dropout: share of the pooled values left out in training.
        loss: on the hardest pairs of a batch.
        margin: of the loss.
        learning_rate: at its peak.
        weight_decay: of AdamW.
        warm_up: steps over which the learning rate rises; it then falls along a cosine to the last step.
        apart: validation views of the query's person fewer frames away than this do not count.
    """

    def __init__(
        self,
        trunk: TrunkName = "mobilenet_v3_small",
        weights: Literal["imagenet"] | None = None,
        feature_length: int = 128,
        stripes: int = 4,
        dropout: float = 0.0,
        loss: Literal["triplet", "contrastive", "softmax"] = "triplet",
        margin: float = 0.3,
        learning_rate: float = 1e-3,
        weight_decay: float = 5e-4,
        warm_up: int = 100,
        apart: int = 25,
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        self.network = AppearanceNetwork(trunk, weights, feature_length, stripes, dropout)
        self.loss, self.margin = LOSSES[loss], margin
        self.learning_rate, self.weight_decay, self.warm_up, self.apart = learning_rate, weight_decay, warm_up, apart
        self._validated: list[tuple[Tensor, AppearanceBatch]] = []

    def forward(self, images: Tensor) -> Tensor:
        """``(B, 3, H, W)`` normalised crops to ``(B, D)`` unit-length features."""
        features: Tensor = self.network(images)
        return features

    def training_step(self, batch: tuple[Tensor, Tensor], _: int) -> Tensor:
        """The loss of a P x K batch."""
        images, ids = batch
        # Distances of close features cancel in half precision.
        features = self(images).float()
        loss = self.loss(features, ids, self.margin)
        self.log("train_loss", loss, prog_bar=True)
        return loss

    def validation_step(self, batch: AppearanceBatch, _: int) -> None:
        """Describe a batch; the scores need all of them."""
        self._validated.append((self(batch.images).float().cpu(), batch))

    def on_validation_epoch_end(self) -> None:
        """Log rank-1 and mean average precision."""
        scores = self._score()
        self._validated.clear()
        self.log("val_rank1", scores.rank1, prog_bar=True)
        self.log("val_map", scores.mean_average_precision, prog_bar=True)

    def _score(self) -> Retrieval:
        features = torch.cat([f for f, _ in self._validated]).double().numpy()
        ids, frames, query = (
            torch.cat([getattr(batch, name) for _, batch in self._validated]).cpu().numpy()
            for name in ("ids", "frames", "query")
        )
        # A video of few people has no one to confuse in the gallery but at other moments.
        distances = 1 - features[query] @ features[~query].T
        near = np.abs(frames[query][:, None] - frames[~query][None]) < self.apart
        junk = near & (ids[query][:, None] == ids[~query][None])
        return evaluate_retrieval(distances, ids[query], ids[~query], junk)

    def configure_optimizers(self) -> Any:
        """AdamW; the learning rate rises over the warm-up and falls along a cosine, step by step."""
        optimizer = torch.optim.AdamW(self.parameters(), self.learning_rate, weight_decay=self.weight_decay)
        steps = max(int(self.trainer.estimated_stepping_batches), 1)
        schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: rate(step, self.warm_up, steps))
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def rate(step: int, warm_up: int, steps: int) -> float:
    """Share of the peak learning rate at ``step``.

    >>> [rate(step, 2, 4) for step in range(5)]
    [0.5, 1.0, 1.0, 0.5, 0.0]
    """
    if step < warm_up:
        return (step + 1) / warm_up
    return (1 + math.cos(math.pi * min((step - warm_up) / max(steps - warm_up, 1), 1))) / 2
