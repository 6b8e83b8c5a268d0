"""Learning the costs of the flow through the flow: the LightningModule, and the networks that it starts from."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.pytorch.cli import instantiate_module
from torch import Tensor, nn

from tsuiseki.models.association import AssociationNetwork
from tsuiseki.models.detector import AnchorDetector, BranchedDetector
from tsuiseki.tracking.association.learnt_costs import FeatureNames
from tsuiseki.tracking.association.link_cost import LinkCost
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, IntArray
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.appearance import Appearance
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.exported_weights import layout_of
from tsuiseki.trainers.exporting.written_costs import export_association
from tsuiseki.trainers.flow.flow_layer import FlowLayer, FlowWindows
from tsuiseki.trainers.flow.flow_loss import FlowLoss, cheapest, finite
from tsuiseki.trainers.flow.graphs import FlowCounts, Graph, Graphs, track_numbers
from tsuiseki.trainers.flow.window_costs import (
    FrozenTrunk,
    contrast_within,
    distances,
    own_loss,
    rescored,
    score_logits,
    with_new_distances,
)
from tsuiseki.trainers.flow.windows import AssociationData, TrainingWindow
from tsuiseki.trainers.network_module import (
    BEGINNINGS,
    NetworkModule,
    Optimisation,
    plain_hyperparameters,
    read_checkpoint,
)
from tsuiseki.trainers.own_network import refuse_parts, try_link_costs
from tsuiseki.trainers.start import begin_network


def siamese_of(path: Path) -> tuple[Appearance, dict[str, Any]]:
    """The Siamese network in a checkpoint or an exported file, and the arguments that it is made with.

    Raises:
        RequestError: the file is missing, or no such checkpoint or file.
    """
    siamese = Appearance(start=path)
    return siamese.eval(), {name: siamese.hparams[name] for name in ("trunk", "feature_length", "height", "width")}


def detector_of(path: Path) -> tuple[Detector, dict[str, Any]]:
    """The detector in a checkpoint or an exported file, and the arguments that it is made with; its heads learn.

    An exported file does not tell the loss it was trained by; it gets that of overlaps as scores, ``quality``.

    Raises:
        RequestError: the file is missing, no such checkpoint, or no detector of the default architecture.
    """
    path = shipped_or_file("detector", path)
    if path.suffix != ".onnx":
        detector, made_of = load_module(Detector, path), _made_of(Detector, path)
        if isinstance(detector.network, BranchedDetector):
            raise RequestError(f"{path}: expected a detector without a branch; export it, then its branch is left out")
        if not isinstance(detector.network, AnchorDetector):
            raise RequestError(f"{path}: expected a detector with heads at anchors, got {detector.card.name}")
        if len(detector.card.class_names) > 1:
            raise RequestError(
                f"{path}: expected a detector of people alone, got {', '.join(detector.card.class_names)}"
            )
        return heads_only(detector), {**made_of, **BEGINNINGS}
    # It is of people alone.
    made_of = {**layout_of(path).arguments, "loss": "quality"}
    detector = Detector(**made_of, start=path)
    return heads_only(detector), made_of


def heads_only(detector: Detector) -> Detector:
    """The detector, of which only the heads learn."""
    detector.requires_grad_(False)
    for heads in (detector.network.class_heads, detector.network.box_heads):
        heads.requires_grad_(True)
    return detector.eval()


def _made_of(kind: type, checkpoint: Path) -> dict[str, Any]:
    parameters = read_checkpoint(checkpoint, "hyper_parameters")
    accepted = set(inspect.signature(kind.__init__).parameters)  # type: ignore[misc]
    return {name: value for name, value in parameters.items() if name in accepted}


# Where a checkpoint says how many epochs, and how many steps at most, its training is to have; below 0 for no end.
PLANNED = "planned_epochs"
PLANNED_STEPS = "planned_steps"


@dataclass(frozen=True)
class AppearanceLearning:
    """How appearance learns with the costs, through the flow.

    Attributes:
        file: checkpoint of a Siamese network (`tsuiseki train appearance`), or one that was exported, that is trained
            on with the crops of the windows; the data then needs it exported, too. null compares no appearance.
        rate: its learning rate, a share of the others'.
        contrast: weight of its own loss, which knows who is who in a window.
    """

    file: Path | None = None
    rate: float = 0.03
    contrast: float = 0.1


@dataclass(frozen=True)
class HeadsLearning:
    """How the heads of a detector learn with the costs, through the flow.

    Attributes:
        file: checkpoint of a detector (`tsuiseki train detector`), or one that was exported; the data then needs it
            exported, and ``heads``. null leaves scores as they are.
        rate: learning rate of the heads, a share of the others'.
        weight: of the detector's own loss, by boxes, on the frames of the windows.
    """

    file: Path | None = None
    rate: float = 0.03
    weight: float = 0.3


class Association(NetworkModule):
    """The association network, the loss of whole flows, and its schedule; validates by agreement with the labels.

    Args:
        start: exported association network, or checkpoint of another training, whose weights are taken over.
        trust: share of the learnt change of what using a detection costs that is taken outside of training: scores and
            sizes mean other things in other videos, so half of it carries over better than all.
        loss: of the flow.
        joins: weight of the loss of the second level, the joins of tracklets; 0 leaves it out.
        appearance: how appearance learns with the costs.
        detector: how a detector learns with the costs.
        learning_rate: at the end of the warm-up.
        optimisation: optimiser and schedule; they decay towards the tracker's own costs.
        seed: of the perturbations.
        network: any `LinkCosts`, which changes the costs of links in place of a linear map.

    Raises:
        RequestError: the ``network`` is no `LinkCosts`, or stands beside a ``start``, which has one.
    """

    kind = "association"

    def __init__(
        self,
        start: str | Path | None = None,
        trust: float = 0.5,
        loss: FlowLoss = FlowLoss(),  # noqa: B008
        joins: float = 0.2,
        appearance: AppearanceLearning = AppearanceLearning(),
        detector: HeadsLearning = HeadsLearning(),
        learning_rate: float = 3e-3,
        optimisation: Optimisation = Optimisation(weight_decay=1e-2, warmup_steps=10),  # noqa: B008
        seed: int = 0,
        network: nn.Module | None = None,
    ) -> None:
        super().__init__()
        # A checkpoint holds plain values alone, so of a network that a command builds how, and no other.
        own, network = network, None
        self.save_hyperparameters(ignore=["appearance", "detector"])
        plain_hyperparameters(self)
        names = FeatureNames()
        sizes = len(names.links), len(names.detections), len(names.joins)
        if own is not None:
            refuse_parts({"start": start}, {})
            try_link_costs(own, len(names.links))
            self.bring(own)
        self.network = AssociationNetwork(*sizes, trust, own)
        self.example_input_array = tuple(torch.zeros(2, size) for size in sizes)
        self._started = start is not None
        if start is not None:
            begin_network(self.network, Path(start), "association")
            self.network.load_state_dict(AssociationNetwork(*sizes, trust).trusts(), strict=False)
        self.flow, self.joins = FlowLayer(loss), joins
        self.learning_rate, self.optimisation, self.seed = learning_rate, optimisation, seed
        self.appearance, self.heads, self.link_cost = appearance, detector, LinkCost()
        self.siamese: Appearance | None = None
        self._siamese_made_of: dict[str, Any] = {}
        if appearance.file is not None:
            self.siamese, self._siamese_made_of = siamese_of(appearance.file)
        self.detector: Detector | None = None
        self._detector_made_of: dict[str, Any] = {}
        self.trunk = FrozenTrunk()
        if detector.file is not None:
            self.detector, self._detector_made_of = detector_of(detector.file)
        self._planned = (-1, -1)

    def transfer_batch_to_device(
        self, batch: TrainingWindow, device: torch.device, dataloader_idx: int
    ) -> TrainingWindow:
        """Windows stay as they are: the solver wants them so, and their tensors are made where the network is."""
        del device, dataloader_idx
        return batch

    def setup(self, stage: str) -> None:
        """Take mean and deviation of the features from what is learnt from; a checkpoint has its own.

        Raises:
            RequestError: the Trainer has a precision that the solver of the flow does not take.
        """
        if self.trainer.precision.endswith("true") and self.trainer.precision != "32-true":
            raise RequestError(
                f"expected the precision 32-true or a mixed one, for the flow is solved outside of torch; got "
                f"{self.trainer.precision}"
            )
        data = getattr(self.trainer, "datamodule", None)
        self._planned = (self.trainer.max_epochs or -1, self.trainer.max_steps)
        if isinstance(data, AssociationData):
            self.link_cost = data.settings.costs.link
            # The weights of a start go with its mean and deviation.
            if stage == "fit" and not self._started:
                self.standardise(data.learnt)

    def standardise(self, graphs: Sequence[Graphs]) -> None:
        """Take mean and deviation of the features from the networks of sequences."""
        for part, rows in (
            (self.network.links, [graph.detections.links for graph in graphs]),
            (self.network.detections, [graph.detections.detections for graph in graphs]),
            (self.network.joins, [graph.tracklets.links for graph in graphs]),
        ):
            part.standardise(torch.as_tensor(np.concatenate(rows), dtype=torch.float32))

    def outputs(self, batch: TrainingWindow) -> tuple[Tensor | None, tuple[Tensor, Tensor] | None]:
        """What the networks that learn with the costs say of a window.

        The normalisations of the Siamese network keep the statistics that they were trained with: a window of one
        street is no fair sample of crops.

        Returns:
            ``(N + M, D)`` what its detections and its others look like, of unit length, and raw heads of the detector
            on its images, ``(T, A, 2)`` and ``(T, A, 4)``; None for a network that does not learn.

        Raises:
            RequestError: crops without a network or frames without a detector, or the other way round.
        """
        for network, inputs, what in (
            (self.siamese, batch.crops, "--model.appearance.file FILE and --data.appearance ONNX"),
            (self.detector, batch.frames, "--model.detector.file FILE, --data.detector ONNX and --data.heads true"),
        ):
            if (network is None) != (inputs is None):
                raise RequestError(f"expected {what} together, got one of them alone")
        features = heads = None
        if self.siamese is not None and batch.crops is not None:
            features = self.siamese.eval()(torch.as_tensor(batch.crops.images, device=self.device))
        if self.detector is not None and batch.frames is not None:
            heads = self.trunk.heads(self.detector, batch.frames.batch.images)
        return features, heads

    def costs(self, batch: TrainingWindow, features: Tensor | None, heads: tuple[Tensor, Tensor] | None) -> Tensor:
        """``(3 N + P,)`` costs of the arcs of a window of detections: by default, and what the `outputs` change.

        Raises:
            RunError: one is no number, as those of weights that ran away are; names the window.
        """
        graph, count = batch.detections, len(batch.detections)
        base, rows, links = (self._tensor(part) for part in (graph.costs, graph.detections, graph.links))
        if features is not None and batch.crops is not None:
            links, dearer = with_new_distances(links, distances(features, batch.crops, graph), self.link_cost)
            base = base + torch.cat([base.new_zeros(3 * count), dearer])
        if heads is not None and batch.frames is not None:
            rows, dearer = rescored(rows, score_logits(heads[0], batch.frames, graph), graph)
            base = base + torch.cat([dearer, base.new_zeros(len(base) - count)])
        changes = self.network.detections(rows).T.reshape(3 * count)
        changes = torch.where(torch.as_tensor(graph.fixed, device=self.device), torch.zeros_like(changes), changes)
        return finite(base + torch.cat([changes, self.network.links(links)[:, 0]]), graph.name, "cost")

    def _tensor(self, values: FloatArray) -> Tensor:
        return torch.as_tensor(values, dtype=torch.float32, device=self.device)

    # The flow is solved outside of torch; there is nothing that torch.compile could do better.
    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def training_step(self, batch: TrainingWindow, batch_index: int) -> Tensor | None:
        """The loss of a window, and of the joins of its sequence; None for a window without detections.

        Raises:
            RunError: the loss is no number; names the window.
        """
        del batch_index
        if not len(batch.detections):
            return self._nothing()
        rng = np.random.default_rng([self.seed, self.global_step])
        objective, others = self.losses(batch, rng)
        self.log(
            "train/objective", objective, on_step=False, on_epoch=True, prog_bar=True, batch_size=1, sync_dist=True
        )
        loss = finite(objective + others, batch.detections.name)
        nothing = self._nothing()
        return loss if nothing is None else loss + nothing

    def _nothing(self) -> Tensor | None:
        """Zero, of which all that learns is part: devices that learn together wait for each other's gradients."""
        if not torch.distributed.is_initialized():
            return None
        return 0.0 * torch.stack([weights.sum() for weights in self.parameters() if weights.requires_grad]).sum()

    def losses(self, batch: TrainingWindow, rng: np.random.Generator) -> tuple[Tensor, Tensor]:
        """The loss of the flow of a window with detections, a detection; and all others, by their weights."""
        graph, joins = batch.detections, batch.tracklets
        features, heads = self.outputs(batch)
        windows, costs = [graph.flow_windows], [self.costs(batch, features, heads)]
        if self.joins and len(joins.tail):
            windows.append(joins.flow_windows)
            costs.append(self.join_costs(joins))
        objective, *of_joins = self._flow_losses(windows, costs, rng)
        others = objective.new_zeros(())
        if features is not None and self.appearance.contrast:
            others = others + self.appearance.contrast * contrast_within(features[: len(graph)], graph)
        if self.detector is not None and heads is not None and batch.frames is not None and self.heads.weight:
            others = others + self.heads.weight * own_loss(self.detector, heads, batch.frames)
        return objective, others + self.joins * sum(of_joins)

    def _flow_losses(self, windows: Sequence[FlowWindows], costs: Sequence[Tensor], rng: np.random.Generator) -> Tensor:
        """``(B,)`` the loss of each window with ``(3 N + P,)`` costs, a detection of it."""
        parts = (part.double().tensor_split(window.borders) for window, part in zip(windows, costs, strict=True))
        detections, entries, exits, links = (torch.cat(kind) for kind in zip(*parts, strict=True))
        together = FlowWindows.join(windows)
        flows = self.flow(together, rng, links=links, detections=detections, entries=entries, exits=exits)
        losses: Tensor = flows.loss / torch.as_tensor(together.sizes, device=flows.loss.device)
        return losses

    def join_costs(self, graph: Graph) -> Tensor:
        """``(3 N + P,)`` costs of the flow over tracklets, of which only those of joins change."""
        joins = self.network.joins(self._tensor(graph.links))[:, 0]
        costs = self._tensor(graph.costs) + torch.cat([joins.new_zeros(3 * len(graph)), joins])
        return finite(costs, graph.name, "cost")

    @torch.compiler.disable  # type: ignore[untyped-decorator]
    def validation_step(self, batch: TrainingWindow, batch_index: int) -> None:
        """Count what the flow does right and wrong."""
        del batch_index
        self.validated.append(FlowCounts())
        self.validated[-1].add(batch.detections, self._flow(batch))

    def _flow(self, batch: TrainingWindow) -> FloatArray:
        """``(3 N + P,)`` the cheapest flow of a window."""
        graph = batch.detections
        with torch.no_grad():
            costs = self.costs(batch, *self.outputs(batch)).double().cpu().numpy()
        return cheapest(costs, graph.tail, graph.head)

    def scores(self, rows: list[FlowCounts]) -> dict[str, float]:
        """Agreement with the labelled flow, MOTA and switches of all windows."""
        counts = FlowCounts.together(rows)
        return {name: getattr(counts, name) for name in ("agreement", "mota", "switches")}

    def parameter_groups(self) -> list[dict[str, Any]]:
        """What learns, and how fast."""
        groups = super().parameter_groups()
        for part, share in ((self.siamese, self.appearance.rate), (self.detector, self.heads.rate)):
            if part is not None:
                groups += self.optimisation.groups(part, share * self.learning_rate)
        return groups

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep what the other networks are made of, so that they can be made again without their own checkpoints."""
        super().on_save_checkpoint(checkpoint)
        checkpoint[PLANNED], checkpoint[PLANNED_STEPS] = self._planned
        if self.siamese is not None:
            checkpoint["siamese"] = self._siamese_made_of
        if self.detector is not None:
            checkpoint["detector"] = self._detector_made_of

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Make the other networks that the checkpoint has weights for; how far changes are trusted is as asked now."""
        checkpoint["state_dict"] |= {f"network.{name}": value for name, value in self.network.trusts().items()}
        if self.detector is None and "detector" in checkpoint:
            self._detector_made_of = checkpoint["detector"]
            self.detector = heads_only(instantiate_module(Detector, self._detector_made_of))
        if self.siamese is None and "siamese" in checkpoint:
            self._siamese_made_of = checkpoint["siamese"]
            self.siamese = instantiate_module(Appearance, self._siamese_made_of).eval()
        super().on_load_checkpoint(checkpoint)

    def forward(self, links: Tensor, detections: Tensor, joins: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Changes of costs by features, see `AssociationNetwork.forward`."""
        changes: tuple[Tensor, Tensor, Tensor] = self.network(links, detections, joins)
        return changes

    def predict_step(self, batch: TrainingWindow, batch_index: int) -> IntArray:
        """``(N,)`` which track each detection of a window is in, numbered from 0; -1 for those that are left out."""
        del batch_index
        return track_numbers(batch.detections, self._flow(batch))

    def export(self, out: str | Path, training_data: str = "", overwrite: bool = False) -> float:
        """Write the costs as ONNX, and check that they are those that torch gives.

        Args:
            out: file to write, for --affinity.
            training_data: what it was trained on, in words; kept in the file.
            overwrite: replace an existing file.

        Returns:
            The largest difference of a cost to torch.

        Raises:
            RequestError: the file exists, or cannot be written.
            RunError: the file does not give what torch gives.
        """
        network = copy.deepcopy(self.network).cpu().float()
        return export_association(network, Path(out), training_data, overwrite)
