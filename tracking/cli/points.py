"""`tsuiseki evaluate points`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from tsuiseki.tracking.errors import RequestError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.table import Table

    from tsuiseki.tracking.evaluation.points import PointScores, PointTracks


def evaluate(
    truth: Path,
    results: list[Path],
    cutoff: float = 100.0,
    window: int = 10,
    json: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Score tracked points: OSPA, OSPA(2), GOSPA and its parts, number of targets, changed identities.

    Args:
        truth: points as CSV with the columns frame,id,x,y, or MOTChallenge text, whose boxes count by their centres.
        results: of the same kinds; several are compared.
        cutoff: distance from which a point counts as missed, in the unit of the files.
        window: frames of OSPA(2).
        json: write all scores to this file.
        overwrite: replace an existing file.
    """
    import json as text
    from dataclasses import asdict

    from tsuiseki.tracking.evaluation.points import evaluate_points
    from tsuiseki.tracking.evaluation.table import show
    from tsuiseki.tracking.output import check_output_file, output_file

    if not cutoff > 0 or window < 1:
        raise RequestError(f"expected --cutoff above 0 and --window from 1, got {cutoff:g} and {window}")
    if json is not None:
        check_output_file(json, overwrite)
    labels = _point_tracks(truth, labelled=True)
    if len(labels.frames) == 0:
        raise RequestError(f"{truth}: expected at least one labelled point, got none")
    scores = {}
    for path in results:
        found = _point_tracks(path, labelled=False)
        frames = int(max(labels.frames.max(), found.frames.max(initial=0))) + 1
        scores[str(path)] = evaluate_points(labels, found, frames, cutoff, window)
    show(_scores_table(scores))
    if json is not None:
        with output_file(json, overwrite) as work:
            values = {name: asdict(value) for name, value in scores.items()}
            work.write_text(text.dumps(values, indent=1) + "\n", encoding="utf-8")


def _point_tracks(path: Path, labelled: bool) -> PointTracks:
    import numpy as np

    from tsuiseki.tracking.evaluation.points import PointTracks as Points
    from tsuiseki.tracking.formats.mot import read_ground_truth, read_tracks
    from tsuiseki.tracking.formats.points import is_point_file, read_point_tracks

    if is_point_file(path):
        return Points(*read_point_tracks(path))
    if labelled:
        truth = read_ground_truth(path)
        truth = truth.select(truth.evaluated)
        return Points(truth.frames, truth.ids, (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2)
    tracks = read_tracks(path)
    boxes = np.concatenate([np.empty((0, 4)), *(track.boxes for track in tracks)])
    frames = np.concatenate([np.empty(0, dtype=np.int64), *(track.frames for track in tracks)])
    ids = np.concatenate([np.empty(0, dtype=np.int64), *(np.full(len(t), t.id) for t in tracks)])
    return Points(frames, ids, (boxes[:, :2] + boxes[:, 2:]) / 2)


def _scores_table(scores: Mapping[str, PointScores]) -> Table:
    from rich.table import Table as RichTable

    table = RichTable()
    names = ("result", "OSPA p=1", "OSPA p=2", "OSPA(2)", "GOSPA", "missed", "false", "|count error|", "switches")
    for name in names:
        table.add_column(name, justify="left" if name == "result" else "right")
    for name, s in scores.items():
        numbers = (s.ospa1, s.ospa2, s.ospa_tracks, s.gospa, s.missed, s.false, s.cardinality_error)
        table.add_row(name, *(f"{value:.2f}" for value in numbers), str(s.switches))
    return table
