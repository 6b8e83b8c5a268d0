"""The costs of the arcs of a window: the tracker's own, and what the networks that learn change of them.

Three networks have a say. The association network changes costs by features of links, detections and joins. The
Siamese network, or a projection of what it says, changes how unlike the two ends of a link look. The detector's heads
change the score of a detection. The chain rule goes through all of it.

The tracker averages features along the track found so far, over some time before a link and after it (eq. 5.3,
one-sided), and weighs the cosine distance d of the two averages: weight · (d − neutral), and d is a feature of the
network of costs. Both are computed here again from the features of the window. By how much a link is dearer than its
rivals is held fixed within a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from tsuiseki.datamodules.labelled_images import read_image
from tsuiseki.models.appearance import softmax_contrastive_loss
from tsuiseki.models.association_network import AssociationNetwork
from tsuiseki.tracking.association.evidence import LINK_FEATURES
from tsuiseki.tracking.association.flow_rounds import AVERAGED
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.association.nearby import gaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.preprocessing import crop_boxes
from tsuiseki.tracking.types import FloatArray, ImageArray, IntArray
from tsuiseki.trainers.association.flow_loss import finite
from tsuiseki.trainers.association.graphs import Graph
from tsuiseki.trainers.association.window_detector import FrozenTrunk, rescored, score_logits
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining
from tsuiseki.trainers.networks.detector_training import DetectorTraining

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


def with_new_distances(rows: Tensor, distance: Tensor, cost: LinkCost) -> tuple[Tensor, Tensor]:
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


if TYPE_CHECKING:
    from tsuiseki.trainers.association.windows import TrainingWindow


@dataclass(frozen=True)
class NetworkOutputs:
    """What the networks that learn with the costs say of a window.

    Attributes:
        features: ``(N + M, D)`` what its detections and its others look like, of unit length, 0 where not known; None
            where no part that learns needs them.
        heads: raw heads of the detector on its images, ``(T, A, 2)`` and ``(T, A, 4)``; None where no detector learns.
    """

    features: Tensor | None = None
    heads: tuple[Tensor, Tensor] | None = None


@dataclass(frozen=True)
class CostMakers:
    """The networks that make the costs of a window.

    Attributes:
        network: changes costs.
        siamese: compares appearance; None where that stays as it is.
        detector: scores detections; likewise.
        trunk: keeps what the detector's trunk, which does not learn, makes of images.
        link_cost: what a distance of appearance costs the tracker.
    """

    network: AssociationNetwork
    siamese: AppearanceTraining | None
    detector: DetectorTraining | None
    trunk: FrozenTrunk
    link_cost: LinkCost

    def outputs(self, batch: TrainingWindow) -> NetworkOutputs:
        """What the networks say of a window.

        The normalisations of the Siamese network keep the statistics that they were trained with: a window of one
        street is no fair sample of crops.

        Raises:
            RequestError: crops without a network or frames without a detector, or the other way round.
        """
        for network, given, what in (
            (self.siamese, batch.crops, "--model.appearance.file FILE and --data.appearance ONNX"),
            (self.detector, batch.frames, "--model.detector.file FILE, --data.detector ONNX and --data.heads true"),
        ):
            if (network is None) != (given is None):
                raise RequestError(f"expected {what} together, got one of them alone")
        heads = None
        if self.detector is not None and batch.frames is not None:
            heads = self.trunk.heads(self.detector, batch.frames.batch.images)
        return NetworkOutputs(self._features(batch), heads)

    def _features(self, batch: TrainingWindow) -> Tensor | None:
        features = None
        if self.siamese is not None and batch.crops is not None:
            self.siamese.eval()
            features = self.siamese(torch.as_tensor(batch.crops.images, device=self._device))
        if self.network.projection is None:
            return features
        known = features_of(batch.detections)
        if features is None and known is not None:
            features = self._tensor(known)
        return None if features is None else self.network.projection(features)

    def costs(self, batch: TrainingWindow, outputs: NetworkOutputs | None = None) -> Tensor:
        """``(3 N + P,)`` costs of the arcs of a window of detections: by default, and what the networks change.

        Raises:
            RunError: one is no number, as those of weights that ran away are; names the window.
        """
        graph, outputs = batch.detections, outputs or self.outputs(batch)
        count = len(graph)
        base, rows, links = (self._tensor(part) for part in (graph.costs, graph.detections, graph.links))
        if outputs.features is not None:
            averages = averages_of(graph) if batch.crops is None else batch.crops.averages
            links, dearer = with_new_distances(links, distances(outputs.features, averages, graph), self.link_cost)
            base = base + torch.cat([base.new_zeros(3 * count), dearer])
        if outputs.heads is not None and batch.frames is not None:
            rows, dearer = rescored(rows, score_logits(outputs.heads[0], batch.frames, graph), graph)
            base = base + torch.cat([dearer, base.new_zeros(len(base) - count)])
        changes = self.network.detections(rows).T.reshape(3 * count)
        changes = torch.where(torch.as_tensor(graph.fixed, device=self._device), torch.zeros_like(changes), changes)
        return finite(base + torch.cat([changes, self.network.links(links)[:, 0]]), graph.name, "cost")

    def join_costs(self, graph: Graph) -> Tensor:
        """``(3 N + P,)`` costs of the arcs between tracklets, of which only those of joins change.

        Raises:
            RunError: as `costs`.
        """
        joins = self.network.joins(self._tensor(graph.links))[:, 0]
        costs = self._tensor(graph.costs) + torch.cat([joins.new_zeros(3 * len(graph)), joins])
        return finite(costs, graph.name, "cost")

    @property
    def _device(self) -> torch.device:
        return self.network.links.mean.device

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self._device)
