"""The rounds of `tsuiseki adapt`: detect, take labels from the tracks, learn from them, detect again.

A round takes the detector of the round before, or the one it starts from, and says how well that agrees with the tracks
made of what it finds (`agreement`). A detector that is right finds people where their tracks pass and nothing
elsewhere. Its boxes need no smoothing, its tracks no filling, and nothing of what it finds is rejected. That is
measured without a label, on frames that taught nothing.

Rounds go on while agreement improves and nothing collapses. What a round makes lies in its folder. What is there
already is not made again, so a run that was stopped goes on.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.drone.observations import file_digest
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import SizedDetect, as_describer, open_detector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores
from tsuiseki.tracking.formats.mot import write_ground_truth
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.openers.values import read_values, write_values
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.people.contract import shifted
from tsuiseki.tracking.people.detections import PeopleInputs
from tsuiseki.tracking.people.settings import NONE
from tsuiseki.tracking.people.tracker_choice import cost_of_scores, people_affinity, people_tracker
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.adapt.learn_detector import CHECKPOINT, export_calibrated, fine_tune
from tsuiseki.trainers.adapt.settings import AdaptSettings
from tsuiseki.trainers.adapt.track_labels import ONTO_SILHOUETTES, CertainBoxes, TrackLabels, label
from tsuiseki.trainers.adapt.watch import KEPT_BACK, Watched
from tsuiseki.trainers.exporting.exported_weights import layout_of

# Detections down to this score are known, so that what the tracker rejects is, too.
LOWEST_SCORE = 0.1


@dataclass(frozen=True)
class TrackedPeople:
    """People who were detected and tracked in a video.

    Attributes:
        detections: of every frame that was read.
        tracks: in frames of the video.
        columns: tiles across of a frame for the detector.
        seconds: that detecting and describing took, a frame.
    """

    detections: list[Detections]
    tracks: list[Track]
    columns: int
    seconds: float = 0.0


@dataclass(frozen=True)
class RoundVideo:
    """A video with a round's detections and tracks, and the labels that were taken of them."""

    watched: Watched
    tracked: TrackedPeople
    labels: TrackLabels


def find(
    watched: Watched, detector: Path | SizedDetect, settings: AdaptSettings, view: str, affinity: Path | None = None
) -> TrackedPeople:
    """Detect and track people as `tsuiseki track people --ground off` does.

    Args:
        watched: the video.
        detector: detector of people: its file, or one that is open and gives scores from `LOWEST_SCORE` on.
        settings: score threshold of the detections that are tracked, and CPU cores.
        view: see `parse_view`.
        affinity: file; None takes the shipped one where it knows the detector's scores, ``none`` hand-set costs.

    Raises:
        RequestError: a file is no such model.
        RunError: the video breaks off.
    """
    device = settings.device
    network = (
        open_detector(detector, LOWEST_SCORE, threads=1, device=device) if isinstance(detector, Path) else detector
    )
    # What is learnt is to know people as large as this camera shows them, so nothing is enlarged.
    viewed = ViewedDetector(network, parse_view(view), frame_rate=watched.frame_rate, enlarge=False)
    describe = as_describer(shipped("appearance_people"), 1, device=device)
    camera = StandingCamera()
    inputs = PeopleInputs(watched.open(), viewed, describe, camera=camera, threads=settings.threads)
    costs = people_affinity("flow", affinity, 1, known_scores=knows_scores(viewed))
    begun = perf_counter()
    detections = [of_frame for _, of_frame in inputs.detections()]
    seconds = (perf_counter() - begun) / max(len(detections), 1)
    scores = cost_of_scores(viewed)
    # Labels take straddling tracks of an uncalibrated detector for counter-examples (see `label`); those of a
    # calibrated one are dropped, as `track people` does.
    straddling = scores is not None
    tracker = people_tracker("flow", None, costs, 0, watched.open(), camera, scores=scores, drop_straddling=straddling)
    for of_frame in detections:
        tracker.update(of_frame.select(of_frame.scores >= settings.score_threshold))
    tracks = [shifted(track, watched.span[0]) for track in tracker.tracks()]
    columns = max((choice.view.columns for choice in viewed.choices.values()), default=1)
    return TrackedPeople(detections, tracks, columns, seconds)


