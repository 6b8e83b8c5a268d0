"""Sequences of people who cross, with labels and what a tracker may report of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

Frames = list[dict[str, Any]]


def crossing(seed: int, length: int = 12, people: int = 5) -> tuple[Frames, Frames]:
    """What is reported, and the labels: boxes that are off, missing, false or of another id; frames without any."""
    rng = np.random.default_rng(seed)
    start, pace = rng.uniform(0, 60, (people, 2)), rng.uniform(-4, 4, (people, 2))
    names = np.arange(1, people + 1) * 3
    preds, target = [], []
    for n in range(length):
        corner = start + n * pace
        boxes = np.column_stack([corner, corner + np.array([12, 30])])
        present = rng.random(people) < (0.8 if rng.random() > 0.1 else 0)
        target.append({"boxes": torch.from_numpy(boxes[present]), "ids": torch.from_numpy(names[present])})
        reported = rng.random(people) < (0.8 if rng.random() > 0.1 else 0)
        noisy = boxes + rng.normal(0, 1.5, boxes.shape)
        ids = names + 100 * (rng.random(people) < 0.1 * (n > length // 2))
        preds.append({"boxes": torch.from_numpy(noisy[reported]), "ids": torch.from_numpy(ids[reported])})
    return preds, target


@pytest.fixture
def crowd() -> Callable[..., tuple[Frames, Frames]]:
    """Makes a sequence of a seed."""
    return crossing
