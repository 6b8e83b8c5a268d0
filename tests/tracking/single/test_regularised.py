"""The spatially regularised correlation filter, and how it takes to new sizes."""

import numpy as np
import pytest

from tests.tracking.single.moving_texture import clip, run, walk
from tsuiseki.tracking.single import regularised
from tsuiseki.tracking.single.regularised import Model, RegularisedSettings, RegularisedTracker


@pytest.mark.parametrize("growth", [0.6, 1.7])
def test_the_regularised_filter_follows_growing_and_shrinking(growth):
    sizes = growth ** np.linspace(0, 1, 50)
    images, boxes = clip(np.column_stack([np.linspace(70, 130, 50), np.full(50, 80.0)]), sizes=sizes)
    tracker = RegularisedTracker()
    run(tracker, images, boxes[0])
    # sizes are 3 % apart, and what was learnt of the sizes before holds them back
    assert tracker.target.size == pytest.approx(growth, rel=0.15)


def test_one_size_is_kept_where_no_others_are_tried():
    images, boxes = clip(walk(10))
    for seen in run(RegularisedTracker(RegularisedSettings(sizes=1)), images, boxes[0]):
        np.testing.assert_allclose(seen.box[2:] - seen.box[:2], boxes[0, 2:] - boxes[0, :2])


@pytest.mark.slow
def test_a_size_that_the_size_filter_does_not_see_is_seen_by_the_colours(monkeypatch):
    """It shrinks at once by more than the filter's five steps of 3 %; without the far look its size stays."""
    images, boxes = clip(walk(40), sizes=[1.0] * 12 + [0.6] * 28)
    found = []
    for margin in (regularised.SIZE_MARGIN, np.inf):
        monkeypatch.setattr(regularised, "SIZE_MARGIN", margin)
        monkeypatch.setattr(regularised, "SIZE_BY_AREA", 2.0)
        tracker = RegularisedTracker()
        run(tracker, images, boxes[0])
        found.append(tracker.target.size)
    assert found[0] == pytest.approx(0.6, rel=0.1)
    assert found[1] > 0.75


@pytest.mark.parametrize(("width", "height"), [(6, 9), (24, 36), (300, 450), (4, 40), (900, 30)])
def test_the_regularised_window_does_not_grow_with_the_target(width, height):
    model = Model.of(RegularisedSettings(), width, height)
    assert max(model.shape) == 24
    assert min(model.shape) >= 4
    assert (np.array(model.shape[::-1]) * model.cell_pixels(1) >= [width, height]).all()
