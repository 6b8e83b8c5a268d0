"""The criterion: 1 where detections are the tracks, less for misses, false and misplaced boxes; collapses are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.trainers.adapt import street
from tsuiseki.tracking.types import Detections
from tsuiseki.trainers.adapt.rounds import RoundScores, agreement

FRAMES = range(10, 30)
TRACKS = [street.track_of(0), street.track_of(1)]


def found(keep: int = 2, shift: float = 0.0, extra: int = 0) -> list[Detections]:
    decoys = np.tile(street.DECOY, (extra, 1))
    boxes = [np.concatenate([street.people(f)[:keep] + shift, decoys]) for f in FRAMES]
    return [Detections(b, np.ones(len(b))) for b in boxes]


def test_right_detections_agree() -> None:
    assert agreement(found(), TRACKS, FRAMES) == pytest.approx(1)
    assert agreement([Detections.empty()] * 20, [], FRAMES) == 0


def test_misses_and_false_boxes_count_alike() -> None:
    """F1 of two boxes with one hit: 2 / 3; of three with two hits: 4 / 5."""
    assert agreement(found(keep=1), TRACKS, FRAMES) == pytest.approx(2 / 3)
    assert agreement(found(extra=1), TRACKS, FRAMES) == pytest.approx(4 / 5)


def test_misplaced_boxes_agree_less() -> None:
    """Moved by 3 and 3 of 14x40: IoU (11 * 37) / (2 * 560 - 11 * 37) = 0.57, right at 0.5 alone."""
    assert agreement(found(shift=3.0), TRACKS, FRAMES) == pytest.approx(1 / 4)


def test_collapses_are_told() -> None:
    start = RoundScores(0.8, 12, boxes=6.0, detections=7.0, rejected=1.0, offset=0.05)
    assert replace(start, boxes=5.0).collapsed(start) is None
    assert "finds 3.0 people" in str(replace(start, boxes=3.0).collapsed(start))
    assert "finds 5.0 people" in str(replace(start, boxes=5.0, fixed=False).collapsed(start))
    assert "rejects 4.0 detections" in str(replace(start, rejected=4.0).collapsed(start))


def test_more_people_are_no_collapse() -> None:
    """Five times as many who are followed, and some more that are not; nothing but the latter is one."""
    start = RoundScores(0.5, 3, boxes=2.0, detections=3.0, rejected=1.0, offset=0.05)
    assert replace(start, boxes=10.0, detections=13.0, rejected=3.0).collapsed(start) is None
    assert "rejects 11.0 detections" in str(replace(start, detections=13.0, rejected=11.0).collapsed(start))
