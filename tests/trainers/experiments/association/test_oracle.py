"""The right links and the mended results on tracks whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.association.oracle import (
    REPAIRS,
    link_counts,
    repaired,
    right_links,
    straight,
)

LENGTH = 20


def at(person: int, frame: int) -> FloatArray:
    """Where a person is: everybody in a lane of their own, a step to the right a frame."""
    return np.array([5.0 * frame, 200.0 * person, 5.0 * frame + 40, 200.0 * person + 100])


def labels(people: int = 2, ignored: tuple[int, ...] = ()) -> GroundTruth:
    frames, ids = np.repeat(np.arange(LENGTH), people), np.tile(np.arange(people), LENGTH)
    boxes = np.array([at(p, f) for f, p in zip(frames, ids, strict=True)])
    which = np.isin(ids, ignored)
    return GroundTruth(frames, ids, boxes, ~which, which, np.ones(len(frames)))


def track(number: int, spots: list[tuple[int, int]]) -> Track:
    """A track through ``(frame, person)``; a person below 0 is nobody, far away."""
    frames = np.array([frame for frame, _ in spots])
    boxes = np.array([at(person if person >= 0 else 20 - person, frame) for frame, person in spots])
    return Track(number, frames, boxes, np.full(len(spots), 0.9))


def stretch(person: int, first: int, last: int) -> list[tuple[int, int]]:
    return [(frame, person) for frame in range(first, last + 1)]


def idf1(truth: GroundTruth, tracks: list[Track]) -> float:
    return evaluate_sequence(truth, tracks, LENGTH).idf1


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
    found = right_links(seen({0: range(8, 12)}), labels(), 5, filled=True)
    scores = evaluate_sequence(labels(), found, LENGTH)
    assert (scores.hota, scores.mota, scores.idf1) == (1, 1, 1)
    assert [int((~one.observed).sum()) for one in found] == [4, 0]


def test_a_gap_that_is_too_long_stays_open() -> None:
    one = straight(track(1, [(0, 0), (2, 0), (8, 0)]), 3)
    assert one.frames.tolist() == [0, 1, 2, 8]
    assert one.observed.tolist() == [True, False, True, True]
    np.testing.assert_allclose(one.boxes[1], at(0, 1))


def swapped_at_once() -> list[Track]:
    """Two tracks that exchange their people from frame 9 to 10."""
    return [
        track(1, stretch(0, 0, 9) + stretch(1, 10, 19)),
        track(2, stretch(1, 0, 9) + stretch(0, 10, 19)),
    ]


def swapped_over_a_gap() -> list[Track]:
    """Two tracks that exchange their people while nobody is seen."""
    return [
        track(1, stretch(0, 0, 7) + stretch(1, 12, 19)),
        track(2, stretch(1, 0, 7) + stretch(0, 12, 19)),
    ]


@pytest.mark.parametrize("tracks", [swapped_at_once(), swapped_over_a_gap()], ids=["at once", "over a gap"])
def test_wrong_links_are_mended(tracks: list[Track]) -> None:
    truth = labels()
    mended = repaired(tracks, truth, "links")
    assert idf1(truth, tracks) < 0.6 < idf1(truth, mended)
    assert evaluate_sequence(truth, mended, LENGTH).id_switches == 0
    assert len(mended) == 2


def test_missed_links_are_made_and_boxes_on_nobody_stay_together() -> None:
    truth = labels(1)
    parts = [
        track(1, stretch(0, 0, 4)),
        track(2, stretch(0, 5, 9)),
        track(3, stretch(0, 15, 19)),
        track(4, [(3, -1), (4, -1)]),
    ]
    assert sorted(len(one) for one in repaired(parts, truth, "links")) == [2, 15]


def test_false_boxes_and_false_tracks() -> None:
    truth = labels(1)
    tracks = [track(1, stretch(0, 0, 13) + stretch(-1, 14, 19)), track(2, stretch(-2, 0, 9))]
    without = repaired(tracks, truth, "false tracks")
    assert [(one.id, len(one)) for one in without] == [(1, 20)]
    without = repaired(tracks, truth, "false boxes")
    assert [(one.id, len(one)) for one in without] == [(1, 14)]


def test_links_are_counted_by_their_length() -> None:
    truth = labels()
    once = link_counts(swapped_at_once(), truth, rate=10.0)
    assert once.right.tolist() == [38, 0, 0, 0, 0]
    assert once.made.tolist() == [36, 0, 0, 0, 0]
    assert once.wrong.tolist() == [2, 0, 0, 0, 0]
    over = link_counts(swapped_over_a_gap(), truth, rate=10.0)  # five frames are half a second
    assert over.right.tolist() == [28, 0, 2, 0, 0]
    assert over.made.tolist() == [28, 0, 0, 0, 0]
    assert over.wrong.tolist() == [0, 0, 2, 0, 0]


@pytest.mark.parametrize("what", REPAIRS)
def test_a_result_without_tracks_stays_one(what: str) -> None:
    assert repaired([], labels(), what) == []  # type: ignore[arg-type]
    assert link_counts([], labels(), 10.0).right.sum() == 0


@pytest.mark.parametrize("what", REPAIRS)
def test_a_right_result_has_nothing_to_mend(what: str) -> None:
    truth = labels()
    right = [track(1, stretch(0, 0, 19)), track(2, stretch(1, 0, 19))]
    assert idf1(truth, repaired(right, truth, what)) == 1  # type: ignore[arg-type]
