"""Detectors of other projects: each layout gives the same two people, what is unclear is refused in one line."""

from __future__ import annotations

from importlib import resources

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, cells, save_constant
from tsuiseki.tracking.errors import RequestError, RunError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.foreign_options import DetectorOptions

# Two people apart, a third box over the first that suppression must drop, and a dog.
CORNERS = np.array([[8, 8, 24, 56], [50, 10, 70, 58], [9, 8, 25, 56], [70, 40, 90, 60]], dtype=np.float32)
SCORES = np.array([0.9, 0.8, 0.6, 0.95], dtype=np.float32)
CLASSES = np.array([0, 0, 0, 1])
CENTRES = np.concatenate([(CORNERS[:, :2] + CORNERS[:, 2:]) / 2, CORNERS[:, 2:] - CORNERS[:, :2]], axis=1)
SIDES = np.array([WIDTH, HEIGHT] * 2, dtype=np.float32)
NAMES = {"names": "{0: 'person', 1: 'dog', 2: 'car'}"}
CELLS = cells()
PER_CLASS = np.where(CLASSES[:, None] == np.arange(3), SCORES[:, None], 0).astype(np.float32)


def yolov8():
    rows = np.zeros((len(CELLS), 7), np.float32)
    rows[:4] = np.concatenate([CENTRES, PER_CLASS], axis=1)
    return {"output0": rows.T.copy()}


def yolov5(cells_times=3):
    rows = np.zeros((cells_times * len(CELLS), 8), np.float32)
    rows[:, :2] = np.tile((CELLS[:, :2] + 0.5) * CELLS[:, 2:], (cells_times, 1))
    rows[:, 2:4] = 10
    rows[:4] = np.concatenate([CENTRES, np.full((4, 1), 0.5), 2 * PER_CLASS], axis=1)
    return {"output": rows}


def yolox():
    rows = np.zeros((len(CELLS), 8), np.float32)
    for n, (centre, score) in enumerate(zip(CENTRES, PER_CLASS, strict=True)):
        column, row, stride = CELLS[n]
        near = 0 if n < 3 else np.argmin(np.abs((CELLS[:, :2] + 0.5) * 8 - centre[:2]).sum(axis=1) + CELLS[:, 2])
        near = max(int(np.argmin(np.abs((CELLS[:, :2] + 0.5) * CELLS[:, 2:] - centre[:2]).sum(axis=1))), near)
        while rows[near, 4]:
            near += 1
        column, row, stride = CELLS[near]
        xy = centre[:2] / stride - [column, row]
        rows[near] = np.concatenate([xy, np.log(centre[2:] / stride), [1.0], score])
    return {"output": rows}


def yolox_decoded():
    return {"output": yolov5(1)["output"]}


def yolo_suppressed():
    rows = np.zeros((300, 6), np.float32)
    kept = [0, 1, 3]
    rows[:3] = np.concatenate([CORNERS[kept], SCORES[kept, None], CLASSES[kept, None]], axis=1)
    return {"output0": rows}


def rtdetr_joined():
    rows = np.full((300, 7), 1e-3, np.float32)
    rows[:4] = np.concatenate([CENTRES / SIDES, PER_CLASS], axis=1)
    return {"output0": rows}


def detr():
    boxes = np.full((50, 4), 0.5, np.float32)
    logits = np.full((50, 3), -9.0, np.float32)
    boxes[:4] = CENTRES / SIDES
    logits[:4] = np.log(np.maximum(PER_CLASS, 1e-4) / (1 - np.maximum(PER_CLASS, 1e-4)))
    return {"dets": boxes, "labels": logits}


def corners():
    boxes = np.tile(np.array([0.9, 0.9, 0.95, 0.95], np.float32), (50, 1))
    scores = np.zeros((50, 3), np.float32)
    boxes[:4], scores[:4] = CORNERS / SIDES, PER_CLASS
    return {"scores": scores, "boxes": boxes}


def torchvision():
    kept = [0, 1, 3]
    return {"boxes": CORNERS[kept], "labels": CLASSES[kept], "scores": SCORES[kept]}


def yolov8_rows():
    rows = yolov5(1)["output"]
    return {"output0": np.concatenate([rows[:, :4], np.maximum(rows[:, 5:] * 0.5, 0.001)], axis=1)}


