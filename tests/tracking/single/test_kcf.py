"""KCF follows targets of any size that grow and shrink."""

import numpy as np
import pytest

from tests.tracking.single.moving_texture import SIZE, clip, overlaps, run, walk
from tsuiseki.tracking.filters.correlation_filters import respond
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.kcf import KcfTracker


@pytest.mark.parametrize("growth", [0.6, 1.7])
def test_scale_search_follows_growing_and_shrinking(growth):
    sizes = growth ** np.linspace(0, 1, 50)
    # it walks: a background that stays the same around a standing target holds the size by the 5 % that it must win by
    images, boxes = clip(np.column_stack([np.linspace(70, 130, 50), np.full(50, 80.0)]), sizes=sizes)
    tracker = KcfTracker(kcf.KcfSettings())
    run(tracker, images, boxes[0])
    # the sizes tried are 5 % apart, and a change of size must win by as much
    assert tracker.state.size == pytest.approx(growth, rel=0.15)


def test_of_two_changed_sizes_one_is_taken_and_not_both(monkeypatch):
    images, boxes = clip(walk(2))
    tracker = KcfTracker(kcf.KcfSettings())
    tracker.start(images[0], boxes[0])

    def both_better(bank, windows, kernel):
        responses = respond(bank, windows, kernel)
        return responses * np.array([0.5, 1.5, 2.0], dtype=np.float32)[:, None, None]

    monkeypatch.setattr(kcf, "respond", both_better)
    tracker.follow(images[1])
    assert tracker.state.size == pytest.approx(1.05)


@pytest.mark.parametrize(("width", "height"), [(6, 9), (24, 36), (300, 450), (4, 40), (900, 30)])
def test_template_size_does_not_depend_on_the_target(width, height):
    window = kcf.Kcf.of(kcf.KcfSettings(), width, height)
    assert max(window.shape) == 24
    assert min(window.shape) >= 4
    assert window.cell_pixels(1) == pytest.approx(2.5 * max(width, height) / 24)


@pytest.mark.parametrize("scale", [0.25, 4.0])
def test_tiny_and_large_targets_are_followed(scale):
    path, shape = walk(12) * scale, (int(SIZE[0] * scale), int(SIZE[1] * scale))
    images, boxes = clip(path, height=round(36 * scale), width=round(24 * scale), shape=shape)
    assert overlaps(run(KcfTracker(kcf.KcfSettings()), images, boxes[0]), boxes).mean() > 0.6


def test_grey_images_are_followed():
    images, boxes = clip(walk(12))
    grey = [np.repeat(image.mean(axis=2, keepdims=True).astype(np.uint8), 3, axis=2) for image in images]
    assert overlaps(run(KcfTracker(kcf.KcfSettings()), grey, boxes[0]), boxes).mean() > 0.75
