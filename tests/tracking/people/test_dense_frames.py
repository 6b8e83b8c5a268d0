"""A thousand boxes a frame: linked with what is near, in bounded time and memory; heaps of boxes are refused."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.nearby import AROUND, DENSE, NEAREST, dense_reach, nearest
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections


def crowd(count: int, frames: int, size: tuple[float, float]) -> list[Detections]:
    """People at random places of a picture of 1280 x 720 who walk straight on."""
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 1, (count, 2)) * (np.array([1280.0, 720]) - size)
    speed = rng.normal(0, 1.0, (count, 2))
    corners = [place + t * speed + rng.normal(0, 0.3, (count, 2)) for t in range(frames)]
    return [Detections(np.concatenate([low, low + size], axis=1), np.full(count, 0.9)) for low in corners]


@pytest.mark.slow
def test_a_dense_crowd_is_linked_with_what_is_near() -> None:
    tracker = FlowTracker(frame_rate=25.0, size=(1280, 720))
    for found in crowd(700, 6, (20.0, 50.0)):
        tracker.update(found)
    tracks = tracker.tracks()
    assert len(tracks) == pytest.approx(700, abs=7)
    assert np.mean([len(track) == 6 for track in tracks]) > 0.98
    # Eight a gap of one to five frames, not all within reach.
    assert len(tracker._flow.window.links.tail) <= NEAREST * 700 * 15


def test_heaps_are_refused_in_a_line() -> None:
    tracker = FlowTracker(frame_rate=25.0)
    (found,) = crowd(1000, 1, (100.0, 220.0))
    with pytest.raises(RequestError, match=r"1000 boxes of a frame cover their place 2[0-9] times over.*suppress"):
        tracker.update(found)
    tracker.update(found.select(np.arange(DENSE)))


def test_reaches_are_cut_only_where_frames_are_dense() -> None:
    boxes = crowd(DENSE + 1, 1, (20.0, 50.0))[0].boxes
    frames = np.zeros(len(boxes), dtype=np.int64)
    assert dense_reach(frames[1:], boxes[1:]) is None
    assert dense_reach(frames[:0], boxes[:0]) is None
    reach = dense_reach(frames, boxes)
    assert reach is not None
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    around = (np.abs(middle[:, None] - middle[None]).max(axis=2) < reach).sum(axis=1)
    assert 0.7 * AROUND < np.mean(around) <= 1.1 * AROUND


def test_the_nearest_of_each_frame_are_kept() -> None:
    rng = np.random.default_rng(3)
    frames = np.repeat([0, 1, 2], [3, 40, 40])
    x, y = rng.uniform(0, 100, (2, len(frames)))
    pairs = [(a, b) for f in (1, 2) for a in range(3) for b in np.flatnonzero(frames == f)]
    i, j = (np.array(column) for column in zip(*pairs, strict=True))
    kept = set(zip(*(part.tolist() for part in nearest(i, j, frames, np.stack([x, y]))), strict=True))
    for a in range(3):
        for f in (1, 2):
            others = np.flatnonzero(frames == f)
            by = others[np.argsort((x[others] - x[a]) ** 2 + (y[others] - y[a]) ** 2)]
            assert {b for tail, b in kept if tail == a and frames[b] == f} == set(by[:NEAREST].tolist())