def yolov6():
    rows = yolov5(1)["output"]
    rows[:, 5:] *= 0.5
    rows[:, 4] = 1
    return {"outputs": rows}


def tensorflow(suffix=""):
    kept, empty = [0, 1, 3], np.zeros((2, 4), np.float32)
    shares = (CORNERS[kept] / SIDES)[:, [1, 0, 3, 2]]
    outputs = {
        "num_detections": np.array(3, np.float32),
        "detection_scores": np.concatenate([SCORES[kept], [0.99, 0.0]]).astype(np.float32),
        "detection_boxes": np.concatenate([shares, empty]).astype(np.float32),
        "detection_classes": np.concatenate([1 + CLASSES[kept], [1, 1]]).astype(np.float32),
    }
    return {name + suffix: value for name, value in outputs.items()}


LAYOUTS = {
    "yolov8": yolov8,
    "yolov8-rows": yolov8_rows,
    "yolov6": yolov6,
    "yolov5": yolov5,
    "yolox": yolox,
    "yolox-decoded": yolox_decoded,
    "yolo-suppressed": yolo_suppressed,
    "rtdetr-joined": rtdetr_joined,
    "detr": detr,
    "torchvision": torchvision,
    "tensorflow": tensorflow,
}
BYTES = {"shape": ("batch", HEIGHT, WIDTH, 3), "kind": TensorProto.UINT8}


def saved(path, name, **options):
    plain = ("boxes", "labels", "scores") if name == "torchvision" else ()
    shape = (3, HEIGHT, WIDTH) if name == "torchvision" else ("batch", 3, HEIGHT, WIDTH)
    wanted = BYTES if name == "tensorflow" else {"shape": shape}
    return save_constant(path / f"{name}.onnx", LAYOUTS[name](), plain=plain, **wanted | options)


@pytest.mark.parametrize("name", LAYOUTS)
def test_every_layout_is_recognised_and_gives_the_same_people(tmp_path, name):
    detector = open_detector(saved(tmp_path, name, metadata=NAMES), score_threshold=0.3)
    assert isinstance(detector, ForeignDetector)
    assert (detector.layout, detector.person) == (name, int(name == "tensorflow"))
    assert f"people are class {detector.person} 'person'" in str(detector)
    small, large = np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    for scale, found in zip((1, 2), detector.detect([small, large]), strict=True):
        order = np.argsort(-found.scores)
        np.testing.assert_allclose(found.boxes[order] / scale, CORNERS[:2], atol=1e-3)
        np.testing.assert_allclose(found.scores[order], SCORES[:2], atol=1e-3)


def test_a_batch_axis_of_one_is_run_picture_by_picture(tmp_path):
    detector = open_detector(saved(tmp_path, "yolov8", metadata=NAMES, shape=(1, 3, HEIGHT, WIDTH)))
    assert [len(d) for d in detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 3)] == [2, 2, 2]
    assert detector.detect([]) == []


def test_letterboxed_boxes_come_back_to_the_picture(tmp_path):
    detector = open_detector(saved(tmp_path, "yolov8", metadata=NAMES))
    tall = np.zeros((2 * HEIGHT, WIDTH // 2, 3), np.uint8)
    np.testing.assert_allclose(detector.detect([tall])[0].boxes[0], 2 * CORNERS[0], atol=1e-3)


def test_half_precision_goes_in_where_the_file_wants_it(tmp_path):
    detector = open_detector(saved(tmp_path, "yolov8", metadata=NAMES, kind=TensorProto.FLOAT16))
    assert len(detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])[0]) == 2


def test_a_size_that_the_file_leaves_open_comes_from_metadata_or_options(tmp_path):
    shape = ("batch", 3, "height", "width")
    told = saved(tmp_path, "yolov8", shape=shape, metadata={**NAMES, "imgsz": f"[{HEIGHT}, {WIDTH}]"})
    assert open_detector(told).input_size == (HEIGHT, WIDTH)
    path = saved(tmp_path, "yolov5", shape=shape, metadata=NAMES)
    assert open_detector(path, options=DetectorOptions(height=HEIGHT, width=WIDTH)).layout == "yolov5"
    with pytest.raises(RequestError, match="height and width of its input are open"):
        open_detector(path)


