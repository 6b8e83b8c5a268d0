"""What a training of the association starts from: networks that were trained apart."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from torch import nn

from tsuiseki.models.association_network import AppearanceProjection
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.trainers.association.graphs import Graphs
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.exported_weights import fold_normalisations, layout_of
from tsuiseki.trainers.networks.appearance_training import AppearanceTraining
from tsuiseki.trainers.networks.detector_training import DetectorTraining


def siamese_of(checkpoint: Path) -> tuple[AppearanceTraining, dict[str, Any]]:
    """The Siamese network in a checkpoint or an exported file, and the arguments that it is made with.

    Raises:
        RequestError: the file is missing, or no such checkpoint or file.
    """
    if checkpoint.suffix == ".onnx":
        return _exported_siamese(checkpoint)
    siamese = load_module(AppearanceTraining, checkpoint)
    return siamese, {**_made_of(AppearanceTraining, checkpoint), "weights": None}


def projection_of(graphs: Sequence[Graphs], kept: int) -> AppearanceProjection:
    """A projection to ``kept`` numbers along the principal axes of what the detections of sequences look like.

    Raises:
        RequestError: nothing described them, or by fewer numbers.
    """
    described = [one.detections.features for one in graphs if one.detections.features is not None]
    rows = np.concatenate(described) if described else np.empty((0, 0))
    rows = rows[~np.isnan(rows).any(axis=1)]
    if not len(rows):
        raise RequestError(
            "expected --data.appearance ONNX with --model.appearance.projection, for features to project; got none"
        )
    if kept > rows.shape[1]:
        raise RequestError(
            f"expected --model.appearance.projection up to {rows.shape[1]}, the length of a feature, got {kept}"
        )
    projection = AppearanceProjection(rows.shape[1], kept)
    projection.start(torch.as_tensor(rows))
    return projection


def _exported_siamese(path: Path) -> tuple[AppearanceTraining, dict[str, Any]]:
    try:
        model = onnx.load(path)
        card = ModelCard.from_json({p.key: p.value for p in model.metadata_props}[METADATA_KEY])
        arrays = {x.name.removesuffix("_half"): onnx.numpy_helper.to_array(x) for x in model.graph.initializer}
        made_of: dict[str, Any] = {"trunk": card.name, "feature_length": card.feature_length}
        made_of |= {"height": card.input_height, "width": card.input_width}
        siamese = AppearanceTraining(**made_of)
        state = siamese.network.state_dict()
        for name, norm in siamese.network.named_modules():
            batch_norm = isinstance(norm, nn.BatchNorm1d | nn.BatchNorm2d) and norm.running_var is not None
            # It is part of the layer before: here it only adds a bias.
            if batch_norm and f"{name}.weight" not in arrays:
                norm.running_var.fill_(1 - norm.eps)
        for name, value in state.items():
            # A normalisation after a convolution or a matrix is part of it, and its shift lies there.
            folded = name.removesuffix(".bias")
            folded = f"{folded[:-1]}{int(folded[-1]) - 1}.weight_bias" if folded[-1:].isdigit() else ""
            found = arrays.get(name, arrays.get(folded))
            if found is not None:
                value.copy_(torch.tensor(found.T if found.shape == tuple(value.shape)[::-1] else found))
            elif name.endswith(("weight", "bias")) and value.ndim > 1:
                raise KeyError(name)
    except Exception as error:
        raise RequestError(f"{path}: expected an appearance network of `tsuiseki export appearance`") from error
    return siamese.eval(), made_of


def detector_of(path: Path) -> tuple[DetectorTraining, dict[str, Any]]:
    """The detector in a checkpoint or an exported file, and the arguments that it is made with; its heads learn.

    An exported file does not tell the loss it was trained by; it gets that of overlaps as scores, ``quality``.

    Raises:
        RequestError: the file is missing, no such checkpoint, or no detector of the default architecture.
    """
    if path.suffix != ".onnx":
        detector, made_of = load_module(DetectorTraining, path), _made_of(DetectorTraining, path)
        return heads_only(detector), {**made_of, "weights": None, "start": None, "teacher": {}}
    layout = layout_of(path)
    height, width = layout.size
    parts: dict[str, Any] = {
        "trunk": layout.trunk,
        "anchors": layout.anchors,
        "channels": layout.channels,
    }
    made_of = {**parts, "height": height, "width": width, "loss": "quality", "box_weight": 2.0}
    detector = DetectorTraining(**made_of, start=path)
    # Normalisations of an exported file are part of its convolutions: here they only add a bias.
    fold_normalisations(detector)
    return heads_only(detector), made_of


def heads_only(detector: DetectorTraining) -> DetectorTraining:
    """The detector, of which only the heads learn."""
    detector.requires_grad_(False)
    for heads in (detector.network.class_heads, detector.network.box_heads):
        heads.requires_grad_(True)
    return detector.eval()


def _made_of(kind: type, checkpoint: Path) -> dict[str, Any]:
    given = torch.load(checkpoint, map_location="cpu", weights_only=True)["hyper_parameters"]
    known = set(inspect.signature(kind.__init__).parameters)  # type: ignore[misc]
    return {name: value for name, value in given.items() if name in known}
