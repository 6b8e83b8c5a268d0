"""Fine-tuning: from the shipped detector, on labels beside pictures; a stopped one goes on."""

from __future__ import annotations

import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from tests.trainers.adapt import street
from tsuiseki.tracking.errors import Interrupted
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.frame_range import EVERY_FRAME
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt import learn_detector
from tsuiseki.trainers.adapt.learn_detector import CHECKPOINT, TorchDetector, fine_tune
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.track_labels import label
from tsuiseki.trainers.adapt.watch import HELD_OUT, Watched, watch, with_empty_view
from tsuiseki.trainers.detector import Detector
from tsuiseki.trainers.exporting.export import load_module
from tsuiseki.trainers.exporting.exported_weights import layout_of

TINY = AdaptSettings(steps=5, threads=1)


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few windows."""
    for name, value in {"BATCH_SIZE": 2, "GENERATED_PEOPLE": 3}.items():
        monkeypatch.setattr(learn_detector, name, value)


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Watched:
    folder = tmp_path_factory.mktemp("camera")
    video = watch(str(street.write_video(folder / "street")), EVERY_FRAME, folder / "kept", 20)
    tracks = [street.track_of(0), street.track_of(1)]
    labels = label(with_empty_view(video), tracks, [Detections.empty()] * 20)
    write_ground_truth(Path(video.folder) / "gt" / "gt.txt", labels.people)
    return video


@pytest.mark.slow
def test_a_stopped_training_goes_on(watched: Watched, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    start = shipped("detector_street")
    layout = layout_of(start)
    small = replace(layout, size=(128, 192))
    steps: list[int] = []
    step = Detector.training_step

    def counted(self: Detector, batch: Any, index: int) -> Tensor:
        steps.append(index)
        if len(steps) == 3:
            raise Interrupted(signal.SIGTERM)
        return step(self, batch, index)

    monkeypatch.setattr(Detector, "training_step", counted)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(Interrupted) as stopped:
        fine_tune(start, small, [watched], 1, 1, tmp_path, TINY)
    signal.signal(signal.SIGINT, before)  # Lightning ignores it from then on
    assert stopped.value.number == signal.SIGTERM
    assert not (tmp_path / CHECKPOINT).exists()
    checkpoint = fine_tune(start, small, [watched], 1, 1, tmp_path, TINY)
    # Two steps were done and saved; the third was not.
    assert len(steps) == 3 + 3
    module = load_module(Detector, checkpoint, layout.size)
    assert all(torch.isfinite(p).all() for p in module.parameters())
    found = TorchDetector(module).detect([watched.picture(0), watched.picture(3)])
    assert len(found) == 2
    assert all((d.boxes[:, 2] <= street.SIZE[0]).all() and (d.scores <= 1).all() for d in found)
    assert fine_tune(start, small, [watched], 1, 1, tmp_path, replace(TINY, seed=1)) == checkpoint
    assert len(steps) == 6
    assert np.isfinite(sum(d.scores.sum() for d in found))


def test_what_teaches_what_calibrates_and_what_judges_are_apart(
    watched: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []
    certain = (np.array([0.9, 0.2, 0.8, 0.1]), np.array([True, False, False, True]))
    monkeypatch.setattr(learn_detector, "matched_scores", lambda _, __, frames: asked.append(frames) or certain)
    learn_detector._calibration(TorchDetector.__new__(TorchDetector), [watched], (1, None))
    learnt = learn_detector._data([watched], layout_of(shipped("detector_street")), 1, 1, TINY)
    assert [source.frames for source in learnt.sources["train"]] == [(1, 15)]
    assert asked == [(16, 17)]
    assert watched.learnt(HELD_OUT) == 17
    assert len(watched.frames) == 20
