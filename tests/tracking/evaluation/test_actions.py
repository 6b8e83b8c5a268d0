"""Scores of recognised actions, against scikit-learn and by hand."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics import average_precision_score, f1_score, precision_score, recall_score

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.actions import (
    LabelledActions,
    action_rows,
    average_precisions,
    evaluate_actions,
    read_labelled_actions,
)
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks, write_acting_tracks
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import ActingTrack


@pytest.mark.parametrize("levels", [4, 1000])
def test_scores_are_those_of_scikit_learn_ties_included(levels: int) -> None:
    rng = np.random.default_rng(levels)
    truth = rng.random((200, 5)) < [0.5, 0.3, 0.1, 0.02, 0.9]
    said = rng.integers(0, levels, truth.shape) / levels
    scores = evaluate_actions(tuple("abcde"), said, truth, 0.4)
    called = said > 0.4
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for values, function in (
            (scores.f1, f1_score),
            (scores.precision, precision_score),
            (scores.recall, recall_score),
        ):
            np.testing.assert_allclose(values, function(truth, called, average=None, zero_division=0), atol=1e-12)
    expected = [average_precision_score(t, s) for t, s in zip(truth.T, said.T, strict=True)]
    np.testing.assert_allclose(scores.average_precision, expected, atol=1e-12)
    assert scores.mean_average_precision == pytest.approx(np.mean(expected))


def test_actions_that_do_not_occur_do_not_count() -> None:
    truth = np.array([[True, False], [False, False]])
    scores = evaluate_actions(("a", "b"), np.array([[0.9, 0.8], [0.2, 0.1]]), truth)
    assert scores.mean_f1 == 1
    assert np.isnan(scores.f1[1])
    assert np.isnan(average_precisions(np.zeros((3, 1)), np.zeros((3, 1), bool)))[0]
    with pytest.raises(RequestError, match="rows with actions"):
        evaluate_actions(("a",), np.zeros((2, 1)), np.zeros((2, 1), bool))


def labels() -> LabelledActions:
    """Two people in two frames, the second hidden in the second."""
    boxes = np.array([[0, 0, 10, 20], [50, 0, 60, 20]] * 2, dtype=np.float64)
    hidden = np.array([False, False, False, True])
    truth = GroundTruth(np.array([0, 0, 1, 1]), np.array([1, 2, 1, 2]), boxes, ~hidden, hidden, np.ones(4))
    return LabelledActions("x", truth, np.array([[True, False], [False, True]] * 2), ("a", "b"))


def person(identity: int, frames: list[int], x: float, said: float) -> ActingTrack:
    boxes = np.array([[x, 0, x + 10, 20.0]] * len(frames))
    track = Track(identity, np.array(frames), boxes, np.ones(len(frames)))
    single = np.full((len(frames), 2), said)
    return ActingTrack(track, single, single / 2)


def test_rows_are_labelled_people_and_boxes_on_nobody() -> None:
    found = [person(1, [0, 1], 1.0, 0.8), person(2, [1], 51.0, 0.6), person(3, [0], 200.0, 0.4)]
    rows = action_rows(labels(), found)
    # The person whom no track has in frame 0, and the box on nobody; the hidden one and the track on them are out.
    np.testing.assert_array_equal(rows.truth, [[True, False], [False, True], [True, False], [False, False]])
    np.testing.assert_allclose(rows.single[:, 0], [0.8, np.nan, 0.8, 0.4])
    np.testing.assert_allclose(rows.multi, rows.single / 2)
    empty = action_rows(labels(), [])
    assert np.isnan(empty.single).all()
    assert len(empty.truth) == 3
    scores = evaluate_actions(("a", "b"), empty.multi, empty.truth)
    assert scores.mean_average_precision == scores.mean_f1 == 0


def test_tracks_with_actions_come_back_as_they_went(tmp_path: Path) -> None:
    found = [person(4, [3, 5], 12.5, 0.25), ActingTrack(person(7, [1], 2.0, 0.5).track)]
    write_acting_tracks(tmp_path / "t.json", found, ("a", "b"))
    again, names = read_acting_tracks(tmp_path / "t.json")
    assert names == ("a", "b")
    assert again[1].single is None
    for a, b in zip(found, again, strict=True):
        assert a.track.id == b.track.id
        np.testing.assert_array_equal(a.track.frames, b.track.frames)
        np.testing.assert_allclose(a.track.boxes, b.track.boxes, atol=0.01)
    assert again[0].multi is not None
    np.testing.assert_allclose(again[0].multi, found[0].multi, atol=1e-4)


def test_labels_come_from_clip_folders(acting_clips: Path) -> None:
    (clip,) = read_labelled_actions(acting_clips / "validation")
    assert clip.name == "validation-0"
    assert clip.truth.ignored.sum() == 1
    (published,) = read_labelled_actions(acting_clips / "validation/validation-0", "published")
    assert published.truth.frames.min() == 1
    (by_file,) = read_labelled_actions(acting_clips / "validation/validation-0/gt/actions.txt", "published")
    np.testing.assert_array_equal(by_file.truth.boxes, published.truth.boxes)
    assert by_file.name == "validation-0"
    assert not published.truth.ignored.any()
