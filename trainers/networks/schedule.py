"""What every training does to its weights: which of them decay, and how the learning rate rises and falls."""

from __future__ import annotations

import math
from typing import Any

from lightning import Trainer
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR


def decay_groups(module: nn.Module, weight_decay: float, learning_rate: float | None = None) -> list[dict[str, Any]]:
    """The trained parameters in two groups: matrices and kernels, which decay, and the others, which do not.

    Args:
        module: whose parameters.
        weight_decay: of the first group.
        learning_rate: of both; None is the optimiser's.
    """
    trained = [p for p in module.parameters() if p.requires_grad]
    own: dict[str, Any] = {} if learning_rate is None else {"lr": learning_rate}
    return [
        {"params": [p for p in trained if p.ndim > 1], "weight_decay": weight_decay, **own},
        {"params": [p for p in trained if p.ndim <= 1], "weight_decay": 0.0, **own},
    ]


def warmup_cosine(step: int, warmup: int, total: int, final_share: float) -> float:
    """Factor on the learning rate: a linear rise to 1 at ``warmup``, a cosine fall to ``final_share`` at ``total``.

    >>> [round(warmup_cosine(s, 10, 110, 0.0), 2) for s in (0, 9, 10, 60, 110)]
    [0.1, 1.0, 1.0, 0.5, 0.0]
    """
    if step < warmup:
        return (step + 1) / warmup
    return cosine(step, warmup, total, 1.0, final_share)


def cosine(step: int, first: int, last: int, before: float, after: float) -> float:
    """From ``before`` at step ``first`` along half a cosine to ``after`` at ``last``, and so on from there."""
    progress = min(1.0, (step - first) / max(last - first, 1))
    return after + (before - after) * (1 + math.cos(math.pi * progress)) / 2


class WarmupCosine(LambdaLR):
    """`warmup_cosine` over the steps of a training, which may be gone on with over more steps or fewer.

    A checkpoint holds where the factor was. From there it falls to the final share over the steps that are left now, so
    it never jumps; a training that had ended goes on at the final share.

    Args:
        optimiser: whose rates it sets.
        warmup: steps of the rise.
        total: steps of the training.
        final_share: of the rate, in the end.
    """

    def __init__(self, optimiser: Optimizer, warmup: int, total: int, final_share: float) -> None:
        self.warmup, self.total, self.final_share = warmup, total, final_share
        # Where the fall began, and from what factor.
        self.fall: tuple[int, float] = (warmup, 1.0)
        super().__init__(optimiser, lambda step: self.factor(step))

    def factor(self, step: int) -> float:
        """On the learning rate."""
        if step < self.warmup:
            return (step + 1) / self.warmup
        first, before = self.fall
        return cosine(step, first, self.total, before, self.final_share)

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on from a checkpoint, over the steps that this training has."""
        total = self.total
        super().load_state_dict(state_dict)
        if total != self.total and self.last_epoch >= self.warmup:
            self.fall = (self.last_epoch, self.factor(self.last_epoch))
        self.total = total


def scheduled(optimiser: Optimizer, trainer: Trainer, warmup: int, final_share: float) -> OptimizerLRSchedulerConfig:
    """``optimiser`` under `WarmupCosine` over all steps of ``trainer``."""
    total = max(int(trainer.estimated_stepping_batches), warmup + 1)
    return {
        "optimizer": optimiser,
        "lr_scheduler": {"scheduler": WarmupCosine(optimiser, warmup, total, final_share), "interval": "step"},
    }
