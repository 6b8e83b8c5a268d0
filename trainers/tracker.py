"""Learning to follow one target: the LightningModule around the Siamese tracker.

Each search picture is also compared with the template of the next pair, whose target it does not show, so that the
score learns to say no; the trunk, which costs most, sees every picture once.
"""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tsuiseki.datamodules.tracker import TrackerBatch
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.losses import paired_iou
from tsuiseki.models.tracker import TEMPLATE_SIDE, Heads, TrackerNetwork, best_boxes
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.exporting.exported_weights import Normalisation, arrays_of, fill_network, opened_onnx, unfold
from tsuiseki.trainers.exporting.written_networks import model_files, write_tracker
from tsuiseki.trainers.network_module import (
    NetworkModule,
    Optimisation,
    normalised,
    plain_hyperparameters,
    read_checkpoint,
)
from tsuiseki.trainers.own_network import card_of_network
from tsuiseki.trainers.start import begin_network, completed


class Tracker(NetworkModule):
    """A Siamese tracker, its loss and its schedule; validates by the overlap of the best box.

    With a ``start``, trunk and channels are taken from its file.

    Args:
        start: exported ``…_search.onnx``, or checkpoint of another training, whose weights are taken over; of an
            exported appearance network the trunk alone.
        trunk: of the network; by default ``mobilenet_v3_small``.
        channels: of what is compared; by default 64.
        learning_rate: at the end of the warm-up.
        optimisation: optimiser and schedule.

    Raises:
        RequestError: an argument contradicts the ``start``, or there is no such trunk or file.
    """

    kind = "tracker"
    network: TrackerNetwork

    def __init__(
        self,
        start: str | Path | None = None,
        trunk: TrunkName | None = None,
        channels: int | None = None,
        learning_rate: float = 1e-3,
        optimisation: Optimisation = Optimisation(),  # noqa: B008
    ) -> None:
        super().__init__()
        self.save_hyperparameters()
        file = None if start is None else Path(start)
        asked = {"trunk": trunk, "channels": channels}
        held = None if file is None else parts_of(file)
        parts = completed(asked, USUAL, held, file, fixed=tuple(held or ()))
        self.hparams.update(parts)
        try:
            self.network = TrackerNetwork(parts["trunk"], parts["channels"])
        except ValueError as error:
            raise RequestError(str(error)) from error
        self._folded: list[Normalisation] = [] if file is None else _begun(self.network, file)
        self.card = card_of_network(self.network, "tracker", class_names=())
        plain_hyperparameters(self)
        self.learning_rate, self.optimisation = learning_rate, optimisation
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)
        sides = TEMPLATE_SIDE, self.card.input_height
        self.example_input_array = tuple(torch.zeros(1, side, side, 3, dtype=torch.uint8) for side in sides)

    def on_fit_start(self) -> None:
        """Weights of an exported file get their normalisations back; a training that goes on has all it needs."""
        if self._folded and self.trainer.ckpt_path is None:
            self.trainer.fit_loop.setup_data()
            batch = next(iter(self.trainer.train_dataloader or ()))
            unfold(self.network, self._folded, *(normalised(x.to(self.device), self.card) for x in batch[:2]))
            self.network.train()
        self._folded = []

    def forward(self, template: Tensor, search: Tensor) -> Heads:
        """Heads of ``(B, 127, 127, 3)`` and ``(B, 255, 255, 3)`` uint8 RGB pictures; see `TrackerNetwork.locate`."""
        heads: Heads = self.network(*(normalised(images, self.card, self.dtype) for images in (template, search)))
        return heads

    def training_step(self, batch: TrackerBatch, batch_index: int) -> Tensor:
        """The loss of a batch of pairs, and of as many whose search picture does not show the target."""
        del batch_index
        template, search = (self.network.describe(normalised(x, self.card, self.dtype)) for x in batch[:2])
        templates = torch.cat((template, template.roll(1, dims=0)))
        heads = self.network.locate(templates, torch.cat((search, search)))
        present = torch.cat((batch.present, torch.zeros_like(batch.present)))
        terms = self.network.loss(heads, batch.boxes.repeat(2, 1), present)
        self.log_dict({f"train/{name}": value for name, value in terms.items()}, on_step=False, on_epoch=True)
        total: Tensor = reduce(torch.add, terms.values())
        return total

    def validation_step(self, batch: TrackerBatch, batch_index: int) -> None:
        """Keep overlap and score of the best box of each pair."""
        del batch_index
        boxes, score = best_boxes(self(batch.template, batch.search))
        rows = paired_iou(boxes, batch.boxes), score, batch.present
        self.validated += zip(*(values.cpu().numpy() for values in rows), strict=True)

    def scores(self, rows: list[tuple[np.ndarray, ...]]) -> dict[str, float]:
        """Mean overlap where the target is there, and how often its score lies above that of a pair without it."""
        overlap, score, present = (np.stack(x) for x in zip(*rows, strict=True))
        scores = {"overlap": float(overlap[present].mean())}
        if 0 < present.sum() < len(present):
            scores["told_apart"] = float((score[present][:, None] > score[~present][None]).mean())
        return scores

    def predict_step(self, batch: TrackerBatch, batch_index: int) -> FloatArray:
        """``(B, 5)``: the best box x1, y1, x2, y2 in pixels of the search picture, and its score in [0, 1]."""
        del batch_index
        boxes, score = best_boxes(self(batch.template, batch.search))
        return np.asarray(torch.cat((boxes, score[:, None]), dim=1).double().cpu().numpy())

    def export(
        self, out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False
    ) -> dict[Path, float]:
        """Write the network as ONNX, and check that it gives what torch gives.

        Args:
            out: ``tracker.onnx`` becomes ``tracker_template.onnx`` and ``tracker_search.onnx``.
            training_data: what it was trained on, in words; kept in the files.
            float16: store weights as 16-bit numbers, half the size.
            overwrite: replace existing files.

        Returns:
            Of each file the largest relative difference to torch.
        """
        return write_tracker(self.network, self.card, model_files(out, training_data, float16, overwrite))


# What a network is built of without a start.
USUAL: dict[str, Any] = {"trunk": "mobilenet_v3_small", "channels": 64}


def parts_of(path: Path) -> dict[str, Any]:
    """What the tracker at ``path`` is built of; of an appearance network the trunk.

    Raises:
        RequestError: the file is missing or of another network.
    """
    if path.suffix != ".onnx":
        held = read_checkpoint(path, "hyper_parameters")
        if not held.keys() >= USUAL.keys():
            raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train tracker`, got one of another network")
        return {name: held[name] for name in USUAL}
    _, card = opened_onnx(path)
    if card.kind == "appearance":
        return {"trunk": card.name}
    if card.kind != "tracker" or card.settings.get("part") != "search":
        raise RequestError(
            f"{path}: expected the …_search.onnx of a tracker, or an appearance network, got kind {card.kind!r}"
        )
    return {name: card.settings[name] for name in USUAL}


def _begun(network: TrackerNetwork, path: Path) -> list[Normalisation]:
    """Fill ``network`` with the weights of the file; its normalisations that are part of a layer there."""
    if path.suffix == ".onnx" and (opened := opened_onnx(path))[1].kind == "appearance":
        return fill_network(network.trunk, arrays_of(opened[0], "trunk.stages."))
    return begin_network(network, path, "tracker", prefix="network.")
