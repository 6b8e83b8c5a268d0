"""How well actions are recognised, person by person and frame by frame (thesis 5.4.4).

A row is one person in one frame. The thesis calls its frame-wise numbers recognition accuracy and does not define them.
Here the number of Table 5.5 is F1 = 2 TP / (2 TP + FP + FN) of each action over all rows. An action counts as
recognised where its probability is above the threshold. The average is over the actions that occur in the labels.
Precision and recall are given, too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.coverage import UNMATCHED, matched_labels
from tsuiseki.tracking.evaluation.result_files import result_file, warn_of_other_frames
from tsuiseki.tracking.evaluation.tables import score_table
from tsuiseki.tracking.formats.acting_tracks import read_acting_tracks
from tsuiseki.tracking.formats.drone_action import DRONE_ACTION_CLASSES
from tsuiseki.tracking.formats.labelled import open_labelled
from tsuiseki.tracking.formats.okutama import Protocol, counted_from, okutama_truth
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.tracking.types.tracks import ActingTrack

if TYPE_CHECKING:
    from rich.table import Table

# Probability above which an action is called.
THRESHOLD = 0.4


@dataclass(frozen=True)
class ActionScores:
    """Scores of each of A actions, NaN where an action does not occur.

    Attributes:
        names: of the actions.
        f1: ``(A,)`` in [0, 1].
        precision: ``(A,)`` right share of the calls; 0 where there is none.
        recall: ``(A,)`` called share of what occurs.
        average_precision: ``(A,)`` area under the precision-recall steps.
        positives: ``(A,)`` number of rows in which the action occurs.
        rows: number of rows.
    """

    names: tuple[str, ...]
    f1: FloatArray
    precision: FloatArray
    recall: FloatArray
    average_precision: FloatArray
    positives: IntArray
    rows: int

    @property
    def mean_f1(self) -> float:
        """Mean over the actions that occur: the average of Table 5.5."""
        return float(np.nanmean(self.f1))

    @property
    def mean_average_precision(self) -> float:
        """Mean over the actions that occur: mAP."""
        return float(np.nanmean(self.average_precision))


def evaluate_actions(
    names: Sequence[str], probabilities: FloatArray, truth: BoolArray, threshold: float = THRESHOLD
) -> ActionScores:
    """Scores of probabilities against labels.

    Args:
        names: of the A actions.
        probabilities: ``(N, A)`` of what is reported; NaN where nothing is reported of a person, which is a miss.
        truth: ``(N, A)`` what is so.
        threshold: on the probability, above which an action is called.

    Raises:
        RequestError: no action occurs in any row.
    """
    if not truth.any():
        raise RequestError("expected rows with actions to score, found none")
    called = probabilities > threshold
    right = (called & truth).sum(axis=0)
    positives, calls = truth.sum(axis=0), called.sum(axis=0)
    occurs = positives > 0
    f1, precision, recall = (
        np.where(occurs, numerator / np.maximum(denominator, 1), np.nan)
        for numerator, denominator in ((2 * right, positives + calls), (right, calls), (right, positives))
    )
    average = average_precisions(probabilities, truth)
    return ActionScores(tuple(names), f1, precision, recall, average, positives.astype(np.int64), len(truth))


def average_precisions(scores: FloatArray, truth: BoolArray) -> FloatArray:
    """``(A,)`` sum over the rises of recall of the precision there, for ``(N, A)`` scores; NaN without a positive.

    Rows of equal score enter together, so their order does not matter. A row without a score, NaN, never enters: what
    is so there is never recalled.

    >>> average_precisions(np.array([[0.9], [0.8], [0.7]]), np.array([[True], [False], [True]])).round(4).tolist()
    [0.8333]
    """
    scored = np.isfinite(scores)
    scores = np.where(scored, scores, -np.inf)
    order = np.argsort(-scores, axis=0, kind="stable")
    ranked, hits = np.take_along_axis(scores, order, axis=0), np.take_along_axis(truth & scored, order, axis=0)
    recalled = np.cumsum(hits, axis=0)
    precision = recalled / np.arange(1, len(scores) + 1)[:, None]
    # Precision at the last row of each group of equal scores, carried back to the others of the group.
    last = np.ones(ranked.shape, dtype=np.bool_)
    last[:-1] = ranked[1:] != ranked[:-1]
    rows = np.where(last, np.arange(len(scores))[:, None], len(scores))
    ends = np.minimum.accumulate(rows[::-1], axis=0)[::-1]
    precision = np.take_along_axis(precision, ends, axis=0)
    positives = truth.sum(axis=0)
    total = (precision * hits).sum(axis=0)
    nowhere = np.full(scores.shape[1], np.nan)
    return np.asarray(np.divide(total, positives, out=nowhere, where=positives > 0))


PLACES = ("{name}/tracks.json", "{name}.json"), ("tracks.json",)


@dataclass(frozen=True)
class LabelledActions:
    """A clip's people and their actions.

    Attributes:
        name: of the clip.
        truth: who is where.
        actions: ``(N, A)`` of its rows.
        names: of the actions.
        frames: that count; reports of others are passed over.
    """

    name: str
    truth: GroundTruth
    actions: BoolArray
    names: tuple[str, ...]
    frames: FrameRange = EVERY_FRAME


@dataclass(frozen=True)
class ActionRows:
    """M rows to score: every labelled person in every frame, and every tracked box that is a false positive.

    Attributes:
        truth: ``(M, A)`` what is so; nothing on a false positive.
        single: ``(M, A)`` what single frames say; NaN of a person whom no track has.
        multi: ``(M, A)`` what the window says.
    """

    truth: BoolArray
    single: FloatArray
    multi: FloatArray


def read_labelled_actions(
    path: Path,
    protocol: Protocol = "lenient",
    size: tuple[int, int] | None = None,
    frames: FrameRange = EVERY_FRAME,
) -> list[LabelledActions]:
    """The labels at ``path``, see `open_labelled`, by a protocol of `okutama_truth`; all of Drone-Action's count.

    ``size`` has width and height of the frames that were tracked, for Okutama-Action's labels; by default those of the
    frames that lie with them, or else of those that come with the data.

    Raises:
        RequestError: there are none, they are broken, or no person to score is labelled in these frames.
    """
    clips = []
    for video in open_labelled(path):
        labels = video.actions(size)
        # Every frame of Drone-Action counts, whatever the protocol.
        used: Protocol = "lenient" if labels.class_names == DRONE_ACTION_CLASSES else protocol
        truth, actions = okutama_truth(labels, used)
        clips.append(LabelledActions(video.name, truth, actions, labels.class_names, counted_from(used)))
    return [_within(labels, frames) for labels in clips] if frames != EVERY_FRAME else clips


def _within(labels: LabelledActions, frames: FrameRange) -> LabelledActions:
    within = FrameRange(max(frames.first, labels.frames.first), frames.last)
    inside = within.mask(labels.truth.frames)
    truth = labels.truth.select(inside)
    if not truth.evaluated.any():
        raise RequestError(f"{labels.name}: expected a labelled person who counts in frames {frames}, got none")
    return replace(labels, truth=truth, actions=labels.actions[inside], frames=within)


def match_actions(truths: Sequence[LabelledActions], result: Path) -> ActionRows:
    """The rows of all clips with what the tracks in ``result`` say of them.

    It is a ``tracks.json``, or a folder with NAME/tracks.json for each clip NAME (of one clip also tracks.json).

    Raises:
        RequestError: a result is missing or broken, or has other actions than the labels.
    """
    parts = []
    for labels in truths:
        path = result_file(labels.name, result, len(truths) == 1, PLACES)
        people, names = read_acting_tracks(path)
        warn_of_other_frames(path, int(labels.truth.frames.min()), int(labels.truth.frames.max()))
        if names != labels.names:
            raise RequestError(
                f"{path}: expected the actions of the labels, {', '.join(labels.names)}; got {', '.join(names)}"
            )
        parts.append(action_rows(labels, people))
    return join_action_rows(parts)


def join_action_rows(parts: Sequence[ActionRows]) -> ActionRows:
    """The rows of several clips."""
    return ActionRows(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("truth", "single", "multi")))


def action_rows(labels: LabelledActions, people: Sequence[ActingTrack]) -> ActionRows:
    """The rows of one clip; people and labels are matched frame by frame from an overlap of 0.5 on.

    A track on a label that is to be ignored gives no row, and neither does that label.
    """
    acting = [person for person in people if person.single is not None and person.multi is not None]
    width = len(labels.names)
    frames = np.concatenate([np.empty(0, np.int64), *(person.track.frames for person in acting)])
    order = np.argsort(frames, kind="stable")
    order = order[labels.frames.mask(frames[order])]
    frames = frames[order]
    boxes = np.concatenate([np.empty((0, 4)), *(person.track.boxes for person in acting)])[order]
    single = np.concatenate([np.empty((0, width)), *(p.single for p in acting if p.single is not None)])[order]
    multi = np.concatenate([np.empty((0, width)), *(p.multi for p in acting if p.multi is not None)])[order]
    label = matched_labels(frames, boxes, labels.truth)
    matched = np.flatnonzero(label != UNMATCHED)
    match = np.full(len(labels.truth), -1, dtype=np.int64)
    match[label[matched]] = matched
    nothing = np.full((1, width), np.nan)
    counted = labels.truth.evaluated
    # Index -1, no match, picks the appended row.
    of_labels = [np.concatenate([part, nothing])[match[counted]] for part in (single, multi)]
    unmatched = label == UNMATCHED
    truth = np.concatenate([labels.actions[counted], np.zeros((int(unmatched.sum()), width), dtype=np.bool_)])
    rows = [
        np.concatenate([part, reported[unmatched]]) for part, reported in zip(of_labels, (single, multi), strict=True)
    ]
    return ActionRows(truth, *rows)


def action_table(results: Mapping[str, ActionScores]) -> Table:
    """F1 and average precision of every action, in percent, a column a result."""
    first = next(iter(results.values()))
    headings = ["rows", *(heading for name in results for heading in (f"{name}\nF1", "\nAP"))]
    columns = [values for s in results.values() for values in (s.f1, s.average_precision)]
    rows = [
        [action, str(first.positives[a]), *(_percent(values[a]) for values in columns)]
        for a, action in enumerate(first.names)
    ]
    means = [_percent(value) for s in results.values() for value in (s.mean_f1, s.mean_average_precision)]
    return score_table(("Action",), headings, [rows, [["mean", str(first.rows), *means]]])


def action_values(results: Mapping[str, ActionScores]) -> dict[str, Any]:
    """The same for a JSON file, with precision and recall; null where an action does not occur."""
    kinds = ("f1", "precision", "recall", "average_precision")
    return {
        name: {
            "mean_f1": scores.mean_f1,
            "mean_average_precision": scores.mean_average_precision,
            "rows": scores.rows,
            "actions": {
                action: {kind: None if np.isnan(value := getattr(scores, kind)[a]) else float(value) for kind in kinds}
                | {"rows": int(scores.positives[a])}
                for a, action in enumerate(scores.names)
            },
        }
        for name, scores in results.items()
    }


def _percent(value: float) -> str:
    return "–" if np.isnan(value) else f"{100 * value:.2f}"
