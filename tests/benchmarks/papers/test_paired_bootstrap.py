"""Scores from sums against those of the evaluation, and intervals against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.papers.paired_bootstrap import SCORES, paired_bootstrap, score_sums, scores_of
from tsuiseki.tracking.evaluation.multi import SequencePair, evaluate_sequences
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth


def pair(name: str, seed: int, noise: float) -> SequencePair:
    """Four people in ten frames, found with noise, now and then missed or with another's id."""
    rng = np.random.default_rng(seed)
    frames, ids = np.repeat(np.arange(10), 4), np.tile(np.arange(1, 5), 10)
    corner = np.stack([100.0 * ids, 5.0 * frames], axis=1)
    boxes = np.concatenate([corner, corner + np.array([40, 80])], axis=1)
    every = np.ones(40, dtype=np.bool_)
    truth = GroundTruth(frames, ids, boxes, every, ~every, np.ones(40))
    found = boxes + rng.normal(0, noise, boxes.shape)
    shown = np.where(frames >= rng.integers(3, 8), ids % 4 + 1, ids)
    tracks = []
    for number in range(1, 5):
        mine = (shown == number) & (rng.random(40) > 0.2)
        tracks.append(Track(number, frames[mine], found[mine], np.ones(mine.sum())))
    return SequencePair(name, truth, tracks, 10)


def test_scores_from_sums_are_the_evaluations() -> None:
    pairs = [pair("a", 0, 2.0), pair("b", 1, 6.0), pair("c", 2, 10.0)]
    wanted = evaluate_sequences(pairs)
    sums = np.array([score_sums(one) for one in pairs])
    each, combined = scores_of(sums), scores_of(sums.sum(axis=0))
    for name in (*SCORES, "id_switches", "false_positives", "false_negatives", "labelled"):
        assert combined[name] == pytest.approx(getattr(wanted.combined, name)), name
        assert each[name] == pytest.approx([getattr(one, name) for one in wanted.sequences.values()]), name


def test_a_tracker_is_no_better_than_itself() -> None:
    sums = np.array([score_sums(pair("a", seed, 4.0)) for seed in range(3)])
    intervals = paired_bootstrap(sums, sums, 50, np.random.default_rng(0))
    assert list(intervals) == [*SCORES, "id_switches"]
    for interval in intervals.values():
        assert (interval.difference, interval.low, interval.high) == (0, 0, 0)


def test_one_sequence_has_an_interval_of_one_point() -> None:
    ours, theirs = (score_sums(pair("a", 0, noise))[None] for noise in (1.0, 9.0))
    interval = paired_bootstrap(ours, theirs, 20, np.random.default_rng(0))["hota"]
    assert interval.low == interval.high == pytest.approx(interval.difference)
    assert interval.difference > 0.1


def test_two_sequences_give_the_scores_of_four_samples() -> None:
    """(a, a), (a, b), (b, a) and (b, b): the ends of the interval are the differences on a alone and on b alone."""
    ours, theirs = (
        np.array([score_sums(pair("a", 0, noise)), score_sums(pair("b", 1, 2 * noise))]) for noise in (1.0, 5.0)
    )
    found = paired_bootstrap(ours, theirs, 400, np.random.default_rng(0))
    alone = scores_of(ours)["hota"] - scores_of(theirs)["hota"]
    assert found["hota"].low == pytest.approx(min(alone))
    assert found["hota"].high == pytest.approx(max(alone))
    assert min(alone) < found["hota"].difference < max(alone)


def test_the_sequences_must_be_the_same() -> None:
    with pytest.raises(ValueError, match="same sequences"):
        paired_bootstrap(np.zeros((2, 83)), np.zeros((3, 83)), 10, np.random.default_rng(0))
