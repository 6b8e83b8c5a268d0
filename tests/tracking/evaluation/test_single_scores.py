"""Scores of one target by hand, and the published scores of Struck."""

import json

import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.success_curves import OVERLAPS, compare, evaluate_boxes, evaluate_single
from tsuiseki.tracking.formats.single import ATTRIBUTES, SingleSequence, find_single_sequences

TRUTH = np.array([[0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 10], [0, 0, 10, 10.0]])


def test_curves_by_hand():
    # overlaps 1 (the first box is given), 1, 1/2, 0
    result = np.array([[90, 90, 99, 99], [0, 0, 10, 10], [0, 0, 10, 5], [40, 0, 50, 10.0]])
    scores = evaluate_boxes(TRUTH, result)
    # strictly greater: the half does not count at 0.5, nor the whole at 1
    expected = [0.75 if t < 0.5 else 0.5 if t < 1 else 0 for t in np.round(OVERLAPS, 2)]
    np.testing.assert_allclose(scores.success, expected)
    assert scores.auc == pytest.approx(np.mean(expected))
    assert scores.thesis_auc == pytest.approx(np.mean(expected[::2]))
    # centres 0, 0, 2.5 and 40 pixels off
    assert scores.precision[[0, 2, 3, 20, 39, 40]].tolist() == [0.5, 0.5, 0.75, 0.75, 0.75, 1]


def test_a_missing_box_is_the_one_before():
    result = np.array([[0, 0, 10, 10], [0, 0, 10, 10], [np.nan] * 4, [0, 0, 0, 5.0]])
    assert evaluate_boxes(TRUTH, result).success[10] == 1


@pytest.mark.parametrize(("count", "share"), [(1, 0.25), (3, 0.75), (6, 1.0)])
def test_frames_without_a_result_are_misses_and_said(count, share):
    right = np.concatenate([TRUTH, TRUTH])[:count]
    scores = evaluate_boxes(TRUTH, right)
    assert scores.frames == 4
    assert (scores.success[:-1] == share).all()
    assert scores.precision[-1] == share
    assert f"{count} results for" in scores.note


def test_frames_without_a_true_box_are_not_scored():
    truth = TRUTH.copy()
    truth[2] = np.nan
    scores = evaluate_boxes(truth, TRUTH)
    assert (scores.frames, scores.success[0]) == (3, 1)
    assert scores.note == "1 frames without a true box are not scored"


def test_nothing_to_score_is_an_error_and_no_zero():
    with pytest.raises(RequestError, match="at least one frame"):
        evaluate_boxes(TRUTH, np.empty((0, 4)))
    with pytest.raises(RequestError, match="found none; are these their names"):
        evaluate_single([SingleSequence("a", (), TRUTH)], {"b": TRUTH})


def test_sequences_weigh_the_same_whatever_their_length():
    sequences = [
        SingleSequence("a", (), TRUTH, frozenset({"OCC"})),
        SingleSequence("b", (), TRUTH[:1]),
        SingleSequence("c", (), TRUTH),
    ]
    found = evaluate_single(sequences, {"a": np.add(TRUTH, [0, 0, 90, 90]), "b": TRUTH[:1]})
    half = (found.sequences["a"].auc + found.sequences["b"].auc) / 2
    assert found.groups["ALL"].auc == pytest.approx(half)
    assert found.missing == ("c",)
    assert set(found.groups) == {"ALL", "OCC"}
    assert found.groups["OCC"].auc == found.sequences["a"].auc


@pytest.mark.parametrize("group", ["ALL", *ATTRIBUTES])
def test_published_scores_of_struck(data_folder, group):
    folder = data_folder / "sot" / "otb_results" / "Struck"
    published = json.loads((folder / "scores_tb50" / f"{group}.json").read_text())
    sequences = find_single_sequences(data_folder / "sot" / "otb_annotations", folder / "scores_tb50")
    found = compare(sequences, folder, published_precision=True).groups[group]
    assert found.sequences == len(published["seqs"])
    # the published means are of curves that were rounded; four digits
    assert found.auc == pytest.approx(published["overlap"] / 100, abs=5e-5)
    assert found.precision[20] == pytest.approx(published["precisionList"][20], abs=5e-5)


@pytest.mark.parametrize(("tracker", "auc", "precision"), [("Struck", 0.3840, 0.540), ("KCF", 0.4030, 0.610)])
def test_reference_values_of_whole_tb50(data_folder, tracker, auc, precision):
    sot = data_folder / "sot"
    sequences = find_single_sequences(sot / "otb_annotations", sot / "otb_annotations" / "tb_50.txt")
    found = compare(sequences, sot / "otb_results" / tracker).groups["ALL"]
    assert found.sequences == 50
    assert found.auc == pytest.approx(auc, abs=5e-5)
    assert found.precision[20] == pytest.approx(precision, abs=5e-4)
