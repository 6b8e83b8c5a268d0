"""Generated clips: exact boxes, repeatable."""

import numpy as np

from tsuiseki.datamodules.scenes import single_clip
from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings

SMALL = SingleClipSettings(frames=8, width=160, height=120, person_height=(30, 31), passers=1, obstacles=1)


def test_a_clip_is_what_it_says():
    clip = SingleClip(np.random.default_rng(0), SMALL)
    assert clip.images.shape == (8, 120, 160, 3)
    assert clip.boxes.shape == (8, 4)
    assert ((clip.visibility >= 0) & (clip.visibility <= 1)).all()
    heights = clip.boxes[:, 3] - clip.boxes[:, 1]
    assert ((heights > 15) & (heights < 60)).all()


def test_the_same_seed_gives_the_same_clip():
    first, second = (SingleClip(np.random.default_rng(5), SMALL) for _ in range(2))
    assert (first.images == second.images).all()
    assert (first.boxes == second.boxes).all()


def test_boxes_hold_the_person(monkeypatch):
    """Without anything else in view, what differs between two worlds of one seed is the person."""
    monkeypatch.setattr(single_clip, "SHAKE", 0.0)
    alone = SingleClipSettings(frames=2, width=160, height=120, person_height=(40, 41), passers=0, obstacles=0)
    clip = SingleClip(np.random.default_rng(3), alone)
    assert clip.visibility[0] == 1
    x1, y1, x2, y2 = clip.boxes[0].astype(int)
    inside = clip.images[0][y1:y2, x1:x2].astype(int)
    assert inside.std() > 0