def test_torchvision_takes_pictures_of_any_size(tmp_path):
    path = saved(tmp_path, "torchvision", shape=(3, "height", "width"))
    detector = open_detector(path, options=DetectorOptions(person=0))
    assert detector.input_size is None
    large = np.zeros((4 * HEIGHT, 4 * WIDTH, 3), np.uint8)
    np.testing.assert_allclose(detector.detect([large])[0].boxes, CORNERS[:2], atol=1e-3)


def test_people_are_found_by_name_by_number_and_where_coco_has_them(tmp_path):
    path = saved(tmp_path, "yolov8")
    assert open_detector(path, options=DetectorOptions(classes=("dog", "Person", "car"))).person == 1
    assert open_detector(path, options=DetectorOptions(person=2)).person == 2
    with pytest.raises(RequestError, match=r"3 classes without names; say which one is people"):
        open_detector(path)
    with pytest.raises(RequestError, match="no class of people among dog, cat, car"):
        open_detector(saved(tmp_path, "yolov8", metadata={"names": "['dog', 'cat', 'car']"}))
    with pytest.raises(RequestError, match="several classes of people"):
        open_detector(path, options=DetectorOptions(classes=("person", "pedestrian", "car")))
    with pytest.raises(RequestError, match="from 0 to 2, got 3"):
        open_detector(path, options=DetectorOptions(person=3))
    rows = np.zeros((84, len(CELLS)), np.float32)
    assert open_detector(save_constant(tmp_path / "coco.onnx", {"o": rows})).person == 0


def test_a_file_of_two_layouts_is_refused_with_both_and_the_option_decides(tmp_path):
    path = save_constant(tmp_path / "pair.onnx", corners())
    boxes_of_detr = detr() | {}
    unnamed = {"a": boxes_of_detr["dets"], "b": boxes_of_detr["labels"]}
    unnamed["a"] = np.maximum(unnamed["a"], 0)
    unnamed["a"][:, 2:] = np.maximum(unnamed["a"][:, 2:], unnamed["a"][:, :2])
    either = r"could be detr .* or corners .*; say which with `detector_options\.layout`"
    with pytest.raises(RequestError, match=either):
        open_detector(path)
    with pytest.raises(RequestError, match="could be detr"):
        open_detector(save_constant(tmp_path / "unnamed.onnx", unnamed))
    detector = open_detector(path, options=DetectorOptions(layout="corners", person=0))
    found = detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])[0]
    np.testing.assert_allclose(found.boxes, CORNERS[:2], atol=1e-3)
    with pytest.raises(RequestError, match=r"are not \(1, 4\+C, N\), as layout yolov8 asks for"):
        open_detector(path, options=DetectorOptions(layout="yolov8", person=0))


def test_two_classes_of_a_transformer_are_told_from_suppressed_boxes(tmp_path):
    rows = np.full((300, 6), 1e-3, np.float32)
    rows[:4] = np.concatenate([CENTRES / SIDES, PER_CLASS[:, :2]], axis=1)
    path = save_constant(tmp_path / "two.onnx", {"output0": rows})
    assert open_detector(path, options=DetectorOptions(person=0)).layout == "rtdetr-joined"
    empty = save_constant(tmp_path / "empty.onnx", {"output0": np.zeros((300, 6), np.float32)})
    detector = open_detector(empty, options=DetectorOptions(person=0))
    assert detector.layout == "yolo-suppressed"
    assert len(detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])[0]) == 0


def test_rows_with_and_without_an_objectness_are_told_by_the_classes_or_refused_with_both(tmp_path):
    rows = yolov8_rows()["output0"]
    two = save_constant(tmp_path / "two.onnx", {"output0": rows[:, :6]})
    both = r"could be yolox-decoded .* or yolov8-rows .*; say which with `detector_options\.layout`"
    with pytest.raises(RequestError, match=both):
        open_detector(two)
    with pytest.raises(RequestError, match=both):
        open_detector(two, options=DetectorOptions(person=0))
    assert open_detector(two, options=DetectorOptions(classes=("person", "dog"))).layout == "yolov8-rows"
    assert open_detector(two, options=DetectorOptions(classes=("person",))).layout == "yolox-decoded"
    for columns, layout in ((84, "yolov8-rows"), (85, "yolox-decoded")):  # 80 classes are COCO's
        coco = np.concatenate([rows, np.zeros((len(rows), columns - rows.shape[1]), np.float32)], axis=1)
        detector = open_detector(save_constant(tmp_path / f"{columns}.onnx", {"o": coco}))
        assert (detector.layout, detector.person) == (layout, 0)


