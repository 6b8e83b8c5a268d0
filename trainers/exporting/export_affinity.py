"""Boosted trees to ONNX: features in, one calibrated probability out."""

from __future__ import annotations

import warnings
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper
from skl2onnx import to_onnx
from skl2onnx.common.data_types import FloatTensorType
from sklearn.ensemble import HistGradientBoostingClassifier
from threadpoolctl import threadpool_limits

from tsuiseki.tracking.errors import RunError
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard, OnnxModel
from tsuiseki.tracking.output import output_file
from tsuiseki.tracking.types import FloatArray

# float32 sums of the leaves against float64 ones; a share of rows may lie on a threshold, where rounding decides.
TOLERANCE = 1e-4
ON_A_THRESHOLD = 1e-3
OPSET = 18
NEAR_CERTAIN = 1e-6


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
    card = replace(card, project_version=version("tsuiseki"))
    model.metadata_props.add(key=METADATA_KEY, value=card.to_json())
    onnx.checker.check_model(model)
    with output_file(path, overwrite) as work:
        work.parent.mkdir(parents=True, exist_ok=True)
        work.write_bytes(model.SerializeToString())
        check_parity(trees, calibration, work, example)


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def check_parity(
    trees: HistGradientBoostingClassifier, calibration: tuple[float, float], path: Path, example: FloatArray
) -> None:
    """Compare the file with scikit-learn on single rows and on many, unknown values included.

    Raises:
        RunError: they differ.
    """
    model = OnnxModel(path, "affinity", threads=1)
    rng = np.random.default_rng(0)
    rows = example[rng.permutation(len(example))[:4096]].astype(np.float32)
    unknown = rows.copy()
    unknown[:, 1] = np.nan
    for batch in (rows, unknown, rows[:1]):
        scale, shift = calibration
        logits = np.clip(trees.decision_function(batch.astype(np.float64)), *np.log([1e-6, 1e6]))
        expected = 1 / (1 + np.exp(-(scale * logits + shift)))
        got = model.run(batch)[0]
        if got.shape != expected.shape:
            raise RunError(f"parity check failed: expected probabilities of shape {expected.shape}, got {got.shape}")
        wrong = np.abs(got - expected) > TOLERANCE
        if wrong.mean() > ON_A_THRESHOLD:
            raise RunError(
                f"parity check failed: {wrong.sum()} of {len(wrong)} probabilities differ from scikit-learn's by over "
                f"{TOLERANCE:g}, the worst by {np.abs(got - expected).max():.3g}; check the versions of skl2onnx and "
                "onnxruntime"
            )


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
