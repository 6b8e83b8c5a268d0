"""Fitting an association network to the networks of sequences without the frame of a training run, in seconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.optim import AdamW

from tsuiseki.models.association_network import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import LARGEST
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.trainers.association.flow_loss import FlowLoss, finite
from tsuiseki.trainers.association.graphs import Graphs
from tsuiseki.trainers.association.training import AssociationTraining
from tsuiseki.trainers.association.windows import RandomWindows, WindowImages
from tsuiseki.trainers.networks.modules import Optimisation, warmup_cosine


@dataclass(frozen=True)
class Fit:
    """How an association network is fitted; see `AssociationTraining` for what is not told here.

    Attributes:
        loss: of the flow.
        trust: share of the change of what detections cost that is taken outside of training.
        flow: weight of the loss of the flow; 0 trains by all other losses alone, to compare with.
        steps: windows that are looked at.
        seconds: length of a window.
        joins: weight of the second level.
        optimisation: how weights are moved.
        seed: of windows, perturbations and first weights.
    """

    loss: FlowLoss = FlowLoss()  # noqa: RUF009
    trust: float = 0.5
    flow: float = 1.0
    steps: int = 120
    seconds: float = 2.0
    joins: float = 0.2
    optimisation: Optimisation = Optimisation(3e-3, 1e-2, warmup_steps=10)  # noqa: RUF009
    seed: int = 0


def fit_network(graphs: Sequence[Graphs], fit: Fit) -> AssociationNetwork:
    """The network after ``fit.steps`` windows.

    Raises:
        RunError: a loss is no number; names the window.
    """
    torch.manual_seed(fit.seed)
    module = AssociationTraining(trust=fit.trust, loss=fit.loss, joins=fit.joins, optimisation=fit.optimisation)
    return fitted(module, graphs, fit).network.eval()


def fitted(
    module: AssociationTraining,
    graphs: Sequence[Graphs],
    fit: Fit,
    images: WindowImages = WindowImages(),  # noqa: B008
) -> AssociationTraining:
    """A module, whatever networks it has, after ``fit.steps`` windows.

    Args:
        module: is changed.
        graphs: of the sequences.
        fit: how long, how fast, on windows of what length.
        images: what its networks see of a window.

    Raises:
        RunError: a loss is no number; names the window.
    """
    module.standardise(graphs)
    windows = RandomWindows(graphs, fit.seconds, fit.steps, lambda: (fit.seed, 0), images)
    groups = [group for group in module.parameter_groups() if group["params"]]
    how = fit.optimisation
    highest = [group.get("lr", how.learning_rate) for group in groups]
    optimiser = AdamW(groups, lr=how.learning_rate)
    for step in range(fit.steps):
        batch = windows[step]
        if not len(batch.detections):
            continue
        for group, rate in zip(optimiser.param_groups, highest, strict=True):
            group["lr"] = rate * warmup_cosine(step, how.warmup_steps, max(fit.steps, 11), how.final_share)
        optimiser.zero_grad()
        objective, others = module.losses(batch, module.loss, np.random.default_rng([fit.seed, step]))
        finite(fit.flow * objective + others, batch.detections.name).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimiser.step()
    return module


@dataclass(frozen=True)
class NetworkChanges:
    """An association network in torch as the tracker takes it; a `CostChanges`.

    Attributes:
        network: the network.
    """

    network: AssociationNetwork

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return self._of("links", rows)[:, 0]

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        return self._of("detections", rows).clip(-LARGEST, LARGEST)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return self._of("joins", rows)[:, 0]

    def projected(self, found: Detections) -> Detections:
        """The detections of a frame with their appearance features as they are compared."""
        if self.network.projection is None or found.features is None:
            return found
        with torch.no_grad():
            features: torch.Tensor = self.network.projection(torch.as_tensor(found.features, dtype=torch.float32))
        return found.with_features(features.double().numpy())

    def _of(self, part: str, rows: FloatArray) -> FloatArray:
        with torch.no_grad():
            changes: torch.Tensor = getattr(self.network, part)(torch.as_tensor(rows, dtype=torch.float32))
        return changes.double().numpy()
