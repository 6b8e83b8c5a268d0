"""A box that shows what stood there before is told from one that shows the target."""

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.single import seen_before
from tsuiseki.tracking.single.seen_before import SeenBefore

BACKGROUND = np.random.default_rng(0).integers(0, 255, (80, 200, 3), dtype=np.uint8)
TARGET = np.random.default_rng(1).integers(0, 255, (30, 20, 3), dtype=np.uint8)


def frame(x):
    image = BACKGROUND.copy()
    image[20:50, x : x + 20] = TARGET
    return image


def box(x):
    return np.array([x, 20.0, x + 20, 50.0])


@pytest.fixture(autouse=True)
def _looks_back(monkeypatch):
    monkeypatch.setattr(seen_before, "BACK", (2, 4, 8))
    monkeypatch.setattr(seen_before, "TURNS", 1)


def looks(places, boxes):
    """Of a target at ``places`` and boxes at ``boxes``."""
    witness = SeenBefore()
    return [witness.look(frame(x), box(at)) for x, at in zip(places, boxes, strict=True)]


def test_a_box_on_a_moving_target_shows_nothing_that_was_there():
    xs = list(range(10, 170, 8))
    assert not any(looks(xs, xs))


def test_a_box_on_a_standing_target_is_not_taken_for_background():
    assert not any(looks([60] * 10, [60] * 10))


def test_a_box_that_stays_behind_shows_what_was_in_view_before(monkeypatch):
    """The target walks on. What the box shows from then on was in view until the target came, eight looks ago."""
    places = [*range(10, 98, 8), *range(98, 178, 8)]
    boxes = [*range(10, 98, 8), *[98] * 10]
    said = looks(places, boxes)
    assert not any(said[:13])
    assert all(said[14:])
    # In turn it is seen a look later at most, and from then on in every look.
    first = said.index(True)
    monkeypatch.setattr(seen_before, "TURNS", 2)
    in_turn = looks(places, boxes)
    assert in_turn.index(True) - first in (0, 1)
    assert all(in_turn[in_turn.index(True) :])


def test_a_small_box_at_the_border_is_no_match():
    assert looks([0] * 6, [-18] * 6) == [False] * 6


def test_large_boxes_are_reduced_and_found_all_the_same(monkeypatch):
    monkeypatch.setattr(seen_before, "BACK", (1,))
    witness = SeenBefore()
    coarse = [cv2.resize(frame(x)[::5, ::5], (1200, 480), interpolation=cv2.INTER_CUBIC) for x in (10, 15)]
    assert not witness.look(coarse[0], 6 * box(10))
    assert witness.look(coarse[1], 6 * box(90) + 3)


def test_halves_that_are_alike_are_looked_at_in_full(monkeypatch):
    """A smooth background stays alike at half the size, so that the screen changes no verdict."""
    smooth = cv2.GaussianBlur(BACKGROUND, (0, 0), 3)
    places, boxes = [*range(10, 98, 8), *range(98, 178, 8)], [*range(10, 98, 8), *[98] * 10]
    said = []
    for screen in (-1.0, 0.7):
        monkeypatch.setattr(seen_before, "SCREEN", screen)
        witness = SeenBefore()
        frames = []
        for x in places:
            frames.append(smooth.copy())
            frames[-1][20:50, x : x + 20] = TARGET
        said.append([witness.look(image, box(at)) for image, at in zip(frames, boxes, strict=True)])
    assert said[0] == said[1]
    assert any(said[0])
