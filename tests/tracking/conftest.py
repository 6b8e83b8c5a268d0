"""A short video and small models that find the same person in every frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.street_clip import StreetClip, StreetSettings
from tsuiseki.tracking.association.learnt_costs import FEATURE_SETS, FeatureSet
from tsuiseki.tracking.features.action import STREAMS, ActionInput, StreamName
from tsuiseki.tracking.formats.okutama import OKUTAMA_ACTIONS
from tsuiseki.tracking.onnx import METADATA_KEY, ModelCard
from tsuiseki.tracking.video.webm import VideoWriter

HEIGHT, WIDTH = 24, 32
FRAMES = 12
# In the pixels of the 64x48 images: twice the anchor of the detector.
PERSON = [8.0, 8.0, 24.0, 40.0]


@dataclass(frozen=True)
class Inputs:
    """Files that are as they should be."""

    video: Path
    images: Path
    detections: Path
    detector: Path
    appearance: Path
    affinity: Path

    def words(self, source: str | Path | None = None) -> list[str]:
        """The command that tracks with all of them; more options may follow.

        The detector here finds somebody in whatever it sees, so it must not look at tiles.
        """
        models = ("detector", "appearance", "affinity")
        given = [word for name in models for word in (f"--{name}", str(getattr(self, name)))]
        return ["track", "people", str(source or self.video), *given, "--view", "1"]


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    folder = tmp_path_factory.mktemp("inputs")
    found = Inputs(*(folder / name for name in ("v.webm", "images", "det.txt", "d.onnx", "p.onnx", "f.onnx")))
    found.images.mkdir()
    with VideoWriter(found.video, 10) as writer:
        for number in range(FRAMES):
            image = np.full((48, 64, 3), 60 + 5 * number, dtype=np.uint8)
            writer.write(image)
            cv2.imwrite(str(found.images / f"{number + 1:06d}.png"), image)
    found.detections.write_text("".join(f"{n},-1,9,9,16,32,0.97\n" for n in range(1, FRAMES + 1)))
    save_detector(found.detector)
    save_appearance(found.appearance)
    save_affinity(found.affinity)
    return found


def save(path: Path, name: str, shape: list[Any], nodes: list[Any], outputs: dict[str, Any], constants: Any) -> None:
    """Write a graph with one input, and with metadata where ``constants`` has a text for it."""
    graph = helper.make_graph(
        nodes,
        "small",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info(n, TensorProto.FLOAT, s) for n, s in outputs.items()],
        [numpy_helper.from_array(v, n) for n, v in constants.items() if n != "card"],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if constants["card"] is not None:
        helper.set_model_props(model, {METADATA_KEY: constants["card"]})
    onnx.save(model, path)


DETECTOR = ModelCard("detector", "small", ("person",), HEIGHT, WIDTH, "letterbox", settings={"variances": [0.1, 0.2]})


def save_detector(path: Path, card: str | None = DETECTOR.to_json()) -> None:
    """A detector that finds `PERSON` in every image, and nothing in a second place."""
    constants = {
        "nothing": np.zeros(1, np.float32),
        "l": np.array([[[0, 3], [0, -4]]], dtype=np.float32),
        "o": np.zeros((1, 2, 4), np.float32),
        "a": np.array([[8, 12, 8, 16], [24, 12, 8, 16]], dtype=np.float32),
        "axes": np.array([1, 2, 3]),
        "shape": np.array([-1, 1, 1]),
        "card": card,
    }
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "nothing"], ["zero"]),
        helper.make_node("Reshape", ["zero", "shape"], ["zeros"]),
        helper.make_node("Add", ["zeros", "l"], ["logits"]),
        helper.make_node("Add", ["zeros", "o"], ["offsets"]),
        helper.make_node("Identity", ["a"], ["anchors"]),
    ]
    outputs = {"logits": ["n", 2, 2], "offsets": ["n", 2, 4], "anchors": [2, 4]}
    save(path, "images", ["n", 3, HEIGHT, WIDTH], nodes, outputs, constants)


def save_appearance(path: Path) -> None:
    """Mean colour, made unit length."""
    card = ModelCard("appearance", "small", (), HEIGHT, WIDTH, feature_length=3, mean=(0, 0, 0), std=(1, 1, 1))
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("LpNormalization", ["mean"], ["features"], axis=1, p=2),
    ]
    constants = {"axes": np.array([2, 3]), "card": card.to_json()}
    save(path, "images", ["n", 3, HEIGHT, WIDTH], nodes, {"features": ["n", 3]}, constants)


def save_affinity(path: Path, features: FeatureSet = "extended") -> None:
    """Every pair is the same person, almost surely."""
    names = FEATURE_SETS[features]
    settings = {"features": features, "window": 3, "alpha": 1.0, "beta": -3.0, "b": 0.0}
    card = ModelCard("affinity", "small", names, layout="NF", settings=settings)
    value = numpy_helper.from_array(np.array([0.95], dtype=np.float32))
    nodes = [
        helper.make_node("Shape", ["features"], ["rows"], start=0, end=1),
        helper.make_node("ConstantOfShape", ["rows"], ["probability"], value=value),
    ]
    save(path, "features", ["n", len(names)], nodes, {"probability": ["n"]}, {"card": card.to_json()})


@pytest.fixture(scope="session")
def action_streams(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two streams that know the coloured people of ``acting_clips``: by their colours, and not at all by their flow."""
    folder = tmp_path_factory.mktemp("streams")
    paths = [folder / "rgb.onnx", folder / "flow.onnx"]
    save_action(paths[0], "rgb_local")
    save_action(paths[1], "flow_local")
    return paths


@pytest.fixture(scope="session")
def drone_models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with four small streams, ``STREAM.onnx``."""
    folder = tmp_path_factory.mktemp("drone")
    for stream in STREAMS:
        save_action(folder / f"{stream}.onnx", stream)
    return folder


def save_action(path: Path, stream: StreamName, names: tuple[str, ...] = OKUTAMA_ACTIONS) -> None:
    """Red is walking, green sitting, blue running, by the sigmoid of a linear map of the mean colour."""
    takes = ActionInput(stream, 16)
    weight = np.zeros((takes.channels, len(names)), dtype=np.float32)
    if stream == "rgb_local" and len(names) == len(OKUTAMA_ACTIONS):
        for channel, action in enumerate(("Walking", "Sitting", "Running")):
            weight[:, names.index(action)] = -2
            weight[channel, names.index(action)] = 4
    constants = {"axes": np.array([2, 3]), "w": weight, "card": takes.card("small", names).to_json()}
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("MatMul", ["mean", "w"], ["logit"]),
        helper.make_node("Sigmoid", ["logit"], ["probability"]),
    ]
    save(path, "images", ["n", takes.channels, 16, 16], nodes, {"probability": ["n", len(names)]}, constants)


@pytest.fixture(scope="session")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sequence folder of 16 frames with labels."""
    return write_clip(tmp_path_factory.mktemp("street") / "street", StreetClip(StreetSettings(frames=16), 100))
