"""One trial of every network before the first frame: it ends, and several at once come out as one at a time."""

from __future__ import annotations

import warnings
from time import monotonic

import numpy as np
import onnx
import pytest
from onnx import helper

from tests.tracking.association.test_affinity import CARD, write_iou_model
from tests.tracking.conftest import save_action
from tests.tracking.features.faulty_onnx import BATCH_FAULTS, add_endless_loop, spoil_batch
from tests.tracking.features.test_exported import fake_appearance, fake_detector
from tests.tracking.features.test_foreign_appearance import RAW, mean_colour
from tests.tracking.features.test_foreign_detector import CORNERS, LAYOUTS, NAMES, SCORES, mean_colour_detector, saved
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH
from tsuiseki.tracking import onnx as networks
from tsuiseki.tracking.association.costs import PairFeatures
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.features import exported, foreign_detector
from tsuiseki.tracking.features.action import ActionRecogniser
from tsuiseki.tracking.features.exported import Appearance, ForeignAppearance, open_detector

BLANK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
ONE_AT_A_TIME = "gives for two {} at once something else .* gets one at a time"
# TensorFlow's file counts its rows, and torchvision's has no axis of pictures.
BATCHED = [name for name in LAYOUTS if name not in ("tensorflow", "torchvision")]


@pytest.mark.parametrize("fault", ["first only", "refuses", "weaker"])
@pytest.mark.parametrize("layout", BATCHED)
def test_a_detector_that_is_wrong_in_a_batch_gets_one_picture_at_a_time_and_that_is_said(tmp_path, layout, fault):
    path = spoil_batch(saved(tmp_path, layout, metadata=NAMES), fault)
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("pictures")):
        detector = open_detector(path)
    for found in detector.detect([BLANK] * 3):
        order = np.argsort(-found.scores)
        np.testing.assert_allclose(found.boxes[order], CORNERS[:2], atol=1e-3)
        np.testing.assert_allclose(found.scores[order], SCORES[:2], atol=1e-3)


@pytest.mark.parametrize("fault", BATCH_FAULTS)
def test_a_detector_that_confuses_its_pictures_gets_one_at_a_time(tmp_path, fault):
    """Its score is the mean colour, so that pictures differ."""
    path = spoil_batch(mean_colour_detector(tmp_path / "m.onnx"), fault)
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("pictures")):
        detector = open_detector(path, 0.1)
    images = [np.full((HEIGHT, WIDTH, 3), level, np.uint8) for level in (250, 100)]
    scores = [found.scores.round(2).tolist() for found in detector.detect(images)]
    assert scores == [[0.98], [0.39]]


@pytest.mark.parametrize("layout", BATCHED)
def test_a_detector_that_is_right_in_a_batch_gets_several_at_once(tmp_path, layout):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        detector = open_detector(saved(tmp_path, layout, metadata=NAMES))
    calls, call = [], detector._call
    detector._call = lambda images: calls.append(len(images)) or call(images)
    assert [len(found) for found in detector.detect([BLANK] * 3)] == [2, 2, 2]
    assert calls == [3]


def in_the_dark(path):
    """Change a detector so that it gives nothing but zeros for pictures that are not nearly black."""
    model = onnx.load(path)
    (name,) = (output.name for output in model.graph.output)
    node = next(node for node in model.graph.node if name in node.output)
    node.output[0] = "rows_lit"
    limit = onnx.numpy_helper.from_array(np.float32(0.01), "limit")
    rank = onnx.numpy_helper.from_array(np.array([-1, 1, 1]), "rank")
    model.graph.initializer.extend([limit, rank])
    model.graph.node.extend([
        helper.make_node("Less", ["mean", "limit"], ["dark"]),
        helper.make_node("Cast", ["dark"], ["dark_number"], to=onnx.TensorProto.FLOAT),
        helper.make_node("Reshape", ["dark_number", "rank"], ["dark_rows"]),
        helper.make_node("Mul", ["rows_lit", "dark_rows"], [name]),
    ])  # fmt: skip
    onnx.save(model, path)
    return path


def test_where_noise_shows_nobody_the_first_frames_with_people_decide(tmp_path):
    bright = np.full_like(BLANK, 200)
    good = open_detector(in_the_dark(saved(tmp_path, "yolo-suppressed", metadata=NAMES)))
    bad_path = spoil_batch(in_the_dark(saved(tmp_path, "yolo-suppressed", metadata=NAMES)), "weaker")
    bad = open_detector(bad_path)
    for detector in (good, bad):
        assert [len(found) for found in detector.detect([bright, bright])] == [0, 0]
        assert detector._together is None
    assert [len(found) for found in good.detect([BLANK, BLANK])] == [2, 2]
    assert good._together
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("pictures")):
        assert [len(found) for found in bad.detect([BLANK, BLANK])] == [2, 2]
    np.testing.assert_allclose(np.sort(bad.detect([BLANK, BLANK])[1].scores), np.sort(SCORES[:2]), atol=1e-3)


