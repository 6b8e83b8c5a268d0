"""Learnt costs of the flow as ONNX: networks over whole tracks, and boosted trees over pairs of detections."""

from __future__ import annotations

import warnings
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from skl2onnx import to_onnx
from skl2onnx.common.data_types import FloatTensorType
from sklearn.ensemble import HistGradientBoostingClassifier
from threadpoolctl import threadpool_limits

from tsuiseki.models.association import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import CostNetwork, FeatureNames
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.association import PLANNED, PLANNED_STEPS, Association
from tsuiseki.trainers.exporting.export import ModelFile, convert_module, load_module, write_checked
from tsuiseki.trainers.exporting.export_networks import write_appearance, write_heads

# Largest difference of costs and probabilities to torch, absolute: float32 sums in another order differ by about 1e-6
# of a cost of up to 8.
TOLERANCE = 1e-4
# Share of rows that may lie on a threshold of a tree, where rounding decides.
ON_A_THRESHOLD = 1e-3
# Version of the ONNX operators that the trees are written with.
OPSET = 18
# Probabilities nearer to 0 and 1 count as this, so that their logit is finite.
NEAR_CERTAIN = 1e-6
# Names of the file's inputs.
INPUTS = ("links", "detections", "joins")
# Names of the file's outputs.
OUTPUTS = ("link_changes", "detection_changes", "join_changes")