def above(detections: Sequence[Detections], score: float) -> list[Detections]:
    """Those that score at least ``score``, as boxes alone."""
    return [Detections(of_frame.boxes, of_frame.scores).select(of_frame.scores >= score) for of_frame in detections]


# Intersections over union from which a detection lies on a track's box: the mean over them tells how well boxes lie,
# too.
OVERLAPS = (0.5, 0.6, 0.7, 0.8)
# People of a round, relative to the start: with fewer the models have collapsed.
FEWEST = 0.6
# Before a moving camera nothing says where people are who are not tracked, and they are learnt as background.
FEWEST_MOVING = 0.9
# Rejected detections, relative to the start, from which anything is a person.
MOST = 1.8
# The start counts as rejecting at least this share of the people, so that a start without any does not forbid all.
ALLOWED = 0.25


@dataclass(frozen=True)
class RoundScores:
    """How a round did.

    Attributes:
        agreement: F1 of detections against taken tracks on held-out frames, mean over IoU 0.5 to 0.8.
        people: taken tracks.
        boxes: of them, a frame.
        detections: a frame, from the threshold on.
        rejected: of them on no taken track, a frame.
        offset: by how much boxes are moved onto silhouettes, mean over the sides in widths and heights.
        fixed: the camera stands still.
        seconds: of detection, a frame.
    """

    agreement: float
    people: int
    boxes: float
    detections: float
    rejected: float
    offset: float
    fixed: bool = True
    seconds: float = 0.0

    @property
    def precision(self) -> float:
        """Share of the detections that lie on taken tracks."""
        return 1 - self.rejected / self.detections if self.detections else 0.0

    def collapsed(self, start: RoundScores) -> str | None:
        """In what way the models have collapsed since the ``start``; None where they have not."""
        if self.boxes < (FEWEST if self.fixed else FEWEST_MOVING) * start.boxes:
            return f"it finds {self.boxes:.1f} people a frame, before {start.boxes:.1f}"
        if self.rejected > MOST * max(start.rejected, ALLOWED * self.boxes):
            return f"it rejects {self.rejected:.1f} detections a frame, before {start.rejected:.1f}"
        return None


def agreement(detections: Sequence[Detections], tracks: Sequence[Track], frames: Sequence[int]) -> float:
    """Mean F1 over `OVERLAPS` of the detections of ``frames`` against the boxes of ``tracks`` there; 0 without any.

    Args:
        detections: one entry for each of ``frames``.
        tracks: with filled boxes.
        frames: their numbers.
    """
    rows = np.concatenate([np.empty(0, np.int64), *(t.frames for t in tracks)])
    boxes: FloatArray = np.concatenate([np.empty((0, 4)), *(t.boxes for t in tracks)])
    hits, detected, tracked = np.zeros(len(OVERLAPS)), 0, 0
    for frame, of_frame in zip(frames, detections, strict=True):
        there = boxes[rows == frame]
        overlaps = iou_matrix(of_frame.boxes, there)
        hits += [len(assign_overlaps(overlaps, least)[0]) for least in OVERLAPS]
        detected, tracked = detected + len(of_frame), tracked + len(there)
    return float(np.mean(2 * hits / (detected + tracked))) if detected + tracked else 0.0


def agreement_held_out(
    videos: Sequence[RoundVideo], detections: Sequence[Sequence[Detections]], score_threshold: float
) -> float:
    """`agreement` with the tracks of a round on the held-out frames, the mean over its videos.

    Args:
        videos: of the camera.
        detections: of each, its held-out frames alone.
        score_threshold: from which detections count.
    """
    ends = [video.watched.held_out for video in videos]
    agreements = [
        agreement(above(of_video, score_threshold), video.labels.tracks, end)
        for video, of_video, end in zip(videos, detections, ends, strict=True)
    ]
    return float(np.average(agreements, weights=[len(end) for end in ends]))


