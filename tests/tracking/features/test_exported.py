"""Exported networks: the contract is checked, boxes are decoded, frames stream through in order."""

from __future__ import annotations

import dataclasses

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features import exported
from tsuiseki.tracking.features.exported import Appearance, Detector, decode_boxes
from tsuiseki.tracking.features.streaming import stream
from tsuiseki.tracking.onnx import FORMAT_VERSION, METADATA_KEY, ModelCard, OnnxModel, cores_of, open_session
from tsuiseki.tracking.preprocessing import crop_boxes, fit_image, normalise
from tsuiseki.tracking.stages import StageTimes
from tsuiseki.tracking.types import Detections, Frame
from tsuiseki.tracking.weights import shipped

HEIGHT, WIDTH = 24, 32
DETECTOR_CARD = ModelCard(
    "detector", "fake", ("person",), HEIGHT, WIDTH, "letterbox", settings={"variances": [0.1, 0.2]}
)
ANCHORS = np.array([[8, 12, 8, 16], [9, 12, 8, 16], [24, 12, 8, 16]], dtype=np.float32)
# Scores: sigmoid of the differences, so about 0.95, 0.88 and 0.02; the second overlaps the first.
LOGITS = np.array([[0, 3], [0, 2], [0, -4]], dtype=np.float32)


def save(path, nodes, outputs, constants, card_text):
    graph = helper.make_graph(
        nodes,
        "fake",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, ["n", 3, HEIGHT, WIDTH])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in outputs],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    if card_text is not None:
        helper.set_model_props(model, {METADATA_KEY: card_text})
    onnx.save(model, path)
    return path


def fake_detector(path, card=DETECTOR_CARD, card_text=""):
    """A detector that finds the same in every image."""
    constants = {
        "nothing": np.zeros(1, np.float32),
        "l": LOGITS[None],
        "o": np.zeros((1, 3, 4), np.float32),
        "a": ANCHORS,
        "axes": np.array([1, 2, 3]),
        "shape": np.array([-1, 1, 1]),
    }
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "nothing"], ["zero"]),
        helper.make_node("Reshape", ["zero", "shape"], ["zeros"]),
        helper.make_node("Add", ["zeros", "l"], ["logits"]),
        helper.make_node("Add", ["zeros", "o"], ["offsets"]),
        helper.make_node("Identity", ["a"], ["anchors"]),
    ]
    outputs = [("logits", ["n", 3, 2]), ("offsets", ["n", 3, 4]), ("anchors", [3, 4])]
    return save(path, nodes, outputs, constants, card.to_json() if card_text == "" else card_text)


def fake_appearance(path):
    """An appearance network whose feature is the mean colour, made unit length."""
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("LpNormalization", ["mean"], ["features"], axis=1, p=2),
    ]
    card = ModelCard("appearance", "fake", (), HEIGHT, WIDTH, feature_length=3, mean=(0, 0, 0), std=(1, 1, 1))
    return save(path, nodes, [("features", ["n", 3])], {"axes": np.array([2, 3])}, card.to_json())


def test_normalisation_is_scale_mean_and_deviation():
    images = np.random.default_rng(0).integers(0, 256, (2, 5, 7, 3), dtype=np.uint8)
    card = ModelCard("detector", "x")
    expected = ((images / 255 - np.array(card.mean)) / np.array(card.std)).transpose(0, 3, 1, 2)
    np.testing.assert_allclose(normalise(images, card), expected, atol=1e-6)


def test_box_code_of_zero_is_the_anchor_and_codes_move_and_scale_it():
    anchors = np.array([[10, 20, 4, 8]] * 2, dtype=np.float32)
    offsets = np.array([[0, 0, 0, 0], [10, -5, np.log(2) / 0.2, 0]], dtype=np.float32)
    boxes = decode_boxes(offsets, anchors, (0.1, 0.2))
    np.testing.assert_allclose(boxes, [[8, 16, 12, 24], [10, 12, 18, 20]], atol=1e-5)


def test_letterbox_keeps_the_aspect_ratio_and_stretch_does_not():
    image = np.full((48, 48, 3), 7, dtype=np.uint8)
    boxed, scale = fit_image(image, DETECTOR_CARD)
    assert (boxed.shape, scale) == ((HEIGHT, WIDTH, 3), (0.5, 0.5))
    assert (boxed[:, :24] == 7).all()
    assert boxed[0, 30].tolist() == np.round(255 * np.array(DETECTOR_CARD.mean)).tolist()
    stretched, scale = fit_image(image, dataclasses.replace(DETECTOR_CARD, resize="stretch"))
    assert scale == (WIDTH / 48, HEIGHT / 48)
    assert (stretched == 7).all()


def test_detector_decodes_suppresses_and_scales_back(tmp_path, monkeypatch):
    detector = Detector(fake_detector(tmp_path / "d.onnx"), score_threshold=0.3)
    small, large = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    found = detector.detect([small, large])
    np.testing.assert_allclose(found[0].boxes, [[4, 4, 12, 20]], atol=1e-5)
    np.testing.assert_allclose(found[1].boxes, [[8, 8, 24, 40]], atol=1e-5)
    np.testing.assert_allclose(found[0].scores, [1 / (1 + np.exp(-3))], rtol=1e-6)
    monkeypatch.setattr(exported, "SAME", 1.0)
    everything = Detector(tmp_path / "d.onnx", score_threshold=0.0).detect([small])[0]
    assert len(everything) == 3
    assert detector.detect([]) == []