def softmax_detr(queries=60, classes=3, no_object=8.0, first=False):
    """DETR of Hugging Face: "no object" wins every query but that of one person, class 0."""
    logits = np.zeros((queries, classes + 1), np.float32)
    logits[:, 0 if first else -1] = no_object
    logits[0, 1 if first else 0] = no_object + 4
    # A sigmoid would take these for people.
    logits[1:, 1 if first else 0] = 2
    return {"logits": logits, "pred_boxes": np.full((queries, 4), 0.5, np.float32)}


@pytest.mark.parametrize("first", [False, True])
def test_logits_with_a_class_of_no_object_go_through_a_softmax(tmp_path, first):
    path = save_constant(tmp_path / "detr.onnx", softmax_detr(first=first), metadata=NAMES)
    detector = open_detector(path)
    assert (detector.layout, detector.scores, detector.person) == ("detr", "softmax", int(first))
    found = detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])[0]
    np.testing.assert_allclose(found.scores, [np.exp(12) / (np.exp(12) + np.exp(8) + 2)], atol=1e-4)
    coco = save_constant(tmp_path / "coco.onnx", softmax_detr(classes=91))
    assert open_detector(coco).person == 1
    unknown = save_constant(tmp_path / "unknown.onnx", softmax_detr())
    with pytest.raises(RequestError, match="3 classes without names"):
        open_detector(unknown)
    with pytest.raises(RequestError, match="from 0 to 2, got 3"):
        open_detector(unknown, options=DetectorOptions(person=3))


def test_logits_that_may_be_of_a_sigmoid_or_a_softmax_are_asked_for(tmp_path):
    low = softmax_detr(classes=1, no_object=-3.0)
    low["logits"][:, 0] -= 6
    path = save_constant(tmp_path / "low.onnx", low)
    either = r"logits of a sigmoid or of a softmax; say which with `detector_options\.scores`"
    with pytest.raises(RequestError, match=either):
        open_detector(path, options=DetectorOptions(person=0))
    for kind in ("sigmoid", "softmax"):
        assert open_detector(path, options=DetectorOptions(person=0, scores=kind)).scores == kind
    with pytest.raises(RequestError, match="expected probabilities, got class values from -5 to -3"):
        open_detector(path, options=DetectorOptions(person=0, scores="probabilities"))
    with pytest.raises(RequestError, match=r"leave `detector_options\.scores` out"):
        open_detector(saved(tmp_path, "yolov8", metadata=NAMES), options=DetectorOptions(scores="sigmoid"))


def test_logits_stay_logits_where_a_picture_gives_only_small_ones(tmp_path):
    detector = open_detector(saved(tmp_path, "detr", metadata=NAMES))
    assert detector.scores == "sigmoid"
    boxes, logits = np.full((50, 4), 0.5, np.float32), np.full((50, 3), 0.2, np.float32)
    found = detector._decode([boxes, logits], (HEIGHT, WIDTH), (1.0, 1.0), (HEIGHT, WIDTH))
    np.testing.assert_allclose(found.scores, [1 / (1 + np.exp(-0.2))], atol=1e-6)


def test_how_a_file_is_read_is_said_in_a_line_and_in_plain_values(tmp_path):
    detector = open_detector(saved(tmp_path, "yolox", metadata=NAMES))
    said = "layout yolox, people are class 0 'person'; pictures letterbox, BGR, [0, 255], 96x64"
    assert str(detector) == said
    facts = detector.facts
    assert (facts["layout"], facts["person"], facts["colour"], facts["pixels"]) == ("yolox", 0, "BGR", "bytes")
    assert facts["classes"] == ("person", "dog", "car")
    assert "scores by sigmoid; pictures stretch, RGB, [0, 1], normalised as ImageNet" in str(
        open_detector(saved(tmp_path, "detr", metadata=NAMES))
    )