def round_scores(videos: Sequence[RoundVideo], score_threshold: float) -> RoundScores:
    """How a round did in the videos of a camera; detections from ``score_threshold`` on count."""
    certain = [above(video.tracked.detections, score_threshold) for video in videos]
    ends = [video.tracked.detections[-len(video.watched.held_out) :] for video in videos]
    tracks = [track for video in videos for track in video.labels.tracks]
    frames = sum(video.watched.length for video in videos)
    detections = sum(len(of_frame) for of_video in certain for of_frame in of_video)
    return RoundScores(
        agreement_held_out(videos, ends, score_threshold),
        len(tracks),
        sum(map(len, tracks)) / frames,
        detections / frames,
        max(detections - sum(int(track.observed.sum()) for track in tracks), 0) / frames,
        float(np.mean([np.abs(video.labels.offset).mean() for video in videos])),
        all(video.watched.empty is not None for video in videos),
        sum(video.tracked.seconds * video.watched.length for video in videos) / frames,
    )


_DONE = "finished.npz"
# Number of the round that only detects, with the default detector.
DEFAULT = -1


@dataclass(frozen=True)
class Round:
    """What came of a round.

    Attributes:
        number: 0 for the detector that it starts from, `DEFAULT` for what `tsuiseki track people` takes.
        detector: of the round: a file, or one that is open.
        scores: how it did.
        columns: tiles across for the detector.
        labels: of each video, with everyone who was followed.
        detections: in each frame of each video, from its first one on.
    """

    number: int
    detector: Path | SizedDetect
    scores: RoundScores
    columns: int
    labels: tuple[TrackLabels, ...] = field(compare=False, repr=False)
    detections: tuple[list[Detections], ...] = field(compare=False, repr=False)


def keep_round(finished: Round, folder: Path) -> None:
    """Write a round; its presence says that it is finished."""
    with whole_file(folder / _DONE) as file:
        write_values(file, replace(finished, detector=Path()))


def kept_round(folder: Path, detector: Path | SizedDetect) -> Round | None:
    """What `keep_round` wrote in ``folder``; None where the round is not finished.

    Raises:
        RequestError: its file holds something else.
    """
    path, what = folder / _DONE, "a round of tsuiseki adapt"
    if not path.is_file():
        return None
    finished = read_values(path, what)
    if not isinstance(finished, Round):
        raise RequestError(f"{path}: expected {what}, got something else; remove it")
    return replace(finished, detector=detector)


# What a detector may lose of the default's share of detections on tracks.
_LESS_PRECISE = 0.02
# How much longer than with the default a frame may take before it is reported.
_SLOWER = 1.25
# Agreement must rise by this much for a round to be better.
_BETTER = 0.002
# Likewise of the first round: a detector that has learnt from tracks agrees with tracks a little more whether it is
# better or not.
_BETTER_AT_FIRST = 0.02


@dataclass(frozen=True)
class Adaptation:
    """What the rounds of a camera share.

    Attributes:
        videos: of the camera, at least one.
        start: exported detector to begin with.
        work: folder for what the rounds make.
        settings: how.
        default: what `tsuiseki track people` takes, which a learnt detector must beat.
        teacher: detector of the first round, in place of ``start``; may be of another project.
        certain: what corrections say of the only video.
        view: tiles of a frame, see `parse_view`.
        tell: gets a line about what is being done.
    """

    videos: tuple[Watched, ...]
    start: Path
    work: Path
    settings: AdaptSettings
    default: Path
    teacher: SizedDetect | None = None
    certain: CertainBoxes | None = None
    view: str = "auto"
    tell: Callable[[str], None] = print

    def folder(self, number: int) -> Path:
        """Where the files of a round lie; made where it is not there."""
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
    _check_people(first, adaptation.videos)
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
    accepted = rises and ours.precision > theirs.precision - _LESS_PRECISE and ours.collapsed(theirs) is None
    line = (
        f"round {learnt.number} {'beats' if accepted else 'does not beat'} {Path(str(default.detector)).name}, "
        f"which track people takes: agreement {ours.agreement:.3f} and {theirs.agreement:.3f}, "
        f"precision {ours.precision:.3f} and {theirs.precision:.3f}"
    )
    if accepted and ours.seconds > _SLOWER * theirs.seconds:
        line += f"; it is slower: {1e3 * ours.seconds:.0f} and {1e3 * theirs.seconds:.0f} ms a frame"
    return accepted, line


