"""Learning actions: the LightningModule around the streams of the action network."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn

from tsuiseki.datamodules.action import ActionBatch, ActionData
from tsuiseki.models.action import ActionNetwork, ActionStream, action_loss, fused_logits, positive_weights
from tsuiseki.models.backbones import TrunkName
from tsuiseki.models.contract import NetworkCard
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.action import STREAMS, ActionInput, StreamName
from tsuiseki.tracking.features.optical_flow import FlowName
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.weights import FOLDER, shipped
from tsuiseki.trainers.exporting.export import ModelFiles
from tsuiseki.trainers.exporting.exported_weights import Normalisation, opened_onnx, unfold
from tsuiseki.trainers.exporting.written_networks import model_files, write_streams
from tsuiseki.trainers.metrics.actions import ActionPrecision
from tsuiseki.trainers.network_module import (
    NetworkModule,
    Optimisation,
    first_samples,
    normalised,
    plain_hyperparameters,
    read_checkpoint,
)
from tsuiseki.trainers.own_network import refuse_parts, try_action
from tsuiseki.trainers.start import begin_network, completed

# Actions that Okutama-Action labels.
OKUTAMA_ACTIONS = 12
# Largest weight of rare actions, see `positive_weights`.
RARE_LIMIT = 5.0
# Crops that tell the normalisations of exported streams their statistics.
_NORM_EXAMPLES = 64


# What a network is built of without a start.
USUAL: dict[str, Any] = {"trunk": "resnet18", "streams": STREAMS, "actions": OKUTAMA_ACTIONS, "size": 64, "flow": "dis"}


class Action(NetworkModule):
    """The streams of an action network, trained side by side or as one network; validates by mAP.

    With a ``start`` trunk, actions, size and flow are taken from its files.

    Args:
        start: name of shipped streams (``drone``), the name that exported streams were written by (``action.onnx``
            stands for ``action_rgb_local.onnx`` and so on), or checkpoint of another training, whose weights are taken
            over.
        trunk: network under every stream; by default ``resnet18``; the thesis has ``resnet101``.
        weights: ``imagenet`` starts the trunks from torchvision's weights, null from scratch.
        dropout: share of the pooled values left out in training, in [0, 1); the thesis has 0.7.
        streams: which streams are trained; by default all four.
        actions: number of classes; the data's names go with the network; by default the 12 of Okutama-Action.
        size: side of the input, pixels; by default 64.
        flow: how flow is estimated; by default ``dis``.
        fused: one loss on the mean of the streams' probabilities trains them jointly; otherwise each has its own.
        rare_weight: exponent of the weight of rare actions, see `positive_weights`; 0 is eq. 5.1 as it stands.
        learning_rate: at the end of the warm-up; the thesis has 0.0001.
        optimisation: optimiser and schedule.
        network: any `ActionClassifier`, that of the stream ``rgb_local`` or of the one in ``streams``, or several by
            the names of their streams. They decide trunk, dropout, actions and size.

    Raises:
        RequestError: an argument contradicts the ``start`` or the ``network``, there is no such trunk, or the
            ``network`` is no `ActionClassifier`.
    """

    kind = "action"

    def __init__(
        self,
        start: str | Path | None = None,
        trunk: TrunkName | None = None,
        weights: Literal["imagenet"] | None = None,
        dropout: float = 0.7,
        streams: tuple[StreamName, ...] | None = None,
        actions: int | None = None,
        size: int | None = None,
        flow: FlowName | None = None,
        fused: bool = False,
        rare_weight: float = 0.5,
        learning_rate: float = 1e-4,
        optimisation: Optimisation = Optimisation(),  # noqa: B008
        network: nn.Module | dict[StreamName, nn.Module] | None = None,
    ) -> None:
        super().__init__()
        # A checkpoint holds plain values alone, so of a network that a command builds how, and no other.
        own, network = network, None
        self.save_hyperparameters()
        asked = {"trunk": trunk, "streams": streams, "actions": actions, "size": size, "flow": flow}
        self._folded: dict[StreamName, list[Normalisation]] = {}
        if own is None:
            self._build(asked, start, weights, dropout)
        else:
            decided = {"start": start, "weights": weights, "dropout": dropout, "trunk": trunk, "actions": actions}
            refuse_parts({**decided, "size": size}, {"dropout": 0.7})
            self._take(own, streams, flow)
        plain_hyperparameters(self)
        if fused and tuple(self.inputs) != STREAMS:
            raise RequestError(f"expected {', '.join(STREAMS)} with `fused`, got {', '.join(self.inputs)}")
        self.fused, self.rare_weight = fused, rare_weight
        self.learning_rate, self.optimisation = learning_rate, optimisation
        self.register_buffer("positive_weight", torch.ones(self.actions))
        # The layout that convolutions on a CPU are fastest with, twice for depthwise ones.
        self.network.to(memory_format=torch.channels_last)
        crops = {n: torch.zeros(1, i.size, i.size, i.channels, dtype=torch.uint8) for n, i in self.inputs.items()}
        self.example_input_array = (crops,)

    def _build(
        self, asked: dict[str, Any], start: str | Path | None, weights: Literal["imagenet"] | None, dropout: float
    ) -> None:
        """The streams that are asked for, with the weights of the ``start``."""
        if start is not None and weights is not None:
            raise RequestError("expected one of `start` and `weights`, got both")
        path, held, names = (None, None, None) if start is None else action_parts(start)
        parts = completed(asked, USUAL, held, path, ("trunk", "actions", "flow"))
        self.hparams.update(parts)
        self.actions, trunk = parts["actions"], parts["trunk"]
        try:
            self.inputs = {n: ActionInput(n, parts["size"], flow=parts["flow"]) for n in parts["streams"]}
            self.network = ActionNetwork(
                {n: ActionStream(self.actions, i.channels, trunk, weights, dropout) for n, i in self.inputs.items()}
            )
        except (ValueError, ConnectionError) as error:
            raise RequestError(str(error)) from error
        self.own_cards = dict.fromkeys(self.inputs, NetworkCard(trunk, parts["size"], parts["size"]))
        self._folded = {} if path is None else begin_streams(self.network, path)
        self.names = names or tuple(f"action {n + 1}" for n in range(self.actions))

    def _take(
        self,
        own: nn.Module | dict[StreamName, nn.Module],
        streams: tuple[StreamName, ...] | None,
        flow: FlowName | None,
    ) -> None:
        """The user's networks of streams, of which one by itself is that of the first stream."""
        networks: dict[Any, nn.Module] = own if isinstance(own, dict) else {(streams or STREAMS)[0]: own}
        if streams is not None and set(streams) != set(networks):
            raise RequestError(f"`streams`: expected those of the `network`, {', '.join(networks)}, got {streams}")
        try:
            channels = {name: ActionInput(name).channels for name in networks}
        except ValueError as error:
            raise RequestError(f"`network`: {error}") from error
        self.own_cards = {name: try_action(network, channels[name]) for name, network in networks.items()}
        first, *others = self.own_cards.values()
        for card in others:
            if (card.input_height, card.class_names) != (first.input_height, first.class_names):
                raise RequestError(
                    f"`network`: expected one size and the same actions of all streams, got {first.name} of "
                    f"{first.input_height} and {card.name} of {card.input_height} pixels, {len(first.class_names)} and "
                    f"{len(card.class_names)} actions"
                )
        self.inputs = {name: ActionInput(name, first.input_height, flow or USUAL["flow"]) for name in networks}
        self.names, self.actions = first.class_names, len(first.class_names)
        self.network = ActionNetwork(networks)
        self.bring(*networks.values())

    def card(self, stream: StreamName) -> ModelCard:
        """What the exported network of ``stream`` says of itself."""
        own, inputs = self.own_cards[stream], self.inputs[stream]
        card = inputs.card(own.name, self.names)
        return card if inputs.is_flow else replace(card, mean=own.mean, std=own.std)

    def forward(self, crops: dict[StreamName, Tensor]) -> dict[StreamName, Tensor]:
        """``(B, A)`` logits by stream of ``(B, S, S, C)`` uint8 crops."""
        return {n: self.network.streams[n](normalised(crops[n], self.card(n), self.dtype)) for n in self.inputs}

    def to_onnx(
        self, file_path: str | Path | BytesIO | None = None, input_sample: Any | None = None, **kwargs: Any
    ) -> torch.onnx.ONNXProgram | None:
        """As Lightning does; torch takes a dictionary that comes last for keywords, so an empty one follows."""
        crops: Any = self.example_input_array
        return super().to_onnx(file_path, (*crops, {}) if input_sample is None else input_sample, **kwargs)

    def on_fit_start(self) -> None:
        """Take the names of the actions and how rare they are from the data.

        Weights of exported files get their normalisations back; a training that goes on has all it needs.

        Raises:
            RequestError: the data have others, or more or fewer actions.
        """
        if self.trainer.ckpt_path is None:
            for name, norms in self._folded.items():
                crops = first_samples(self, _NORM_EXAMPLES, partial(_crops, name))
                unfold(self.network.streams[name], norms, normalised(crops.to(self.device), self.card(name)))
            if self._folded:
                self.network.train()
        self._folded = {}
        data = getattr(self.trainer, "datamodule", None)
        if not isinstance(data, ActionData):
            return
        if len(data.names) != self.actions:
            raise RequestError(
                f"expected clips with {self.actions} actions, got {len(data.names)}: {', '.join(data.names)}; "
                f"set model.actions to {len(data.names)}"
            )
        self.names = data.names
        truth = data.train_crops.actions
        counts = torch.from_numpy(truth.sum(axis=0).astype(np.float64))
        weight = positive_weights(counts, len(truth), self.rare_weight, RARE_LIMIT)
        assert isinstance(self.positive_weight, Tensor)
        self.positive_weight.copy_(weight)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Keep the names of the actions."""
        super().on_save_checkpoint(checkpoint)
        checkpoint["action_names"] = list(self.names)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Know the names of the actions again."""
        super().on_load_checkpoint(checkpoint)
        names = checkpoint.get("action_names")
        assert isinstance(names, list)
        self.names = tuple(names)

    def training_step(self, batch: ActionBatch, batch_index: int) -> Tensor:
        """The loss of the streams' mean on a batch, or the sum of their own losses."""
        del batch_index
        assert isinstance(self.positive_weight, Tensor)
        outputs = [logits.float() for logits in self(batch.crops).values()]
        parts = [fused_logits(outputs)] if self.fused else outputs
        losses = [action_loss(logits, batch.actions.float(), self.positive_weight) for logits in parts]
        loss = torch.stack(losses).sum()
        mean_loss = loss / len(losses)
        self.log("train/loss", mean_loss, on_step=False, on_epoch=True, prog_bar=True, batch_size=1, sync_dist=True)
        return loss

    def validation_step(self, batch: ActionBatch, batch_index: int) -> None:
        """Recognise a batch; the scores need all of them."""
        del batch_index
        outputs = {name: logits.float().sigmoid().cpu() for name, logits in self(batch.crops).items()}
        self.validated.append((outputs, batch.actions.float().cpu()))

    def predict_step(self, batch: ActionBatch, batch_index: int) -> FloatArray:
        """``(B, A)`` probabilities of what each person of a batch does, the mean over the streams."""
        del batch_index
        streams = [logits.double().sigmoid() for logits in self(batch.crops).values()]
        return np.asarray(torch.stack(streams).mean(dim=0).cpu().numpy())

    def export(
        self, out: str | Path, training_data: str = "", float16: bool = False, overwrite: bool = False
    ) -> dict[Path, float]:
        """Write the streams as ONNX, and check that they give what torch gives; as `Detector.export`.

        Args:
            out: ``action.onnx`` becomes ``action_rgb_local.onnx`` and so on, and ``action_fused.onnx`` of streams that
                were trained jointly.
            training_data: what it was trained on, in words; kept in the files.
            float16: store weights as 16-bit numbers, half the size.
            overwrite: replace existing files.

        Returns:
            Of each file the largest difference to torch, as a share of the range of an output.
        """
        return self.write(model_files(out, training_data, float16, overwrite))

    def write(self, output: ModelFiles) -> dict[Path, float]:
        """Write the streams, see `write_streams`."""
        return write_streams(self.network, self.inputs, self.card, self.fused, output)

    def scores(self, rows: list[tuple[dict[str, Tensor], Tensor]]) -> dict[str, float]:
        """The mAP of the average of all streams, and of each; nothing where no action occurs."""
        parts, actions = zip(*rows, strict=True)
        outputs = {name: torch.cat([part[name] for part in parts]).double() for name in self.inputs}
        mean = torch.stack([*outputs.values()]).mean(dim=0)
        scores = {}
        for name, probabilities in {"map": mean, **{f"map_{name}": outputs[name] for name in outputs}}.items():
            # The rows are those of all devices.
            metric = ActionPrecision(sync_on_compute=False)
            metric.update(probabilities, torch.cat(actions) > 0)
            scores[name] = metric.compute()["map"].item()
        return {name: value for name, value in scores.items() if not np.isnan(value)}