def test_crops_outside_the_image_repeat_its_border():
    image = np.zeros((10, 10, 3), dtype=np.uint8)
    image[:, 5:] = 200
    crops = crop_boxes(image, np.array([[5.0, 0, 25, 10], [-20, -20, -5, -5], [0, 0, 5, 10]]), 16, 8)
    assert crops.shape == (3, 16, 8, 3)
    assert (crops[0] == 200).all()
    assert (crops[1:] == 0).all()


def test_appearance_is_batched_and_of_unit_length(tmp_path, monkeypatch):
    monkeypatch.setattr(exported, "BATCH", 2)
    network = Appearance(fake_appearance(tmp_path / "a.onnx"))
    image = np.random.default_rng(1).integers(1, 256, (40, 40, 3), dtype=np.uint8)
    boxes = np.array([[i, i, i + 10.0, i + 20] for i in range(5)])
    features = network.describe(image, boxes)
    np.testing.assert_allclose(np.linalg.norm(features, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(features[3:4], network.describe(image, boxes[3:4]), atol=1e-6)
    assert network.describe(image, np.empty((0, 4))).shape == (0, 3)


@pytest.mark.parametrize("batch_size", [1, 3, 100])
def test_streaming_keeps_the_order_and_never_reads_ahead_more_than_a_batch(tmp_path, batch_size):
    detector = Detector(fake_detector(tmp_path / "d.onnx"))
    read = []

    def frames():
        for n in range(7):
            read.append(n)
            yield Frame(n, n / 10, np.zeros((HEIGHT, WIDTH, 3), np.uint8))

    for expected, (frame, found) in enumerate(stream(frames(), detector, batch_size=batch_size)):
        assert frame.index == expected
        assert len(found) == 1
        assert len(read) <= (expected // batch_size + 1) * batch_size
    assert read == list(range(7))


def test_given_detections_are_described(tmp_path):
    given = [Detections(np.array([[0.0, 0, 5, 5]]), np.ones(1)), Detections.empty()]
    frames = [Frame(n, 0.0, np.full((9, 9, 3), 50, np.uint8)) for n in range(3)]
    found = [d for _, d in stream(frames, given, Appearance(fake_appearance(tmp_path / "a.onnx")))]
    assert [len(d) for d in found] == [1, 0, 0]
    np.testing.assert_allclose(found[0].features, np.full((1, 3), 3**-0.5), atol=1e-6)


def test_wrong_files_are_refused_in_one_line(tmp_path):
    newer = dataclasses.replace(DETECTOR_CARD, format_version=FORMAT_VERSION + 1).to_json()
    (tmp_path / "text.onnx").write_text("no model")
    cases = {
        "found none": tmp_path / "missing.onnx",
        "not a readable ONNX": tmp_path / "text.onnx",
        "no tsuiseki metadata": fake_detector(tmp_path / "bare.onnx", card_text=None),
        "format version 2": fake_detector(tmp_path / "new.onnx", card_text=newer),
        "odd.onnx: expected a model card, got no JSON": fake_detector(tmp_path / "odd.onnx", card_text="{"),
        "kind 'detector', got 'appearance'": fake_appearance(tmp_path / "a.onnx"),
    }
    for message, path in cases.items():
        with pytest.raises(RequestError, match=message) as caught:
            OnnxModel(path, "detector")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("workers", [2, 3])
@pytest.mark.parametrize("frames", [0, 1, 4, 5, 23])
def test_several_workers_give_the_same_in_the_same_order_and_hold_few_frames(tmp_path, workers, frames):
    rng = np.random.default_rng(frames)
    images = rng.integers(0, 255, (frames, HEIGHT, WIDTH, 3), dtype=np.uint8)
    detector, describe = Detector(fake_detector(tmp_path / "d.onnx")), Appearance(fake_appearance(tmp_path / "a.onnx"))
    read = []

    def video():
        for n, image in enumerate(images):
            read.append(n)
            yield Frame(n, n / 10, image)

    alone = list(stream(video(), detector, describe, 2))
    read.clear()
    times = StageTimes()
    for n, (frame, found) in enumerate(stream(video(), detector, describe, 2, times, workers)):
        assert frame.index == n
        np.testing.assert_array_equal(found.boxes, alone[n][1].boxes)
        np.testing.assert_array_equal(found.features, alone[n][1].features)
        assert len(read) <= n + 2 * (2 * workers + 1)
    assert len(read) == frames
    assert frames == 0 or set(times.seconds) == {"decode", "detect", "describe"}


def test_what_goes_wrong_in_a_worker_reaches_the_caller():
    class Broken:
        calls = 0

        def detect(self, images):
            self.calls += 1
            if self.calls == 3:
                raise RunError("the network gives NaN")
            return [Detections.empty()] * len(images)

    frames = (Frame(n, 0.0, np.zeros((HEIGHT, WIDTH, 3), np.uint8)) for n in range(40))
    with pytest.raises(RunError, match="gives NaN"):
        list(stream(frames, Broken(), batch_size=2, workers=2))


def test_threads_are_as_many_as_asked_for_or_all_there_are():
    assert cores_of(3) == 3
    assert cores_of(0) >= 1


def test_all_cores_are_asked_for_by_number(tmp_path):
    """Onnxruntime's own default binds threads to cores: with other work on them it is slower than a number."""
    path = tmp_path / "m.onnx"
    path.write_bytes(shipped("affinity_people").read_bytes())
    assert open_session(path, 0).get_session_options().intra_op_num_threads == cores_of(0)