def file_state(source: str) -> list[int]:
    """Files, bytes and time of the last change (ns) of a video or folder; of a source elsewhere nothing is known.

    Videos are too large for a digest of their contents.
    """
    path = Path(source)
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    states = [file.stat() for file in files if file.is_file()]
    return [len(states), sum(x.st_size for x in states), max((x.st_mtime_ns for x in states), default=0)]


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
    folder = adaptation.folder(number)
    detector = folder / "detector.onnx"
    if detector.is_file():
        return detector
    videos = _teaching(adaptation.videos, taught_by)
    layout = layout_of(adaptation.start)
    previous = adaptation.work / f"round-{number - 1}" / CHECKPOINT
    start = previous if previous.is_file() else adaptation.start
    adaptation.tell(f"round {number}: learning from {taught_by.scores.people} people")
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
    for video, labels in zip(videos, taught_by.labels, strict=True):
        frames = np.concatenate([np.empty(0, np.int64), *(t.frames for t in labels.tracks)])
        if np.isin(video.frames[: video.learnt(KEPT_BACK)], frames).any():
            write_ground_truth(Path(video.folder) / "gt" / "gt.txt", labels.people)
            teaching.append(video)
    if not teaching:
        raise RequestError(
            f"expected people before the last {KEPT_BACK:.0%} of a video, kept back, got none; give a longer one"
        )
    return teaching


def _detect_and_track(adaptation: Adaptation, number: int, detector: Path | SizedDetect) -> Round:
    """Run the ``detector``, or read the detections of an earlier call."""
    folder, settings = adaptation.folder(number), adaptation.settings
    if (done := kept_round(folder, detector)) is not None:
        return done
    # The shipped costs know the scores of the shipped detectors, not those that were learnt here.
    affinity = Path(NONE) if number > 0 else None
    # Boxes that were learnt from silhouettes are not moved again.
    onto = 0.0 if number > 0 else ONTO_SILHOUETTES
    videos = []
    for video in adaptation.videos:
        task = f"detecting in {video.source}"
        adaptation.tell(f"{task} with the default" if number == DEFAULT else f"round {number}: {task}")
        tracked = find(video, detector, settings, adaptation.view, affinity)
        detections = [tracked.detections[frame - video.span[0]] for frame in video.frames]
        labels = label(video, tracked.tracks, detections, settings.sitting, onto, adaptation.certain)
        videos.append(RoundVideo(video, tracked, labels))
    scores = round_scores(videos, settings.score_threshold)
    if not number and adaptation.teacher is not None:
        scores = replace(scores, agreement=_before_learning(adaptation, videos))
    finished = Round(
        number,
        detector,
        scores,
        max(video.tracked.columns for video in videos),
        tuple(video.labels for video in videos),
        tuple(above(video.tracked.detections, 0.0) for video in videos),
    )
    keep_round(finished, folder)
    return finished


def _before_learning(adaptation: Adaptation, videos: Sequence[RoundVideo]) -> float:
    """How well the detector that is to learn agrees with the tracks of its teacher."""
    detections = []
    for video in adaptation.videos:
        end = replace(video, span=(video.held_out.start, video.span[1]))
        adaptation.tell(f"round 0: detecting in the end of {end.source} with {adaptation.start.name}")
        tracked = find(end, adaptation.start, adaptation.settings, adaptation.view)
        detections.append(tracked.detections[-len(video.held_out) :])
    return agreement_held_out(videos, detections, adaptation.settings.score_threshold)


def _check_people(first: Round, videos: Sequence[Watched]) -> None:
    """Without anybody there is nothing to learn from."""
    if first.scores.people:
        return
    names = ", ".join(video.source for video in videos)
    others = sum(len(labels.verdicts) for labels in first.labels)
    instead = f"{others} uncertain tracks" if others else "no person"
    raise RequestError(
        f"expected people to learn from in {names}, found {instead}; give another video, or a `teacher` that sees them"
    )
