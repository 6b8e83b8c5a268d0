"""RF-DETR has a class more than it has names, and a sigmoid: what the user says of it makes it no worse."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.tracking.features.test_foreign_detector import CORNERS, SIDES, softmax_detr
from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.layout_recognition import coco_names
from tsuiseki.tracking.types.class_choice import ClassChoice

BLANK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
CASES = Path(os.environ.get("TSUISEKI_DATA", "../shared/data")) / "cases" / "round2" / "05-onnx"
NAMES = ("person", "dog", "car")
PEOPLE = [0.9, 0.8]


def rf_detr(classes, *, person=0, last=-5.0, seed=0):
    """Two people of 300 queries; the class without a name has logits of about ``last``, which may win many."""
    rng = np.random.default_rng(seed)
    logits = rng.normal(-6, 0.5, (300, classes + 1)).astype(np.float32)
    logits[:, -1] = rng.normal(last, 0.3, 300)
    boxes = np.concatenate([rng.uniform(0.2, 0.8, (300, 2)), rng.uniform(0.05, 0.2, (300, 2))], axis=1)
    corners = CORNERS[:2] / SIDES
    boxes[:2] = np.concatenate([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]], axis=1)
    logits[[0, 1], person] = np.log([9, 4])
    return {"dets": boxes.astype(np.float32), "labels": logits}


def people(path, **options):
    found = open_detector(path, options=DetectorOptions(**options)).detect([BLANK])[0]
    return np.sort(found.scores)[::-1].round(3).tolist()


# Shares of the queries that the class without a name wins: few, some, nearly all.
@pytest.mark.parametrize("last", [-9.0, -6.0, -5.5, -4.0])
@pytest.mark.parametrize("classes", [1, 3])
def test_scores_are_those_of_a_sigmoid_whoever_names_the_classes(tmp_path, classes, last):
    names, outputs = NAMES[:classes], rf_detr(classes, last=last)
    plain = save_constant(tmp_path / "plain.onnx", outputs, shape=(1, 3, HEIGHT, WIDTH))
    said = {"names": str([*names])}
    named = save_constant(tmp_path / "named.onnx", outputs, shape=(1, 3, HEIGHT, WIDTH), metadata=said)
    answers = [
        {"person": 0},
        {"classes": names},
        {"classes": names, "person": 0},
        {"person": 0, "scores": "sigmoid"},
        {"person": 0, "layout": "detr"},
        {"classes": names, "scores": "sigmoid", "layout": "detr", "height": HEIGHT, "width": WIDTH},
    ]
    for path, options in [(plain, options) for options in answers] + [(named, options) for options in ({}, *answers)]:
        assert people(path, **options) == PEOPLE, (path.name, options)
    with pytest.raises(RequestError, match=rf"{classes + 1} classes without names; say which one is people"):
        open_detector(plain)


def test_a_name_too_few_does_not_make_a_softmax_of_outputs_of_other_names(tmp_path):
    outputs = rf_detr(3, last=-9.0)
    other = save_constant(tmp_path / "o.onnx", {"pred_boxes": outputs["dets"], "pred_logits": outputs["labels"]})
    assert people(other, classes=NAMES) == people(other, person=0) == PEOPLE
    unclear = rf_detr(3, last=-4.0)
    path = save_constant(tmp_path / "u.onnx", {"pred_boxes": unclear["dets"], "pred_logits": unclear["labels"]})
    for options in ({"person": 0}, {"classes": NAMES}):
        with pytest.raises(RequestError, match=r"of a sigmoid or of a softmax; say which with"):
            people(path, **options)
        assert people(path, **options, scores="sigmoid") == PEOPLE


def test_a_softmax_that_noise_shows_stays_one_whatever_its_outputs_are_called(tmp_path):
    outputs = softmax_detr()
    renamed = {"labels": outputs["logits"], "dets": outputs["pred_boxes"]}
    for names in (outputs, renamed):
        path = save_constant(tmp_path / "s.onnx", names)
        for options in ({"person": 0}, {"classes": NAMES}):
            assert open_detector(path, options=DetectorOptions(**options)).scores == "softmax"


@pytest.mark.parametrize("count", [80, 90])
def test_cocos_names_without_its_gaps_do_not_move_the_class_of_people(tmp_path, count):
    """The 91 outputs count as COCO does, from 1 and with gaps; who lists 80 or 90 names means the same."""
    path = save_constant(tmp_path / "coco.onnx", rf_detr(90, person=1))
    own = coco_names(91)
    names = tuple(own.values()) if count == 80 else tuple(own.get(n, f"gap {n}") for n in range(1, 91))
    assert people(path) == people(path, classes=names) == people(path, person=1) == PEOPLE
    detector = open_detector(path, options=DetectorOptions(classes=names), classes=ClassChoice(["car", "toothbrush"]))
    assert detector.wanted == {3: "car", 90: "toothbrush"}


@pytest.mark.integration
@pytest.mark.parametrize("file", ["rfdetr_1", "rfdetr_3", "rfdetr_1_named", "rfdetr_3_named", "dyn_baked", "dyn_ok"])
def test_the_collected_files_give_two_people(file):
    if not CASES.is_dir():
        pytest.skip("needs the collected cases of ../shared/data")
    names = {"classes": NAMES[: int(file[7])]} if file.startswith("rfdetr") else {}
    images = [np.random.default_rng(n).integers(0, 256, (320, 320, 3), dtype=np.uint8) for n in range(3)]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        detectors = [open_detector(CASES / f"{file}.onnx", options=DetectorOptions(**names))]
        detectors += [open_detector(CASES / f"{file}.onnx")] if "named" in file else []
    for detector in detectors:
        for found in detector.detect(images):
            np.testing.assert_allclose(np.sort(found.scores), [0.8, 0.9], atol=1e-3)
    assert [("pictures at once" in str(warning.message)) for warning in said] == ([True] if file == "dyn_baked" else [])
