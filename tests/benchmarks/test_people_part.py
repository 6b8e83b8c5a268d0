"""The people's part of the shipped detector, taught beside its branch and joined with it."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.detectors.long_training import HEIGHT, WIDTH
from benchmarks.detectors.people_part import first_stage, ignore_wide, join
from tsuiseki.datamodules.detector import IGNORED, PADDING, PERSON, DetectionBatch
from tsuiseki.tracking.features.exported import Detector as Exported
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.exporting.exported_weights import layout_of


def test_wide_boxes_are_ignored_but_those_that_the_border_cuts_off() -> None:
    boxes = torch.tensor([[[10.0, 10, 30, 60], [10, 10, 60, 40], [0, 10, 60, 40], [0, 0, 0, 0]]])
    labels = torch.tensor([[PERSON, PERSON, PERSON, PADDING]])
    ignore_wide(DetectionBatch(torch.zeros(1, 100, 120, 3, dtype=torch.uint8), boxes, labels))
    assert labels.tolist() == [[PERSON, IGNORED, PERSON, PADDING]]


@pytest.mark.slow
def test_the_shipped_detector_joined_with_its_own_branch_detects_what_it_did(tmp_path) -> None:
    whole, people, joined = shipped(PEOPLE_DETECTOR), tmp_path / "people.onnx", tmp_path / "joined.onnx"
    Detector(start=whole, height=HEIGHT, width=WIDTH).export(people, float16=True)
    join(people, whole, joined)
    image = np.random.default_rng(4).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    before, after = (Exported(file, 0.01, threads=1).detect([image])[0] for file in (whole, joined))
    assert len(before)
    np.testing.assert_allclose(after.boxes, before.boxes, atol=0.5)
    np.testing.assert_allclose(after.scores, before.scores, atol=0.01)
    assert layout_of(joined).card.settings.keys() == layout_of(whole).card.settings.keys()


def test_a_people_part_has_the_first_stage_that_the_branch_sees() -> None:
    people = Detector(start=shipped(PEOPLE_DETECTOR))
    layout = layout_of(shipped(PEOPLE_DETECTOR), branched=True)
    whole = Detector(start=shipped(PEOPLE_DETECTOR), **layout.arguments)
    for name, weight in first_stage(people).state_dict().items():
        assert torch.equal(weight, first_stage(whole).state_dict()[name])
