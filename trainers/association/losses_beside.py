"""The losses that stand beside that of the flow, a window at a time."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tsuiseki.models.metric_losses import softmax_contrastive_loss
from tsuiseki.tracking.errors import RunError
from tsuiseki.trainers.association.graphs import Graph

# Of the softmax over the views of a window, as of those that the network was trained on.
TEMPERATURE = 0.1


def finite(values: Tensor, name: str, what: str = "loss") -> Tensor:
    """The loss, or the costs, of the window ``name``.

    Raises:
        RunError: one of them is no number.
    """
    wrong = values.detach()[~torch.isfinite(values.detach())]
    if len(wrong):
        raise RunError(f"the {what} is {wrong[0].item()} on {name}; lower --model.learning_rate and start again")
    return values


def contrast_within(features: Tensor, graph: Graph) -> Tensor:
    """The Siamese network's own loss, over the people of a window who have several detections in it."""
    names, place, counts = np.unique(graph.owners, return_inverse=True, return_counts=True)
    several = (counts > 1) & (names >= 0)
    if several.sum() < 2:
        return features.new_zeros(())
    chosen = torch.as_tensor(np.flatnonzero(several[place]), device=features.device)
    return softmax_contrastive_loss(
        features[chosen], torch.as_tensor(place, device=features.device)[chosen], TEMPERATURE
    )


def link_cross_entropy(costs: Tensor, graph: Graph) -> Tensor:
    """The loss that links are learnt by apart: each right with the probability that half a break is dearer than it."""
    count = len(graph)
    if not len(graph.tail):
        return costs.new_zeros(())
    start, end, link = costs[count : 2 * count], costs[2 * count : 3 * count], costs[3 * count :]
    tail, head = (torch.as_tensor(part, device=costs.device) for part in (graph.tail, graph.head))
    logit = (end.detach()[tail] + start.detach()[head]) / 2 - link
    right = torch.as_tensor(graph.labelled[3 * count :], dtype=costs.dtype, device=costs.device)
    return functional.binary_cross_entropy_with_logits(logit, right)
