"""Points in files against labelled points in a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.evaluation.points import PointScores, PointTracks, evaluate_points
from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks
from tsuiseki.tracking.formats.sensors.points import is_point_file, read_point_tracks
from tsuiseki.tracking.types.frame_range import EVERY_FRAME, FrameRange


def evaluate_point_files(
    truth: Path,
    results: Mapping[str, Path],
    cutoff: float = 100.0,
    window: int = 10,
    wanted: FrameRange = EVERY_FRAME,
) -> dict[str, PointScores]:
    """Scores of several results, from frame 1 to the last that has a point; frames without any count as right.

    Args:
        truth: points as CSV with the columns frame,id,x,y, or MOTChallenge text, whose boxes count by their centres.
        results: files of the same kinds, by name.
        cutoff: distance from which a point counts as missed.
        window: frames of OSPA(2).
        wanted: these frames only.

    Raises:
        RequestError: a file is missing or broken, or no point is labelled.
    """
    labels = read_labelled_points(truth)
    if not wanted.mask(labels.frames).any():
        raise RequestError(f"{truth}: expected at least one labelled point in the frames to score, got none")
    scores = {}
    for name, path in results.items():
        found = read_tracked_points(path)
        end = int(max(labels.frames.max(), found.frames.max(initial=0)))
        first, last = wanted.first, end if wanted.last is None else wanted.last
        parts = [_counted_from(points, first, last) for points in (labels, found)]
        scores[name] = evaluate_points(parts[0], parts[1], last - first + 1, cutoff, window)
    return scores


def _counted_from(points: PointTracks, first: int, last: int) -> PointTracks:
    """The points of these frames, the first of which becomes 0."""
    inside = points.between(first, last)
    return PointTracks(inside.frames - first, inside.ids, inside.positions)


def read_labelled_points(path: Path) -> PointTracks:
    """The points of a CSV file, or the centres of the boxes in MOTChallenge's gt.txt that count."""
    if is_point_file(path):
        return PointTracks(*read_point_tracks(path))
    truth = read_ground_truth(path)
    truth = truth.select(truth.evaluated)
    return PointTracks(truth.frames, truth.ids, (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2)


def read_tracked_points(path: Path) -> PointTracks:
    """The points of a CSV file, or the centres of the boxes in MOTChallenge text."""
    return PointTracks(*read_point_tracks(path)) if is_point_file(path) else PointTracks.of(read_tracks(path))