def export_trained(
    *,
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
    module = load_module(Association, checkpoint)
    _check_ended(checkpoint, unfinished)
    network = module.network
    if not any(part.linear.weight.any() for part in (network.links, network.detections, network.joins)):
        raise RequestError(f"{checkpoint}: expected a trained network, but it changes no cost; go on with the training")
    if appearance is not None:
        if module.siamese is None:
            raise RequestError(
                f"{checkpoint}: expected a Siamese network, but the training had no --model.appearance.file"
            )
        file = ModelFile(out=appearance, training_data=training_data, overwrite=overwrite)
        write_appearance(module.siamese, file)
        print(f"{appearance}: the Siamese network")
    if detector is not None:
        if module.detector is None:
            raise RequestError(f"{checkpoint}: expected a detector, but the training had no --model.detector.file")
        # Their scores are as they come, not calibrated again.
        card = replace(module.detector.card, training_data=training_data)
        write_heads(module.detector.network, card, ModelFile(out=detector, overwrite=overwrite))
        print(f"{detector}: the detector")
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


def export_association(
    network: AssociationNetwork, path: Path, training_data: str = "", overwrite: bool = False
) -> float:
    """Write the network as ``path``, once it gives what torch gives.

    The graph maps ``links`` ``(P, 25)``, ``detections`` ``(N, 15)`` and ``joins`` ``(J, 29)`` to changes of costs
    ``(P,)``, ``(N, 3)`` and ``(J,)``, all float32; any of P, N and J may be 0.

    Returns:
        The largest difference to torch, in costs.

    Raises:
        RequestError: the path cannot be written to.
        RunError: onnxruntime and torch disagree.
    """
    card = ModelCard(
        kind="association",
        name="perceptron",
        layout="NF",
        settings={part: list(names) for part, names in asdict(FeatureNames()).items()},
        training_data=training_data,
    )
    network.eval()
    examples = tuple(torch.ones(3 + k, len(getattr(network, part).mean)) for k, part in enumerate(INPUTS))
    rows = tuple({0: torch.export.Dim(f"{part}_rows", min=0)} for part in INPUTS)
    model = convert_module(network, examples, INPUTS, OUTPUTS, rows)
    return write_checked(model, card, path, lambda work: network_parity(network, work), overwrite)


def network_parity(network: AssociationNetwork, path: Path) -> float:
    """The largest difference of a cost between the network and the file, on single rows, on many and on none.

    Raises:
        RunError: it is larger than `TOLERANCE`.
    """
    model, rng, worst = CostNetwork(path, threads=1), np.random.default_rng(0), 0.0
    for count in (0, 1, 500):
        for part in INPUTS:
            change = getattr(network, part)
            rows = rng.normal(0, 3, (count, len(change.mean))) * change.deviation.numpy() + change.mean.numpy()
            with torch.no_grad():
                expected = change(torch.as_tensor(rows, dtype=torch.float32)).numpy()
            got = getattr(model, part)(rows)
            if got.size != expected.size:
                raise RunError(f"parity check failed: expected {expected.size} changes of {part}, got {got.size}")
            worst = max(worst, float(np.abs(got.ravel() - expected.ravel()).max(initial=0.0)))
    if not worst <= TOLERANCE:
        raise RunError(f"parity check failed: a cost differs by {worst:.2g} from torch, expected {TOLERANCE:g} at most")
    return worst


def export_affinity(
    trees: HistGradientBoostingClassifier,
    calibration: tuple[float, float],
    card: ModelCard,
    path: Path,
    example: FloatArray,
    overwrite: bool = False,
) -> None:
    """Write the trees and their calibration as ``path``, checked against scikit-learn.

    The graph maps ``features`` ``(N, F)`` float32 to ``probability`` ``(N,)`` float32.

    Args:
        trees: fitted.
        calibration: scale and shift of the trees' logit.
        card: what goes into the metadata.
        path: of the file.
        example: ``(N, F)`` rows to check on.
        overwrite: replace an existing file.

    Raises:
        RequestError: the path cannot be written to.
        RunError: the exported model answers otherwise than the trees.
    """
    with warnings.catch_warnings():
        # skl2onnx hands onnx booleans for integers, which onnx says it will refuse one day.
        warnings.simplefilter("ignore", DeprecationWarning)
        model = to_onnx(
            trees,
            initial_types=[("features", FloatTensorType([None, example.shape[1]]))],
            options={"zipmap": False},
            target_opset={"": OPSET, "ai.onnx.ml": 3},
        )
    _calibrate(model.graph, calibration)
    onnx.checker.check_model(model)
    write_checked(model, card, path, lambda work: trees_parity(trees, calibration, work, example), overwrite)


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def trees_parity(
    trees: HistGradientBoostingClassifier, calibration: tuple[float, float], path: Path, example: FloatArray
) -> float:
    """The largest difference of a probability to scikit-learn's, on single rows and on many, unknown values included.

    Raises:
        RunError: they differ.
    """
    model = OnnxModel(path, "affinity", threads=1)
    rng = np.random.default_rng(0)
    rows = example[rng.permutation(len(example))[:4096]].astype(np.float32)
    unknown = rows.copy()
    unknown[:, 1] = np.nan
    worst = 0.0
    for batch in (rows, unknown, rows[:1]):
        scale, shift = calibration
        logits = np.clip(trees.decision_function(batch.astype(np.float64)), *np.log([1e-6, 1e6]))
        expected = 1 / (1 + np.exp(-(scale * logits + shift)))
        got = model.run(batch)[0]
        if got.shape != expected.shape:
            raise RunError(f"parity check failed: expected probabilities of shape {expected.shape}, got {got.shape}")
        difference = np.abs(got - expected)
        wrong, worst = difference > TOLERANCE, max(worst, float(difference.max()))
        if wrong.mean() > ON_A_THRESHOLD:
            raise RunError(
                f"parity check failed: {wrong.sum()} of {len(wrong)} probabilities differ from scikit-learn's by over "
                f"{TOLERANCE:g}, the worst by {difference.max():.3g}; check the versions of skl2onnx and "
                "onnxruntime"
            )
    return worst


def _calibrate(graph: onnx.GraphProto, calibration: tuple[float, float]) -> None:
    """Replace the outputs by sigmoid(scale * logit(P(same)) + shift)."""
    scores = next(output.name for output in graph.output if "probabilit" in output.name)
    constants: dict[str, NDArray[Any]] = {
        "column": np.array(1, dtype=np.int64),
        "least": np.array(NEAR_CERTAIN, dtype=np.float32),
        "most": np.array(1 - NEAR_CERTAIN, dtype=np.float32),
        "one": np.array(1, dtype=np.float32),
        "scale": np.array(calibration[0], dtype=np.float32),
        "shift": np.array(calibration[1], dtype=np.float32),
    }
    graph.initializer.extend(numpy_helper.from_array(value, name) for name, value in constants.items())
    steps = (
        ("Gather", (scores, "column"), "same"),
        ("Clip", ("same", "least", "most"), "within"),
        ("Sub", ("one", "within"), "other"),
        ("Div", ("within", "other"), "odds"),
        ("Log", ("odds",), "logit"),
        ("Mul", ("logit", "scale"), "scaled"),
        ("Add", ("scaled", "shift"), "calibrated"),
        ("Sigmoid", ("calibrated",), "probability"),
    )
    for operator, inputs, output in steps:
        node = helper.make_node(operator, list(inputs), [output])
        if operator == "Gather":
            node.attribute.append(helper.make_attribute("axis", 1))
        graph.node.append(node)
    del graph.output[:]
    graph.output.append(helper.make_tensor_value_info("probability", TensorProto.FLOAT, ["N"]))
