"""The rows of the drone experiment's tables: every method on the same observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, get_args

import numpy as np

from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.association.costs import ActionFeatures
from tsuiseki.tracking.association.detection_tables import rows_of
from tsuiseki.tracking.drone.models import DroneMethod
from tsuiseki.tracking.drone.observations import Observation
from tsuiseki.tracking.drone.settings import DroneSettings
from tsuiseki.tracking.drone.tracker import DroneTracker, acting_track
from tsuiseki.tracking.drone.tracking import suited
from tsuiseki.tracking.evaluation.action_files import LabelledActions, action_rows, join_action_rows
from tsuiseki.tracking.evaluation.action_scores import ActionScores, evaluate_actions
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, SequencePair, evaluate_sequences
from tsuiseki.tracking.evaluation.resampling import Interval, paired_bootstrap, score_sums
from tsuiseki.tracking.features.action import LOCAL_STREAMS, STREAMS, StreamName, averaged
from tsuiseki.tracking.features.camera_path import CameraPath
from tsuiseki.tracking.formats.mot_sequence import read_sequence
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.deepsort import DeepSort, DeepSortSettings
from tsuiseki.tracking.people.lifecycle import LifecycleSettings
from tsuiseki.tracking.people.methods import MotionCompensated
from tsuiseki.tracking.people.whole_flow import long_tracks
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.trainers.experiments.drone.borrowed_actions import borrowed, done_by_person, place_of
from tsuiseki.trainers.experiments.drone.clips import Clip

ComparedMethod = Literal["deepsort", "flow", "flow-saf", "flow-maf", "flow-maf, one-sided"]
METHODS: tuple[ComparedMethod, ...] = get_args(ComparedMethod)
# Chosen by IDF1 on the same clips as the settings of the flow (seeds 2000 to 2002 and 20500 to 20505); its tracks are
# where the detector found people, as the flow's are.
DEEPSORT = DeepSortSettings(
    feature_gate=0.5,
    position_gate=0.95,
    lifecycle=LifecycleSettings(min_hits=2, max_age=60, start_score=0.35, boxes="detected"),
)
MOST_ITERATIONS = 10
SAMPLES = 2000
# Overlap from which a detection shows a labelled person.
SAME = 0.3


def tracker_for(
    method: ComparedMethod,
    clip: Clip,
    settings: DroneSettings | None = None,
    *,
    compensate: bool,
    rounds: int | None = None,
) -> DroneTracker:
    """A drone tracker that has seen all observations of a clip.

    Args:
        method: of linking.
        clip: what was observed.
        settings: by default those of the tracker.
        compensate: take the camera's motion out.
        rounds: how often links are priced again at most; by default as the settings say.
    """
    named: DroneMethod = "flow-maf" if method.startswith("flow-maf") else method  # type: ignore[assignment]
    chosen = suited(settings or DroneSettings(), named)
    costs = chosen.flow.costs
    if named == "flow-maf" and costs.link.action is not None:
        features: ActionFeatures = "one-sided" if method.endswith("one-sided") else "centred"
        costs = replace(costs, link=replace(costs.link, action=replace(costs.link.action, features=features)))
    if rounds is not None:
        costs = replace(costs, rounds=replace(costs.rounds, rounds=rounds))
    sequence = read_sequence(clip.folder)
    size = (sequence.width, sequence.height)
    tracker = DroneTracker(replace(chosen, flow=replace(chosen.flow, costs=costs)), sequence.frame_rate, size)
    for one in clip.seen:
        actions = None if named == "flow" or one.actions is None else streams_mean(one, STREAMS)
        tracker.update(replace(one.detections, actions=actions), one.motion if compensate else None)
    return tracker


def track_all(
    clips: Sequence[Clip], method: ComparedMethod, settings: DroneSettings | None = None, *, compensate: bool
) -> list[list[ActingTrack]]:
    """The people of every clip."""
    if method == "deepsort":
        return [[ActingTrack(track) for track in _deepsort(clip, compensate=compensate)] for clip in clips]
    return [tracker_for(method, clip, settings, compensate=compensate).people() for clip in clips]


def _deepsort(clip: Clip, *, compensate: bool) -> list[Track]:
    path = CameraPath()
    tracker = MotionCompensated(DeepSort(DEEPSORT), path) if compensate else DeepSort(DEEPSORT)
    for one in clip.seen:
        if one.motion is not None:
            path.follow(one.motion)
        tracker.update(one.detections)
    return tracker.tracks()


def people_scores(clips: Sequence[Clip], people: Sequence[Sequence[ActingTrack]]) -> PeopleEvaluation:
    """Scores of the tracks of all clips."""
    return evaluate_sequences(
        SequencePair(clip.folder.name, clip.truth, [person.track for person in found], len(clip.seen))
        for clip, found in zip(clips, people, strict=True)
    )


def difference(
    clips: Sequence[Clip], ours: Sequence[Sequence[ActingTrack]], theirs: Sequence[Sequence[ActingTrack]]
) -> dict[str, Interval]:
    """How far the scores of ours are above theirs, with 95 % intervals over the clips (paired bootstrap)."""
    sums = [
        np.stack(
            [
                score_sums(SequencePair(clip.folder.name, clip.truth, [one.track for one in people], len(clip.seen)))
                for clip, people in zip(clips, found, strict=True)
            ]
        )
        for found in (ours, theirs)
    ]
    return paired_bootstrap(sums[0], sums[1], SAMPLES, np.random.default_rng(0))


def by_iteration(
    clips: Sequence[Clip], method: ComparedMethod, *, compensate: bool, count: int = MOST_ITERATIONS
) -> list[list[list[ActingTrack]]]:
    """The people of every clip when links are priced again 0, 1, ... ``count`` - 1 times."""
    return [
        [tracker_for(method, clip, compensate=compensate, rounds=k).people() for clip in clips] for k in range(count)
    ]


def with_labelled_actions(clip: Clip, rng: np.random.Generator) -> Clip:
    """``clip`` with the labelled actions in place of what the streams say; false boxes act as a person at another time.

    Args:
        clip: observed.
        rng: draws whom and when for each place of false boxes.
    """
    like = borrowed(done_by_person(clip.labels, len(clip.seen)), rng)
    first = clip.seen[0].frame
    return replace(clip, seen=[_labelled(one, clip.labels, like[one.frame - first]) for one in clip.seen])


def _labelled(one: Observation, labels: LabelledActions, like: FloatArray) -> Observation:
    assert one.actions is not None
    rows = np.flatnonzero(labels.truth.frames == one.frame)
    found, label = assign_overlaps(iou_matrix(one.detections.boxes, labels.truth.boxes[rows]), SAME)
    actions = like[place_of(one.detections.boxes)]
    actions[found] = labels.actions[rows[label]]
    return replace(one, actions=np.repeat(actions[None], len(one.actions), axis=0))


def action_scores(clips: Sequence[Clip], people: Sequence[Sequence[ActingTrack]], kind: str) -> ActionScores:
    """Scores of the ``single`` or ``multi`` probabilities along tracks."""
    rows = join_action_rows([action_rows(clip.labels, found) for clip, found in zip(clips, people, strict=True)])
    return evaluate_actions(clips[0].labels.names, getattr(rows, kind), rows.truth)


def with_given_tracks(clips: Sequence[Clip], streams: Sequence[StreamName]) -> list[list[ActingTrack]]:
    """The labelled people, with the actions that some of the streams see."""
    people = []
    for clip in clips:
        rows = rows_of([one.detections for one in clip.given], clip.given[0].frame, 0)
        actions = np.concatenate([streams_mean(one, streams) for one in clip.given])
        half = round(DroneSettings().window / 2 * read_sequence(clip.folder).frame_rate)
        people.append(
            [
                acting_track(Track(n, rows.frames[p], rows.boxes[p], np.ones(len(p))), actions[p], half)
                for n, p in enumerate(long_tracks(clip.given_labels), start=1)
            ]
        )
    return people


def recognition(clips: Sequence[Clip]) -> dict[str, ActionScores]:
    """Table 5.5: single or multi frame, local or local and global crops, tracks given."""
    scores = {}
    for kind, name in (("single", "Single frame"), ("multi", "Multi frames")):
        for streams, crops in ((LOCAL_STREAMS, "local"), (STREAMS, "local+global")):
            scores[f"{name} ({crops})"] = action_scores(clips, with_given_tracks(clips, streams), kind)
    return scores


def streams_mean(one: Observation, streams: Sequence[StreamName]) -> FloatArray:
    """``(N, A)`` mean probabilities of some streams, in the order of `STREAMS` in the observation."""
    assert one.actions is not None
    return averaged(one.actions[[STREAMS.index(name) for name in streams]])


def people_row(scores: PeopleEvaluation) -> dict[str, float]:
    """The columns of Table 5.3, and more; shares in percent."""
    total = scores.combined
    return {
        "recall": 100 * total.recall,
        "precision": 100 * total.precision,
        "id_switches": float(total.id_switches),
        "mota": 100 * total.mota,
        "motp": 100 * total.motp,
        "motp_as_printed": 100 * (1 - total.motp),
        "idf1": 100 * total.idf1,
        "hota": 100 * total.hota,
    }


def mean_rows(rows: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Means over the seeds, and the standard deviation of the switches; switches are added up."""
    mean = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    mean["id_switches"] = float(sum(row["id_switches"] for row in rows))
    mean["id_switches_sd"] = float(np.std([row["id_switches"] for row in rows]))
    return mean
