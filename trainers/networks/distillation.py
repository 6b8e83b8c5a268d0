"""A trained detector as the teacher of another one."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from tsuiseki.models.detector import Detector
from tsuiseki.models.distillation import SoftTargets, flip_averaged, found_by, mirrored_anchors
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import ModelCard
from tsuiseki.trainers.exporting.exported_weights import fold_normalisations, layout_of
from tsuiseki.trainers.networks.detector_network import build_detector, detector_card, take_over

_LAYOUT = ("architecture", "trunk", "anchors", "channels", "fine")


class Teacher:
    """Soft targets of a detector that does not learn; no part of the student's checkpoint.

    Args:
        path: exported detector or checkpoint. Its input may have another size, where its network takes any.
        student: that is to learn; both must have the same anchors.
        card: of the student; both must take pictures normalised alike.
        flips: average over the mirror image, too.

    Raises:
        RequestError: the file is missing or no detector, or does not fit the student.
    """

    def __init__(self, path: Path, student: Detector, card: ModelCard, flips: bool) -> None:
        if not path.is_file():
            raise RequestError(f"expected a detector to teach at {path}, found none")
        layout, own, self.calibration = _described(path)
        if (own.mean, own.std) != (card.mean, card.std):
            raise RequestError(f"{path}: expected a teacher that takes pictures normalised as the student does")
        self.network = build_detector(layout["architecture"], layout["trunk"], None, student.size, *_sizes(layout))
        anchors = self.network.anchors
        if anchors.shape != student.anchors.shape or not torch.allclose(anchors, student.anchors):
            raise RequestError(
                f"{path}: expected a teacher with the anchors of the student, got {layout['anchors']}; give these as "
                "model.anchors"
            )
        try:
            self._order = mirrored_anchors(anchors, student.size[1]) if flips else None
        except ValueError as error:
            raise RequestError(f"{path}: {error}") from error
        # Exported files hold no counts of batches.
        exported = path.suffix == ".onnx"
        wanted = [n for n in self.network.state_dict() if not (exported and n.endswith("num_batches_tracked"))]
        if take_over(self.network, path) < len(wanted):
            raise RequestError(f"{path}: expected a whole detector to learn from, got weights of a part")
        if exported:
            fold_normalisations(self.network)
        self.network.eval().requires_grad_(False).to(memory_format=torch.channels_last)

    def targets(self, images: Tensor) -> SoftTargets:
        """What the teacher finds in ``(B, 3, H, W)`` normalised images."""
        network = self.network.to(images.device)
        with torch.no_grad():
            if self._order is None:
                return found_by(network, images, self.calibration)
            return flip_averaged(network, images, self._order.to(images.device), self.calibration)


def _described(path: Path) -> tuple[dict[str, Any], ModelCard, tuple[float, float]]:
    """Arguments that the network in a file is built with, what it says about itself, and its calibration."""
    if path.suffix == ".onnx":
        layout = layout_of(path)
        parts = {"trunk": layout.trunk, "anchors": layout.anchors, "channels": layout.channels, "fine": layout.fine}
        scale, shift = layout.card.settings.get("score_calibration", (1.0, 0.0))
        return {"architecture": "people", **parts}, layout.card, (float(scale), float(shift))
    try:
        given = torch.load(path, map_location="cpu", weights_only=True)["hyper_parameters"]
        parts = {name: given[name] for name in _LAYOUT}
        card = detector_card("", (given["height"], given["width"]), given["resize"], given["normalisation"])
    except (RuntimeError, KeyError, TypeError, EOFError, pickle.UnpicklingError) as error:
        raise RequestError(f"{path}: expected a checkpoint of `tsuiseki train detector` to learn from") from error
    return parts, card, (1.0, 0.0)


def _sizes(layout: dict[str, Any]) -> tuple[list[list[tuple[float, float]]], int, bool]:
    return layout["anchors"], layout["channels"], layout["fine"]
