"""The costs of the arcs of a window: the tracker's own, and what the networks that learn change of them.

Three networks have a say. The association network changes costs by features of links, detections and joins. The
Siamese network, or a projection of what it says, changes how unlike the two ends of a link look. The detector's heads
change the score of a detection. The chain rule goes through all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from tsuiseki.models.association_network import AssociationNetwork
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.flow_loss import finite
from tsuiseki.trainers.association.graphs import Graph
from tsuiseki.trainers.association.window_appearance import averages_of, distances, features_of, repriced
from tsuiseki.trainers.association.window_detector import FrozenTrunk, rescored, score_logits
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining
from tsuiseki.trainers.networks.detector_training import DetectorTraining

if TYPE_CHECKING:
    from tsuiseki.trainers.association.windows import TrainingWindow


@dataclass(frozen=True)
class NetworkOutputs:
    """What the networks that learn with the costs say of a window.

    Attributes:
        features: ``(N + M, D)`` what its detections and its others look like, of unit length, 0 where not known; None
            where nothing that learns looks at them.
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
            links, dearer = repriced(links, distances(outputs.features, averages, graph), self.link_cost)
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
