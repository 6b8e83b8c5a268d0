"""Layout and weights back out of an exported detector, so that training can go on where only the shipped file is left.

The exporter folds every batch normalisation into the convolution before it. Here the normalisation comes back as one
that changes nothing, and takes its mean and deviation from pictures, so that the network computes what it did before
and further training has normalisations to work with.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard

_PREFIX = "detector."
Normalisation: TypeAlias = nn.BatchNorm1d | nn.BatchNorm2d


@dataclass(frozen=True)
class ExportedLayout:
    """What a network must be to take over the weights of an exported detector.

    Attributes:
        architecture: people or branched.
        trunk: its name.
        size: height and width of the input.
        anchors: ``[width, height]`` of each map; those of a branch last.
        channels: of the top-down path, or of that of the branch.
        card: what the file says about itself.
    """

    architecture: Literal["people", "branched"]
    trunk: str
    size: tuple[int, int]
    anchors: list[list[tuple[float, float]]]
    channels: int
    card: ModelCard

    @property
    def arguments(self) -> dict[str, Any]:
        """What `Detector` makes such a network of."""
        parts = {"architecture": self.architecture, "trunk": self.trunk, "anchors": self.anchors}
        return {**parts, "channels": self.channels, "height": self.size[0], "width": self.size[1]}


def layout_of(path: Path, people: bool = True, branched: bool = False) -> ExportedLayout:
    """The layout of the exported detector at ``path``.

    Args:
        path: of the file.
        people: it must be of one class.
        branched: with the branch where the file has one. Without, the branch is left out.

    Raises:
        RequestError: it is no such detector of this toolkit's default architecture.
    """
    model, card = opened_onnx(path)
    tensors = {x.name: x for x in model.graph.initializer}
    kind, _, trunk = card.name.partition("-")
    if kind not in ("people", "branched"):
        raise RequestError(f"{path}: expected a detector of the architecture people, got {card.name}")
    if people and len(card.class_names) > 1:
        raise RequestError(f"{path}: expected a detector of people alone, got one of {', '.join(card.class_names)}")
    if "anchors" not in tensors:
        raise RequestError(f"{path}: expected a detector of `tsuiseki export detector`, got one without anchors")
    anchors = onnx.numpy_helper.to_array(tensors["anchors"])
    parts = np.split(anchors, [_first_of_branch(anchors)]) if kind == "branched" else [anchors]
    branched = branched and kind == "branched"
    features = "detector.branch.features" if branched else "detector.features"
    lateral = next(x for name, x in tensors.items() if name.startswith(f"{features}.lateral.0.0.weight"))
    return ExportedLayout(
        "branched" if branched else "people",
        trunk,
        (card.input_height, card.input_width),
        [sizes for part in parts[: 2 if branched else 1] for sizes in anchor_sizes(part)],
        int(lateral.dims[0]),
        card,
    )


def _first_of_branch(anchors: NDArray[np.float32]) -> int:
    """Which of ``(A, 4)`` anchors is the first of the branch: that of the fourth of six maps, each from the top on."""
    return int(np.flatnonzero(anchors[1:, 1] < anchors[:-1, 1])[2]) + 1


def anchor_sizes(anchors: np.ndarray) -> list[list[tuple[float, float]]]:
    """The sizes of ``(A, 4)`` anchors at each map, distinguished by where the first cell of a map lies."""
    sizes: dict[float, list[tuple[float, float]]] = {}
    shapes = set()
    for x, _, width, height in anchors.tolist():
        if (width, height) not in shapes:
            shapes.add((width, height))
            sizes.setdefault(x, []).append((width, height))
    return [sizes[x] for x in sorted(sizes)]


def exported_weights(path: Path) -> dict[str, Tensor]:
    """State of the network inside the exported detector at ``path``, the calibration of its scores folded into it.

    Raises:
        RequestError: the file is no detector that `tsuiseki export detector` wrote.
    """
    model, card = opened_onnx(path)
    tensors = {
        x.name.removesuffix("_half").removeprefix(_PREFIX): torch.tensor(onnx.numpy_helper.to_array(x)).float()
        for x in model.graph.initializer
        if x.name.startswith(_PREFIX)
    }
    weights: dict[str, Tensor] = {}
    for name, value in tensors.items():
        if name.endswith(".0.weight_bias"):
            norm = name.removesuffix("0.weight_bias") + "1."
            weights |= {norm + "bias": value, norm + "weight": torch.ones_like(value)}
            weights |= {norm + "running_mean": torch.zeros_like(value), norm + "running_var": torch.ones_like(value)}
        else:
            weights[name] = value
    scale, shift = card.settings.get("score_calibration", (1.0, 0.0))
    calibrate(weights, scale, shift, len(card.class_names))
    return weights


def calibrate(weights: Mapping[str, Tensor], scale: float, shift: float, classes: int) -> None:
    """Multiply the logits of the classes by ``scale`` and add ``shift``, in place in a detector's state."""
    for name in [n for n in weights if re.fullmatch(r"(branch\.)?class_heads\.\d+\.1\.bias", n)]:
        weights[name.replace("bias", "weight")].mul_(scale)
        moved = torch.tensor([0.0] + [shift] * classes)
        weights[name].copy_((weights[name].view(-1, len(moved)) * scale + moved).flatten())


