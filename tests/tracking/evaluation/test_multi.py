"""Scores of people: against known results, trackeval's own reading of MOTChallenge files, and closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.multi import (
    PeopleScores,
    SequencePair,
    evaluate_sequence,
    evaluate_sequences,
    restrict,
)
from tsuiseki.tracking.evaluation.result_files import Truth, evaluate_detection_files
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks, write_tracks
from tsuiseki.tracking.types import Track
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.types.labels import GroundTruth


def walk(identity: int, frames: range, x: float, y: float = 0.0) -> Track:
    """A person of 10 x 20 pixels who walks one pixel a frame."""
    numbers = np.arange(frames.start, frames.stop)
    left = x + numbers
    boxes = np.column_stack([left, np.full(len(left), y), left + 10, np.full(len(left), y + 20)])
    return Track(identity, numbers, boxes, np.ones(len(left)))


def labels(*tracks: Track) -> GroundTruth:
    """``tracks`` as ground truth in which everyone counts."""
    frames = np.concatenate([track.frames for track in tracks])
    ids = np.concatenate([np.full(len(track), track.id) for track in tracks])
    order = np.argsort(frames, kind="stable")
    boxes = np.concatenate([track.boxes for track in tracks])
    count = len(frames)
    return GroundTruth(
        frames, ids, boxes, np.ones(count, dtype=bool), np.zeros(count, dtype=bool), np.ones(count)
    ).select(order)


def test_truth_scored_against_itself_is_perfect() -> None:
    people = [walk(3, range(10), 0), walk(7, range(5, 20), 100)]
    scores = evaluate_sequence(labels(*people), people, 20)
    assert scores == PeopleScores(1, 1, 1, 1, 1, 1, 0, 0, 0, 1, 1, 25)


@pytest.mark.parametrize("frames", [np.arange(0, 200, 10), np.arange(5, 200, 10), np.arange(0, 200, 2),
                                    np.cumsum(np.tile([9, 11, 10], 6))])  # fmt: skip
def test_frames_that_nobody_labelled_are_not_scored(frames: np.ndarray) -> None:
    people = [walk(3, range(200), 0), walk(7, range(40, 200), 0, 100)]
    truth = labels(*people)
    truth = truth.select(np.isin(truth.frames, frames))
    with pytest.warns(InputWarning, match=rf"labels in {len(frames)} of 200 frames, .* are not scored"):
        scores = evaluate_sequence(truth, people, 200)
    assert (scores.mota, scores.hota, scores.false_positives, scores.labelled) == (1, 1, 0, len(truth))
    wrong = walk(9, range(200), 0, 300)
    with pytest.warns(InputWarning):
        scores = evaluate_sequence(truth, [*people, wrong], 200)
    assert scores.false_positives == pytest.approx(len(frames), abs=1)


def test_an_empty_end_is_labelled(recwarn: pytest.WarningsRecorder) -> None:
    scores = evaluate_sequence(labels(walk(1, range(20), 0)), [walk(1, range(40), 0)], 40)
    assert (scores.false_positives, scores.labelled) == (20, 20)
    assert not recwarn.list


def test_no_track_at_all_misses_everything() -> None:
    scores = evaluate_sequence(labels(walk(1, range(8), 0)), [], 8)
    assert (scores.false_negatives, scores.mota, scores.hota, scores.idf1) == (8, 0, 0, 0)


def test_a_change_of_id_half_way() -> None:
    truth = labels(walk(1, range(10), 0))
    halves = [walk(1, range(5), 0), walk(2, range(5, 10), 0)]
    scores = evaluate_sequence(truth, halves, 10)
    assert (scores.id_switches, scores.mota) == (1, 0.9)
    assert scores.idf1 == pytest.approx(5 / 10)
    # Every match is with a track that shares 5 of the 10 labelled boxes: Jaccard 5 / (10 + 5 - 5).
    assert scores.ass_a == pytest.approx(0.5)
    assert scores.hota == pytest.approx(np.sqrt(0.5))


def test_half_shifted_boxes_match_below_their_overlap_only() -> None:
    person = walk(1, range(6), 0)
    shifted = Track(1, person.frames, person.boxes + np.array([2.5, 0, 2.5, 0]), person.scores)
    scores = evaluate_sequence(labels(person), [shifted], 6)
    assert scores.motp == pytest.approx(0.6)  # overlap 7.5 / 12.5
    assert scores.hota == pytest.approx(12 / 19)  # right at the 12 overlaps 0.05 … 0.60 of 19


@pytest.mark.parametrize("length", [9, 15])
def test_truth_of_any_length_may_be_cut(length: int) -> None:
    person = walk(1, range(20), 0)
    truth = labels(person).between(0, length - 1)
    scores = evaluate_sequence(truth, restrict([person], FrameRange(0, length - 1)), length)
    assert (scores.hota, scores.labelled) == (1, length)


@pytest.mark.parametrize("seed", range(3))
def test_ignore_rules_agree_with_trackeval(tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(seed)
    write_random_mot17(rng, tmp_path)
    expected = trackeval_scores(tmp_path)
    capsys.readouterr()
    truth = read_ground_truth(tmp_path / "gt" / "S-train" / "S" / "gt" / "gt.txt")
    assert truth.ignored.any()
    scores = evaluate_sequence(truth, read_tracks(tmp_path / "results" / "S-train" / "ours" / "data" / "S.txt"), 30)
    for name, value in expected.items():
        assert getattr(scores, name) == pytest.approx(value, abs=1e-12), name


def write_random_mot17(rng: np.random.Generator, folder: Path) -> None:
    """Random people, distractors and vehicles, and results jittered around half of all of them."""
    truth, result = [], []
    for identity in range(1, 13):
        x, y = rng.uniform(0, 200, 2)
        kind = int(rng.choice([1, 1, 1, 2, 3, 7, 8, 12]))
        for frame in range(1, 31):
            counts = int(rng.random() < 0.9)
            box = np.array([x + frame, y, 20, 50])
            truth.append(f"{frame},{identity},{','.join(map(str, box))},{counts},{kind},1.0")
            if rng.random() < 0.8:
                seen = box + rng.normal(0, 3, 4)
                name = identity + (100 if rng.random() < 0.1 else 0)
                result.append(f"{frame},{name},{','.join(map(str, seen))},1,-1,-1,-1")
    write(folder / "gt" / "S-train" / "S" / "gt" / "gt.txt", truth)
    write(folder / "results" / "S-train" / "ours" / "data" / "S.txt", result)


def write(path: Path, lines: list[str]) -> None:
    path.parent.mkdir(parents=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def trackeval_scores(folder: Path) -> dict[str, float]:
    """The scores by trackeval's own reader and rules."""
    from trackeval.datasets import MotChallenge2DBox
    from trackeval.metrics import CLEAR, HOTA, Identity

    dataset = MotChallenge2DBox(
        {
            "GT_FOLDER": str(folder / "gt"),
            "TRACKERS_FOLDER": str(folder / "results"),
            "BENCHMARK": "S",
            "SPLIT_TO_EVAL": "train",
            "SEQ_INFO": {"S": 30},
            "PRINT_CONFIG": False,
        }
    )
    data = dataset.get_preprocessed_seq_data(dataset.get_raw_seq_data("ours", "S"), "pedestrian")
    hota = HOTA().eval_sequence(data)
    clear = CLEAR({"PRINT_CONFIG": False}).eval_sequence(data)
    identity = Identity({"PRINT_CONFIG": False}).eval_sequence(data)
    return {
        "hota": float(np.mean(hota["HOTA"])),
        "ass_a": float(np.mean(hota["AssA"])),
        "mota": clear["MOTA"],
        "motp": clear["MOTP"],
        "idf1": identity["IDF1"],
        "id_switches": clear["IDSW"],
        "false_positives": clear["CLR_FP"],
        "false_negatives": clear["CLR_FN"],
    }


