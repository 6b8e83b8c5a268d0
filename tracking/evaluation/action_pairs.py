"""Labelled actions and what a tracker says of them, person by person and frame by frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.multi import MATCH_OVERLAP
from tsuiseki.tracking.evaluation.pairs import result_file
from tsuiseki.tracking.formats.acting_tracks import ActingTrack, read_acting_tracks
from tsuiseki.tracking.formats.mot import GroundTruth, find_sequences
from tsuiseki.tracking.formats.okutama import Protocol, okutama_truth, read_okutama
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray, IntArray

ACTIONS_FILE = "gt/actions.txt"
PLACES, SINGLE_PLACES = ("{name}/tracks.json", "{name}.json"), ("tracks.json",)


@dataclass(frozen=True)
class LabelledActions:
    """A clip's people and their actions.

    Attributes:
        name: of the clip.
        truth: who is where.
        actions: ``(N, A)`` of its rows.
        names: of the actions.
    """

    name: str
    truth: GroundTruth
    actions: BoolArray
    names: tuple[str, ...]


@dataclass(frozen=True)
class ActionRows:
    """M rows to score: every labelled person in every frame, and every tracked box on nobody.

    Attributes:
        truth: ``(M, A)`` what is so; nothing on a box on nobody.
        single: ``(M, A)`` what single frames say; 0 of a person whom no track has.
        multi: ``(M, A)`` what the window says.
    """

    truth: BoolArray
    single: FloatArray
    multi: FloatArray


def read_labelled_actions(path: Path, protocol: Protocol = "published") -> list[LabelledActions]:
    """The labels of a sequence folder with ``gt/actions.txt``, or of a folder of such.

    Raises:
        RequestError: there are none, or they are broken.
    """
    found = []
    for sequence in find_sequences(path):
        labels = read_okutama(sequence.folder / ACTIONS_FILE, (sequence.width, sequence.height))
        truth, actions = okutama_truth(labels, protocol)
        found.append(LabelledActions(sequence.name, truth, actions, labels.class_names))
    return found


def match_actions(truths: Sequence[LabelledActions], result: Path) -> ActionRows:
    """The rows of all clips with what the tracks in ``result`` say of them.

    Args:
        truths: the labels.
        result: a ``tracks.json``, or a folder with NAME/tracks.json for each clip NAME (of one clip also tracks.json).

    Raises:
        RequestError: a result is missing or broken, or has other actions than the labels.
    """
    parts = []
    for labels in truths:
        path = result_file(labels.name, result, len(truths) == 1, PLACES, SINGLE_PLACES)
        people, names = read_acting_tracks(path)
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
    frames = frames[order]
    boxes = np.concatenate([np.empty((0, 4)), *(person.track.boxes for person in acting)])[order]
    single = np.concatenate([np.empty((0, width)), *(p.single for p in acting if p.single is not None)])[order]
    multi = np.concatenate([np.empty((0, width)), *(p.multi for p in acting if p.multi is not None)])[order]
    match = _matched(labels.truth, frames, boxes)
    nothing = np.zeros((1, width))
    counted = labels.truth.evaluated
    # Index -1, no match, picks the appended row of zeros.
    of_labels = [np.concatenate([said, nothing])[match[counted]] for said in (single, multi)]
    on_nobody = np.ones(len(frames), dtype=np.bool_)
    on_nobody[match[match >= 0]] = False
    truth = np.concatenate([labels.actions[counted], np.zeros((int(on_nobody.sum()), width), dtype=np.bool_)])
    rows = [np.concatenate([said, rest[on_nobody]]) for said, rest in zip(of_labels, (single, multi), strict=True)]
    return ActionRows(truth, *rows)


def _matched(truth: GroundTruth, frames: IntArray, boxes: FloatArray) -> IntArray:
    """``(N,)`` row of the box that each label is matched to, -1 for none."""
    match = np.full(len(truth), -1, dtype=np.int64)
    for frame in np.unique(truth.frames).tolist():
        here = np.flatnonzero(truth.frames == frame)
        first, last = np.searchsorted(frames, [frame, frame + 1])
        rows, columns = assign_overlaps(iou_matrix(truth.boxes[here], boxes[first:last]), MATCH_OVERLAP)
        match[here[rows]] = first + columns
    return match
