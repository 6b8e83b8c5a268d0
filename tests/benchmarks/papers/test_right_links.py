"""The right links over detections whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.papers.association import right_links
from tsuiseki.tracking.association.smoothing import fill_gaps
from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.types.labels import GroundTruth

LENGTH = 20


def at(person: int, frame: int) -> FloatArray:
    """Where a person is: everybody in a lane of their own, a step to the right a frame."""
    return np.array([5.0 * frame, 200.0 * person, 5.0 * frame + 40, 200.0 * person + 100])


def labels(people: int = 2) -> GroundTruth:
    frames, ids = np.repeat(np.arange(LENGTH), people), np.tile(np.arange(people), LENGTH)
    boxes = np.array([at(p, f) for f, p in zip(frames, ids, strict=True)])
    every = np.ones(len(frames), dtype=np.bool_)
    return GroundTruth(frames, ids, boxes, every, ~every, np.ones(len(frames)))


def seen(skipped: dict[int, range]) -> list[Detections]:
    """Detections of two people and somebody who is nobody, each person unseen for some frames."""
    found = []
    for frame in range(LENGTH):
        boxes = [at(p, frame) for p in (0, 1, 9) if frame not in skipped.get(p, ())]
        found.append(Detections(np.array(boxes), np.full(len(boxes), 0.8)))
    return found


@pytest.mark.parametrize(("longest", "tracks"), [(1, 3), (4, 3), (5, 2), (np.inf, 2)])
def test_right_links_reach_as_far_as_they_may(longest: float, tracks: int) -> None:
    """Unseen from frame 8 to 11, the next detection is five frames after the last."""
    found = right_links(seen({0: range(8, 12)}), labels(), longest)
    assert len(found) == tracks
    assert sum(map(len, found)) == 2 * LENGTH - 4
    assert evaluate_sequence(labels(), found, LENGTH).false_positives == 0


def test_filled_right_links_are_the_truth() -> None:
    """People walk straight, so boxes on straight lines are where they were."""
    found = [fill_gaps(one, LENGTH) for one in right_links(seen({0: range(8, 12)}), labels(), 5)]
    scores = evaluate_sequence(labels(), found, LENGTH)
    assert (scores.hota, scores.mota, scores.idf1) == (1, 1, 1)
    assert [int((~one.observed).sum()) for one in found] == [4, 0]