REFERENCE = {
    "TUD-Campus": (0.526462, 0.557659, 0.391397, 7, 13, 150),
    "TUD-Stadtmitte": (0.564014, 0.644619, 0.397849, 7, 45, 452),
    "combined": (0.555116, 0.624296, 0.399957, 14, 58, 602),
}


@pytest.mark.integration
def test_reference_values_of_a_published_result(data_folder: Path) -> None:
    folders = [data_folder / "mot" / name for name in ("TUD-Campus", "TUD-Stadtmitte")]
    evaluation = evaluate_sequences(
        SequencePair(f.name, read_ground_truth(f / "gt" / "gt.txt"), read_tracks(f / "cem-result" / "test.txt"))
        for f in folders
    )
    for name, (mota, idf1, hota, switches, false, missed) in REFERENCE.items():
        scores = evaluation.combined if name == "combined" else evaluation.sequences[name]
        assert (scores.mota, scores.idf1, scores.hota) == pytest.approx((mota, idf1, hota), abs=1e-6)
        assert (scores.id_switches, scores.false_positives, scores.false_negatives) == (switches, false, missed)


def test_what_cannot_be_scored_is_refused() -> None:
    person = walk(1, range(10), 0)
    truth = labels(person)
    nobody = GroundTruth(truth.frames, truth.ids, truth.boxes, ~truth.evaluated, truth.ignored, truth.visibility)
    with pytest.raises(RequestError, match="labelled box that counts"):
        evaluate_sequence(nobody, [person], 10)
    with pytest.raises(RequestError, match="box in frame 10"):
        evaluate_sequence(truth.between(0, 4), [person], 5)
    with pytest.raises(RequestError, match="id twice"):
        evaluate_sequence(truth, [person, walk(1, range(3), 50)], 10)
    with pytest.raises(RequestError, match="got none"):
        evaluate_sequences([])
    with pytest.raises(RequestError, match="twice"):
        evaluate_sequences([SequencePair("a", truth, [person], 10)] * 2)


