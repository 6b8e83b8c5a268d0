"""The appearance of the detections of a window, as the tracker compares it, with gradients into the Siamese network.

The tracker averages features along the track found so far, over some time before a link and after it (eq. 5.3,
one-sided), and prices the cosine distance d of the two averages: weight · (d − neutral), and d is a feature of the
network of costs. Both are computed here again from the crops of the window. By how much a link is dearer than its
rivals is held fixed within a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tsuiseki.datamodules.identity_crops import read_image
from tsuiseki.tracking.association.flow.evidence import LINK_FEATURES
from tsuiseki.tracking.association.flow.flow_rounds import RoundSettings
from tsuiseki.tracking.association.flow.link_cost import LinkCost
from tsuiseki.tracking.association.nearby import gaps
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.trainers.association.graphs import Graph

COST, DISTANCE, KNOWN = (LINK_FEATURES.index(name) for name in ("cost", "appearance", "appearance_known"))


@dataclass(frozen=True)
class WindowCrops:
    """The crops of a window.

    Attributes:
        images: ``(N, H, W, 3)`` uint8 RGB.
        past: ``(N, N)`` which detections are averaged before a link from each.
        future: ``(N, N)`` likewise after a link to each.
    """

    images: ImageArray
    past: FloatArray
    future: FloatArray


def crops_of(graph: Graph, height: int, width: int) -> WindowCrops:
    """The crops of a window's detections, stretched to ``height`` by ``width``."""
    images = np.empty((len(graph), height, width, 3), dtype=np.uint8)
    for frame in np.unique(graph.frames):
        here = np.flatnonzero(graph.frames == frame)
        images[here] = crop_boxes(read_image(graph.images[frame]), graph.boxes[here], height, width)
    reach = gaps(RoundSettings().averaged, graph.frame_rate)
    past = averaged(graph.frames, graph.tracks, reach)
    return WindowCrops(images, past, past.T.copy())


def averaged(frames: IntArray, tracks: IntArray, reach: int) -> FloatArray:
    """``(N, N)`` 1 where the second detection lies in the track of the first, up to ``reach`` frames before it."""
    same = (tracks[:, None] == tracks[None]) & (tracks[:, None] >= 0)
    before = frames[:, None] - frames[None]
    within: FloatArray = (same & (before >= 0) & (before <= reach)).astype(np.float64)
    np.fill_diagonal(within, 1.0)
    return within


def distances(features: Tensor, crops: WindowCrops, graph: Graph) -> Tensor:
    """``(P,)`` cosine distances of the averages at both ends of every link, of ``(N, D)`` features of unit length."""
    past, future = (
        functional.normalize(torch.as_tensor(part, dtype=features.dtype, device=features.device) @ features, dim=1)
        for part in (crops.past, crops.future)
    )
    tail, head = (torch.as_tensor(part, device=features.device) for part in (graph.tail, graph.head))
    return 1 - (past[tail] * future[head]).sum(dim=1)


def repriced(rows: Tensor, distance: Tensor, cost: LinkCost) -> tuple[Tensor, Tensor]:
    """Features of the links with another distance of appearance, and by how much that changes the default's costs.

    Args:
        rows: ``(P, F)`` the features, with another distance or none.
        distance: ``(P,)``.
        cost: what a distance costs.
    """
    weight, neutral = cost.appearance[1], cost.neutral[1]
    before = torch.where(rows[:, KNOWN] > 0, rows[:, DISTANCE] - neutral, torch.zeros_like(distance))
    change = weight * (distance - neutral - before)
    columns = list(rows.unbind(dim=1))
    columns[COST] = columns[COST] + change
    columns[DISTANCE], columns[KNOWN] = distance, torch.ones_like(distance)
    return torch.stack(columns, dim=1), change
