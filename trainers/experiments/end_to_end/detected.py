"""Costs learnt on generated streets, after a detector and with appearance: where the costs that ship are the default.

`tsuiseki track people` takes the costs of pairs that ship where the detector and the appearance network do, too. Here
these find and describe people on generated streets, which teach, and on a real sequence that none of them has seen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.tracking.association.affinity import Affinity
from tsuiseki.tracking.association.costs import ScoreCost, TransitionCost
from tsuiseki.tracking.association.flow.cost_network import CostChanges
from tsuiseki.tracking.evaluation.multi import SequencePair
from tsuiseki.tracking.evaluation.resampling import score_sums
from tsuiseki.tracking.features.motion.standing_camera import StandingCamera
from tsuiseki.tracking.features.networks.exported import Appearance, Detector
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import FloatArray
from tsuiseki.tracking.types.frame_range import parse_frames
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fit_network
from tsuiseki.trainers.association.graphs import DetectedVideo
from tsuiseki.trainers.association.videos import described
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.association.tables import values_of
from tsuiseki.trainers.experiments.end_to_end.pictured import Stretch, graphs_of_video, read_stretch
from tsuiseki.trainers.experiments.end_to_end.simple_changes import Shrunk
from tsuiseki.trainers.experiments.end_to_end.streets import write_pictured
from tsuiseki.trainers.experiments.end_to_end.tables import gain_table
from tsuiseki.trainers.experiments.end_to_end.through_pictures import LOOK_ALIKES, PETS, UNLIKE, pictured_clips
from tsuiseki.trainers.experiments.experiment import Bench, Table

FIT = Fit(steps=300)
PAIRS, DEFAULT = "trees of pairs that ship", "default"
SCORES, LINKS_AND_SCORES = "default, scores as the pairs' file", "… links alone, scores as the pairs' file"
# Shares of what is learnt of links and joins, and of detections.
LINKS = "… links alone"
SHARES = {"both losses": (1.0, 0.5), LINKS: (1.0, 0.0), "… half of all": (0.5, 0.5)}
# What `tsuiseki track people` takes of a detector.
THRESHOLD = 0.3
DETECTORS = ("detector_street", "detector_figures")
STRETCHES = tuple((first, first + 99) for first in (1, 101, 201, 301))


def detected_tables(bench: Bench, data: Path) -> tuple[list[Table], dict[str, Any]]:
    """A table a detector that ships: PETS in four stretches; none where that is not there."""
    folder = data / PETS
    if not folder.is_dir():
        return [], {}
    halves = [pictured_clips(bench, write_pictured, share) for share in (LOOK_ALIKES, UNLIKE)]
    train = tuple(clip for both in halves for half in both for clip in half)
    tests = tuple(Stretch(folder, *stretch) for stretch in STRETCHES)
    tables, values = list[Table](), dict[str, Any]()
    for name in bench.watch.over(DETECTORS, "detected: PETS"):
        models = shipped(name), shipped("appearance_people"), shipped("affinity_people")
        found = bench.store.recall(detected_sums, train, tests, *models)
        rows = [Result(row, np.stack(sums), "generated streets") for row, sums in found.items()]
        values[name] = {row.name: values_of(row) for row in rows}
        tables.append(gain_table(f"PETS 1–400 by {name}, with appearance", rows, (PAIRS,)))
    return tables, values


def detected_sums(
    train: tuple[Stretch, ...], tests: tuple[Stretch, ...], detector: Path, appearance: Path, pairs: Path
) -> dict[str, list[FloatArray]]:
    """For each row ``(83,)`` sums of each test, see `score_sums`.

    Args:
        train: what is learnt from.
        tests: what is tracked.
        detector: exported.
        appearance: exported.
        pairs: exported costs of pairs.
    """
    find, look = Detector(detector, THRESHOLD, threads=1), Appearance(appearance, threads=1)
    known = Affinity(pairs, 1)
    videos = [_Watched(described(read_stretch(one, find), look), standing_in(one)) for one in tests]
    graphs = [graphs_of_video(described(read_stretch(one, find), look)) for one in train]
    graphs = [one for one in graphs if len(one.detections) and len(one.detections.tail)]
    learnt = NetworkChanges(fit_network(graphs, replace(FIT, trust=1.0)))
    found = {DEFAULT: [_sums(video) for video in videos]}
    found[PAIRS] = [_sums(video, transition=known, observation=known.observation) for video in videos]
    for name, share in SHARES.items():
        found[name] = [_sums(video, Shrunk(learnt, *share)) for video in videos]
    # Scores are worth what the pairs' file says: only links and joins may differ.
    found[SCORES] = [_sums(video, observation=known.observation) for video in videos]
    links = Shrunk(learnt, *SHARES[LINKS])
    found[LINKS_AND_SCORES] = [_sums(video, links, observation=known.observation) for video in videos]
    return found


@dataclass(frozen=True)
class _Watched:
    """A video, and where its camera stands still."""

    video: DetectedVideo
    camera: StandingCamera


def standing_in(stretch: Stretch) -> StandingCamera:
    """Where the camera stands still, by the pictures of a stretch."""
    camera = StandingCamera()
    for frame in open_source(str(stretch.folder), parse_frames(f"{stretch.first}-{stretch.last}")).frames():
        camera.add(frame.image)
    return camera


def _sums(
    watched: _Watched,
    changes: CostChanges | None = None,
    transition: TransitionCost | None = None,
    observation: ScoreCost | None = None,
) -> FloatArray:
    """As `tsuiseki track people` tracks with such costs."""
    video = watched.video
    tracker = FlowTracker(None, transition, observation, video.frame_rate, video.size, watched.camera, changes=changes)
    for found in video.detections:
        tracker.update(found)
    return score_sums(SequencePair(video.name, video.truth, tracker.tracks(), len(video.detections)))