def test_results_long_after_the_labels_are_told() -> None:
    with pytest.warns(InputWarning, match="290 of 300 boxes lie outside frames 1-10, .* `frames` 1-10 leaves"):
        scores = evaluate_sequence(labels(walk(1, range(10), 0.0)), [walk(1, range(300), 0.0)])
    assert scores.false_positives == 290


def test_a_result_without_boxes_is_told() -> None:
    with pytest.warns(InputWarning, match="the result has no box; every score is 0"):
        assert evaluate_sequence(labels(walk(1, range(10), 0.0)), [], 10).hota == 0


def as_corners(boxes: np.ndarray) -> np.ndarray:
    """What corners become where width and height are expected."""
    return np.column_stack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (as_corners, r"0 of 20 boxes .* lie in 30,40 to 108,100, the labels in 30,40 to 59,60; they fit as corners"),
        (lambda boxes: boxes + 500, r"in 530,540 to 559,560, .* of another video, or of a picture of another size\?"),
        (lambda boxes: boxes / 2, r"0 of 20 boxes are on labelled ones; they lie in 15,20 to 30,30, .* another size"),
    ],
)
def test_boxes_that_lie_elsewhere_are_told(
    change: Callable[[np.ndarray], np.ndarray], told: str, tmp_path: Path
) -> None:
    person = walk(1, range(20), 30, 40)
    other = replace(person, boxes=change(person.boxes))
    with pytest.warns(InputWarning, match=told):
        assert evaluate_sequence(labels(person), [other], 20).mota <= 0
    write_tracks(tmp_path / "det.txt", [other])
    truth = Truth("walk", labels(person), 20)
    with pytest.warns(InputWarning, match=told):
        assert evaluate_detection_files([truth], tmp_path / "det.txt").combined.average_precision == 0


def test_poor_results_are_not_taken_for_others(recwarn: pytest.WarningsRecorder) -> None:
    person, crowd = walk(1, range(20), 30, 40), [walk(n, range(20), 300) for n in range(2, 90)]
    evaluate_sequence(labels(person), [person, *crowd], 20)
    evaluate_sequence(labels(person, *crowd), [person], 20)
    assert not recwarn.list
