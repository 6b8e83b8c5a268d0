"""The association network as ONNX, with the names of its features, checked against torch."""

from __future__ import annotations

from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import onnx
import torch
from torch import nn

from tsuiseki.models.association import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import CostNetwork, FeatureNames
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association.training import PLANNED, PLANNED_STEPS, AssociationTraining
from tsuiseki.trainers.exporting.export import convert_module, export_onnx, load_module
from tsuiseki.trainers.exporting.export_detector import OUTPUTS as DETECTOR_OUTPUTS
from tsuiseki.trainers.exporting.export_detector import RawHeads
from tsuiseki.trainers.networks.detector import DetectorTraining

# Costs, absolute: float32 sums in another order differ by about 1e-6 of a cost of up to 8.
TOLERANCE = 1e-4
INPUTS = ("links", "detections", "joins")
OUTPUTS = ("link_changes", "detection_changes", "join_changes")
# The fourth of each, where appearance is projected.
APPEARANCE, PROJECTED = "appearance", "projected"


def export_trained(
    checkpoint: Path,
    out: Path,
    appearance: Path | None = None,
    detector: Path | None = None,
    training_data: str = "",
    unfinished: bool = False,
    overwrite: bool = False,
) -> float:
    """Write the network of a checkpoint as ONNX, for --affinity, and check that it gives the costs that torch gives.

    Args:
        checkpoint: of `tsuiseki train association`.
        out: the file to write.
        appearance: file for the Siamese network that was trained with it, for --appearance.
        detector: file for the detector whose heads were trained with it, for --detector.
        training_data: what it was trained on, in words; kept in the file.
        unfinished: take a training that has not had all its epochs as it is.
        overwrite: replace an existing file.

    Returns:
        The largest difference of a cost to torch that the parity check saw.

    Raises:
        RequestError: a missing or foreign file, a training that has not taken a step or has not ended, or one without
            the network that is asked for.
    """
    module = load_module(AssociationTraining, checkpoint)
    _check_ended(checkpoint, unfinished)
    network = module.network
    if not any(part.linear.weight.any() for part in (network.links, network.detections, network.joins)):
        raise RequestError(f"{checkpoint}: expected a trained network, but it changes no cost; go on with the training")
    if appearance is not None:
        _export_siamese(module, checkpoint, appearance, training_data, overwrite)
    if detector is not None:
        _export_heads(module, checkpoint, detector, training_data, overwrite)
    worst = export_association(network, out, training_data, overwrite=overwrite)
    print(f"{out}: no cost differs from torch's by more than {worst:.1g}")
    return worst


def _check_ended(checkpoint: Path, unfinished: bool) -> None:
    """Refuse a training that has had fewer epochs, and steps, than it was to have; or tell of it."""
    last = checkpoint.with_name("last.ckpt")
    path = last if last.is_file() else checkpoint
    held = torch.load(path, map_location="cpu", weights_only=True)
    done, epochs, steps = held["epoch"] + 1, held.get(PLANNED, -1), held.get(PLANNED_STEPS, -1)
    if done >= epochs or 0 < steps <= held["global_step"]:
        return
    had = f"that has had {done} of {epochs} epochs"
    if not unfinished:
        raise RequestError(
            f"{checkpoint}: expected a training that has ended, got one {had}; go on with --ckpt_path {path}, or take "
            "it as it is with `unfinished`"
        )
    print(f"{checkpoint}: of a training {had}; --ckpt_path goes on with it")


def _export_siamese(module: AssociationTraining, checkpoint: Path, out: Path, data: str, overwrite: bool) -> None:
    siamese = module.siamese
    if siamese is None:
        raise RequestError(f"{checkpoint}: expected a Siamese network, but the training had no --model.appearance.file")
    network = siamese.network.to(memory_format=torch.contiguous_format)
    example = torch.zeros(2, 3, siamese.card.input_height, siamese.card.input_width)
    card = replace(siamese.card, training_data=data)
    export_onnx(network, card, out, example, ("features",), overwrite=overwrite)
    print(f"{out}: the Siamese network")