def test_rows_that_are_never_filled_are_noticed(tmp_path):
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    empty = open_detector(save_constant(tmp_path / "e.onnx", {"o": np.zeros((300, 6), np.float32)}, metadata=NAMES))
    assert not empty.blank
    empty.detect([image])
    assert empty.blank
    filled = open_detector(saved(tmp_path, "yolo-suppressed", metadata=NAMES))
    filled.detect([image])
    assert not filled.blank
    nothing = {"boxes": np.zeros((0, 4), np.float32), "labels": np.zeros(0, np.int64)}
    no_rows = {**nothing, "scores": np.zeros(0, np.float32)}
    plain = {"plain": ("boxes", "labels", "scores"), "shape": (3, HEIGHT, WIDTH), "metadata": NAMES}
    torchvision = open_detector(save_constant(tmp_path / "n.onnx", no_rows, **plain))
    assert len(torchvision.detect([image])[0]) == 0
    assert torchvision.blank
    zeros = {name: np.zeros((5, *value.shape[1:]), value.dtype) for name, value in no_rows.items()}
    with pytest.raises(RunError, match="nothing but zeros"):
        open_detector(save_constant(tmp_path / "z.onnx", zeros, **plain)).detect([image])


def mean_colour_detector(path):
    """One box whose score is the mean of the first channel: shows what the network is given."""
    nodes = [
        helper.make_node("ReduceMean", ["images", "axes"], ["means"], keepdims=0),
        helper.make_node("Slice", ["means", "from", "to", "axis"], ["first"]),
        helper.make_node("Reshape", ["first", "shape"], ["score"]),
        helper.make_node("Mul", ["score", "only_score"], ["scored"]),
        helper.make_node("Add", ["scored", "box"], ["output0"]),
    ]
    rows = np.zeros((1, 5, len(CELLS)), np.float32)
    only = rows.copy()
    rows[0, :4, 0], only[0, 4, 0] = [40, 30, 20, 40], 1
    constants = {"axes": [2, 3], "from": [0], "to": [1], "axis": [1], "shape": [-1, 1, 1]}
    graph = helper.make_graph(
        nodes,
        "mean",
        [helper.make_tensor_value_info("images", TensorProto.FLOAT, ["n", 3, HEIGHT, WIDTH])],
        [helper.make_tensor_value_info("output0", TensorProto.FLOAT, ["n", 5, len(CELLS)])],
        [onnx.numpy_helper.from_array(np.array(v), k) for k, v in constants.items()]
        + [onnx.numpy_helper.from_array(only, "only_score"), onnx.numpy_helper.from_array(rows, "box")],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


@pytest.mark.parametrize(
    ("options", "score"),
    [
        (DetectorOptions(), 200 / 255),
        (DetectorOptions(colour="BGR"), 100 / 255),
        (DetectorOptions(pixels="bytes", std=(400.0, 1.0, 1.0)), 0.5),
        (DetectorOptions(mean=(0.25, 0.0, 0.0), std=(0.8, 1.0, 1.0)), (200 / 255 - 0.25) / 0.8),
    ],
)
def test_pictures_are_normalised_as_the_layout_or_the_user_says(tmp_path, options, score):
    image = np.full((HEIGHT, WIDTH, 3), (200, 50, 100), np.uint8)
    found = open_detector(mean_colour_detector(tmp_path / "m.onnx"), 0.1, options=options).detect([image])[0]
    np.testing.assert_allclose(found.scores, [score], atol=1e-5)


BAD_FILES = {
    r"expected a float32 or float16 input, got int32": {"kind": TensorProto.INT32},
    r"channels before the rows \(N, 3, H, W\), got batchx64x96x3": {"shape": ("batch", HEIGHT, WIDTH, 3)},
    r"pictures of 3 channels": {"shape": ("batch", 1, HEIGHT, WIDTH)},
    r"expected pictures \(N, 3, H, W\) as input": {"shape": ("batch", 12)},
    r"a batch of 1 or any, got 4": {"shape": (4, 3, HEIGHT, WIDTH)},
    r"a network for 'classify'": {"metadata": {"task": "classify"}},
    r"height and width of its input are open": {"shape": ("batch", "c", "h", "w")},
}


@pytest.mark.parametrize("message", BAD_FILES)
def test_files_with_other_inputs_are_refused_in_one_line(tmp_path, message):
    path = save_constant(tmp_path / "bad.onnx", yolov8(), **BAD_FILES[message])
    with pytest.raises(RequestError, match=message) as caught:
        open_detector(path)
    assert "\n" not in str(caught.value)


def test_outputs_of_no_known_layout_nan_and_zeros_are_refused(tmp_path):
    with pytest.raises(RequestError, match=r"logits \(7, 9\) are of no known layout; known are yolov8"):
        open_detector(save_constant(tmp_path / "odd.onnx", {"logits": np.ones((7, 9), np.float32)}))
    for number in (np.nan, np.inf):
        bad = yolov8()
        bad["output0"][4, 0] = number
        with pytest.raises(RequestError, match="for a picture of noise are NaN or infinite"):
            open_detector(save_constant(tmp_path / "nan.onnx", bad, metadata=NAMES))
    nothing = {"output0": np.zeros_like(yolov8()["output0"])}
    detector = open_detector(save_constant(tmp_path / "zero.onnx", nothing, metadata=NAMES))
    with pytest.raises(RunError, match="nothing but zeros"):
        detector.detect([np.zeros((HEIGHT, WIDTH, 3), np.uint8)])


def test_a_file_newer_than_onnxruntime_is_refused_with_its_opset(tmp_path):
    path = saved(tmp_path, "yolov8")
    model = onnx.load(path)
    model.opset_import[0].version = 99
    onnx.save(model, tmp_path / "opset.onnx")
    with pytest.raises(RequestError, match=r"its opset 99 is newer than onnxruntime .*lower opset"):
        open_detector(tmp_path / "opset.onnx")
    model.opset_import[0].version, model.ir_version = 18, 99
    onnx.save(model, tmp_path / "ir.onnx")
    with pytest.raises(RequestError, match=r"its IR version 99 is newer"):
        open_detector(tmp_path / "ir.onnx")


def test_options_are_refused_for_a_detector_of_this_toolkit():
    shipped = str(resources.files("tsuiseki.tracking") / "weights" / "detector_street.onnx")
    with pytest.raises(RequestError, match="leave the detector options out"):
        open_detector(shipped, options=DetectorOptions(person=0))


def test_a_second_input_gets_the_size_that_boxes_are_to_be_in(tmp_path):
    """RT-DETR's own export asks for it and gives boxes in its pixels."""
    constants = {
        "share": (CORNERS[[0, 1, 3]] / SIDES)[None],
        "twice": np.array([0, 1, 0, 1]),
        "rows": np.array([1]),
        "label_values": CLASSES[None, [0, 1, 3]],
        "score_values": SCORES[None, [0, 1, 3]],
        "nothing": np.zeros(1, np.float32),
        "axes": np.array([1, 2, 3]),
    }
    nodes = [
        helper.make_node("Cast", ["orig_target_sizes"], ["sizes"], to=TensorProto.FLOAT),
        helper.make_node("Gather", ["sizes", "twice"], ["sides"], axis=1),
        helper.make_node("Unsqueeze", ["sides", "rows"], ["each"]),
        helper.make_node("Mul", ["share", "each"], ["boxes"]),
        helper.make_node("Identity", ["label_values"], ["labels"]),
        helper.make_node("ReduceMean", ["images", "axes"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "nothing"], ["zero"]),
        helper.make_node("Add", ["zero", "score_values"], ["scores"]),
    ]
    graph = helper.make_graph(
        nodes,
        "rtdetr",
        [
            helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, HEIGHT, WIDTH]),
            helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, [1, 2]),
        ],
        [
            helper.make_tensor_value_info("labels", TensorProto.INT64, None),
            helper.make_tensor_value_info("boxes", TensorProto.FLOAT, None),
            helper.make_tensor_value_info("scores", TensorProto.FLOAT, None),
        ],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    path = tmp_path / "rtdetr.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    detector = open_detector(path, options=DetectorOptions(person=0))
    assert detector.layout == "torchvision"
    found = detector.detect([np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)])[0]
    np.testing.assert_allclose(found.boxes / 2, CORNERS[:2], atol=1e-3)
