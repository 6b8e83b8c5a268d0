"""Learning appearance: the LightningModule around the Siamese network and its metric loss."""

from __future__ import annotations

from typing import Literal

import lightning
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.optim import AdamW

from tsuiseki.datamodules.appearance_data import AppearanceBatch
from tsuiseki.models.appearance import AppearanceNetwork
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.metric_losses import contrastive_loss, softmax_contrastive_loss, triplet_loss
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.retrieval import Retrieval, evaluate_retrieval
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.networks.schedule import decay_groups, scheduled

LossName = Literal["softmax", "triplet", "contrastive"]
LOSSES = {"softmax": softmax_contrastive_loss, "triplet": triplet_loss, "contrastive": contrastive_loss}


class AppearanceTraining(lightning.LightningModule):
    """An appearance network, its loss and its schedule; validates by rank-1 and mean average precision.

    Args:
        trunk: of the network.
        weights: ``imagenet`` starts the trunk from torchvision's weights, null from scratch.
        feature_length: D of the features.
        stripes: horizontal stripes that are averaged apart.
        dropout: share of the pooled values left out in training, in [0, 1).
        height: of the input, pixels.
        width: likewise.
        loss: ``softmax`` compares all views of a batch and is the one to start from scratch with; ``triplet`` and
            ``contrastive`` compare the hardest ones.
        margin: of ``triplet`` and ``contrastive``; the temperature of ``softmax``.
        learning_rate: at the end of the warm-up.
        weight_decay: of matrices and kernels; normalisations and biases have none.
        warmup_steps: of linear rise.
        final_share: of the learning rate that the cosine decay ends with.
        apart: frames that validation views of one person have to be apart to count.
    """

    def __init__(
        self,
        trunk: TrunkName = "mobilenet_v3_small",
        weights: Literal["imagenet"] | None = None,
        feature_length: int = 128,
        stripes: int = 4,
        dropout: float = 0.0,
        height: int = 128,
        width: int = 64,
        loss: LossName = "softmax",
        margin: float = 0.1,
        learning_rate: float = 2e-3,
        weight_decay: float = 0.02,
        warmup_steps: int = 100,
        final_share: float = 0.01,
        apart: int = 25,
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        try:
            self.network = AppearanceNetwork(trunk, weights, feature_length, stripes, dropout)
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
        self.learning_rate, self.weight_decay = learning_rate, weight_decay
        self.warmup_steps, self.final_share, self.apart = warmup_steps, final_share, apart
        self.register_buffer("mean", 255 * torch.tensor(self.card.mean).view(1, 3, 1, 1), persistent=False)
        self.register_buffer("std", 255 * torch.tensor(self.card.std).view(1, 3, 1, 1), persistent=False)
        self._described: list[Tensor] = []
        self._validated: list[AppearanceBatch] = []
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)

    def forward(self, images: Tensor) -> Tensor:
        """``(B, D)`` unit-length features of ``(B, H, W, 3)`` uint8 RGB crops."""
        assert isinstance(self.mean, Tensor)
        assert isinstance(self.std, Tensor)
        features: Tensor = self.network((images.permute(0, 3, 1, 2).float() - self.mean) / self.std)
        return features

    def training_step(self, batch: AppearanceBatch, batch_index: int) -> Tensor:
        """The loss of a P x K batch."""
        del batch_index
        # Distances of close features cancel in half precision.
        loss = self.loss(self(batch.images).float(), batch.ids, self.margin)
        self.log("train/loss", loss, on_step=False, on_epoch=True, prog_bar=True)
        return loss

    def validation_step(self, batch: AppearanceBatch, batch_index: int) -> None:
        """Describe a batch; the scores need all of them."""
        del batch_index
        self._described.append(self(batch.images).float().cpu())
        self._validated.append(batch)

    def on_validation_epoch_end(self) -> None:
        """Log rank-1 and mean average precision of the queries against the gallery."""
        if not self.trainer.sanity_checking:
            scores = self._score()
            self.log("val/rank1", scores.rank1, prog_bar=True, sync_dist=True)
            self.log("val/map", scores.mean_average_precision, prog_bar=True, sync_dist=True)
        self._described, self._validated = [], []

    def _score(self) -> Retrieval:
        features = torch.cat(self._described).double().numpy()
        ids, frames, query = (
            torch.cat([getattr(batch, name) for batch in self._validated]).cpu().numpy()
            for name in ("ids", "frames", "query")
        )
        distances = 1 - features[query] @ features[~query].T
        # Views a moment apart look the same to anything; finding those says nothing.
        near = np.abs(frames[query][:, None] - frames[~query][None]) < self.apart
        junk = near & (ids[query][:, None] == ids[~query][None])
        return evaluate_retrieval(distances, ids[query], ids[~query], junk)

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """AdamW under a linear warm-up and a cosine decay over the whole training."""
        optimiser = AdamW(decay_groups(self.network, self.weight_decay), lr=self.learning_rate)
        return scheduled(optimiser, self.trainer, self.warmup_steps, self.final_share)
