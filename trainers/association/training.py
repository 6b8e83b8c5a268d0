"""Learning the costs of the flow through the flow: the LightningModule."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import torch
from lightning.pytorch.utilities.types import OptimizerLRSchedulerConfig
from torch import Tensor
from torch.nn import functional
from torch.optim import AdamW

from tsuiseki.models.association import AssociationNetwork
from tsuiseki.models.metric_losses import softmax_contrastive_loss
from tsuiseki.tracking.association.flow.cost_network import FeatureNames
from tsuiseki.tracking.association.flow.link_cost import LinkCost
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.counts import Counts
from tsuiseki.trainers.association.data import AssociationData, TrainingWindow
from tsuiseki.trainers.association.flow_loss import DifferenceWeights, FlowLoss, LossName, Problem, Spread, cheapest
from tsuiseki.trainers.association.graphs import Graph
from tsuiseki.trainers.association.window_appearance import WindowCrops, distances, repriced
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.networks.appearance import AppearanceTraining
from tsuiseki.trainers.networks.schedule import decay_groups, scheduled

# Of the softmax over the views of a window, as of those that the network was trained on.
TEMPERATURE = 0.1


class AssociationTraining(lightning.LightningModule):
    """The association network, the loss of whole flows, and its schedule; validates by agreement with the labels.

    Args:
        hidden: width of the network's hidden layers; 0 for a linear one, which few sequences call for.
        trust: share of the learnt change of what using a detection costs that is taken outside of training: scores and
            sizes mean other things in other videos, so half of it carries over better than all.
        loss: ``fenchel_young`` or ``hinge``, see `flow_loss`.
        epsilon: ε of ``fenchel_young``, in costs.
        epsilon_last: ε in the end, approached geometrically; None keeps it.
        pairs: K, antithetic pairs of perturbations a step.
        switch: what Δ of ``hinge`` counts for a wrong link; a missed detection counts 1.
        length: power of the length of an identity that Δ is multiplied with.
        joins: weight of the loss of the second level, the joins of tracklets; 0 leaves it out.
        pairwise: weight of the cross-entropy of single links, the loss that costs are learnt by apart.
        appearance: checkpoint of a Siamese network (`tsuiseki train appearance`) that is trained on through the flow,
            on the crops of the windows; the data then needs it exported, too. None compares no appearance.
        appearance_rate: its learning rate, a share of the others'.
        contrast: weight of its own loss, by which it is told who is who in a window.
        start: checkpoint whose network is gone on with; by default the tracker's own costs.
        learning_rate: at the end of the warm-up.
        weight_decay: of matrices, towards the tracker's own costs.
        warmup_steps: of linear rise.
        final_share: of the learning rate that the cosine decay ends with.
        processes: that solve at the same time; 0 takes all cores.
        seed: of the perturbations.
    """

    def __init__(
        self,
        hidden: int = 0,
        trust: float = 0.5,
        loss: LossName = "fenchel_young",
        epsilon: float = 1.0,
        epsilon_last: float | None = None,
        pairs: int = 1,
        switch: float = 2.0,
        length: float = 0.0,
        joins: float = 0.2,
        pairwise: float = 0.0,
        appearance: Path | None = None,
        appearance_rate: float = 0.03,
        contrast: float = 0.1,
        start: Path | None = None,
        learning_rate: float = 3e-3,
        weight_decay: float = 1e-2,
        warmup_steps: int = 10,
        final_share: float = 0.01,
        processes: int = 1,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.save_hyperparameters(ignore=["start", "appearance"])
        names = FeatureNames()
        self.network = AssociationNetwork(len(names.links), len(names.detections), len(names.joins), hidden, trust)
        try:
            self.loss = FlowLoss(loss, epsilon, pairs)
            self.weights = DifferenceWeights(wrong=switch, length=length)
        except ValueError as error:
            raise RequestError(str(error)) from error
        self.epsilon_last, self.joins, self.pairwise = epsilon_last, joins, pairwise
        self.learning_rate, self.weight_decay = learning_rate, weight_decay
        self.warmup_steps, self.final_share = warmup_steps, final_share
        self.processes, self.seed = processes or os.cpu_count() or 1, seed
        self.siamese: AppearanceTraining | None = None
        self._siamese_made_of: dict[str, Any] = {}
        self.appearance_rate, self.contrast, self.link_cost = appearance_rate, contrast, LinkCost()
        if appearance is not None:
            self.siamese, self._siamese_made_of = _siamese_of(appearance)
        self.started_from = start
        if start is not None:
            self.network.load_state_dict(_network_of(start, self.network))
        self._pool: Executor | None = None
        self._counts = Counts()

    def transfer_batch_to_device(
        self, batch: TrainingWindow, device: torch.device, dataloader_idx: int
    ) -> TrainingWindow:
        """Windows stay as they are: the solver wants them so, and their tensors are made where the network is."""
        del device, dataloader_idx
        return batch

    def setup(self, stage: str) -> None:
        """Take mean and deviation of the features from what is learnt from; a checkpoint has its own."""
        data = getattr(self.trainer, "datamodule", None)
        if stage == "fit" and isinstance(data, AssociationData) and self.started_from is None:
            self.standardise(data.learnt)

    def standardise(self, graphs: Sequence[Any]) -> None:
        """Take mean and deviation of the features from the networks of sequences."""
        for part, rows in (
            (self.network.links, [one.detections.links for one in graphs]),
            (self.network.detections, [one.detections.detections for one in graphs]),
            (self.network.joins, [one.tracklets.links for one in graphs]),
        ):
            part.standardise(torch.as_tensor(np.concatenate(rows), dtype=torch.float32))

    def features(self, crops: WindowCrops | None) -> Tensor | None:
        """``(N, D)`` what the detections of a window look like; None where nothing looks at them.

        The normalisations of the Siamese network keep the statistics that they were trained with: a window of one
        street is no fair sample of crops.

        Raises:
            RequestError: crops without a network or a network without crops.
        """
        if (self.siamese is None) != (crops is None):
            raise RequestError(
                "expected --model.appearance CHECKPOINT and --data.appearance ONNX together, got one of them"
            )
        if self.siamese is None or crops is None:
            return None
        self.siamese.eval()
        features: Tensor = self.siamese(torch.as_tensor(crops.images, device=self.device))
        return features

    def costs(self, graph: Graph, features: Tensor | None = None, crops: WindowCrops | None = None) -> Tensor:
        """``(3 N + P,)`` costs of the arcs of a window of detections: by default, and what the network changes."""
        count = len(graph)
        base, rows = self._tensor(graph.costs), self._tensor(graph.links)
        if features is not None and crops is not None:
            rows, dearer = repriced(rows, distances(features, crops, graph), self.link_cost)
            base = base + torch.cat([base.new_zeros(3 * count), dearer])
        changes = self.network.detections(self._tensor(graph.detections)).T.reshape(3 * count)
        changes = torch.where(torch.as_tensor(graph.fixed, device=self.device), torch.zeros_like(changes), changes)
        links = self.network.links(rows)[:, 0]
        return base + torch.cat([changes, links])

    def join_costs(self, graph: Graph) -> Tensor:
        """``(3 N + P,)`` costs of the arcs between tracklets, of which only those of joins change."""
        joins = self.network.joins(self._tensor(graph.links))[:, 0]
        return self._tensor(graph.costs) + torch.cat([joins.new_zeros(3 * len(graph)), joins])

    def training_step(self, batch: TrainingWindow, batch_index: int) -> Tensor | None:
        """The loss of a window, and of the joins of its sequence; None for a window without detections.

        Raises:
            RunError: the loss is no number; names the window.
        """
        del batch_index
        if not len(batch.detections):
            return None
        rng = np.random.default_rng([self.seed, self.global_step])
        objective, others = self.losses(batch, self._annealed(), rng)
        self.log("train/objective", objective, on_step=False, on_epoch=True, prog_bar=True, batch_size=1)
        return finite(objective + others, batch.detections.name)

    def losses(self, batch: TrainingWindow, loss: FlowLoss, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """The loss of the flow of a window with detections, a detection; and all others, by their weights."""
        graph, tracklets = batch.detections, batch.tracklets
        features = self.features(batch.crops)
        costs = self.costs(graph, features, batch.crops)
        objective = loss(costs.double(), graph.arcs(self.weights), rng, self._spread) / len(graph)
        others = objective.new_zeros(())
        if features is not None and self.contrast:
            others = others + self.contrast * contrast_within(features, graph)
        if self.pairwise:
            others = others + self.pairwise * link_cross_entropy(costs, graph)
        if self.joins and len(tracklets.tail):
            joined = loss(self.join_costs(tracklets).double(), tracklets.arcs(self.weights), rng, self._spread)
            others = others + self.joins * joined / len(tracklets)
        return objective, others

    def validation_step(self, batch: TrainingWindow, batch_index: int) -> None:
        """Count what the flow does right and wrong."""
        del batch_index
        graph = batch.detections
        with torch.no_grad():
            costs = self.costs(graph, self.features(batch.crops), batch.crops).double().cpu().numpy()
        self._counts.add(graph, cheapest(Problem(costs, graph.tail, graph.head)))

    def on_validation_epoch_end(self) -> None:
        """Log agreement with the labelled flow, MOTA and switches of all windows."""
        if not self.trainer.sanity_checking and self._counts.windows:
            self.log("val/agreement", self._counts.agreement, prog_bar=True)
            self.log("val/mota", self._counts.mota, prog_bar=True)
            self.log("val/switches", self._counts.switches, prog_bar=True)
        self._counts = Counts()

    def configure_optimizers(self) -> OptimizerLRSchedulerConfig:
        """AdamW under a warm-up and a cosine."""
        groups = decay_groups(self.network, self.weight_decay)
        if self.siamese is not None:
            slower = {"lr": self.learning_rate * self.appearance_rate}
            groups += [{**group, **slower} for group in decay_groups(self.siamese, self.weight_decay)]
        optimiser = AdamW(groups, lr=self.learning_rate)
        return scheduled(optimiser, self.trainer, self.warmup_steps, self.final_share)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep what the Siamese network is made of, so that it can be made again without its own checkpoint."""
        if self.siamese is not None:
            checkpoint["siamese"] = self._siamese_made_of

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Make the Siamese network that the checkpoint has weights for."""
        if self.siamese is None and "siamese" in checkpoint:
            self._siamese_made_of = checkpoint["siamese"]
            self.siamese = AppearanceTraining(**self._siamese_made_of).eval()

    def on_fit_end(self) -> None:
        """Let the processes go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _annealed(self) -> FlowLoss:
        if self.epsilon_last is None:
            return self.loss
        steps = max(int(self.trainer.estimated_stepping_batches), 1)
        return self.loss.annealed(min(self.global_step / steps, 1.0), self.epsilon_last)

    @property
    def _spread(self) -> Spread:
        """How the solver is asked several things: in processes, where there are any."""
        if self.processes == 1:
            return map
        if self._pool is None:
            self._pool = ProcessPoolExecutor(self.processes, get_context("spawn"))
        pool = self._pool

        def spread(function: Callable[[Problem], FloatArray], items: Iterable[Problem]) -> Iterable[FloatArray]:
            return pool.map(function, items)

        return spread

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.device)