def action_parts(start: str | Path) -> tuple[Path, dict[str, Any], tuple[str, ...] | None]:
    """The file or the files' common name at ``start``, what its network is built of, and the names of its actions.

    Raises:
        RequestError: the file is missing or of another network.
    """
    path = Path(start)
    if path.suffix and path.suffix != ".onnx":
        held = read_checkpoint(path, "hyper_parameters")
        if not held.keys() >= USUAL.keys() or held["trunk"] is None:
            raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train action`, got one of another network")
        return path, {name: held[name] for name in USUAL}, None
    if not path.suffix and len(path.parts) == 1:
        shipped(f"action_{start}_{STREAMS[0]}")
        path = FOLDER / f"action_{start}.onnx"
    files = {name: path.with_name(f"{path.stem}_{name}.onnx") for name in STREAMS}
    streams = tuple(name for name, file in files.items() if file.is_file())
    if not streams:
        raise RequestError(f"`start`: expected exported streams such as {files[STREAMS[0]]}, found none")
    cards = [opened_onnx(files[name])[1] for name in streams]
    wrong = [card.kind for card in cards if card.kind != "action"]
    if wrong:
        raise RequestError(f"{files[streams[0]]}: expected an action network, got one of kind {wrong[0]!r}")
    first = cards[0]
    held = {"trunk": first.name, "streams": streams, "actions": len(first.class_names), "size": first.input_height}
    return path, {**held, "flow": first.settings["flow"]}, first.class_names


def begin_streams(network: ActionNetwork, path: Path) -> dict[StreamName, list[Normalisation]]:
    """Fill the streams with the weights at ``path``; their normalisations that are part of the layer before."""
    if path.suffix != ".onnx":
        begin_network(network, path, "action")
        return {}
    return {
        name: begin_network(stream, path.with_name(f"{path.stem}_{name}.onnx"), "action", "stream.")  # type: ignore[misc]
        for name, stream in network.streams.items()
    }


def _crops(name: StreamName, batch: ActionBatch) -> Tensor:
    return batch.crops[name]