def _export_heads(module: AssociationTraining, checkpoint: Path, out: Path, data: str, overwrite: bool) -> None:
    if module.detector is None:
        raise RequestError(f"{checkpoint}: expected a detector, but the training had no --model.detector.file")
    export_heads(module.detector, out, data, overwrite)
    print(f"{out}: the detector")


def export_heads(detector: DetectorTraining, out: Path, data: str = "", overwrite: bool = False) -> float:
    """Write a detector whose heads were trained on; its scores are as they come, not calibrated again.

    Returns:
        The largest relative difference to torch.
    """
    card = replace(detector.card, training_data=data)
    network = detector.network.to(memory_format=torch.contiguous_format)
    example = torch.zeros(2, 3, card.input_height, card.input_width)
    return export_onnx(RawHeads(network), card, out, example, DETECTOR_OUTPUTS, overwrite=overwrite)


def export_association(
    network: AssociationNetwork, path: Path, training_data: str = "", name: str = "perceptron", overwrite: bool = False
) -> float:
    """Write the network as ``path``, once it gives what torch gives.

    The graph maps ``links`` ``(P, 25)``, ``detections`` ``(N, 15)`` and ``joins`` ``(J, 29)`` to changes of costs
    ``(P,)``, ``(N, 3)`` and ``(J,)``, all float32; any of P, N and J may be 0. A network that projects appearance maps
    ``appearance`` ``(A, D)`` to ``projected`` ``(A, d)``, too.

    Returns:
        The largest difference to torch, in costs.

    Raises:
        RequestError: the path cannot be written to.
        RunError: onnxruntime and torch disagree.
    """
    card = ModelCard(
        kind="association",
        name=name,
        layout="NF",
        feature_length=0 if network.projection is None else network.projection.matrix.shape[1],
        settings={part: list(names) for part, names in asdict(FeatureNames()).items()},
        training_data=training_data,
        project_version=version("tsuiseki"),
    )
    network.eval()
    with output_file(path, overwrite) as work:
        work.parent.mkdir(parents=True, exist_ok=True)
        model = _converted(network)
        entry = model.metadata_props.add()
        entry.key, entry.value = METADATA_KEY, card.to_json()
        onnx.save(model, work)
        return check_parity(network, work)


def check_parity(network: AssociationNetwork, path: Path) -> float:
    """The largest difference of a cost between the network and the file, on single rows, on many and on none.

    Raises:
        RunError: it is larger than `TOLERANCE`.
    """
    model, rng, worst = CostNetwork(path, threads=1), np.random.default_rng(0), 0.0
    for count in (0, 1, 500):
        for part in INPUTS:
            change = getattr(network, part)
            rows = rng.normal(0, 3, (count, len(change.mean))) * change.deviation.numpy() + change.mean.numpy()
            worst = max(worst, _differing(change, getattr(model, part)(rows), rows, f"changes of {part}"))
        if network.projection is not None:
            rows = rng.normal(size=(count, network.projection.matrix.shape[1]))
            worst = max(worst, _differing(network.projection, model.project(rows), rows, "projected numbers"))
    if not worst <= TOLERANCE:
        raise RunError(f"parity check failed: a cost differs by {worst:.2g} from torch, expected {TOLERANCE:g} at most")
    return worst


def _differing(part: nn.Module, got: FloatArray, rows: FloatArray, what: str) -> float:
    with torch.no_grad():
        expected = part(torch.as_tensor(rows, dtype=torch.float32)).numpy()
    if got.size != expected.size:
        raise RunError(f"parity check failed: expected {expected.size} {what}, got {got.size}")
    return float(np.abs(got.ravel() - expected.ravel()).max(initial=0.0))


def _converted(network: AssociationNetwork) -> onnx.ModelProto:
    sizes = {part: len(getattr(network, part).mean) for part in INPUTS}
    outputs: tuple[str, ...] = OUTPUTS
    if network.projection is not None:
        sizes[APPEARANCE], outputs = network.projection.matrix.shape[1], (*OUTPUTS, PROJECTED)
    # Of appearance no row of zeros, which has no direction.
    examples = tuple(torch.ones(3 + k, size) for k, size in enumerate(sizes.values()))
    rows = tuple({0: torch.export.Dim(f"{part}_rows", min=0)} for part in sizes)
    return convert_module(network, examples, tuple(sizes), outputs, rows)
