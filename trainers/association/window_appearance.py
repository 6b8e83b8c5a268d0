"""The appearance of the detections of a window, as the tracker compares it, with gradients into what made it.

That is the Siamese network, or a projection of features that stay as they are, or one after the other.

The tracker averages features along the track found so far, over some time before a link and after it (eq. 5.3,
one-sided), and prices the cosine distance d of the two averages: weight · (d − neutral), and d is a feature of the
network of costs. Both are computed here again from the features of the window. By how much a link is dearer than its
rivals is held fixed within a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.models.metric_losses import softmax_contrastive_loss
from tsuiseki.tracking.association.evidence import LINK_FEATURES
from tsuiseki.tracking.association.flow_rounds import AVERAGED
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.nearby import gaps
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.trainers.association.graphs import Graph

COST, DISTANCE, KNOWN = (LINK_FEATURES.index(name) for name in ("cost", "appearance", "appearance_known"))
# Of the softmax over the views of a window, as of those that the network was trained on.
TEMPERATURE = 0.1


@dataclass(frozen=True)
class Averages:
    """Along which detections of a window features are averaged: its N, then its M others.

    Attributes:
        past: ``(N, N + M)`` which detections are averaged before a link from each.
        future: ``(N, N + M)`` likewise after a link to each.
    """

    past: FloatArray
    future: FloatArray


@dataclass(frozen=True)
class WindowCrops:
    """The crops of a window.

    Attributes:
        images: ``(N + M, H, W, 3)`` uint8 RGB, those of its others last.
        averages: along which of them features are averaged.
    """

    images: ImageArray
    averages: Averages


def crops_of(graph: Graph, height: int, width: int) -> WindowCrops:
    """The crops of a window's detections and others, stretched to ``height`` by ``width``."""
    frames, boxes = np.append(graph.frames, graph.others.frames), np.concatenate([graph.boxes, graph.others.boxes])
    images = np.empty((len(frames), height, width, 3), dtype=np.uint8)
    for frame in np.unique(frames):
        here = np.flatnonzero(frames == frame)
        images[here] = crop_boxes(read_image(graph.images[frame]), boxes[here], height, width)
    return WindowCrops(images, averages_of(graph))


def features_of(graph: Graph) -> FloatArray | None:
    """``(N + M, D)`` features of a window's detections and others, 0 where not known; None if none were described."""
    if graph.features is None:
        return None
    more = graph.others.features
    rows = graph.features if more is None else np.concatenate([graph.features, more])
    return np.asarray(np.nan_to_num(rows))


def averages_of(graph: Graph) -> Averages:
    """Along which detections of a window the tracker averages features."""
    frames, tracks = np.append(graph.frames, graph.others.frames), np.append(graph.tracks, graph.others.tracks)
    past = averaged(frames, tracks, gaps(AVERAGED, graph.frame_rate))
    return Averages(past[: len(graph)], past.T[: len(graph)].copy())


def averaged(frames: IntArray, tracks: IntArray, reach: int) -> FloatArray:
    """``(N, N)`` 1 where the second detection lies in the track of the first, up to ``reach`` frames before it."""
    same = (tracks[:, None] == tracks[None]) & (tracks[:, None] >= 0)
    before = frames[:, None] - frames[None]
    within: FloatArray = (same & (before >= 0) & (before <= reach)).astype(np.float64)
    np.fill_diagonal(within, 1.0)
    return within


def distances(features: Tensor, averages: Averages, graph: Graph) -> Tensor:
    """``(P,)`` cosine distances of the averages at both ends of every link, NaN where one has none.

    Args:
        features: ``(N + M, D)`` of unit length, 0 where not known.
        averages: of the window.
        graph: the window.
    """
    past, future = (
        functional.normalize(torch.as_tensor(part, dtype=features.dtype, device=features.device) @ features, dim=1)
        for part in (averages.past, averages.future)
    )
    tail, head = (torch.as_tensor(part, device=features.device) for part in (graph.tail, graph.head))
    known = past.detach().any(dim=1)[tail] & future.detach().any(dim=1)[head]
    distance = 1 - (past[tail] * future[head]).sum(dim=1)
    return torch.where(known, distance, torch.full_like(distance, float("nan")))


def repriced(rows: Tensor, distance: Tensor, cost: LinkCost) -> tuple[Tensor, Tensor]:
    """Features of the links with another distance of appearance, and by how much that changes the default's costs.

    Args:
        rows: ``(P, F)`` the features, with another distance or none.
        distance: ``(P,)``, NaN where not known, which leaves a link as it is.
        cost: what a distance costs.
    """
    weight, neutral = cost.appearance[1], cost.neutral[1]
    known = ~torch.isnan(distance)
    distance = torch.where(known, distance, rows[:, DISTANCE])
    before = torch.where(rows[:, KNOWN] > 0, rows[:, DISTANCE] - neutral, torch.zeros_like(distance))
    change = torch.where(known, weight * (distance - neutral - before), torch.zeros_like(distance))
    columns = list(rows.unbind(dim=1))
    columns[COST] = columns[COST] + change
    columns[DISTANCE], columns[KNOWN] = distance, torch.where(known, torch.ones_like(distance), rows[:, KNOWN])
    return torch.stack(columns, dim=1), change


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
