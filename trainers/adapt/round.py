"""A round: how well its detector agrees with the tracks made of what it finds, and what is kept of it on disk.

A detector that is right finds people where their tracks pass and nothing elsewhere. Its boxes need no smoothing, its
tracks no filling, and nothing of what it finds is rejected. That is measured without a label, on frames that taught
nothing. What is kept lets a run that was stopped go on from there.

Finding and tracking people in a camera's video with the detector of a round, and labels out of the tracks.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.cli.adapt import AdaptSettings
from tsuiseki.tracking.features.exported import SizedDetect, as_describer, open_detector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.output import whole_file
from tsuiseki.tracking.people.inputs import PeopleInputs
from tsuiseki.tracking.people.methods import cost_of_scores, people_affinity, people_tracker
from tsuiseki.tracking.people.tracker import shifted
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.adapt.certain import CertainBoxes
from tsuiseki.trainers.adapt.track_labels import TAKEN, TrackLabels, Verdict, label
from tsuiseki.trainers.adapt.watch import HELD_OUT, Foreground, Watched

# Detections down to this score are known, so that what the tracker rejects is, too.
LOWEST_SCORE = 0.1


@dataclass(frozen=True)
class TrackedPeople:
    """People who were detected and tracked in a video.

    Attributes:
        detections: of every frame, from the first detected one on, with their appearance.
        first: its 0-based number.
        tracks: in frames of the video.
        columns: tiles across of a frame for the detector.
        seconds: that detecting and describing took, a frame.
    """

    detections: list[Detections]
    first: int
    tracks: list[Track]
    columns: int
    seconds: float = 0.0


@dataclass(frozen=True)
class RoundVideo:
    """A video with a round's detections.

    Attributes:
        watched: the video.
        foreground: of its kept pictures; None where the camera moves.
        tracked: detections and tracks.
        labels: taken of them.
        held_out: the first frame of the end that teaches nothing.
    """

    watched: Watched
    foreground: Foreground | None
    tracked: TrackedPeople
    labels: TrackLabels
    held_out: int


def labelled(
    watched: Watched,
    foreground: Foreground | None,
    found: TrackedPeople,
    sitting: bool,
    onto_silhouettes: float,
    certain: CertainBoxes | None = None,
) -> RoundVideo:
    """Take labels from the detections in a video; see `label`."""
    kept = [found.detections[frame - found.first] for frame in watched.frames]
    labels = label(watched, foreground, found.tracks, kept, sitting, onto_silhouettes, certain)
    return RoundVideo(watched, foreground, found, labels, found.first + round((1 - HELD_OUT) * watched.length))


def find(
    watched: Watched, given: Path | SizedDetect, settings: AdaptSettings, view: str, affinity: Path | None = None
) -> TrackedPeople:
    """Detect and track people as `tsuiseki track people --ground off` does.

    Args:
        watched: the video.
        given: detector of people: its file, or one that is open and gives scores from `LOWEST_SCORE` on.
        settings: score threshold of the detections that are tracked, and CPU cores.
        view: see `parse_view`.
        affinity: file; None takes the shipped one where it knows the detector's scores, ``none`` hand-set costs.

    Raises:
        RequestError: a file is no such model.
        RunError: the video breaks off.
    """
    from tsuiseki.tracking.weights import shipped

    device = settings.device
    network = open_detector(given, LOWEST_SCORE, threads=1, device=device) if isinstance(given, Path) else given
    # What is learnt is to know people as large as this camera shows them, so nothing is enlarged.
    detector = ViewedDetector(network, parse_view(view), frame_rate=watched.frame_rate, enlarge=False)
    describe = as_describer(shipped("appearance_people"), 1, device=device)
    camera = StandingCamera()
    inputs = PeopleInputs(watched.open(), detector, describe, camera=camera, threads=settings.threads)
    costs = people_affinity("flow", affinity, 1, known_scores=knows_scores(detector))
    begun = perf_counter()
    detections = [found for _, found in inputs.detections()]
    seconds = (perf_counter() - begun) / max(len(detections), 1)
    scores = cost_of_scores(detector)
    # Labels take straddling tracks of an uncalibrated detector for counter-examples (see `labels`); those of a
    # calibrated one are dropped, as `track people` does.
    straddling = scores is not None
    tracker = people_tracker("flow", None, costs, 0, watched.open(), camera, scores=scores, drop_straddling=straddling)
    for here in detections:
        tracker.update(here.select(here.scores >= settings.score_threshold))
    tracks = [shifted(track, watched.span[0]) for track in tracker.tracks()]
    columns = max((choice.view.columns for choice in detector.choices.values()), default=1)
    return TrackedPeople(detections, watched.span[0], tracks, columns, seconds)


def above(detections: Sequence[Detections], score: float) -> list[Detections]:
    """Those that score at least ``score``, as boxes alone."""
    return [Detections(found.boxes, found.scores).select(found.scores >= score) for found in detections]


OVERLAPS = (0.5, 0.6, 0.7, 0.8)
# People of a round, relative to the start: with fewer the models have collapsed.
FEWEST = 0.6
# Before a moving camera nothing says where people are who are not tracked, and they are learnt as background.
FEWEST_MOVING = 0.9
# Rejected detections, relative to the start, or to a share of the people: with more, anything is a person.
MOST, ALLOWED = 1.8, 0.25


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
    hits, found, tracked = np.zeros(len(OVERLAPS)), 0, 0
    for frame, here in zip(frames, detections, strict=True):
        there = boxes[rows == frame]
        overlaps = iou_matrix(here.boxes, there)
        hits += [len(assign_overlaps(overlaps, least)[0]) for least in OVERLAPS]
        found, tracked = found + len(here), tracked + len(there)
    return float(np.mean(2 * hits / (found + tracked))) if found + tracked else 0.0


def agreement_held_out(
    videos: Sequence[RoundVideo], detections: Sequence[Sequence[Detections]], score_threshold: float
) -> float:
    """`agreement` with the tracks of a round on the held-out frames, the mean over its videos.

    Args:
        videos: of the camera.
        detections: of each, its held-out frames alone.
        score_threshold: from which detections count.
    """
    agreements, weights = [], []
    for each, found in zip(videos, detections, strict=True):
        held_out = range(each.held_out, each.tracked.first + each.watched.length)
        agreements.append(agreement(above(found, score_threshold), each.labels.tracks, held_out))
        weights.append(len(held_out))
    return float(np.average(agreements, weights=weights))


def round_scores(videos: Sequence[RoundVideo], score_threshold: float) -> RoundScores:
    """How a round did in the videos of a camera; detections from ``score_threshold`` on count."""
    people, boxes, detections, rejected, frames, offsets, ends = 0, 0, 0, 0, 0, [], []
    for each in videos:
        video, found, labels = each.watched, each.tracked, each.labels
        certain = above(found.detections, score_threshold)
        ends.append(found.detections[each.held_out - found.first :])
        people += len(labels.tracks)
        boxes += sum(map(len, labels.tracks))
        detections += sum(map(len, certain))
        rejected += sum(map(len, certain)) - sum(int(t.observed.sum()) for t in labels.tracks)
        frames += video.length
        offsets.append(float(np.abs(labels.offset).mean()))
    return RoundScores(
        agreement_held_out(videos, ends, score_threshold),
        people,
        boxes / frames,
        detections / frames,
        max(rejected, 0) / frames,
        float(np.mean(offsets)),
        all(each.foreground is not None for each in videos),
        sum(each.tracked.seconds * each.watched.length for each in videos) / frames,
    )


_DONE = "round.pickle"
# Number of the round that only detects, with the default detector.
DEFAULT = -1


@dataclass(frozen=True)
class Round:
    """What came of a round.

    Attributes:
        number: 0 for the detector that it starts from, `DEFAULT` for what `tsuiseki track people` takes.
        detector: of the round: a file, or one that is open.
        scores: how it did.
        verdicts: on the tracks of each video.
        columns: tiles across for the detector.
        tracks: everyone who was followed in each video, taken or not, in the order of the verdicts.
        detections: in each frame of each video, from its first one on.
        people: labels of the kept pictures of each video.
    """

    number: int
    detector: Path | SizedDetect
    scores: RoundScores
    verdicts: tuple[tuple[Verdict, ...], ...]
    columns: int
    tracks: tuple[tuple[Track, ...], ...] = field(compare=False, repr=False)
    detections: tuple[tuple[Detections, ...], ...] = field(compare=False, repr=False)
    people: tuple[GroundTruth, ...] = field(default=(), compare=False, repr=False)

    def taken(self, video: int) -> list[Track]:
        """Those whose tracks are labels."""
        pairs = zip(self.tracks[video], self.verdicts[video], strict=True)
        return [track for track, verdict in pairs if verdict.verdict == TAKEN]


def keep_round(here: Round, folder: Path) -> None:
    """Write a round; its presence says that it is finished."""
    with whole_file(folder / _DONE) as file:
        pickle.dump(replace(here, detector=Path()), file)


def kept_round(folder: Path, detector: Path | SizedDetect) -> Round | None:
    """What `keep_round` wrote in ``folder``; None where the round is not finished."""
    done = folder / _DONE
    return replace(pickle.loads(done.read_bytes()), detector=detector) if done.is_file() else None