def finite(loss: Tensor, name: str) -> Tensor:
    """The loss of the window ``name``.

    Raises:
        RunError: it is no number.
    """
    if not torch.isfinite(loss):
        raise RunError(f"the loss is {loss.item()} on {name}; lower --model.learning_rate and start again")
    return loss


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


def _siamese_of(checkpoint: Path) -> tuple[AppearanceTraining, dict[str, Any]]:
    """The Siamese network in a checkpoint, and the arguments that it was made with.

    Raises:
        RequestError: the file is missing or no such checkpoint.
    """
    siamese = load_module(AppearanceTraining, checkpoint)
    given = torch.load(checkpoint, map_location="cpu", weights_only=True)["hyper_parameters"]
    known = set(inspect.signature(AppearanceTraining.__init__).parameters)
    return siamese, {**{name: value for name, value in given.items() if name in known}, "weights": None}


def _network_of(checkpoint: Path, network: AssociationNetwork) -> dict[str, Tensor]:
    """The weights of the network in a checkpoint of this training.

    Raises:
        RequestError: the file is missing, no such checkpoint, or of other features.
    """
    if not checkpoint.is_file():
        raise RequestError(f"expected a checkpoint to start from at {checkpoint}, found none")
    try:
        state = torch.load(checkpoint, map_location="cpu", weights_only=True)["state_dict"]
        found = {name.removeprefix("network."): value for name, value in state.items() if name.startswith("network.")}
    except Exception as error:
        raise RequestError(f"{checkpoint}: expected a checkpoint of `tsuiseki train association`") from error
    for name, value in network.state_dict().items():
        if name not in found or found[name].shape != value.shape:
            got = tuple(found[name].shape) if name in found else "nothing"
            raise RequestError(
                f"{checkpoint}: expected a network of the same features and hidden, with {name} of shape "
                f"{tuple(value.shape)}, got {got}; train it again"
            )
    return found
