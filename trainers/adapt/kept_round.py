"""A round on disk: what it saw and how it did, so that a run that was stopped goes on from there."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from tsuiseki.tracking.formats.mot import read_detections
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.adapt.agreement import RoundScores
from tsuiseki.trainers.adapt.find import Models
from tsuiseki.trainers.adapt.kept_tracks import read_everyone
from tsuiseki.trainers.adapt.labels import TAKEN, Verdict
from tsuiseki.trainers.adapt.linking import APPEARANCE, COSTS, LinkScores

_DONE = "round.json"


@dataclass(frozen=True)
class Round:
    """What a round saw.

    Attributes:
        number: 0 for the models that it starts from.
        models: that looked.
        scores: how they did.
        links: how what tells people apart did.
        verdicts: on the tracks of each video.
        columns: tiles across in which the detector looked.
        folder: with the labels and tracks of each video.
    """

    number: int
    models: Models
    scores: RoundScores
    links: LinkScores
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
        "links": asdict(here.links),
        "verdicts": [[asdict(v) for v in video] for video in here.verdicts],
        "columns": here.columns,
    }
    (here.folder / "unfinished.json").write_text(json.dumps(values), encoding="utf-8")
    (here.folder / "unfinished.json").replace(here.folder / _DONE)


def kept_round(folder: Path, number: int, models: Models) -> Round | None:
    """What `keep_round` wrote in ``folder``; None where the round is not finished.

    Args:
        folder: of the round.
        number: of it.
        models: it looked with, but for what tells people apart.
    """
    if not (folder / _DONE).is_file():
        return None
    values = json.loads((folder / _DONE).read_text(encoding="utf-8"))
    verdicts = tuple(tuple(Verdict(**v) for v in video) for video in values["verdicts"])
    links = LinkScores(**values["links"])
    if links.better_appearance:
        models = replace(models, appearance=folder / APPEARANCE)
    if links.better_costs:
        models = replace(models, affinity=folder / COSTS)
    return Round(number, models, RoundScores(**values["scores"]), links, verdicts, values["columns"], folder)
