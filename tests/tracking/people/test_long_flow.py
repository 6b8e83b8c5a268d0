"""A flow of many hours lets go of tracks that have ended, and of what it has kept of them."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from tsuiseki.tracking.people import whole_flow
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections

RATE = 10.0


def walkers(frames: int, described: bool) -> list[Detections]:
    """Three lanes, on each of which the next walker comes 6 s after the one before has gone; one stays throughout."""
    rng, found = np.random.default_rng(0), []
    for t in range(frames):
        corner = [(40.0, 400.0)] + [(8.0 * (t % 180), 60.0 + 110 * lane) for lane in range(3) if t % 180 < 120]
        boxes = np.array([[x, y, x + 30, y + 80] for x, y in corner]) + rng.normal(0, 0.7, (len(corner), 4))
        kept = rng.random(len(boxes)) < 0.95
        features = np.eye(8)[[0, 1, 2, 3][: len(boxes)]] if described else None
        found.append(Detections(boxes, rng.uniform(0.6, 0.95, len(boxes)), features).select(kept))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("described", [False, True])
def test_tracks_are_those_of_the_whole(monkeypatch: pytest.MonkeyPatch, described: bool) -> None:
    found = walkers(2400, described)
    whole = FlowTracker(frame_rate=RATE, size=(1000, 500))
    monkeypatch.setattr(whole_flow, "RELEASE", 30.0)
    parts = FlowTracker(frame_rate=RATE, size=(1000, 500))
    for each in found:
        whole.update(each)
        parts.update(each)
    expected, got = whole.tracks(), parts.tracks()
    assert len(expected) == 1 + 3 * 14
    assert parts.facts()["tracks_finished_early"] > 20
    assert whole.facts()["tracks_finished_early"] == 0
    for one, other in zip(expected, got, strict=True):
        assert (one.id, one.frames.tolist()) == (other.id, other.frames.tolist())
        assert one.origin.tolist() == other.origin.tolist()
        assert np.abs(one.boxes - other.boxes).max() < 2
    assert parts.network() is None
    # Rows of who has gone are gone; asking changes nothing.
    assert len(parts._flow._rows) < 0.5 * sum(map(len, found))  # type: ignore[union-attr]
    assert [track.frames.tolist() for track in parts.tracks()] == [track.frames.tolist() for track in got]


@pytest.mark.slow
def test_memory_grows_with_the_boxes_by_few_bytes_each() -> None:
    tracker, count, kept = FlowTracker(frame_rate=RATE, size=(1000, 500)), 0, []
    tracemalloc.start()
    for number, each in enumerate(walkers(2400, described=False), 1):
        tracker.update(each)
        count += len(each)
        # All but the last seconds are decided then.
        if number % 800 == 0:
            kept.append((count, tracemalloc.get_traced_memory()[0]))
    tracemalloc.stop()
    boxes, memory = np.diff(kept, axis=0).T
    assert (memory / boxes < 400).all(), memory / boxes
