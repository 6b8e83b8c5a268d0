"""Detectors of other projects: layouts beyond plain rows, inputs beside the picture, boxes that are turned."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from tests.tracking.features.test_foreign_detector import (
    CENTRES,
    CLASSES,
    CORNERS,
    NAMES,
    PER_CLASS,
    SCORES,
    SIDES,
    detr,
    yolov5,
    yolov8,
    yolox,
)
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, cells, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.geometry import rotated_iou

KEPT = [0, 1, 3]
BLANK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
FLOAT, INT64 = TensorProto.FLOAT, TensorProto.INT64


def logit(values):
    clipped = np.clip(values, 1e-4, 1 - 1e-4)
    return np.log(clipped / (1 - clipped)).astype(np.float32)


def mmdeploy():
    dets = np.concatenate([CORNERS[KEPT], SCORES[KEPT, None]], axis=1)
    return {"dets": dets, "labels": CLASSES[KEPT].astype(np.int64)}


def counted(boxes="det_boxes", classes="det_classes", scores="det_scores", count="num_dets"):
    """As the end-to-end exports of YOLOs for TensorRT: what stands after the filled rows is nobody."""
    return {
        count: np.array([3], np.int32),
        boxes: np.concatenate([CORNERS[KEPT], np.ones((2, 4), np.float32)]),
        scores: np.concatenate([SCORES[KEPT], [0.99, 0.0]]).astype(np.float32),
        classes: np.concatenate([CLASSES[KEPT], [0, 0]]).astype(np.int32),
    }


def rows(*columns):
    return np.concatenate(columns, axis=1).astype(np.float32)


NOUGHT, SCORE, CLASS = np.zeros((3, 1)), SCORES[KEPT, None], CLASSES[KEPT, None]


def yolo_nas():
    boxes, classes = np.zeros((len(cells()), 4), np.float32), np.zeros((len(cells()), 3), np.float32)
    boxes[:4], classes[:4] = CORNERS, PER_CLASS
    return {"904": classes, "913": boxes}


def nanodet(strides=(8, 16, 32), shift=0.5, bins=8):
    """The distance to a side is a mean of two steps; each box stands in a cell of its own."""
    grid = np.concatenate([
        [(x, y, s) for y in range(-(-HEIGHT // s)) for x in range(-(-WIDTH // s))] for s in strides
    ])  # fmt: skip
    found = np.zeros((len(grid), 3 + 4 * bins), np.float32)
    found[:, 3:] = -1.0
    taken = set()
    for box, score in zip(CORNERS, PER_CLASS, strict=True):
        middles = (grid[:, :2] + shift) * grid[:, 2:]
        off = np.abs(middles - (box[:2] + box[2:]) / 2).sum(axis=1) + 1000 * (grid[:, 2] != 8)
        cell = next(n for n in np.argsort(off) if n not in taken)
        taken.add(cell)
        steps = np.concatenate([middles[cell] - box[:2], box[2:] - middles[cell]]) / grid[cell, 2]
        logits = np.full((4, bins), -60.0)
        for side, step in enumerate(steps):
            low = int(step)
            logits[side, low] = np.log(max(low + 1 - step, 1e-9))
            logits[side, low + 1] = np.log(max(step - low, 1e-9))
        found[cell] = np.concatenate([score, logits.ravel()])
    return {"output": found}


def nanodet_apart(bins):
    found = nanodet(bins=bins)["output"]
    parts = np.split(found, np.cumsum([(HEIGHT // s) * (WIDTH // s) for s in (8, 16)]))
    return {f"{n}_{kind}": part[:, some] for n, part in enumerate(parts[::-1]) for kind, some in
            (("logits", slice(3, None)), ("scores", slice(0, 3)))}  # fmt: skip


def fastestdet(flat=False):
    wide, high = WIDTH // 16, HEIGHT // 16
    found = np.zeros((high, wide, 8), np.float32)
    found[..., 5] = 1
    for (column, row), centre, score in zip([(1, 2), (3, 2), (2, 2), (4, 3)], CENTRES, PER_CLASS, strict=True):
        place = np.arctanh(np.clip(centre[:2] / 16 - [column, row], -1 + 1e-6, 1 - 1e-6))
        chance = score.max()
        found[row, column] = np.concatenate([[chance], place, logit(centre[2:] / SIDES[2:]), score / chance])
    return {"output": found.reshape(-1, 8) if flat else found.transpose(2, 0, 1).copy()}


def yolox_of_logits():
    found = yolox()["output"]
    found[:, 4:] = logit(found[:, 4:])
    return {"output": found}


def yolov5_with_heads():
    heads = [np.full((3, HEIGHT // s, WIDTH // s, 8), 9, np.float32) for s in (8, 16, 32)]
    return yolov5() | dict(zip(("348", "404", "460"), heads, strict=True))


def masked_detr():
    return {"pred_masks": np.ones((50, 8, 8), np.float32), **detr()}


def hugging_face():
    found = detr()
    return {"logits": found["labels"], "pred_boxes": found["dets"], "last_hidden_state": np.ones((50, 7), np.float32)}


GROUPED = counted("graph2_pred_boxes", "graph2_pred_classes", "graph2_pred_scores", "graph2_num_predictions")
# By what is exported: the layout, the outputs, how pictures are fitted, and what else the file says.
FILES = {
    "RTMDet by mmdeploy": ("mmdeploy", mmdeploy(), "letterbox", {}),
    "YOLOv7 for TensorRT": ("tensorrt", counted(), "letterbox", {}),
    "TensorRT's own names": (
        "tensorrt",
        counted("detection_boxes", "detection_classes", "detection_scores", "num_detections"),
        "letterbox",
        {},
    ),
    "without names": ("tensorrt", dict(zip("abcd", counted().values(), strict=True)), "letterbox", {}),
    "YOLO-NAS, batch": ("tensorrt", GROUPED, "letterbox", {"kind": TensorProto.UINT8}),
    "YOLO-NAS, flat": (
        "yolo-nas-rows",
        {"graph2_flat_predictions": rows(NOUGHT, CORNERS[KEPT], SCORE, CLASS)},
        "letterbox",
        {"plain": ("graph2_flat_predictions",), "kind": TensorProto.UINT8},
    ),
    "YOLO-NAS without suppression": ("yolo-nas", yolo_nas(), "letterbox", {}),
    "PP-YOLOE without suppression": (
        "yolo-nas",
        {"boxes": yolo_nas()["913"], "scores": yolo_nas()["904"].T.copy()},
        "letterbox",
        {},
    ),
    "YOLOv7 end-to-end": (
        "yolov7",
        {"output": rows(NOUGHT, CORNERS[KEPT], CLASS, SCORE)},
        "letterbox",
        {"plain": ("output",)},
    ),
    "YOLOv5 with raw heads": ("yolov5", yolov5_with_heads(), "letterbox", {}),
    "YOLOX of logits": ("yolox", yolox_of_logits(), "letterbox", {}),
    "PP-YOLOE": (
        "paddle",
        {
            "multiclass_nms3_0.tmp_0": rows(CLASS, SCORE, CORNERS[KEPT]),
            "multiclass_nms3_0.tmp_2": np.array([3], np.int32),
        },
        "stretch",
        {"plain": ("multiclass_nms3_0.tmp_0", "multiclass_nms3_0.tmp_2")},
    ),
    "NanoDet": ("nanodet", nanodet(), "stretch", {}),
    "NanoDet-Plus": ("nanodet", nanodet((8, 16, 32, 64), 0), "stretch", {}),
    "NanoDet-g": ("nanodet-g", nanodet(bins=11), "letterbox", {}),
    "NanoDet-g, each stride apart": ("nanodet-g", nanodet_apart(11), "letterbox", {}),
    "FastestDet": ("fastestdet", fastestdet(), "stretch", {}),
    "FastestDet, a row a cell": ("fastestdet", fastestdet(flat=True), "stretch", {"plain": ("output",)}),
    "RF-DETR with masks": ("detr", masked_detr(), "stretch", {}),
    "boxes and logits": (
        "detr",
        {"boxes": np.maximum(detr()["dets"], [0, 0, 1e-3, 1e-3]).astype(np.float32), "logits": detr()["labels"]},
        "stretch",
        {},
    ),
    "D-FINE by Hugging Face": ("detr", hugging_face(), "stretch", {}),
}


@pytest.mark.parametrize("file", FILES)
def test_every_export_is_recognised_and_gives_its_people_to_the_pixel(tmp_path, file):
    layout, outputs, resize, said = FILES[file]
    detector = open_detector(save_constant(tmp_path / "d.onnx", outputs, metadata=NAMES, **said))
    assert (detector.layout, detector.person, detector.input.resize) == (layout, 0, resize)
    wide = np.zeros((HEIGHT, 2 * WIDTH, 3), np.uint8)
    scales = {"letterbox": [2, 2, 2, 2], "stretch": [2, 1, 2, 1]}[resize]
    expected = np.clip(CORNERS[:2] * scales, 0, [2 * WIDTH, HEIGHT, 2 * WIDTH, HEIGHT])
    for images, people in (([BLANK, BLANK], CORNERS[:2]), ([wide], expected)):
        for found in detector.detect(images):
            order = np.argsort(-found.scores)
            np.testing.assert_allclose(found.boxes[order], people, atol=0.05)
            np.testing.assert_allclose(found.scores[order], SCORES[:2], atol=1e-3)


def test_no_rows_for_a_picture_of_noise_are_told_by_their_names(tmp_path):
    none, images = np.zeros((0, 7), np.float32), [BLANK, BLANK]
    for name, layout in (("output", "yolov7"), ("graph2_flat_predictions", "yolo-nas-rows")):
        path = save_constant(tmp_path / "none.onnx", {name: none}, metadata=NAMES, plain=(name,))
        detector = open_detector(path)
        assert detector.layout == layout
        assert [len(found) for found in detector.detect(images)] == [0, 0]


def test_as_many_rows_as_pictures_are_not_taken_for_a_batch(tmp_path):
    outputs = {"output": rows(NOUGHT, CORNERS[KEPT], CLASS, SCORE)[:2]}
    detector = open_detector(save_constant(tmp_path / "two.onnx", outputs, metadata=NAMES, plain=("output",)))
    assert [len(found) for found in detector.detect([BLANK, BLANK])] == [2, 2]


def test_class_values_of_plain_yolos_may_be_logits_too(tmp_path):
    found = yolov8()["output0"]
    found[4:] = logit(found[4:])
    detector = open_detector(save_constant(tmp_path / "raw.onnx", {"output0": found}, metadata=NAMES))
    assert (detector.layout, detector.scores) == ("yolov8", "sigmoid")
    np.testing.assert_allclose(np.sort(detector.detect([BLANK])[0].scores), np.sort(SCORES[:2]), atol=1e-3)


def test_which_transformers_want_imagenets_colours_is_told_by_their_outputs(tmp_path):
    """D-FINE and RT-DETR take plain pixels, as Hugging Face exports them with logits of a sigmoid."""
    plain = open_detector(save_constant(tmp_path / "plain.onnx", hugging_face(), metadata=NAMES))
    assert plain.input.mean == (0.0, 0.0, 0.0)
    assert open_detector(save_constant(tmp_path / "rf.onnx", detr(), metadata=NAMES)).input.mean != plain.input.mean


def with_side_inputs(path, names):
    """PP-YOLOE gives boxes in pixels of the picture before ``scale_factor``, RT-DETR those of ``im_shape``."""
    model = onnx.load(path)
    factors = {"scale_factor": np.ones(2), "im_shape": np.array([HEIGHT, WIDTH])}
    row = next(node for node in model.graph.node if "multiclass_nms3_0.tmp_0" in node.output)
    row.output[0] = "rows"
    last = "rows"
    for name in names:
        model.graph.input.insert(0, helper.make_tensor_value_info(name, FLOAT, ["n", 2]))
        constants = {f"{name}_is": factors[name].astype(np.float32), f"{name}_axes": np.array([0, 1])}
        model.graph.initializer.extend(onnx.numpy_helper.from_array(v, k) for k, v in constants.items())
        model.graph.node.extend([
            helper.make_node("Div", [name, f"{name}_is"], [f"{name}_share"]),
            helper.make_node("ReduceProd", [f"{name}_share", f"{name}_axes"], [f"{name}_one"], keepdims=0),
            helper.make_node("Mul", [last, f"{name}_one"], [f"rows_{name}"]),
        ])  # fmt: skip
        last = f"rows_{name}"
    model.graph.node.append(helper.make_node("Identity", [last], ["multiclass_nms3_0.tmp_0"]))
    onnx.save(model, path)
    return path


@pytest.mark.parametrize("names", [("scale_factor",), ("scale_factor", "im_shape")])
def test_the_inputs_of_paddle_are_filled_so_that_boxes_are_in_pixels_of_the_input(tmp_path, names):
    _, outputs, _, said = FILES["PP-YOLOE"]
    path = with_side_inputs(save_constant(tmp_path / "pp.onnx", outputs, metadata=NAMES, **said), names)
    detector = open_detector(path)
    assert detector.layout == "paddle"
    large = np.zeros((3 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    np.testing.assert_allclose(detector.detect([large])[0].boxes, CORNERS[:2] * [2, 3, 2, 3], atol=1e-3)


def with_input(path, name, kind, shape):
    model = onnx.load(path)
    model.graph.input.append(helper.make_tensor_value_info(name, kind, shape))
    onnx.save(model, path)
    return path


def test_a_mask_of_the_picture_is_filled_and_unknown_inputs_are_refused(tmp_path):
    def file(name, kind, shape):
        return with_input(save_constant(tmp_path / "d.onnx", hugging_face(), metadata=NAMES), name, kind, shape)

    assert len(open_detector(file("pixel_mask", INT64, ["n", "h", "w"])).detect([BLANK])[0]) == 2
    assert len(open_detector(file("pixel_mask", INT64, ["n", 64, 64])).detect([BLANK])[0]) == 2
    two = r"expected one picture as input, got images batchx3x64x96 and thermal nx3x64x96; export a network of one"
    with pytest.raises(RequestError, match=two):
        open_detector(file("thermal", FLOAT, ["n", 3, HEIGHT, WIDTH]))
    with pytest.raises(RequestError, match=r"beside it at most scale_factor, .*, got prompt \('n', 77\)"):
        open_detector(file("prompt", FLOAT, ["n", 77]))


# Centre, width, height and angle: one stands, one lies to the right, one over it, and one of another class.
TURNED = np.array([
    [30, 32, 10, 30, 0.3], [65, 30, 36, 12, 0.2], [65, 30, 34, 12, 0.25], [50, 40, 8, 8, 0.0]
], dtype=np.float32)  # fmt: skip
UPRIGHT = TURNED[:2].astype(np.float64)
UPRIGHT[1] = [65, 30, 12, 36, 0.2 - np.pi / 2]  # the same box with the longer side as its height
OBB = {**NAMES, "task": "obb"}


def obb():
    found = np.zeros((len(cells()), 8), np.float32)
    found[:4] = np.concatenate([TURNED[:, :4], PER_CLASS, TURNED[:, 4:]], axis=1)
    return {"output0": found.T.copy()}


def obb_suppressed():
    found = np.zeros((300, 7), np.float32)
    found[:3] = rows(TURNED[KEPT, :4], SCORE, CLASS, TURNED[KEPT, 4:])
    return {"output0": found}


@pytest.mark.parametrize(("layout", "outputs"), [("obb", obb()), ("obb-suppressed", obb_suppressed())])
def test_turned_boxes_come_with_their_angles_or_as_upright_boxes_about_them(tmp_path, layout, outputs):
    path = save_constant(tmp_path / "obb.onnx", outputs, metadata=OBB)
    turned = open_detector(path, turned=True)
    assert turned.layout == layout
    large = np.zeros((2 * HEIGHT, 2 * WIDTH, 3), np.uint8)
    for scale, found in zip((1, 2), turned.detect([BLANK, large]), strict=True):
        half = (found.boxes[:, 2:] - found.boxes[:, :2]) / 2
        middle = (found.boxes[:, :2] + found.boxes[:, 2:]) / 2
        np.testing.assert_allclose(middle, scale * UPRIGHT[:, :2], atol=1e-3)
        np.testing.assert_allclose(2 * half, scale * UPRIGHT[:, 2:4], atol=1e-3)
        np.testing.assert_allclose(found.angles, UPRIGHT[:, 4], atol=1e-5)
        given = np.column_stack([middle, 2 * half, found.angles]) / [scale, scale, scale, scale, 1]
        np.testing.assert_allclose(np.diag(rotated_iou(given, TURNED[:2].astype(np.float64))), 1, atol=1e-3)
    turned.check.tell()  # no box counts as outside the picture
    upright = open_detector(path).detect([BLANK])[0]
    assert upright.angles is None
    half = np.abs([10 * np.cos(0.3) + 30 * np.sin(0.3), 30 * np.cos(0.3) + 10 * np.sin(0.3)]) / 2
    np.testing.assert_allclose(upright.boxes[0], [*(TURNED[0, :2] - half), *(TURNED[0, :2] + half)], atol=1e-3)


def test_turned_boxes_are_not_stretched(tmp_path):
    path = save_constant(tmp_path / "obb.onnx", obb(), metadata=OBB)
    with pytest.raises(RequestError, match=r"turned boxes .* leave `detector_options\.resize` out"):
        open_detector(path, options=DetectorOptions(resize="stretch"))


def test_what_no_layout_fits_is_shown_with_what_would_read_it(tmp_path):
    path = save_constant(tmp_path / "odd.onnx", {"heatmap": np.ones((7, 9), np.float32)})
    with pytest.raises(RequestError) as caught:
        open_detector(path)
    for words in ("heatmap (7, 9)", "input is 96x64", "`detector_options.layout` yolov8 or", "would read these shapes"):
        assert words in str(caught.value)
    path = save_constant(tmp_path / "odder.onnx", {"heatmap": np.ones((3, 4, 5, 6), np.float32)})
    with pytest.raises(RequestError, match=r"heatmap \(3, 4, 5, 6\) are of no .*; in Python, give a function"):
        open_detector(path)


def test_names_that_are_not_those_of_the_classes_are_refused(tmp_path):
    path = save_constant(tmp_path / "d.onnx", yolov8())
    with pytest.raises(RequestError, match=r"as many classes as .* have, 3 \(layout yolov8\), got 2"):
        open_detector(path, options=DetectorOptions(classes=("person", "car")))
    with pytest.raises(ValueError, match=r"`detector_options\.classes`: expected each name once, got 'car' twice"):
        DetectorOptions(classes=("person", "car", "car"))
