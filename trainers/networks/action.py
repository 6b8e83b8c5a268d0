"""Learning actions: the LightningModule around the streams of the action network."""

from __future__ import annotations

from typing import Literal

import lightning
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.optim import AdamW

from tsuiseki.datamodules.action_data import ActionBatch, ActionData
from tsuiseki.models.action import ActionNetwork, ActionStream, action_loss, positive_weights
from tsuiseki.models.backbones import TrunkName
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.action_scores import average_precisions
from tsuiseki.tracking.features.action_inputs import STREAMS, ActionInput, StreamName
from tsuiseki.tracking.features.motion.optical_flow import FlowName
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.networks.schedule import decay_groups, scheduled

OKUTAMA_ACTIONS = 12


class ActionTraining(lightning.LightningModule):
    """The streams of an action network, trained side by side, each by its own loss; validates by mAP.

    Args:
        trunk: network under every stream; the thesis has ``resnet101``.
        weights: ``imagenet`` starts the trunks from torchvision's weights, null from scratch.
        dropout: share of the pooled values left out in training, in [0, 1); the thesis has 0.7.
        streams: which streams are trained.
        actions: number of classes; the data's names go with the network.
        size: side of the input, pixels.
        enlargement: of the global crop, μ.
        flow_limit: flow is clipped to this many pixels a frame.
        stack: pairs of frames whose flow is stacked.
        flow: how flow is estimated.
        compensate: whether the camera's motion is taken out of the flow; it is not in the thesis.
        learning_rate: at the end of the warm-up; the thesis has 0.0001.
        weight_decay: of matrices and kernels; normalisations and biases have none.
        warmup_steps: of linear rise of the learning rate.
        final_share: share of the learning rate that the cosine decay ends with.
        rare_weight: exponent of the weight of rare actions (see `positive_weights`); 0 is eq. 5.1 as it stands.
        rare_limit: largest weight.
    """

    def __init__(
        self,
        trunk: TrunkName = "resnet18",
        weights: Literal["imagenet"] | None = None,
        dropout: float = 0.7,
        streams: tuple[StreamName, ...] = STREAMS,
        actions: int = OKUTAMA_ACTIONS,
        size: int = 64,
        enlargement: float = 3.0,
        flow_limit: float = 20.0,
        stack: int = 1,
        flow: FlowName = "dis",
        compensate: bool = False,
        learning_rate: float = 1e-4,
        weight_decay: float = 0.02,
        warmup_steps: int = 100,
        final_share: float = 0.01,
        rare_weight: float = 0.5,
        rare_limit: float = 5.0,
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        try:
            self.inputs = {n: ActionInput(n, size, enlargement, flow_limit, stack, flow, compensate) for n in streams}
            self.network = ActionNetwork(
                {n: ActionStream(actions, i.channels, trunk, weights, dropout) for n, i in self.inputs.items()}
            )
        except (ValueError, ConnectionError) as error:
            raise RequestError(str(error)) from error
        self.trunk, self.actions, self.names = trunk, actions, tuple(f"action {n + 1}" for n in range(actions))
        self.learning_rate, self.weight_decay = learning_rate, weight_decay
        self.warmup_steps, self.final_share = warmup_steps, final_share
        self.rare_weight, self.rare_limit = rare_weight, rare_limit
        self.register_buffer("positive_weight", torch.ones(actions))
        self._said: list[dict[str, Tensor]] = []
        self._true: list[Tensor] = []
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)

    def card(self, stream: StreamName) -> ModelCard:
        """The contract of one stream."""
        return self.inputs[stream].card(self.trunk, self.names)

    def forward(self, crops: dict[StreamName, Tensor]) -> dict[StreamName, Tensor]:
        """``(B, A)`` logits by stream of ``(B, K, S, S, C)`` uint8 crops, averaged over the K pictures of a sample."""
        logits: dict[StreamName, Tensor] = {}
        for name in self.inputs:
            images = crops[name]
            samples, pictures = images.shape[:2]
            flat = normalised(images.flatten(0, 1), self.card(name))
            logits[name] = self.network.streams[name](flat).view(samples, pictures, -1).mean(dim=1)
        return logits

    def on_fit_start(self) -> None:
        """Take the names of the actions and how rare they are from the data."""
        data = getattr(self.trainer, "datamodule", None)
        if not isinstance(data, ActionData):
            return
        if len(data.names) != self.actions:
            raise RequestError(
                f"expected clips with {self.actions} actions, got {len(data.names)}: {', '.join(data.names)}; "
                f"set model.actions to {len(data.names)}"
            )
        self.names = data.names
        truth = data.train_crops.actions
        counts = torch.from_numpy(truth.sum(axis=0).astype(np.float64))
        weight = positive_weights(counts, len(truth), self.rare_weight, self.rare_limit)
        assert isinstance(self.positive_weight, Tensor)
        self.positive_weight.copy_(weight)

    def on_save_checkpoint(self, checkpoint: dict[str, object]) -> None:
        """Keep the names of the actions."""
        checkpoint["action_names"] = list(self.names)

    def on_load_checkpoint(self, checkpoint: dict[str, object]) -> None:
        """Know the names of the actions again."""
        names = checkpoint.get("action_names")
        assert isinstance(names, list)
        self.names = tuple(names)

    def training_step(self, batch: ActionBatch, batch_index: int) -> Tensor:
        """The sum of the streams' losses on a batch."""
        del batch_index
        assert isinstance(self.positive_weight, Tensor)
        losses = [
            action_loss(logits.float(), batch.actions, self.positive_weight) for logits in self(batch.crops).values()
        ]
        loss = torch.stack(losses).sum()
        self.log("train/loss", loss / len(losses), on_step=False, on_epoch=True, prog_bar=True, batch_size=1)
        return loss

    def validation_step(self, batch: ActionBatch, batch_index: int) -> None:
        """Recognise a batch; the scores need all of them."""
        del batch_index
        self._said.append({name: logits.float().sigmoid().cpu() for name, logits in self(batch.crops).items()})
        self._true.append(batch.actions.cpu())

    def on_validation_epoch_end(self) -> None:
        """Log the mAP of the average of all streams, and of each."""
        if not self.trainer.sanity_checking:
            truth = torch.cat(self._true).numpy() > 0
            said = {name: torch.cat([part[name] for part in self._said]).double().numpy() for name in self.inputs}
            together = np.mean(list(said.values()), axis=0)
            self.log("val/map", mean_average_precision(together, truth), prog_bar=True)
            for name, probabilities in said.items():
                self.log(f"val/map_{name}", mean_average_precision(probabilities, truth))
        self._said, self._true = [], []

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """AdamW under a linear warm-up and a cosine decay over the whole training."""
        optimiser = AdamW(decay_groups(self.network, self.weight_decay), lr=self.learning_rate)
        return scheduled(optimiser, self.trainer, self.warmup_steps, self.final_share)


def normalised(images: Tensor, card: ModelCard) -> Tensor:
    """``(B, C, S, S)`` float of ``(B, S, S, C)`` uint8 crops, as the card says."""
    mean, std = (255 * torch.tensor(values, device=images.device).view(1, -1, 1, 1) for values in (card.mean, card.std))
    return (images.permute(0, 3, 1, 2).float() - mean) / std


def mean_average_precision(probabilities: FloatArray, truth: BoolArray) -> float:
    """mAP over the actions that occur; 0 where none does."""
    found = average_precisions(probabilities, truth)
    return 0.0 if np.isnan(found).all() else float(np.nanmean(found))
