"""The network of a person detector: built as configured, filled with weights of another, or taught by another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import torch
from torch import Tensor

from tsuiseki.models.anchors import VARIANCES, size_iou
from tsuiseki.models.backbones import TrunkName, build_trunk
from tsuiseki.models.contract import NetworkCard
from tsuiseki.models.detector import AnchorDetector, BranchedDetector, branched_detector, people_detector
from tsuiseki.models.losses import SoftTargets, soft_targets
from tsuiseki.models.ssd import coco_start, ssd300, ssd512, ssdlite320
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.label_checks import PEOPLE
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.tracking.weights import shipped_or_file
from tsuiseki.trainers.exporting.exported_weights import (
    anchor_sizes,
    calibration_of,
    exported_weights,
    fold_normalisations,
    layout_of,
)
from tsuiseki.trainers.network_module import read_checkpoint
from tsuiseki.trainers.start import completed

Architecture = Literal["people", "branched", "ssdlite320", "ssd300", "ssd512"]
Resize = Literal["letterbox", "stretch"]
Normalisation = Literal["imagenet", "symmetric", "bytes"]
# Of each map the widths and heights of its anchors, pixels of the input.
Anchors: TypeAlias = list[list[tuple[float, float]]]

# Width and height of the input, pixels, of architectures that take no other.
FIXED_SIDES = {"ssdlite320": 320, "ssd300": 300, "ssd512": 512}
# Mean and standard deviation of the channels: of torchvision's classifiers, and of its two COCO detectors.
_NORMALISATIONS: dict[Normalisation, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "imagenet": ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)),
    "symmetric": ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5)),
    "bytes": ((0.48235, 0.45882, 0.40784), (1 / 255, 1 / 255, 1 / 255)),
}
COCO_NORMALISATIONS: dict[str, Normalisation] = {"ssdlite320": "symmetric", "ssd300": "bytes"}
_LAYOUT = ("architecture", "trunk", "anchors", "channels")
# Widths and heights of people in street views, in pixels of a 640x480 input, at strides 8, 16, 32 and 64.
STREET_ANCHORS: list[list[tuple[float, float]]] = [
    [(9.0, 22.0), (13.0, 32.0), (18.0, 46.0)],
    [(25.0, 64.0), (36.0, 92.0)],
    [(52.0, 132.0), (78.0, 190.0)],
    [(120.0, 280.0)],
]
# How the tensors of a branch begin.
OF_BRANCH = ("branch.", "halved.")
# Share of its tensors that a detector takes over from its start at least: heads for other anchors are a twentieth.
TAKEN_OVER = 0.9


def build_detector(
    architecture: Architecture,
    trunk: TrunkName,
    weights: Literal["imagenet", "coco"] | None,
    size: tuple[int, int],
    anchors: list[list[tuple[float, float]]],
    channels: int,
    classes: int = 1,
) -> AnchorDetector:
    """The detector of a number of classes that a configuration names.

    Raises:
        RequestError: the parts do not fit together, or weights cannot be downloaded.
    """
    side = FIXED_SIDES.get(architecture)
    if side is not None and size != (side, side):
        raise RequestError(f"{architecture} takes {side}x{side} images, got height {size[0]} and width {size[1]}")
    if weights == "coco" and architecture not in ("ssdlite320", "ssd300"):
        raise RequestError(f"weights coco exist for ssdlite320 and ssd300, not for {architecture}")
    if architecture == "branched" and (classes > 1 or weights is not None):
        raise RequestError(
            "a branched detector is of people alone and starts from one; expected one class, no `weights`"
        )
    if weights == "coco" and classes > 1:
        raise RequestError("weights coco start a detector of people alone; give `start` for other classes")
    try:
        if weights == "coco":
            return coco_start("ssd300" if architecture == "ssd300" else "ssdlite320")
        start: Literal["imagenet"] | None = "imagenet" if weights == "imagenet" else None
        # A type checker sees where an architecture has no case.
        match architecture:
            case "people":
                return people_detector(build_trunk(trunk, start), size, anchors, channels, classes)
            case "branched":
                return branched_detector(build_trunk(trunk), size, anchors, channels)
            case "ssdlite320":
                return ssdlite320(classes, trunk=None if start is None else build_trunk("mobilenet_v3_large", start))
            case "ssd300":
                return ssd300(classes, trunk=build_trunk("vgg16", start))
            case "ssd512":
                return ssd512(classes, trunk=build_trunk("vgg16", start))
    except (ValueError, ConnectionError) as error:
        raise RequestError(str(error)) from error


def take_over(
    network: AnchorDetector, checkpoint: Path, anchors: Anchors | None = None, branch: bool = True
) -> list[str]:
    """Fill ``network`` with the tensors of a detector's ``checkpoint`` that fit; names of those that it has not got.

    Every class of ``network`` starts as people, where the checkpoint is of them alone.

    Args:
        network: to fill.
        checkpoint: of a training, or a detector that was exported from one (``.onnx``).
        anchors: of the checkpoint; where the network of people has others, see `_widen_heads`.
        branch: take over that of a branched detector, too.

    Raises:
        RequestError: the file is missing or no checkpoint.
    """
    if checkpoint.suffix == ".onnx":
        weights = exported_weights(checkpoint)
    else:
        state = read_checkpoint(checkpoint, "state_dict")
        weights = {name.removeprefix("network."): value for name, value in state.items()}
    if not branch:
        weights = {name: value for name, value in weights.items() if not name.startswith(OF_BRANCH)}
    target = network.state_dict()
    if network.classes > 1:
        _suit_heads(weights, target, network.classes)
    elif anchors is not None:
        _widen_heads(weights, anchors, anchor_sizes(network.anchors.cpu().numpy()))
    fitting = {name: value for name, value in weights.items() if name in target and target[name].shape == value.shape}
    network.load_state_dict(fitting, strict=False)
    # Exported files hold no counts of batches.
    return [name for name in target if name not in fitting and not name.endswith("num_batches_tracked")]


def begin_network(network: AnchorDetector, path: Path) -> None:
    """Fill ``network`` with the weights of the detector at ``path``, and see that hardly any is missing.

    The network computes what the file does, where it has the file's anchors, and perhaps more at the same strides.

    Raises:
        RequestError: less than `TAKEN_OVER` of its tensors are taken over.
    """
    missing = take_over(network, path, _described(path, people=False)[0]["anchors"])
    count = sum(not name.endswith("num_batches_tracked") for name in network.state_dict())
    if count - len(missing) < TAKEN_OVER * count:
        raise RequestError(
            f"`start`: expected weights for {TAKEN_OVER:.0%} of the {count} tensors of this detector, got "
            f"{count - len(missing)} from {path}; leave out `trunk`, `channels` and `anchors`, then they are the file's"
        )
    if path.suffix == ".onnx":
        fold_normalisations(network)


def begin_branch(network: BranchedDetector, path: Path, anchors: list[list[tuple[float, float]]]) -> bool:
    """Fill ``network`` with the whole detector at ``path``: with its branch, too, where it has one like it.

    Args:
        network: to fill.
        path: checkpoint of a training, or a detector that was exported from one (``.onnx``).
        anchors: of ``network``, six maps.

    Returns:
        Whether the branch has weights from there, too.

    Raises:
        RequestError: it is no such detector, or has another trunk or other anchors than the first three maps.
    """
    layout, _, _ = _described(path, branched=True)
    anchors_of_file = [[tuple(size) for size in sizes] for sizes in layout["anchors"]]
    wanted = [[tuple(size) for size in sizes] for sizes in anchors]
    alike = anchors_of_file == wanted
    missing = take_over(network, path, branch=alike) if anchors_of_file[:3] == wanted[:3] else ["all"]
    if path.suffix == ".onnx":
        fold_normalisations(network)
    if not all(name.startswith(OF_BRANCH) for name in missing):
        raise RequestError(
            f"{path}: expected a `start` of the architecture people with the trunk of the branched detector and the "
            f"anchors of its first three maps, got trunk {layout['trunk']} and anchors {anchors_of_file}"
        )
    return alike and not missing


def _suit_heads(weights: dict[str, Tensor], target: dict[str, Tensor], classes: int) -> None:
    """Let each of the classes start as people, and each anchor that ``weights`` lack as one of those that they have."""
    for name in [n for n in weights if n.startswith("box_heads") and n in target and weights[n].ndim > 0]:
        kinds, count = name.replace("box", "class", 1), len(weights[name]) // 4
        scores, boxes = weights.get(kinds), weights[name]
        if scores is None or count == 0 or len(scores) not in (2 * count, (classes + 1) * count):
            continue
        rows = scores.view(count, -1, *scores.shape[1:])
        if len(scores) == 2 * count:
            rows = torch.cat((rows[:, :1], *[rows[:, 1:]] * classes), dim=1)
        order = torch.arange(len(target[name]) // 4) % count
        weights[kinds] = rows[order].flatten(0, 1)
        weights[name] = boxes.view(count, 4, *boxes.shape[1:])[order].flatten(0, 1)


def _widen_heads(weights: dict[str, Tensor], before: Anchors, after: Anchors) -> None:
    """Let the anchors ``after`` begin with scores and boxes that the most similar ones ``before`` have in ``weights``.

    Nothing changes where a map has no more anchors than before: the other training had other ones on purpose.
    """
    if len(before) != len(after):
        return
    for level, (old, new) in enumerate(zip(before, after, strict=True)):
        heads = [f"{kind}_heads.{level}.1" for kind in ("class", "box")]
        if len(new) <= len(old) or not all(f"{head}.weight" in weights for head in heads):
            continue
        origin = size_iou(np.array(new, dtype=np.float64), np.array(old, dtype=np.float64)).argmax(axis=1)
        ratio = torch.tensor(np.array(old)[origin] / np.array(new), dtype=torch.float32)
        for part in ("weight", "bias"):
            for head in heads:
                values = weights[f"{head}.{part}"]
                rows = values.view(len(old), -1, *values.shape[1:])[origin].clone()
                if head == heads[1]:
                    # The same box from an anchor of another size; see `encode`.
                    rows[:, :2] *= ratio.view(len(new), 2, *[1] * (rows.ndim - 2))
                    if part == "bias":
                        rows[:, 2:] += ratio.log() / VARIANCES[1]
                weights[f"{head}.{part}"] = rows.flatten(0, 1)


def detector_card(
    name: str,
    size: tuple[int, int],
    resize: Resize,
    normalisation: Normalisation,
    classes: Sequence[str] = (PEOPLE,),
) -> ModelCard:
    """What the exported detector will say about its input."""
    mean, std = _NORMALISATIONS[normalisation]
    return ModelCard(
        kind="detector",
        name=name,
        class_names=tuple(classes),
        input_height=size[0],
        input_width=size[1],
        resize=resize,
        mean=mean,
        std=std,
        settings={"variances": list(VARIANCES)},
    )


@dataclass(frozen=True)
class Teacher:
    """A detector that teaches another one beside the labels.

    Attributes:
        file: checkpoint or exported detector of the same anchors; null for no teacher.
        weight: of its part of the loss.
    """

    file: Path | None = None
    weight: float = 1.0


class SoftTeacher:
    """Soft targets of a detector that does not learn; no part of the student's checkpoint.

    Args:
        path: exported detector or checkpoint. Its input may have another size, where its network takes any.
        student: that is to learn; both must have the same anchors.
        card: of the student; both must take pictures normalised alike.

    Raises:
        RequestError: the file is missing or no detector, or does not fit the student.
    """

    def __init__(self, path: Path, student: AnchorDetector, card: ModelCard) -> None:
        path = shipped_or_file("detector", path)
        if not path.is_file():
            raise RequestError(f"expected a detector to teach at {path}, found none")
        layout, teacher, self.calibration = _described(path, branched=isinstance(student, BranchedDetector))
        if (teacher.mean, teacher.std) != (card.mean, card.std):
            raise RequestError(f"{path}: expected a teacher that takes pictures normalised as the student does")
        parts = layout["anchors"], layout["channels"]
        self.network = build_detector(layout["architecture"], layout["trunk"], None, student.size, *parts)
        anchors = self.network.anchors
        if anchors.shape != student.anchors.shape or not torch.allclose(anchors, student.anchors):
            raise RequestError(
                f"{path}: expected a teacher with the anchors of the student, got {layout['anchors']}; give these as "
                "model.anchors"
            )
        if take_over(self.network, path):
            raise RequestError(f"{path}: expected a whole detector to learn from, got weights of a part")
        if path.suffix == ".onnx":
            fold_normalisations(self.network)
        self.network.eval().requires_grad_(False).to(memory_format=torch.channels_last)

    def targets(self, images: Tensor) -> SoftTargets:
        """What the teacher detects in ``(B, 3, H, W)`` normalised images."""
        network = self.network.to(images.device)
        with torch.no_grad():
            return soft_targets(network, images, self.calibration)


# What a detector is built of without a start.
USUAL: dict[str, Any] = {
    "architecture": "people",
    "trunk": "mobilenet_v3_large",
    "anchors": STREET_ANCHORS,
    "channels": 96,
    "height": 384,
    "width": 512,
    "normalisation": "imagenet",
    "classes": [PEOPLE],
}


def detector_parts(
    asked: dict[str, Any], weights: Literal["imagenet", "coco"] | None, path: Path | None
) -> dict[str, Any]:
    """What a detector is built of, by the names of `USUAL`.

    Args:
        asked: parts that are asked for; None for those that the start or `USUAL` decides.
        weights: of torchvision.
        path: of the start: exported detector or checkpoint; None without one.

    Raises:
        RequestError: the file is missing or of another network, or a part contradicts it.
    """
    if path is None:
        norm = COCO_NORMALISATIONS.get(asked["architecture"] or "") if weights == "coco" else None
        usual = {**USUAL, "normalisation": norm or USUAL["normalisation"]}
        return completed(asked, usual, None, None, ())
    if weights is not None:
        raise RequestError("expected one of `start` and `weights`, got both")
    layout, card, _ = _described(path, people=False, branched=asked["architecture"] == "branched")
    norms = [name for name, values in _NORMALISATIONS.items() if values == (card.mean, card.std)]
    held = {**layout, "height": card.input_height, "width": card.input_width}
    held |= {"normalisation": next(iter(norms), None), "classes": list(card.class_names)}
    fixed = ["normalisation"]
    if asked["architecture"] == "branched":
        # Those of the branch are its own.
        if layout["architecture"] == "people":
            held["channels"] = USUAL["channels"]
    else:
        fixed += ["architecture", "trunk", "channels"]
    if len(card.class_names) > 1:
        fixed.append("classes")
    return completed(asked, USUAL, held, path, fixed)


def built(parts: dict[str, Any], weights: Literal["imagenet", "coco"] | None) -> AnchorDetector:
    """The network of `detector_parts`, see `build_detector`."""
    size, how = (parts["height"], parts["width"]), (parts["anchors"], parts["channels"], len(parts["classes"]))
    network = build_detector(parts["architecture"], parts["trunk"], weights, size, *how)
    card = card_of(parts)
    network.card = NetworkCard(**{field.name: getattr(card, field.name) for field in fields(NetworkCard)})
    return network


def resize_of(architecture: str) -> Resize:
    """How images are fitted into the input: those of a fixed square shape are stretched, as their authors do."""
    return "stretch" if architecture in FIXED_SIDES else "letterbox"


def card_of(parts: dict[str, Any]) -> ModelCard:
    """What the exported detector of `detector_parts` will say about itself."""
    kind = parts["architecture"]
    name = f"{kind}-{parts['trunk']}" if kind in ("people", "branched") else kind
    size = parts["height"], parts["width"]
    return detector_card(name, size, resize_of(kind), parts["normalisation"], parts["classes"])


def _described(
    path: Path, people: bool = True, branched: bool = False
) -> tuple[dict[str, Any], ModelCard, tuple[float, float]]:
    """Arguments that the network in a file is built with, what it says about itself, and its calibration.

    See `layout_of` for ``people`` and ``branched``.
    """
    if path.suffix == ".onnx":
        layout = layout_of(path, people, branched)
        return {name: getattr(layout, name) for name in _LAYOUT}, layout.card, calibration_of(layout.card)
    parameters = read_checkpoint(path, "hyper_parameters")
    if not parameters.keys() >= {*_LAYOUT, "height", "width", "normalisation"} or parameters["architecture"] is None:
        raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train detector`, got one of another network")
    size = parameters["height"], parameters["width"]
    classes = parameters.get("classes") or [PEOPLE]
    card = detector_card("", size, resize_of(parameters["architecture"]), parameters["normalisation"], classes)
    parts: dict[str, Any] = {name: parameters[name] for name in _LAYOUT}
    if parts["architecture"] == "branched" and not branched:
        parts |= {"architecture": "people", "anchors": parts["anchors"][:3], "channels": USUAL["channels"]}
    return parts, card, (1.0, 0.0)
