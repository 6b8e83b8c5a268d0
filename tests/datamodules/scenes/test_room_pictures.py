"""Generated views of ceiling cameras: boxes about people, the same picture for the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.datamodules.scenes import room_pictures
from tsuiseki.datamodules.scenes.room_pictures import panorama_picture
from tsuiseki.datamodules.scenes.things.room import chair, table

SMALL = 160, 120


@pytest.fixture(autouse=True)
def crowded(monkeypatch):
    monkeypatch.setattr(room_pictures, "PEOPLE", (5, 8))
    monkeypatch.setattr(room_pictures, "SAMPLES", 1)


def test_the_same_seed_gives_the_same_picture():
    first, again = (panorama_picture(np.random.default_rng(4), *SMALL) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    other = panorama_picture(np.random.default_rng(5), *SMALL)
    assert not np.array_equal(first[0], other[0])


def test_boxes_lie_in_the_picture_and_hold_something_seen():
    count = 0
    for seed in range(8):
        image, boxes, visibility = panorama_picture(np.random.default_rng(seed), *SMALL)
        assert image.shape == (120, 160, 3)
        assert (boxes[:, :2] >= 0).all()
        assert (boxes[:, 2:] <= [160, 120]).all()
        assert ((visibility > 0) & (visibility <= 1)).all()
        count += len(boxes)
    assert count >= 16


def test_nobody_is_asked_for_and_nobody_is_there(monkeypatch):
    monkeypatch.setattr(room_pictures, "PEOPLE", (0, 0))
    for seed, downward in ((0, 0.0), (1, 1.0)):
        monkeypatch.setattr(room_pictures, "DOWNWARD", downward)
        _, boxes, _ = panorama_picture(np.random.default_rng(seed), *SMALL)
        assert len(boxes) == 0


def test_a_sitter_has_the_back_of_the_chair_behind():
    thing = chair(np.random.default_rng(0), np.array([2.0, 3.0]), 0.0)
    back = thing.solids.start[:, :2][thing.solids.start[:, 2] > 0.6]
    assert (back[:, 0] < 2.0 + 0.31).all()
    assert back[:, 0].min() < 1.85
    top = table(np.random.default_rng(0), np.array([2.0, 3.0]), 0.0, (0.4, 0.7)).solids
    assert np.isclose(top.start[:, 2].min(), 0.36, atol=0.36)
