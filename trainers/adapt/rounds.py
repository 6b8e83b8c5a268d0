"""The rounds of `tsuiseki adapt`: look at the camera's video, take labels from the tracks, learn from them, look again.

A round looks with the models of the round before, or those it starts from, learns what tells people apart (`linking`),
and says how well all did (`agreement`). Rounds go on while that improves and nothing collapses. What a round makes lies
in its folder, and what is there already is not made again, so a run that was stopped goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.networks.foreign_options import DetectorOptions
from tsuiseki.tracking.formats.mot import read_detections, write_detections
from tsuiseki.tracking.frame_range import FrameRange
from tsuiseki.tracking.pipelines.people.finding import NONE
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.adapt.agreement import RoundScores, agreement_held_out, round_scores
from tsuiseki.trainers.adapt.examples import first_held_out
from tsuiseki.trainers.adapt.find import Models, find
from tsuiseki.trainers.adapt.foreground import Foreground, foreground_of
from tsuiseki.trainers.adapt.kept_tracks import read_everyone, write_everyone
from tsuiseki.trainers.adapt.labels import TAKEN, Verdict
from tsuiseki.trainers.adapt.learn_detector import CHECKPOINT, export_calibrated, fine_tune
from tsuiseki.trainers.adapt.linking import APPEARANCE, COSTS, LinkScores, Seen, learn_links, seen_in
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.watch import Watched, refuse_other_sizes, refuse_two_cameras, watch
from tsuiseki.trainers.exporting.exported_weights import layout_of

_DONE = "round.json"
# Agreement must rise by this much for a round to be better.
_BETTER = 0.002


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


@dataclass(frozen=True)
class Camera:
    """The videos of a camera and how to look at them.

    Attributes:
        videos: at least one.
        foregrounds: what is not the empty view of each; None where the camera moves.
        view: tiles of a frame, see `parse_view`.
    """

    videos: tuple[Watched, ...]
    foregrounds: tuple[Foreground | None, ...]
    view: str = "auto"

    @property
    def fixed(self) -> bool:
        """Whether the camera stands still in every video."""
        return all(foreground is not None for foreground in self.foregrounds)


def open_camera(
    sources: Sequence[str], stretch: FrameRange, work: Path, settings: AdaptSettings, view: str = "auto"
) -> Camera:
    """Read the videos of a camera once, and keep pictures of them.

    Args:
        sources: see `open_source`.
        stretch: frames of each to look at.
        work: folder for the pictures.
        settings: how many.
        view: tiles of a frame.

    Raises:
        RequestError: see `watch`; or the videos are of two cameras.
        RunError: a video breaks off.
    """
    share = max(20, settings.pictures // len(sources))
    videos = [watch(source, stretch, work / f"video-{n}", share) for n, source in enumerate(sources)]
    refuse_other_sizes(videos)
    foregrounds = [foreground_of(video) if video.fixed else None for video in videos]
    fixed = [foreground for foreground in foregrounds if foreground is not None]
    if len(fixed) > 1:
        refuse_two_cameras([each.watched for each in fixed], [each.empty for each in fixed])
    return Camera(tuple(videos), tuple(foregrounds), view)


@dataclass(frozen=True)
class Adaptation:
    """What the rounds of a camera share.

    Attributes:
        camera: what to learn.
        start: exported detector to begin with.
        work: folder for what the rounds make.
        settings: how.
        teacher: detector that looks first, in place of ``start``; may be of another project.
        tell: gets a line about what is being done.
        teacher_options: what the teacher's file does not tell.
    """

    camera: Camera
    start: Path
    work: Path
    settings: AdaptSettings
    teacher: Path | None = None
    tell: Callable[[str], None] = print
    teacher_options: DetectorOptions | None = None

    def folder(self, number: int) -> Path:
        """Of a round."""
        path = self.work / f"round-{number}"
        path.mkdir(parents=True, exist_ok=True)
        return path


def rounds(adaptation: Adaptation) -> Iterator[Round]:
    """Round 0, which only looks, and those that learn; each as soon as it is finished.

    With a teacher round 0 is what the teacher sees; its agreement is that of the detector that is to learn from it, so
    that the first round competes with the detector that would be kept otherwise.

    Raises:
        RequestError: nobody is followed with confidence, or a file is no such model.
    """
    looking = Models(adaptation.teacher or adaptation.start, options=adaptation.teacher_options)
    first = best = _look(adaptation, 0, looking)
    _refuse_nobody(first, adaptation.camera)
    yield first
    for number in range(1, adaptation.settings.rounds + 1):
        here = _look(adaptation, number, _learn(adaptation, number, best))
        yield here
        if here.scores.collapsed(first.scores) is not None or not better(here, best):
            return
        best = here


def resumed(work: Path, key: dict[str, Any]) -> bool:
    """Prepare the folder of the rounds; whether it holds what a run with the same ``key`` has finished.

    Args:
        work: the folder; what another request has left there is removed.
        key: plain values that say what is asked for.
    """
    file, text = work / "request.json", json.dumps(key, indent=1)
    if file.is_file() and file.read_text(encoding="utf-8") == text:
        return True
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    file.write_text(text, encoding="utf-8")
    return False


def better(later: Round, earlier: Round) -> bool:
    """Whether a round agrees with its tracks clearly more."""
    return later.scores.agreement > earlier.scores.agreement + _BETTER


def best_of(finished: Sequence[Round]) -> Round:
    """The round to keep: the last one that was better than the best before it and did not collapse."""
    best = finished[0]
    for later in finished[1:]:
        if later.scores.collapsed(finished[0].scores) is None and better(later, best):
            best = later
    return best


def _learn(adaptation: Adaptation, number: int, taught_by: Round) -> Models:
    """The models of round ``number``, from the labels of the one before."""
    folder, camera = adaptation.folder(number), adaptation.camera
    detector = folder / "detector.onnx"
    # The shipped costs know the scores of the shipped detector, not those that were learnt here.
    models = Models(detector, affinity=Path(NONE))
    if detector.is_file():
        return models
    videos = _teaching(camera.videos, taught_by, adaptation.settings.held_out)
    layout = layout_of(adaptation.start)
    before = adaptation.work / f"round-{number - 1}" / CHECKPOINT
    start = before if before.is_file() else adaptation.start
    adaptation.tell(f"round {number}: learning from {sum(map(_taken, taught_by.verdicts))} people")
    checkpoint = fine_tune(start, layout, videos, taught_by.columns, number, folder, adaptation.settings)
    view = (taught_by.columns, None)
    export_calibrated(checkpoint, layout.size, videos, view, detector, adaptation.settings)
    return models


def _teaching(videos: Sequence[Watched], taught_by: Round, held_out: float) -> list[Watched]:
    """The videos with people in what may be learnt from, the labels of the round beside their pictures.

    Raises:
        RequestError: there is none.
    """
    teaching = []
    for n, video in enumerate(videos):
        frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in taught_by.taken(n))])
        if np.isin(video.frames[: video.learnt(held_out)], frames).any():
            shutil.copyfile(taught_by.folder / f"gt-{n}.txt", _labels_of(video))
            teaching.append(video)
    if not teaching:
        raise RequestError(
            f"expected people before the last {held_out:.0%} of a video, held out, got none; give a longer one"
        )
    return teaching


def _look(adaptation: Adaptation, number: int, models: Models) -> Round:
    """Look with ``models``, or read what an earlier call saw."""
    folder, camera, settings = adaptation.folder(number), adaptation.camera, _settings_of(adaptation, number)
    if (folder / _DONE).is_file():
        return _read(folder, number, models)
    seen = []
    for video, foreground in zip(camera.videos, camera.foregrounds, strict=True):
        adaptation.tell(f"round {number}: looking at {video.source}")
        found = find(video, models, settings.score_threshold, camera.view, settings.threads)
        seen.append(seen_in(video, foreground, found, settings))
    links = LinkScores()
    if number:
        seen, models, links = learn_links(seen, models, folder, settings, settings.seed + number)
    scores = round_scores(seen, settings)
    if not number and adaptation.teacher is not None:
        scores = replace(scores, agreement=_before_learning(adaptation, seen))
    for n, each in enumerate(seen):
        before = [Detections.empty()] * each.found.first
        write_detections(folder / f"det-{n}.txt", [*before, *each.found.detections])
        write_everyone(folder / f"tracks-{n}.npz", each.labels.everyone)
        if len(each.labels.people):
            each.labels.write(each.watched)
            shutil.copyfile(_labels_of(each.watched), folder / f"gt-{n}.txt")
    here = Round(
        number,
        models,
        scores,
        links,
        tuple(each.labels.verdicts for each in seen),
        max(each.found.columns for each in seen),
        folder,
    )
    _keep(here)
    return here


def _before_learning(adaptation: Adaptation, seen: Sequence[Seen]) -> float:
    """How well the detector that is to learn agrees with the tracks of its teacher."""
    settings, detections = adaptation.settings, []
    for each in seen:
        first = first_held_out(each.watched, each.found, settings.held_out)
        end = replace(each.watched, stretch=(first, each.watched.stretch[1]))
        adaptation.tell(f"round 0: looking at the end of {end.source} with {adaptation.start.name}")
        found = find(end, Models(adaptation.start), settings.score_threshold, adaptation.camera.view, settings.threads)
        detections.append(found.detections[first - found.first :])
    return agreement_held_out(seen, detections, settings)


def _settings_of(adaptation: Adaptation, number: int) -> AdaptSettings:
    """Those of a round: boxes that were learnt from silhouettes are not moved again."""
    settings = adaptation.settings
    return replace(settings, labels=replace(settings.labels, onto_silhouettes=0.0)) if number else settings


def _keep(here: Round) -> None:
    """Write what of a round no other file holds; last, and whole: its presence says that the round is finished."""
    values = {
        "scores": asdict(here.scores),
        "links": asdict(here.links),
        "verdicts": [[asdict(v) for v in video] for video in here.verdicts],
        "columns": here.columns,
    }
    (here.folder / "unfinished.json").write_text(json.dumps(values), encoding="utf-8")
    (here.folder / "unfinished.json").replace(here.folder / _DONE)


def _read(folder: Path, number: int, models: Models) -> Round:
    values = json.loads((folder / _DONE).read_text(encoding="utf-8"))
    verdicts = tuple(tuple(Verdict(**v) for v in video) for video in values["verdicts"])
    links = LinkScores(**values["links"])
    if links.better_appearance:
        models = replace(models, appearance=folder / APPEARANCE)
    if links.better_costs:
        models = replace(models, affinity=folder / COSTS)
    return Round(number, models, RoundScores(**values["scores"]), links, verdicts, values["columns"], folder)


def _labels_of(video: Watched) -> Path:
    return Path(video.folder) / "gt" / "gt.txt"


def _taken(verdicts: Sequence[Verdict]) -> int:
    return sum(v.verdict == TAKEN for v in verdicts)


def _refuse_nobody(first: Round, camera: Camera) -> None:
    """Without anybody there is nothing to learn from."""
    if first.scores.people:
        return
    names = ", ".join(video.source for video in camera.videos)
    others = sum(map(len, first.verdicts))
    seen = f"{others} uncertain tracks" if others else "nobody"
    raise RequestError(
        f"expected people to learn from in {names}, found {seen}; give another video, or a `teacher` that sees them"
    )