def opened_onnx(path: Path) -> tuple[onnx.ModelProto, ModelCard]:
    """The model in an exported file, and what it says about itself.

    Raises:
        RequestError: the file is missing, or no such model.
    """
    if not path.is_file():
        raise RequestError(f"expected an exported network at {path}, found none")
    try:
        model = onnx.load(path)
        return model, ModelCard.from_json({p.key: p.value for p in model.metadata_props}[METADATA_KEY])
    except Exception as error:
        raise RequestError(f"{path}: expected a network of `tsuiseki export`, got another file") from error


def calibration_of(card: ModelCard) -> tuple[float, float]:
    """Scale and shift by which the scores of an exported detector were calibrated; of people, beside a branch."""
    scale, shift = card.settings.get("score_calibration", card.settings.get("people_calibration", (1.0, 0.0)))
    return float(scale), float(shift)


def fold_normalisations(network: nn.Module) -> None:
    """Let the normalisations of ``network``, which holds `exported_weights`, change nothing beyond their bias."""
    for norm in network.modules():
        if isinstance(norm, nn.BatchNorm2d) and norm.running_var is not None:
            norm.running_var.fill_(1 - norm.eps)


def fill_network(network: nn.Module, arrays: Mapping[str, NDArray[Any]]) -> list[Normalisation]:
    """Fill ``network`` with the weights of an exported file; it then computes what the file does.

    Args:
        network: to fill; its tensors are called as those of the file.
        arrays: of the file, see `arrays_of`.

    Returns:
        Its normalisations that are part of the layer before in the file: here they only add a bias.

    Raises:
        ValueError: the file lacks weights, or has some of another shape.
    """
    folded = list[Normalisation]()
    for name, norm in network.named_modules():
        if isinstance(norm, Normalisation) and norm.running_var is not None and f"{name}.weight" not in arrays:
            norm.running_var.fill_(1 - norm.eps)
            folded.append(norm)
    for name, value in network.state_dict().items():
        # A normalisation after a convolution or a matrix is part of it, and its shift lies there.
        norm_name = re.fullmatch(r"(.*)\b(bn)?(\d+)\.bias", name)
        before = "" if norm_name is None else norm_name[1]
        if norm_name is not None:
            before += f"conv{norm_name[3]}" if norm_name[2] else str(int(norm_name[3]) - 1)
        values = arrays.get(name, arrays.get(f"{before}.weight_bias"))
        if values is not None:
            values = values.T if values.shape == tuple(value.shape)[::-1] else values
            if values.shape != tuple(value.shape):
                raise ValueError(f"expected {name} of shape {tuple(value.shape)}, got {values.shape}")
            value.copy_(torch.tensor(values))
        elif name.endswith(("weight", "bias")) and value.ndim > 1:
            raise ValueError(f"expected {name}, got none")
    return folded


def arrays_of(model: onnx.ModelProto, prefix: str = "") -> dict[str, NDArray[Any]]:
    """The tensors of an exported file whose names begin with ``prefix``, by the rest of the name."""
    return {
        tensor.name.removesuffix("_half").removeprefix(prefix): onnx.numpy_helper.to_array(tensor)
        for tensor in model.graph.initializer
        if tensor.name.startswith(prefix)
    }


def restore_normalisations(network: nn.Module, images: Tensor) -> None:
    """Give the normalisations of ``network`` the statistics of ``images`` ``(B, 3, H, W)``.

    Its outputs stay as they are. Only for weights of `exported_weights`, whose normalisations do nothing but add a
    bias.
    """
    fold_normalisations(network)
    unfold(network, [norm for norm in network.modules() if isinstance(norm, nn.BatchNorm2d)], images)


def unfold(network: nn.Module, norms: Collection[Normalisation], *images: Tensor) -> None:
    """Give ``norms``, which do nothing but add a bias, the statistics of ``images`` ``(B, 3, H, W)``, all its inputs.

    The outputs of the ``network`` that they are part of stay as they are.
    """
    measured: dict[Normalisation, tuple[Tensor, Tensor]] = {}

    def measure(norm: nn.Module, inputs: tuple[Any, ...]) -> None:
        assert isinstance(norm, Normalisation)
        axes = [axis for axis in range(inputs[0].ndim) if axis != 1]
        variance, mean = torch.var_mean(inputs[0], dim=axes)
        measured[norm] = mean, variance

    hooks = [norm.register_forward_pre_hook(measure) for norm in norms]
    with torch.no_grad():
        network.eval()(*images)
        for hook in hooks:
            hook.remove()
        for norm, (mean, variance) in measured.items():
            assert norm.running_mean is not None
            assert norm.running_var is not None
            norm.running_mean.copy_(mean)
            norm.running_var.copy_(variance)
            norm.bias.add_(norm.weight * mean)
            norm.weight.mul_((variance + norm.eps).sqrt())
