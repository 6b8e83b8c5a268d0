"""`tsuiseki export detector|appearance`: which network of a checkpoint goes into the ONNX file."""

from __future__ import annotations

import dataclasses
import pickle
from pathlib import Path
from typing import Literal, TypeVar

import lightning
import torch
from torch import Tensor, nn

from tsuiseki.models.detector import Detector, OneClass
from tsuiseki.models.pretrained import coco_person_detector
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.detector import DetectorTraining, detector_card
from tsuiseki.trainers.export import export_onnx

CocoArchitecture = Literal["ssdlite320", "ssd300"]
Module = TypeVar("Module", bound=lightning.LightningModule)
_COCO_SIDES = {"ssdlite320": 320, "ssd300": 300}


class RawHeads(nn.Module):
    """A detector with its anchors as a third output, as the exported file has it."""

    def __init__(self, detector: Detector | OneClass) -> None:
        super().__init__()
        self.detector = detector

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``(B, 3, H, W)`` to logits ``(B, A, 2)``, offsets ``(B, A, 4)`` and anchors ``(A, 4)``."""
        logits, offsets = self.detector(images)
        return logits, offsets, self.detector.anchors


def export_detector(
    checkpoint: Path | None,
    weights: Literal["coco"] | None,
    architecture: CocoArchitecture,
    out: Path,
    training_data: str = "",
    float16: bool = False,
    overwrite: bool = False,
    state: Path | None = None,
) -> float:
    """Write a trained detector, or torchvision's COCO-trained one reduced to people, as ONNX.

    Args:
        checkpoint: of `tsuiseki train detector`; or None with ``weights``.
        weights: ``coco``; or None with ``checkpoint``.
        architecture: of the COCO weights.
        out: the file to write.
        training_data: for the card, in words.
        float16: store weights as float16.
        overwrite: replace an existing file.
        state: file of torchvision's state dict, for a machine that cannot download it.

    Returns:
        The largest relative difference to torch that the parity check saw.

    Raises:
        RequestError: not exactly one of checkpoint and weights, a missing or foreign file, no connection.
        RunError: the exported file does not give what torch gives.
    """
    if (checkpoint is None) == (weights is None):
        raise RequestError("expected either --checkpoint FILE or --weights coco")
    if checkpoint is not None:
        module = load_module(DetectorTraining, checkpoint)
        network, card = module.network, module.card
    else:
        network, card = _coco(architecture, state)
        training_data = training_data or "COCO 2017, torchvision's weights"
    card = dataclasses.replace(card, training_data=training_data)
    network.to(memory_format=torch.contiguous_format)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    outputs = ("logits", "offsets", "anchors")
    return export_onnx(RawHeads(network), card, out, example, outputs, float16, overwrite)


def load_module(kind: type[Module], checkpoint: Path) -> Module:
    """The LightningModule in ``checkpoint``; nothing but tensors and plain values is unpickled.

    Raises:
        RequestError: the file is missing, no checkpoint, or of another module.
    """
    if not checkpoint.is_file():
        raise RequestError(f"expected a checkpoint at {checkpoint}, found none; `tsuiseki train` writes best.ckpt")
    try:
        module = kind.load_from_checkpoint(checkpoint, map_location="cpu", weights_only=True)
    except (RuntimeError, KeyError, TypeError, AttributeError, EOFError, pickle.UnpicklingError) as error:
        reason = " ".join(str(error).split())[:200]
        raise RequestError(f"{checkpoint}: expected a checkpoint of {kind.__name__}, got: {reason}") from error
    return module.eval()


def _coco(architecture: CocoArchitecture, state: Path | None) -> tuple[OneClass, ModelCard]:
    if state is not None and not state.is_file():
        raise RequestError(f"expected a state dict at {state}, found none")
    try:
        network = coco_person_detector(architecture, state)
    except (ConnectionError, ValueError, pickle.UnpicklingError) as error:
        raise RequestError(str(error)) from error
    side = _COCO_SIDES[architecture]
    return network.eval(), detector_card(architecture, f"{architecture}-coco", (side, side), "stretch")
