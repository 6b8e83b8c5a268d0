"""The rounds of `tsuiseki adapt`: detect, take labels from the tracks, learn from them, detect again.

A round takes the detector of the round before, or the one it starts from, and says how well it did
(`agreement`). Rounds go on while that improves and nothing collapses. What a round makes lies in its folder. What is
there already is not made again, so a run that was stopped goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.cli.adapt import AdaptSettings
from tsuiseki.tracking.drone.observations import file_digest
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import SizedDetect
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.people.settings import NONE
from tsuiseki.trainers.adapt.certain import CertainBoxes
from tsuiseki.trainers.adapt.learn_detector import CHECKPOINT, export_calibrated, fine_tune
from tsuiseki.trainers.adapt.round import (
    DEFAULT,
    Round,
    RoundVideo,
    above,
    agreement_held_out,
    find,
    keep_round,
    kept_round,
    labelled,
    round_scores,
)
from tsuiseki.trainers.adapt.track_labels import ONTO_SILHOUETTES, TAKEN
from tsuiseki.trainers.adapt.watch import KEPT_BACK, CameraVideos, Watched
from tsuiseki.trainers.exporting.exported_weights import layout_of

# What a detector must not lose against the default, share of its detections on tracks; and how much longer a frame may
# take.
_LESS_PRECISE, _SLOWER = 0.02, 1.25
# Agreement must rise by this much for a round to be better: at first by more, since a detector that has learnt from
# tracks agrees with tracks a little more whether it is better or not.
_BETTER, _BETTER_AT_FIRST = 0.002, 0.02


@dataclass(frozen=True)
class Adaptation:
    """What the rounds of a camera share.

    Attributes:
        camera: what to learn.
        start: exported detector to begin with.
        work: folder for what the rounds make.
        settings: how.
        default: what `tsuiseki track people` takes, which a learnt detector must beat.
        teacher: detector of the first round, in place of ``start``; may be of another project.
        certain: what corrections say of the only video.
        tell: gets a line about what is being done.
    """

    camera: CameraVideos
    start: Path
    work: Path
    settings: AdaptSettings
    default: Path
    teacher: SizedDetect | None = None
    certain: CertainBoxes | None = None
    tell: Callable[[str], None] = print

    def folder(self, number: int) -> Path:
        """Of a round."""
        path = self.work / ("default" if number == DEFAULT else f"round-{number}")
        path.mkdir(parents=True, exist_ok=True)
        return path


def rounds(adaptation: Adaptation) -> Iterator[Round]:
    """Round 0, which only detects, and those that learn; each as soon as it is finished.

    With a teacher round 0 is what the teacher sees; its agreement is that of the detector that is to learn from it,
    since that is what the first round competes with.

    Raises:
        RequestError: no person is tracked with confidence, or a file is no such model.
    """
    first = best = _detect_and_track(adaptation, 0, adaptation.teacher or adaptation.start)
    _check_people(first, adaptation.camera)
    yield first
    for number in range(1, adaptation.settings.rounds + 1):
        here = _detect_and_track(adaptation, number, _learn(adaptation, number, best))
        yield here
        if here.scores.collapsed(first.scores) is not None or not better(here, best):
            return
        best = here


def default_round(adaptation: Adaptation) -> Round:
    """What the default detector sees, which learns nothing; where it is the start, round 0 is that already."""
    started = adaptation.teacher is None and adaptation.default == adaptation.start
    return _detect_and_track(adaptation, 0 if started else DEFAULT, adaptation.default)


def against_default(learnt: Round, default: Round) -> tuple[bool, str]:
    """Whether a round that learnt is to be kept beside the default detector; and a line on how it compares.

    It must agree with its tracks clearly more, and as precisely. What is slower is kept, and reported.
    """
    ours, theirs = learnt.scores, default.scores
    rises = ours.agreement > theirs.agreement + _BETTER_AT_FIRST
    kept = rises and ours.precision > theirs.precision - _LESS_PRECISE and ours.collapsed(theirs) is None
    line = (
        f"round {learnt.number} {'beats' if kept else 'does not beat'} {Path(str(default.detector)).name}, which track "
        f"people takes: agreement {ours.agreement:.3f} and {theirs.agreement:.3f}, "
        f"precision {ours.precision:.3f} and {theirs.precision:.3f}"
    )
    if kept and ours.seconds > _SLOWER * theirs.seconds:
        line += f"; it is slower: {1e3 * ours.seconds:.0f} and {1e3 * theirs.seconds:.0f} ms a frame"
    return kept, line


def file_state(source: str) -> list[int]:
    """Files, bytes and time of the last change (ns) of a video or folder; of a source elsewhere nothing is known.

    Videos are too large for a digest of their contents.
    """
    path = Path(source)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    found = [file.stat() for file in files if file.is_file()]
    return [len(found), sum(x.st_size for x in found), max((x.st_mtime_ns for x in found), default=0)]


def contents_of(sources: Sequence[str], start: Path, **files: Path | None) -> dict[str, Any]:
    """What videos and files hold, as plain values: a file of the same name may have been written anew."""
    models = {name: file_digest(file) if file else "" for name, file in {"detector": start, **files}.items()}
    return {"contents": [file_state(source) for source in sources], **models}


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
    rise = _BETTER if earlier.number else _BETTER_AT_FIRST
    return later.scores.agreement > earlier.scores.agreement + rise


def best_of(finished: Sequence[Round]) -> Round:
    """The round to keep: the last one that was better than the best before it and did not collapse."""
    best = finished[0]
    for later in finished[1:]:
        if later.scores.collapsed(finished[0].scores) is None and better(later, best):
            best = later
    return best


def _learn(adaptation: Adaptation, number: int, taught_by: Round) -> Path:
    """The detector of round ``number``, from the labels of the one before."""
    folder, camera = adaptation.folder(number), adaptation.camera
    detector = folder / "detector.onnx"
    if detector.is_file():
        return detector
    videos = _teaching(camera.videos, taught_by)
    layout = layout_of(adaptation.start)
    before = adaptation.work / f"round-{number - 1}" / CHECKPOINT
    start = before if before.is_file() else adaptation.start
    taken = sum(one.verdict == TAKEN for verdicts in taught_by.verdicts for one in verdicts)
    adaptation.tell(f"round {number}: learning from {taken} people")
    checkpoint = fine_tune(start, layout, videos, taught_by.columns, number, folder, adaptation.settings)
    view = (taught_by.columns, None)
    export_calibrated(checkpoint, layout.size, videos, view, detector)
    return detector


def _teaching(videos: Sequence[Watched], taught_by: Round) -> list[Watched]:
    """The videos with people in what may be learnt from, the labels of the round beside their pictures.

    Raises:
        RequestError: there is none.
    """
    teaching = []
    for n, video in enumerate(videos):
        frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in taught_by.taken(n))])
        if np.isin(video.frames[: video.learnt(KEPT_BACK)], frames).any():
            write_ground_truth(Path(video.folder) / "gt" / "gt.txt", taught_by.people[n])
            teaching.append(video)
    if not teaching:
        raise RequestError(
            f"expected people before the last {KEPT_BACK:.0%} of a video, kept back, got none; give a longer one"
        )
    return teaching


def _detect_and_track(adaptation: Adaptation, number: int, detector: Path | SizedDetect) -> Round:
    """Run the ``detector``, or read the detections of an earlier call."""
    folder, camera, settings = adaptation.folder(number), adaptation.camera, adaptation.settings
    if (done := kept_round(folder, detector)) is not None:
        return done
    # The shipped costs know the scores of the shipped detectors, not those that were learnt here.
    affinity = Path(NONE) if number > 0 else None
    # Boxes that were learnt from silhouettes are not moved again.
    onto = 0.0 if number > 0 else ONTO_SILHOUETTES
    videos = []
    for video, foreground in zip(camera.videos, camera.foregrounds, strict=True):
        task = f"detecting in {video.source}"
        adaptation.tell(f"{task} with the default" if number == DEFAULT else f"round {number}: {task}")
        found = find(video, detector, settings, camera.view, affinity)
        videos.append(labelled(video, foreground, found, settings.sitting, onto, adaptation.certain))
    scores = round_scores(videos, settings.score_threshold)
    if not number and adaptation.teacher is not None:
        scores = replace(scores, agreement=_before_learning(adaptation, videos))
    labels = [each.labels for each in videos]
    here = Round(
        number,
        detector,
        scores,
        tuple(each.verdicts for each in labels),
        max(each.tracked.columns for each in videos),
        tuple(each.everyone for each in labels),
        tuple(tuple(above(each.tracked.detections, 0.0)) for each in videos),
        tuple(each.people for each in labels),
    )
    keep_round(here, folder)
    return here


def _before_learning(adaptation: Adaptation, videos: Sequence[RoundVideo]) -> float:
    """How well the detector that is to learn agrees with the tracks of its teacher."""
    detections = []
    for each in videos:
        end = replace(each.watched, span=(each.held_out, each.watched.span[1]))
        adaptation.tell(f"round 0: detecting in the end of {end.source} with {adaptation.start.name}")
        found = find(end, adaptation.start, adaptation.settings, adaptation.camera.view)
        detections.append(found.detections[each.held_out - found.first :])
    return agreement_held_out(videos, detections, adaptation.settings.score_threshold)


def _check_people(first: Round, camera: CameraVideos) -> None:
    """Without anybody there is nothing to learn from."""
    if first.scores.people:
        return
    names = ", ".join(video.source for video in camera.videos)
    others = sum(map(len, first.verdicts))
    rest = f"{others} uncertain tracks" if others else "no person"
    raise RequestError(
        f"expected people to learn from in {names}, found {rest}; give another video, or a `teacher` that sees them"
    )