def describing(network, levels=((250, 10, 10), (10, 250, 10), (10, 10, 250))):
    """Features of three crops of plain colours."""
    image = np.concatenate([np.full((40, 40, 3), level, np.uint8) for level in levels], axis=1)
    boxes = np.array([[40 * n, 0, 40 * n + 40, 40.0] for n in range(len(levels))])
    return network.describe(image, boxes)


@pytest.mark.parametrize("fault", [fault for fault in BATCH_FAULTS if fault != "weaker"])
@pytest.mark.parametrize("kind", ["others", "ours"])
def test_an_appearance_that_is_wrong_in_a_batch_gets_one_crop_at_a_time_and_that_is_said(tmp_path, kind, fault):
    def opened(path):
        return ForeignAppearance(path, options=RAW) if kind == "others" else Appearance(path)

    save = mean_colour if kind == "others" else fake_appearance
    expected = describing(opened(save(tmp_path / "good.onnx")))
    assert (np.abs(expected.argmax(axis=1) - [0, 1, 2]) == 0).all()
    path = spoil_batch(save(tmp_path / "bad.onnx"), fault)
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("crops")):
        network = opened(path)
    np.testing.assert_allclose(describing(network), expected, atol=1e-5)


def pairs():
    """Overlaps of three pairs of detections."""
    plain = dict.fromkeys(PairFeatures.__dataclass_fields__, np.zeros(3))
    return PairFeatures(**plain | {"iou": np.array([0.2, 0.5, 0.9]), "gap": np.ones(3)})


@pytest.mark.parametrize("fault", ["first only", "refuses", "weaker", "swapped"])
def test_an_affinity_that_is_wrong_in_a_batch_gets_one_pair_at_a_time_and_that_is_said(tmp_path, fault):
    path = spoil_batch(write_iou_model(tmp_path / "a.onnx", CARD), fault)
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("pairs")):
        affinity = Affinity(path)
    np.testing.assert_allclose(affinity.probability(pairs()), [0.2, 0.5, 0.9], atol=1e-6)


def test_a_stream_of_actions_that_is_wrong_in_a_batch_gets_one_crop_at_a_time(tmp_path):
    save_action(tmp_path / "good.onnx", "rgb_local")
    save_action(tmp_path / "bad.onnx", "rgb_local")
    image = np.concatenate([np.full((40, 40, 3), level, np.uint8) for level in (250, 10, 120)], axis=1)
    boxes = np.array([[40 * n, 0, 40 * n + 40, 40.0] for n in range(3)])
    expected = ActionRecogniser([tmp_path / "good.onnx"]).recognise([image], boxes)
    spoil_batch(tmp_path / "bad.onnx", "first only")
    with pytest.warns(InputWarning, match=ONE_AT_A_TIME.format("crops")):
        recogniser = ActionRecogniser([tmp_path / "bad.onnx"])
    np.testing.assert_allclose(recogniser.recognise([image], boxes), expected, atol=1e-6)


def files(folder):
    """A network of each kind, and what opens it."""
    save_action(folder / "action.onnx", "rgb_local")
    return {
        "detector of others": (saved(folder, "yolov8", metadata=NAMES), open_detector),
        "detector": (fake_detector(folder / "d.onnx"), open_detector),
        "appearance of others": (mean_colour(folder / "f.onnx"), lambda path: ForeignAppearance(path, options=RAW)),
        "appearance": (fake_appearance(folder / "a.onnx"), Appearance),
        "affinity": (write_iou_model(folder / "p.onnx", CARD), Affinity),
        "action": (folder / "action.onnx", lambda path: ActionRecogniser([path])),
    }


@pytest.mark.parametrize(
    "kind", ["detector of others", "detector", "appearance of others", "appearance", "affinity", "action"]
)
def test_a_network_that_never_ends_is_stopped_in_its_trial_and_that_is_said(tmp_path, monkeypatch, kind):
    for module in (networks, exported, foreign_detector):
        monkeypatch.setattr(module, "TRIAL_SECONDS", 1.0)
    path, opened = files(tmp_path)[kind]
    opened(path)
    start = monotonic()
    with pytest.raises(RequestError, match=r"expected the network to end within 1 s, .*export it again$"):
        opened(add_endless_loop(path))
    assert monotonic() - start < 5
