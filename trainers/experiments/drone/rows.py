"""The rows of the drone experiment's tables: every method on the same observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.association.tracklets.action_refinement import Prices
from tsuiseki.tracking.evaluation.action.action import ActionScores, evaluate_actions
from tsuiseki.tracking.evaluation.action.action_pairs import action_rows, join_action_rows
from tsuiseki.tracking.evaluation.multi import PeopleEvaluation, SequencePair, evaluate_sequences
from tsuiseki.tracking.features.action import averaged
from tsuiseki.tracking.features.action_inputs import LOCAL_STREAMS, STREAMS, StreamName
from tsuiseki.tracking.pipelines.observations import Observation
from tsuiseki.tracking.trackers.drone import DroneSettings, DroneTracker
from tsuiseki.tracking.trackers.people.deepsort import DeepSort
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.types.tracks import ActingTrack
from tsuiseki.trainers.experiments.drone.clips import Clip

ComparedMethod = Literal["deepsort", "flow", "flow-saf", "flow-maf", "flow-maf, one-sided"]
METHODS: tuple[ComparedMethod, ...] = ("deepsort", "flow", "flow-saf", "flow-maf", "flow-maf, one-sided")
MOST_ITERATIONS = 10


@dataclass(frozen=True)
class Costs:
    """Learnt costs of all kinds, for places with or without the camera's motion.

    Attributes:
        flow: without actions.
        single: with single-frame action features.
        multi: with multi-frame ones.
        sided: with those of one-sided windows.
    """

    flow: Affinity
    single: Affinity
    multi: Affinity
    sided: Affinity

    @classmethod
    def read(cls, folder: Path) -> Costs:
        """The files that `tsuiseki train affinity-drone` writes."""
        names = ("affinity_drone", "affinity_drone_saf", "affinity_drone_maf", "affinity_drone_sided")
        return cls(*(Affinity(folder / f"{name}.onnx", threads=1) for name in names))

    def prices(self, method: ComparedMethod) -> Prices:
        """What a method pays."""
        if method == "flow":
            return Prices(self.flow.observation, self.flow)
        multi = self.sided if method.endswith("one-sided") else self.multi
        return Prices(self.single.observation, self.single, multi)


def tracker_for(
    method: ComparedMethod, seen: Sequence[Observation], costs: Costs, *, compensate: bool, iterations: int = 6
) -> DroneTracker:
    """A drone tracker that has seen all observations."""
    settings = DroneSettings()
    windows: Literal["centred", "one-sided"] = "one-sided" if method.endswith("one-sided") else "centred"
    count = iterations if method.startswith("flow-maf") else 1
    refinement = replace(settings.refinement, iterations=count, windows=windows)
    tracker = DroneTracker(replace(settings, refinement=refinement), costs.prices(method))
    for one in seen:
        actions = None if method == "flow" or one.actions is None else streams_mean(one, STREAMS)
        tracker.update(replace(one.detections, actions=actions), one.motion if compensate else None)
    return tracker


def track_all(
    clips: Sequence[Clip], method: ComparedMethod, costs: Costs, *, compensate: bool
) -> list[list[ActingTrack]]:
    """The people of every clip."""
    if method == "deepsort":
        return [[ActingTrack(track) for track in _deepsort(clip)] for clip in clips]
    return [tracker_for(method, clip.seen, costs, compensate=compensate).people() for clip in clips]


def _deepsort(clip: Clip) -> list[Track]:
    tracker = DeepSort()
    for one in clip.seen:
        tracker.update(one.detections)
    return tracker.tracks()


def people_scores(clips: Sequence[Clip], people: Sequence[Sequence[ActingTrack]]) -> PeopleEvaluation:
    """Scores of the tracks of all clips."""
    return evaluate_sequences(
        SequencePair(clip.folder.name, clip.truth, [person.track for person in found], len(clip.seen))
        for clip, found in zip(clips, people, strict=True)
    )


def by_iteration(
    clips: Sequence[Clip], method: ComparedMethod, costs: Costs, *, compensate: bool, count: int = MOST_ITERATIONS
) -> list[list[list[ActingTrack]]]:
    """The people of every clip after each of ``count`` iterations; where it stopped, the last ones stay."""
    found: list[list[list[ActingTrack]]] = [[] for _ in range(count)]
    for clip in clips:
        tracker = tracker_for(method, clip.seen, costs, compensate=compensate, iterations=count)
        results = [tracker.people_with(one.labels) for one in tracker.iterations()]
        for k in range(count):
            found[k].append(results[min(k, len(results) - 1)])
    return found


def action_scores(clips: Sequence[Clip], people: Sequence[Sequence[ActingTrack]], kind: str) -> ActionScores:
    """Scores of the ``single`` or ``multi`` probabilities along tracks."""
    rows = join_action_rows([action_rows(clip.labels, found) for clip, found in zip(clips, people, strict=True)])
    return evaluate_actions(clips[0].labels.names, getattr(rows, kind), rows.truth)


def with_given_tracks(clips: Sequence[Clip], streams: Sequence[StreamName]) -> list[list[ActingTrack]]:
    """The labelled people, with the actions that some of the streams see."""
    people = []
    for clip in clips:
        tracker = DroneTracker(DroneSettings(min_detections=1, gaps=None))
        for one in clip.given:
            tracker.update(replace(one.detections, actions=streams_mean(one, streams)))
        people.append(tracker.people_with(clip.given_labels))
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
