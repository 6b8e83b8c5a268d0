"""A round on disk: what it saw and how it did, so that a run that was stopped goes on from there."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from tsuiseki.tracking.features.exported import SizedDetect
from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.adapt.agreement import RoundScores
from tsuiseki.trainers.adapt.track_labels import TAKEN, Verdict

_DONE = "round.json"
_COLUMNS = ("frames", "boxes", "scores", "observed")


@dataclass(frozen=True)
class Round:
    """What a round found.

    Attributes:
        number: 0 for the detector that it starts from.
        detector: that looked: a file, or one that is open.
        scores: how it did.
        verdicts: on the tracks of each video.
        columns: tiles across in which the detector looked.
        folder: with the labels and tracks of each video.
    """

    number: int
    detector: Path | SizedDetect
    scores: RoundScores
    verdicts: tuple[tuple[Verdict, ...], ...]
    columns: int
    folder: Path

    def tracks(self, video: int) -> list[Track]:
        """Everyone who was followed in a video, taken or not, in the order of the verdicts."""
        return read_everyone(self.folder / f"tracks-{video}.npz")

    def taken(self, video: int) -> list[Track]:
        """Those whose tracks are labels."""
        pairs = zip(self.tracks(video), self.verdicts[video], strict=True)
        return [track for track, verdict in pairs if verdict.verdict == TAKEN]

    def detections(self, video: int, length: int) -> list[Detections]:
        """What was found in each frame of a video, up to its ``length``."""
        return read_detections(self.folder / f"det-{video}.txt", length)


def keep_round(here: Round) -> None:
    """Write what of a round no other file holds; last, and whole: its presence says that the round is finished."""
    values = {
        "scores": asdict(here.scores),
        "verdicts": [[asdict(v) for v in video] for video in here.verdicts],
        "columns": here.columns,
    }
    (here.folder / "unfinished.json").write_text(json.dumps(values), encoding="utf-8")
    (here.folder / "unfinished.json").replace(here.folder / _DONE)


def kept_round(folder: Path, number: int, detector: Path | SizedDetect) -> Round | None:
    """What `keep_round` wrote in ``folder`` of round ``number``; None where the round is not finished."""
    if not (folder / _DONE).is_file():
        return None
    values = json.loads((folder / _DONE).read_text(encoding="utf-8"))
    verdicts = tuple(tuple(Verdict(**v) for v in video) for video in values["verdicts"])
    return Round(number, detector, RoundScores(**values["scores"]), verdicts, values["columns"], folder)


def write_everyone(path: Path, tracks: Sequence[Track]) -> None:
    """Keep ``tracks`` with what of them was filled in."""
    np.savez(
        path,
        ids=np.array([t.id for t in tracks], dtype=np.int64),
        lengths=np.array([len(t) for t in tracks], dtype=np.int64),
        frames=np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)]),
        boxes=np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)]),
        scores=np.concatenate([np.empty(0), *(t.scores for t in tracks)]),
        observed=np.concatenate([np.empty(0, np.bool_), *(t.observed for t in tracks)]),
    )


def read_everyone(path: Path) -> list[Track]:
    """What `write_everyone` wrote."""
    with np.load(path, allow_pickle=False) as file:
        ends = np.cumsum(file["lengths"])
        columns = [np.split(file[name], ends[:-1]) for name in _COLUMNS]
        ids = file["ids"].tolist()
    return [Track(int(i), *parts) for i, *parts in zip(ids, *columns, strict=True)] if ids else []
