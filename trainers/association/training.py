"""Learning the costs of the flow through the flow: the LightningModule."""

from __future__ import annotations

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
from tsuiseki.tracking.association.flow.cost_network import FeatureNames
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.data import AssociationData, TrainingWindow
from tsuiseki.trainers.association.flow_loss import DifferenceWeights, FlowLoss, LossName, Problem, Spread, cheapest
from tsuiseki.trainers.association.graphs import Counts, Graph
from tsuiseki.trainers.networks.schedule import decay_groups, scheduled


class AssociationTraining(lightning.LightningModule):
    """The association network, the loss of whole flows, and its schedule; validates by agreement with the labels.

    Args:
        hidden: width of the network's hidden layers; 0 for a linear one, which few sequences call for.
        loss: ``fenchel_young`` or ``hinge``, see `flow_loss`.
        epsilon: ε of ``fenchel_young``, in costs.
        epsilon_last: ε in the end, approached geometrically; None keeps it.
        pairs: K, antithetic pairs of perturbations a step.
        switch: what Δ of ``hinge`` counts for a wrong link; a missed detection counts 1.
        length: power of the length of an identity that Δ is multiplied with.
        joins: weight of the loss of the second level, the joins of tracklets; 0 leaves it out.
        pairwise: weight of the cross-entropy of single links, the loss that costs are learnt by apart.
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
        loss: LossName = "fenchel_young",
        epsilon: float = 1.0,
        epsilon_last: float | None = None,
        pairs: int = 1,
        switch: float = 2.0,
        length: float = 0.0,
        joins: float = 0.2,
        pairwise: float = 0.0,
        start: Path | None = None,
        learning_rate: float = 3e-3,
        weight_decay: float = 1e-2,
        warmup_steps: int = 10,
        final_share: float = 0.01,
        processes: int = 1,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.save_hyperparameters(ignore=["start"])
        names = FeatureNames()
        self.network = AssociationNetwork(len(names.links), len(names.detections), len(names.joins), hidden)
        try:
            self.loss = FlowLoss(loss, epsilon, pairs)
            self.weights = DifferenceWeights(wrong=switch, length=length)
        except ValueError as error:
            raise RequestError(str(error)) from error
        self.epsilon_last, self.joins, self.pairwise = epsilon_last, joins, pairwise
        self.learning_rate, self.weight_decay = learning_rate, weight_decay
        self.warmup_steps, self.final_share = warmup_steps, final_share
        self.processes, self.seed = processes or os.cpu_count() or 1, seed
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

    def costs(self, graph: Graph) -> Tensor:
        """``(3 N + P,)`` costs of the arcs of a window of detections: by default, and what the network changes."""
        count = len(graph)
        changes = self.network.detections(self._tensor(graph.detections)).T.reshape(3 * count)
        changes = torch.where(torch.as_tensor(graph.fixed, device=self.device), torch.zeros_like(changes), changes)
        links = self.network.links(self._tensor(graph.links))[:, 0]
        return self._tensor(graph.costs) + torch.cat([changes, links])

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
        costs = self.costs(graph)
        objective = loss(costs.double(), graph.arcs(self.weights), rng, self._spread) / len(graph)
        others = objective.new_zeros(())
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
            costs = self.costs(graph).double().cpu().numpy()
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
        optimiser = AdamW(decay_groups(self, self.weight_decay), lr=self.learning_rate)
        return scheduled(optimiser, self.trainer, self.warmup_steps, self.final_share)

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
