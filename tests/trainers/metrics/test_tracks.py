"""HOTA, CLEAR and IDF1 over sequences: against TrackEval, over all forms of input, and over processes."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import lightning
import numpy as np
import pytest
import torch
from torchmetrics import Metric, MetricCollection

from tests.trainers.metrics.conftest import Frames
from tsuiseki.tracking.errors import InputWarning, RequestError
from tsuiseki.tracking.evaluation.multi import evaluate_sequence
from tsuiseki.tracking.result import Result
from tsuiseki.tracking.types import Targets, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.metrics.tracks import CLEAR, HOTA, IDF1

TRACKING: tuple[type[Metric], ...] = (HOTA, CLEAR, IDF1)
# Names of scores by those of TrackEval.
NAMES = {"HOTA": "hota", "DetA": "det_a", "AssA": "ass_a", "MOTA": "mota", "MOTP": "motp", "IDSW": "id_switches",
         "CLR_FP": "false_positives", "CLR_FN": "false_negatives", "CLR_Re": "recall", "CLR_Pr": "precision",
         "IDF1": "idf1", "IDP": "id_precision", "IDR": "id_recall"}  # fmt: skip


def frame(boxes: Any, ids: Any, **columns: Any) -> dict[str, Any]:
    return {"boxes": torch.tensor(boxes, dtype=torch.float64).reshape(-1, 4), "ids": torch.tensor(ids), **columns}


def scores(metrics: MetricCollection) -> dict[str, float]:
    return {name: value.item() for name, value in metrics.compute().items()}


def all_three() -> MetricCollection:
    return MetricCollection([HOTA(), CLEAR(), IDF1()])


def trackeval_data(preds: Frames, target: Frames) -> dict[str, Any]:
    from trackeval.datasets._base_dataset import _BaseDataset

    def numbered(frames: Frames) -> tuple[list[np.ndarray], int]:
        names = sorted({int(i) for f in frames for i in f["ids"]})
        return [np.array([names.index(int(i)) for i in f["ids"]], dtype=int) for f in frames], len(names)

    reported, count = numbered(preds)
    true, true_count = numbered(target)
    overlaps = [
        _BaseDataset._calculate_box_ious(t["boxes"].numpy(), p["boxes"].numpy(), box_format="x0y0x1y1")
        for t, p in zip(target, preds, strict=True)
    ]
    return {
        "num_timesteps": len(target), "num_gt_ids": true_count, "num_tracker_ids": count,
        "num_gt_dets": sum(map(len, true)), "num_tracker_dets": sum(map(len, reported)),
        "gt_ids": true, "tracker_ids": reported, "similarity_scores": overlaps,
    }  # fmt: skip


def trackeval_scores(sequences: list[tuple[Frames, Frames]]) -> dict[str, float]:
    from trackeval import metrics

    values: dict[str, float] = {}
    quiet = {"PRINT_CONFIG": False}
    for peer in (metrics.HOTA(), metrics.CLEAR(dict(quiet)), metrics.Identity(dict(quiet))):
        of_each = {str(n): peer.eval_sequence(trackeval_data(*pair)) for n, pair in enumerate(sequences)}
        combined = peer.combine_sequences(of_each)
        values |= {ours: float(np.mean(combined[theirs])) for theirs, ours in NAMES.items() if theirs in combined}
    return values


@pytest.mark.parametrize("seed", range(4))
def test_scores_of_several_sequences_are_those_of_trackeval(
    crowd: Callable[..., tuple[Frames, Frames]], seed: int
) -> None:
    sequences = [crowd(seed), crowd(seed + 50, length=25), crowd(seed + 90, people=2)]
    # A sequence in which nobody is labelled, and one in which nothing is reported.
    empty = [frame([], [])] * 4
    sequences += [(crowd(7, length=4)[0], empty), (empty, crowd(8, length=4)[1])]
    metrics = all_three()
    for preds, target in sequences:
        metrics.update(preds, target)
    expected = trackeval_scores(sequences)
    assert expected.keys() == scores(metrics).keys() == set(NAMES.values())
    assert scores(metrics) == pytest.approx(expected, abs=1e-12)


def tracks_of(frames: Frames) -> list[Track]:
    ids = sorted({int(i) for f in frames for i in f["ids"]})
    tracks = []
    for number in ids:
        rows = [(n, f["boxes"][f["ids"] == number][0].numpy()) for n, f in enumerate(frames) if number in f["ids"]]
        tracks.append(Track(number, np.array([n for n, _ in rows]), np.stack([b for _, b in rows]), np.ones(len(rows))))
    return tracks


def labels_of(frames: Frames) -> GroundTruth:
    numbers = np.repeat(np.arange(len(frames)), [len(f["ids"]) for f in frames])
    ids, boxes = (torch.cat([f[name] for f in frames]).numpy() for name in ("ids", "boxes"))
    return GroundTruth.of_boxes(numbers, ids, boxes)


FORMS: dict[str, Callable[[Frames], Any]] = {
    "float32 tensors that need gradients": lambda frames: [
        {"boxes": f["boxes"].float().requires_grad_(), "ids": f["ids"].int()} for f in frames
    ],
    "arrays": lambda frames: [{name: f[name].numpy() for name in f} for f in frames],
    "lists": lambda frames: [{name: f[name].tolist() for name in f} for f in frames],
    "ids as floats": lambda frames: [{"boxes": f["boxes"], "ids": f["ids"].double()} for f in frames],
    "a tuple of frames": tuple,
    "targets of a tracker": lambda frames: [
        Targets(n, f["ids"].numpy(), f["boxes"].numpy(), np.ones(len(f["ids"])), np.full(len(f["ids"]), "tracking"))
        for n, f in enumerate(frames)
    ],
    "tracks": tracks_of,
    "a result": lambda frames: Result(tracks_of(frames)),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("side", [0, 1])
def test_all_forms_of_a_sequence_give_the_same(
    crowd: Callable[..., tuple[Frames, Frames]], form: str, side: int
) -> None:
    pair = [[{"boxes": f["boxes"].float().double(), "ids": f["ids"]} for f in frames] for frames in crowd(3)]
    expected, metrics = all_three(), all_three()
    expected.update(*pair)
    pair[side] = FORMS[form](pair[side])
    metrics.update(*pair)
    assert scores(metrics) == scores(expected)


def test_labels_that_were_read_are_a_target_and_score_as_by_evaluate_people(
    crowd: Callable[..., tuple[Frames, Frames]],
) -> None:
    preds, target = crowd(11)
    labels = labels_of(target)
    labels.ignored[::7], labels.evaluated[::7] = True, False
    expected = evaluate_sequence(labels, tracks_of(preds))
    for form in (preds, tracks_of(preds)):
        metrics = all_three()
        metrics.update(form, labels)
        measured = scores(metrics)
        for name in ("hota", "det_a", "ass_a", "mota", "motp", "idf1", "id_switches", "recall", "precision"):
            assert measured[name] == getattr(expected, name), name


def test_a_box_on_an_ignored_one_is_neither_right_nor_wrong() -> None:
    boxes = [[0, 0, 10, 20], [50, 0, 60, 20]]
    target = [frame(boxes, [1, 2], ignored=torch.tensor([False, True]))] * 3
    for preds in ([frame(boxes, [5, 6])] * 3, [frame(boxes[:1], [5])] * 3):
        metrics = all_three()
        metrics.update(preds, target)
        assert [scores(metrics)[name] for name in ("hota", "mota", "idf1", "false_positives")] == [1, 1, 1, 0]


def test_frames_of_a_list_are_all_scored_also_where_few_have_labels() -> None:
    preds = [frame([[0, 0, 10, 20]], [1])] * 20
    target = [frame([[0, 0, 10, 20]], [1]) if n % 5 == 0 else frame([], []) for n in range(20)]
    metric = CLEAR()
    metric.update(preds, target)
    assert metric.compute()["false_positives"] == 16


@pytest.mark.parametrize("kind", TRACKING)
def test_nothing_labelled_is_nan_with_a_warning(kind: type[Metric]) -> None:
    metric = kind()
    metric.update([frame([[0, 0, 10, 20]], [1])], [frame([], [])])
    with pytest.warns(InputWarning, match="expected labelled boxes .* its scores are NaN; update it with more"):
        assert all(value.isnan() for value in metric.compute().values())


@pytest.mark.parametrize("kind", TRACKING)
def test_a_step_gives_the_scores_of_its_sequence_and_reset_forgets(
    crowd: Callable[..., tuple[Frames, Frames]], kind: type[Metric]
) -> None:
    first, second = crowd(1), crowd(2)
    metric, alone, both = kind(), kind(), kind()
    metric(*first)
    of_second = metric(*second)
    alone.update(*second)
    both.update(*first)
    both.update(*second)
    assert of_second == alone.compute()
    assert metric.compute() == both.compute()
    metric.reset()
    metric.update(*second)
    assert metric.compute() == alone.compute()
    assert pickle.loads(pickle.dumps(metric)).compute() == copy.deepcopy(metric).compute() == alone.compute()


@pytest.mark.parametrize("kind", TRACKING)
def test_half_precision_of_a_training_changes_no_score(
    crowd: Callable[..., tuple[Frames, Frames]], kind: type[Metric]
) -> None:
    sequence = crowd(5)
    metric, expected = kind(), kind()
    metric.update(*sequence)
    metric.to(torch.bfloat16).half()
    metric.update(*sequence)
    expected.update(*sequence)
    expected.update(*sequence)
    assert metric.compute() == expected.compute()
    assert {value.dtype for value in metric.compute().values()} == {torch.float64}


BOX = [[0.0, 0.0, 10.0, 20.0]]
GOOD = [frame(BOX, [1])]
WRONG: list[tuple[Any, Any, str]] = [
    ([], [frame(BOX, [1, 2])], r"`target\[0\].ids`: expected shape \(1,\), got \(2,\)"),
    (GOOD * 2, GOOD, "as many frames in `preds` and `target`, got 2 and 1"),
    (GOOD, [], "as many frames in `preds` and `target`, got 1 and 0"),
    (GOOD, [frame(BOX * 2, [4, 4])], r"`target\[0\].ids`: expected each id once"),
    ([frame(BOX, [1.5])], GOOD, r"`preds\[0\].ids`: expected whole numbers"),
    ([{"boxes": BOX, "ids": ["a"]}], GOOD, r"`preds\[0\].ids`: expected whole numbers"),
    ([{"boxes": [[0, 0, 10]], "ids": [1]}], GOOD, r"`preds\[0\].boxes`: expected boxes of shape \(N, 4\)"),
    ([{"boxes": [[0, 0, 10, float("nan")]], "ids": [1]}], GOOD, r"`preds\[0\].boxes`: expected finite boxes"),
    ([{"boxes": [[50, 50, 10, 20]], "ids": [1]}], GOOD, r"`preds\[0\].boxes`: expected finite boxes with x1 < x2"),
    ([{"boxes": "box", "ids": [1]}], GOOD, r"`preds\[0\].boxes`: expected numbers, got str"),
    ([{"boxes": BOX, "labels": [1]}], GOOD, r"`preds\[0\]`: expected .* `ids` \(N,\); got boxes, labels"),
    (GOOD, torch.zeros(1, 4), "`target`: expected a sequence as tracks, or as a list of its frames.*; got Tensor"),
    (GOOD, None, "`target`: expected a sequence.*; got NoneType"),
    ("result.txt", GOOD, "`preds`: expected a sequence.*; got str"),
    ([Track(1, np.array([3]), np.array(BOX), np.ones(1))], GOOD, "tracks in the 1 frames of `target`, got one in"),
    (tracks_of(GOOD) * 2, GOOD, "`preds`: expected tracks of different ids"),
    (GOOD, tracks_of(GOOD) * 2, "`target`: expected tracks of different ids"),
]


@pytest.mark.parametrize(("preds", "target", "line"), WRONG)
def test_what_is_no_sequence_is_refused_in_one_line(preds: Any, target: Any, line: str) -> None:
    metric = HOTA()
    with pytest.raises(RequestError, match=line) as refused:
        metric.update(preds, target)
    assert "\n" not in str(refused.value)
    assert not metric.hits.any()


class Tracked(lightning.LightningModule):
    """Validates metrics alone."""

    def __init__(self, pair: tuple[Frames, Frames]) -> None:
        super().__init__()
        self.metrics, self.pair = all_three(), pair

    def validation_step(self, batch: torch.Tensor) -> None:
        del batch
        self.metrics.update(*self.pair)

    def on_validation_epoch_end(self) -> None:
        self.log_dict(self.metrics.compute())
        self.metrics.reset()


@pytest.mark.slow
def test_a_lightning_module_logs_them(crowd: Callable[..., tuple[Frames, Frames]]) -> None:
    trainer = lightning.Trainer(logger=False, enable_progress_bar=False, enable_model_summary=False, accelerator="cpu")
    (logged,) = trainer.validate(Tracked(crowd(4)), torch.utils.data.DataLoader([torch.zeros(1)]), verbose=False)
    expected = all_three()
    expected.update(*crowd(4))
    assert logged == pytest.approx(scores(expected), rel=1e-6)
