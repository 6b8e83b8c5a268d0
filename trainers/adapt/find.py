"""Finding and tracking people in a camera's video with the detector of a round, and labels out of the tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from tsuiseki.tracking.cli.adapt import AdaptSettings
from tsuiseki.tracking.features.exported import SizedDetect, open_appearance, open_detector
from tsuiseki.tracking.features.standing_camera import StandingCamera
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector, knows_scores
from tsuiseki.tracking.people.inputs import PeopleInputs
from tsuiseki.tracking.people.methods import cost_of_scores, people_affinity, people_tracker
from tsuiseki.tracking.people.tracker import shifted
from tsuiseki.tracking.types import Detections, Track
from tsuiseki.trainers.adapt.certain import CertainBoxes
from tsuiseki.trainers.adapt.track_labels import TrackLabels, label
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
    describe = open_appearance(shipped("appearance_people"), 1, device=device)
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
