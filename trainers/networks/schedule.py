"""What every training does to its weights: which of them decay, and how the learning rate rises and falls."""

from __future__ import annotations

import math
from typing import Any

from lightning import Trainer
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import nn
from torch.optim import Optimizer
from torch.optim.lr_scheduler import LambdaLR


def decay_groups(module: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """The trained parameters in two groups: matrices and kernels, which decay, and the others, which do not."""
    trained = [p for p in module.parameters() if p.requires_grad]
    return [
        {"params": [p for p in trained if p.ndim > 1], "weight_decay": weight_decay},
        {"params": [p for p in trained if p.ndim <= 1], "weight_decay": 0.0},
    ]


def warmup_cosine(step: int, warmup: int, total: int, final_share: float) -> float:
    """Factor on the learning rate: a linear rise to 1 at ``warmup``, a cosine fall to ``final_share`` at ``total``.

    >>> [round(warmup_cosine(s, 10, 110, 0.0), 2) for s in (0, 9, 10, 60, 110)]
    [0.1, 1.0, 1.0, 0.5, 0.0]
    """
    if step < warmup:
        return (step + 1) / warmup
    progress = min(1.0, (step - warmup) / (total - warmup))
    return final_share + (1 - final_share) * (1 + math.cos(math.pi * progress)) / 2


def scheduled(optimiser: Optimizer, trainer: Trainer, warmup: int, final_share: float) -> OptimizerLRSchedulerConfig:
    """``optimiser`` under `warmup_cosine` over all steps of ``trainer``."""
    total = max(int(trainer.estimated_stepping_batches), warmup + 1)
    schedule = LambdaLR(optimiser, lambda step: warmup_cosine(step, warmup, total, final_share))
    return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}
