"""Learning actions: the LightningModule around the streams of the action network."""

from __future__ import annotations

from typing import Literal

import numpy as np
import torch
from torch import Tensor

from tsuiseki.datamodules.action import ActionBatch, ActionData
from tsuiseki.models.action import ActionNetwork, ActionStream, action_loss, fused_logits, positive_weights
from tsuiseki.models.backbones import TrunkName
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.actions import average_precisions
from tsuiseki.tracking.features.action import STREAMS, ActionInput, StreamName
from tsuiseki.tracking.features.optical_flow import FlowName
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.network_module import NetworkModule, Optimisation, normalised, plain_hyperparameters

# Actions that Okutama-Action labels.
OKUTAMA_ACTIONS = 12
# Largest weight of rare actions, see `positive_weights`.
RARE_LIMIT = 5.0


class Action(NetworkModule):
    """The streams of an action network, trained side by side or as one network; validates by mAP.

    Args:
        trunk: network under every stream; the thesis has ``resnet101``.
        weights: ``imagenet`` starts the trunks from torchvision's weights, null from scratch.
        dropout: share of the pooled values left out in training, in [0, 1); the thesis has 0.7.
        streams: which streams are trained.
        actions: number of classes; the data's names go with the network.
        size: side of the input, pixels.
        flow: how flow is estimated.
        fused: one loss on the mean of the streams' probabilities trains them jointly; otherwise each has its own.
        rare_weight: exponent of the weight of rare actions, see `positive_weights`; 0 is eq. 5.1 as it stands.
        optimisation: how weights are moved; the thesis has a learning rate of 0.0001.
    """

    def __init__(
        self,
        trunk: TrunkName = "resnet18",
        weights: Literal["imagenet"] | None = None,
        dropout: float = 0.7,
        streams: tuple[StreamName, ...] = STREAMS,
        actions: int = OKUTAMA_ACTIONS,
        size: int = 64,
        flow: FlowName = "dis",
        fused: bool = False,
        rare_weight: float = 0.5,
        optimisation: Optimisation = Optimisation(learning_rate=1e-4),  # noqa: B008
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        plain_hyperparameters(self)
        if fused and tuple(streams) != STREAMS:
            raise RequestError(f"expected {', '.join(STREAMS)} with `fused`, got {', '.join(streams)}")
        try:
            self.inputs = {n: ActionInput(n, size, flow=flow) for n in streams}
            self.network = ActionNetwork(
                {n: ActionStream(actions, i.channels, trunk, weights, dropout) for n, i in self.inputs.items()}
            )
        except (ValueError, ConnectionError) as error:
            raise RequestError(str(error)) from error
        self.trunk, self.actions, self.names = trunk, actions, tuple(f"action {n + 1}" for n in range(actions))
        self.optimisation, self.fused, self.rare_weight = optimisation, fused, rare_weight
        self.register_buffer("positive_weight", torch.ones(actions))
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)

    def card(self, stream: StreamName) -> ModelCard:
        """What the exported network of ``stream`` says of itself."""
        return self.inputs[stream].card(self.trunk, self.names)

    def forward(self, crops: dict[StreamName, Tensor]) -> dict[StreamName, Tensor]:
        """``(B, A)`` logits by stream of ``(B, S, S, C)`` uint8 crops."""
        return {n: self.network.streams[n](normalised(crops[n], self.card(n))) for n in self.inputs}

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
        weight = positive_weights(counts, len(truth), self.rare_weight, RARE_LIMIT)
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
        """The loss of the streams' mean on a batch, or the sum of their own losses."""
        del batch_index
        assert isinstance(self.positive_weight, Tensor)
        outputs = [logits.float() for logits in self(batch.crops).values()]
        parts = [fused_logits(outputs)] if self.fused else outputs
        losses = [action_loss(logits, batch.actions, self.positive_weight) for logits in parts]
        loss = torch.stack(losses).sum()
        mean_loss = loss / len(losses)
        self.log("train/loss", mean_loss, on_step=False, on_epoch=True, prog_bar=True, batch_size=1, sync_dist=True)
        return loss

    def validation_step(self, batch: ActionBatch, batch_index: int) -> None:
        """Recognise a batch; the scores need all of them."""
        del batch_index
        outputs = {name: logits.float().sigmoid().cpu() for name, logits in self(batch.crops).items()}
        self.validated.append((outputs, batch.actions.cpu()))

    def scores(self, rows: list[tuple[dict[str, Tensor], Tensor]]) -> dict[str, float]:
        """The mAP of the average of all streams, and of each."""
        parts, actions = zip(*rows, strict=True)
        truth = torch.cat(actions).numpy() > 0
        outputs = {name: torch.cat([part[name] for part in parts]).double().numpy() for name in self.inputs}
        fused = {"map": np.mean(list(outputs.values()), axis=0), **{f"map_{name}": outputs[name] for name in outputs}}
        return {name: mean_average_precision(probabilities, truth) for name, probabilities in fused.items()}


def mean_average_precision(probabilities: FloatArray, truth: BoolArray) -> float:
    """mAP over the actions that occur; 0 where none does."""
    precisions = average_precisions(probabilities, truth)
    return 0.0 if np.isnan(precisions).all() else float(np.nanmean(precisions))
