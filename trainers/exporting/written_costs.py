"""Learnt costs of the flow as ONNX files: networks over whole tracks, and boosted trees over pairs of detections."""

from __future__ import annotations

import warnings
from dataclasses import asdict
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
from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.onnx import ModelCard, OnnxModel
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.exporting.export import convert_module, write_checked

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
