"""The flow with default costs and the shipped appearance on real pedestrians: nothing was learnt or chosen on these."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.people.contract import run_tracker, shifted
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.weights import shipped

FIRST, LAST = 300, 399


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("decide_every", [None, 1.0])
def test_default_costs_and_shipped_appearance_on_pets(data_folder: Path, decide_every: float | None) -> None:
    sequence = read_sequence(data_folder / "mot" / "PETS09-S2L1-first")
    found = read_detections(sequence.detections_path, sequence.length)[FIRST : LAST + 1]
    appearance = Appearance(shipped("appearance_people"))
    described = []
    for path, detections in zip(sequence.images[FIRST : LAST + 1], found, strict=True):
        image = np.asarray(cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB), dtype=np.uint8)
        described.append(detections.with_features(appearance.describe(image, detections.boxes)))
    tracker = FlowTracker(FlowSettings(decide_every=decide_every), frame_rate=sequence.frame_rate)
    tracks = [shifted(t, FIRST) for t in run_tracker(described, tracker)]
    scores = evaluate_sequence(read_ground_truth(sequence.ground_truth_path).between(FIRST, LAST), tracks)
    assert scores.hota >= 0.59
    assert scores.mota >= 0.84
    assert scores.idf1 >= 0.90
