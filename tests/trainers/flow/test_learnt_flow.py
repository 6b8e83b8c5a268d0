"""The flow with costs learnt on frames 1-300 of PETS09-S2L1-first, scored on frames 301-400 only."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsuiseki.datamodules.video_pictures import read_image
from tsuiseki.tracking.association.learnt_costs import Affinity, FeatureSet
from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.features.exported import Appearance
from tsuiseki.tracking.formats.mot import read_detections, read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.people.contract import run_tracker, shifted
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.runs.options import OutputFile
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.affinity import AffinitySettings, AffinityVideo, fit_affinity

FIRST, LAST = 300, 399


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("features", ["extended", "thesis"])
def test_learnt_costs_reach_their_bars(data_folder: Path, tmp_path: Path, features: FeatureSet) -> None:
    """The appearance is the shipped one, which has seen generated people only."""
    network = shipped("appearance_people")
    sequence = read_sequence(data_folder / "mot" / "PETS09-S2L1-first")
    video = AffinityVideo(folders=[sequence.folder], frames=(1, 300), appearance=network)
    path = fit_affinity(
        video, OutputFile(out=tmp_path / "affinity.onnx"), AffinitySettings(features=features, trees=40)
    )
    affinity, appearance = Affinity(path, threads=1), Appearance(network, threads=1)
    found = read_detections(sequence.detections_path, sequence.length)
    described = [
        found[k].with_features(appearance.describe(read_image(sequence.images[k]), found[k].boxes))
        for k in range(FIRST, LAST + 1)
    ]
    tracker = FlowTracker(None, affinity, affinity.observation, frame_rate=sequence.frame_rate)
    tracks = run_tracker(described, tracker)
    truth = read_ground_truth(sequence.ground_truth_path).between(FIRST, LAST)
    scores = evaluate_sequence(truth, [shifted(track, FIRST) for track in tracks])
    assert scores.hota >= 0.58
    assert scores.mota >= 0.70
    assert scores.idf1 >= 0.86
