"""Results against labels, in one call each."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from tsuiseki.tracking.errors import RequestError, a_path
from tsuiseki.tracking.evaluation.frame_offset import moved
from tsuiseki.tracking.evaluation.multi import PeopleScores, evaluate_sequence, restrict
from tsuiseki.tracking.evaluation.point_distances import PointScores, PointTracks
from tsuiseki.tracking.evaluation.point_distances import evaluate_points as score_points
from tsuiseki.tracking.evaluation.result_files import Truth, match_results, of_class, read_truths
from tsuiseki.tracking.evaluation.success_curves import SequenceScores, evaluate_boxes
from tsuiseki.tracking.formats.label_checks import same_class
from tsuiseki.tracking.formats.tracked_video import boxes_of_tracks
from tsuiseki.tracking.types import Estimate, FloatArray, Track, as_numbers
from tsuiseki.tracking.types.class_choice import ClassChoice
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange, parse_frames
from tsuiseki.tracking.types.labels import GroundTruth

TruthLike: TypeAlias = str | Path | GroundTruth | Collection[Track]


@overload
def evaluate_people(
    truth: TruthLike,
    tracks: str | Path | Collection[Track],
    frames: str | None = None,
    classes: None = None,
    offset: int = 0,
) -> PeopleScores: ...
@overload
def evaluate_people(
    truth: TruthLike,
    tracks: str | Path | Collection[Track],
    frames: str | None = None,
    *,
    classes: Sequence[int | str],
    offset: int = 0,
) -> dict[int | str, PeopleScores]: ...
def evaluate_people(
    truth: TruthLike,
    tracks: str | Path | Collection[Track],
    frames: str | None = None,
    classes: Sequence[int | str] | None = None,
    offset: int = 0,
) -> PeopleScores | dict[int | str, PeopleScores]:
    """HOTA, MOTA, IDF1 and more of tracked people, or of tracked objects of each class.

    Args:
        truth: labels: a sequence folder or file in any layout that `tsuiseki evaluate people` reads, ground truth that
            was read before, or the right tracks themselves.
        tracks: the result: tracks, or their file or folder.
        frames: score these only, counted from 1 with both ends, such as ``"301-400"``.
        classes: score these, each apart, by the labels' names or numbers, such as ``["person", "car"]``.
        offset: frames to add to the numbers of the result.

    Returns:
        The scores; with ``classes`` those of each, by its number or its name in small letters.

    Raises:
        RequestError: one of them cannot be read, or nothing can be scored; the message says why.
    """
    if classes is None:
        return _scores(truth, tracks, frames, None, offset)
    return {kind: _scores(truth, tracks, frames, kind, offset) for kind in ClassChoice(classes).plain}


def _scores(
    truth: TruthLike, tracks: str | Path | Collection[Track], frames: str | None, kind: int | str | None, offset: int
) -> PeopleScores:
    label = _truth(truth, frames, kind)
    if isinstance(tracks, str | Path):
        (pair,) = match_results([label], a_path(tracks, "tracks"), offset)
        return evaluate_sequence(pair.truth, pair.tracks, pair.length)
    if not _are_tracks(tracks):
        raise RequestError("expected the result as tracks, a file or a folder, got nothing of that")
    chosen = [*tracks]
    if offset:
        chosen = moved("the result", chosen, offset, FrameRange(0, label.length - 1 if label.length else None))
    chosen = chosen if kind is None else of_class(label, chosen, "the result")
    scored = restrict(chosen, label.frames, label.listed)
    return evaluate_sequence(label.labels, scored, label.length)


def evaluate_target(truth: ArrayLike, target: ArrayLike | Iterable[Estimate]) -> SequenceScores:
    """Success and precision of one target, frame by frame.

    Args:
        truth: ``(T, 4)`` true boxes x1, y1, x2, y2 in pixels, NaN where there is none.
        target: the estimates of the same frames, or their boxes ``(T, 4)``.

    Raises:
        RequestError: these are no boxes, or no frame can be scored.
    """
    rows: Any = target if isinstance(target, np.ndarray) else list(target)  # type: ignore[arg-type]
    boxes = [row.box if isinstance(row, Estimate) else row for row in rows]
    return evaluate_boxes(_boxes(truth, "truth"), _boxes(boxes, "target"))


def evaluate_points(
    truth: Collection[Track], tracks: Collection[Track], frames: int, cut_off: float = 100.0
) -> PointScores:
    """OSPA, GOSPA and more of tracked points or objects, by the centres of their boxes.

    Args:
        truth: the right tracks.
        tracks: the result.
        frames: length of the video.
        cut_off: distance in pixels from which a point counts as missed.

    Raises:
        RequestError: nothing can be scored.
    """
    if not truth or frames < 1:
        raise RequestError("expected at least one frame and one true track, got none")
    return score_points(PointTracks.of([*truth]), PointTracks.of([*tracks]), frames, cut_off)


def _truth(truth: TruthLike, frames: str | None, kind: int | str | None) -> Truth:
    within, names = parse_frames(frames), dict[int, str]()
    if isinstance(truth, str | Path):
        truths = read_truths(a_path(truth, "truth"), within, kind=kind)
        if len(truths) != 1:
            raise RequestError(
                f"expected the labels of one sequence, got {len(truths)} in {truth}; score them one by one, or with "
                "`tsuiseki evaluate people`"
            )
        return truths[0]
    if kind is not None:
        if isinstance(truth, GroundTruth) or not _are_tracks(truth):
            raise RequestError("`classes`: expected the truth as a folder, a file or tracks, got labels of one class")
        names = {track.class_id: track.class_name or str(track.class_id) for track in truth}
        truth = [track for track in truth if kind == track.class_id or same_class(track.class_name, str(kind))]
        if not truth:
            raise RequestError(f"`classes`: expected tracks of {kind} in the truth, got none")
    labels = truth if isinstance(truth, GroundTruth) else ground_truth_of(truth)
    if within != EVERY_FRAME:
        last = int(labels.frames.max(initial=0)) if within.last is None else within.last
        labels = labels.between(within.first, last)
    return Truth("sequence", labels, None, within, None, kind, names)


def ground_truth_of(tracks: Collection[Track]) -> GroundTruth:
    """Right tracks as labels that all count.

    Raises:
        RequestError: there is none, or one is no track.
    """
    if not _are_tracks(tracks) or not tracks:
        raise RequestError("expected the truth as a folder, a file or tracks, got nothing of that")
    rows = boxes_of_tracks([*tracks])
    return GroundTruth.of_boxes(rows.frames, rows.ids, rows.boxes)


def _are_tracks(tracks: object) -> bool:
    return isinstance(tracks, Collection) and all(isinstance(track, Track) for track in tracks)


def _boxes(rows: ArrayLike, name: str) -> FloatArray:
    boxes = as_numbers(rows, name)
    if boxes.ndim != 2 or boxes.shape[1] != 4:
        raise RequestError(f"expected `{name}` as boxes of shape (T, 4), got {boxes.shape}")
    return boxes
