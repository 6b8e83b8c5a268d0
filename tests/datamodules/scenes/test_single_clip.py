"""Generated clips: exact boxes, repeatable."""

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.datamodules.scenes import single_clip
from tsuiseki.datamodules.scenes.clip import write_clip
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import read_sequence

SMALL = SingleClipSettings(frames=8, width=160, height=120, person_height=(30, 31), passers=1, obstacles=1)


def test_a_clip_is_what_it_says() -> None:
    frames = list(SingleClip(SMALL, 0).frames())
    assert {image.shape for (image,), _ in frames} == {(120, 160, 3)}
    assert len(frames) == 8
    boxes, shares = (np.concatenate([getattr(truth, of) for _, truth in frames]) for of in ("boxes", "visibility"))
    assert ((shares >= 0) & (shares <= 1)).all()
    heights = boxes[:, 3] - boxes[:, 1]
    assert ((heights > 15) & (heights < 60)).all()


def test_the_same_seed_gives_the_same_clip_however_often_it_is_drawn() -> None:
    clip = SingleClip(SMALL, 5)
    for first, *others in zip(clip.frames(), list(clip.frames()), SingleClip(SMALL, 5).frames(), strict=False):
        for other in others:
            assert (first[0][0] == other[0][0]).all()
            assert (first[1].boxes == other[1].boxes).all()


def test_a_clip_is_written_as_a_sequence(tmp_path: Path) -> None:
    clip = SingleClip(SMALL, 2)
    sequence = read_sequence(write_clip(tmp_path / "clip", clip))
    assert (sequence.length, sequence.width, sequence.height) == (8, 160, 120)
    truth = read_ground_truth(sequence.ground_truth_path)
    assert truth.ids.tolist() == [1] * 8
    np.testing.assert_allclose(truth.boxes, np.concatenate([t.boxes for _, t in clip.frames()]), atol=0.01)


def test_boxes_hold_the_person(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without anything else in view, what differs between two worlds of one seed is the person."""
    monkeypatch.setattr(single_clip, "SHAKE", 0.0)
    alone = SingleClipSettings(frames=2, width=160, height=120, person_height=(40, 41), passers=0, obstacles=0)
    (image,), truth = next(SingleClip(alone, 3).frames())
    assert truth.visibility[0] == 1
    x1, y1, x2, y2 = truth.boxes[0].astype(int)
    assert image[y1:y2, x1:x2].astype(int).std() > 0
