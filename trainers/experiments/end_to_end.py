"""Costs of the flow learnt through the flow, against costs learnt on pairs and the default (`reproduce end-to-end`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.tracking.association.learnt_costs import Affinity
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import FloatArray, Track
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.fitting import Fit, NetworkChanges, fit_network
from tsuiseki.trainers.association.flow_loss import FlowLoss
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.windows import affordable
from tsuiseki.trainers.experiments.given_sequences import (
    DATA_SETS,
    DataSet,
    GivenSequence,
    as_written,
    combined_scores,
    find_given,
    given_detections,
    given_labels,
    right_sums,
    score_table,
    track_sums,
)
from tsuiseki.trainers.experiments.pairwise_costs import PairLearner, fit_pairs
from tsuiseki.trainers.experiments.study import Bench, Name, Outcome, Study, Table

DEFAULT, PAIRS, BOTH = "default", ("pairs, logistic", "pairs, boosted trees"), "both losses"
# A fit through the flow, or what learns on pairs.
LEARNERS: dict[Name, Fit | PairLearner] = {
    "Fenchel-Young": Fit(FlowLoss("fenchel_young")),
    "hinge": Fit(FlowLoss("hinge")),
    BOTH: Fit(),
    PAIRS[0]: "logistic",
    PAIRS[1]: "trees",
}
STREETS = DataSet("streets", "generated streets", "streets")
# How many groups the sequences of a set are cut into.
FOLDS = {"mot15": 6, "mot17": 4, "kitti-pedestrians": 5, "kitti-cars": 4, "streets": 4}
PARTS = ("given", "unseen")
# Generated streets teach, and these are tracked.
UNSEEN, UNSEEN_FIT = ("mot17", "mot15", "kitti-pedestrians", "pets", "tud"), Fit(steps=300)
# Longest gap that the right links bridge, seconds.
GAP = 2.0
NOTE = (
    "Intervals: paired bootstrap over sequences, 2,000 samples, 95 %. Settings of the fits were chosen on MOT15; "
    "the other sets had no part in that. The default's were tuned on all real sets."
)


@dataclass(frozen=True)
class Fold:
    """Sequences that teach, and sequences that are tracked by what was learnt.

    Attributes:
        train: the first.
        tests: the second.
    """

    train: tuple[GivenSequence, ...]
    tests: tuple[GivenSequence, ...]


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(FOLDS),  # noqa: B006, the parser shows it and nobody changes it
    parts: list[str] = list(PARTS),  # noqa: B006
) -> Outcome:
    """Networks learnt through the flow against costs learnt on pairs and those by default: HOTA, MOTA, IDF1, switches.

    The sequences of a set are cut into groups; each is tracked by what was learnt on the others.

    Args:
        bench: where it works.
        data: folder that holds mot/mot17-val-half, mot/mot15, mot/kitti, mot/PETS09-S2L1-first; what is not there is
            passed over.
        sets: of mot15, mot17, kitti-pedestrians, kitti-cars, and streets, which are generated, separated by commas; for
            the part given.
        parts: given (all sets), unseen (costs learnt on generated streets, on real sequences), separated by commas.

    Raises:
        RequestError: an unknown set or part, or no data.
    """
    for name, asked, known in (("sets", sets, tuple(FOLDS)), ("parts", parts, PARTS)):
        wrong = [one for one in asked if one not in known]
        if wrong or not asked:
            raise RequestError(f"{name}: expected some of {', '.join(known)}, got {', '.join(wrong) or 'none'}")
    if not ((parts, sets) == (["given"], ["streets"]) or (data / "mot").is_dir()):
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found no mot/")
    tables, values = list[Table](), dict[str, Any]()
    streets = list[GivenSequence]()
    if "unseen" in parts or ("given" in parts and "streets" in sets):
        streets = find_given(bench.store.made("streets", write_streets, 10, 120).parent, STREETS)
    there = {one.key: (one, find_given(data, one)) for one in DATA_SETS} | {STREETS.key: (STREETS, streets)}
    if "given" in parts:
        for one, sequences in _found(data, [there[key] for key in FOLDS if key in sets]):
            rows = given_rows(bench, one, sequences)
            better = max(PAIRS, key=lambda name: combined_scores(rows[name])["hota"])
            _add(tables, values, one.key, one.title, rows, (DEFAULT, better))
    if "unseen" in parts:
        values["unseen"] = {}
        for one, rows in _unseen_rows(bench, streets, _found(data, [there[key] for key in UNSEEN])):
            _add(tables, values["unseen"], one.key, f"{one.title}, learnt on generated streets", rows, (DEFAULT,))
    return Outcome(values, tables, notes=[NOTE])


def _add(
    tables: list[Table],
    values: dict[str, Any],
    key: str,
    title: str,
    rows: Mapping[str, FloatArray],
    bases: Sequence[str],
) -> None:
    values[key] = {name: combined_scores(sums) for name, sums in rows.items()}
    tables.append(score_table(title, rows, bases))


def given_rows(
    bench: Bench,
    one: DataSet,
    sequences: Sequence[GivenSequence],
    learners: Mapping[Name, Fit | PairLearner] = LEARNERS,
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of each row of a data set; a sequence is tracked by what the other groups taught."""
    count = min(FOLDS[one.key], len(sequences))
    groups = [tuple(sequences[group::count]) for group in range(count)]
    folds = [Fold(tuple(s for s in sequences if s not in tests), tests) for tests in groups]
    found = Study(learners, folds, fold_sums, f"{one.title}, groups").run(bench)
    rows = {DEFAULT: _default_rows(bench, sequences)}
    for name, by_fold in found.items():
        sums = {given: each for fold, part in zip(folds, by_fold, strict=True)
                for given, each in zip(fold.tests, part, strict=True)}  # fmt: skip
        rows[str(name)] = np.stack([sums[given] for given in sequences])
    rows["right links"] = np.stack([bench.store.recall(right_sums, given, GAP, True) for given in sequences])
    return rows


def _found(
    data: Path, sets: Sequence[tuple[DataSet, list[GivenSequence]]]
) -> list[tuple[DataSet, list[GivenSequence]]]:
    """Those with sequences.

    Raises:
        RequestError: there is none.
    """
    there = [(one, sequences) for one, sequences in sets if sequences]
    if not there:
        raise RequestError(f"data: expected mot/mot17-val-half or another of the data sets in {data}, found none")
    return there


def _unseen_rows(
    bench: Bench, streets: Sequence[GivenSequence], sets: Sequence[tuple[DataSet, list[GivenSequence]]]
) -> Iterator[tuple[DataSet, dict[str, FloatArray]]]:
    """The rows of each set: the default, the costs of pairs that ship, and costs learnt on streets."""
    every = tuple(given for _, sequences in sets for given in sequences)
    ((learnt,),) = Study({BOTH: UNSEEN_FIT}, [Fold(tuple(streets), every)], fold_sums, "unseen").run(bench).values()
    sums = dict(zip(every, learnt, strict=True))
    for one, sequences in sets:
        pairs = np.stack([bench.store.recall(shipped_sums, given) for given in sequences])
        own = np.stack([sums[given] for given in sequences])
        yield one, {DEFAULT: _default_rows(bench, sequences), "trees of pairs that ship": pairs, BOTH: own}


def _default_rows(bench: Bench, sequences: Sequence[GivenSequence]) -> FloatArray:
    return np.stack([bench.store.recall(default_sums, given) for given in sequences])


def fold_sums(learner: Fit | PairLearner, fold: Fold) -> list[FloatArray]:
    """``(83,)`` sums of each tested sequence, tracked by costs that were learnt on the others."""
    every = [graphs_of_given(given) for given in fold.train]
    graphs = [one for one in every if len(one.detections) and len(one.detections.tail)]
    changes = NetworkChanges(fit_network(graphs, learner)) if isinstance(learner, Fit) else fit_pairs(graphs, learner)
    return [track_sums(given, _tracked(given, FlowTracker(changes=changes, **_filmed(given)))) for given in fold.tests]


def default_sums(given: GivenSequence) -> FloatArray:
    """``(83,)`` sums at the tracker's own costs, by boxes alone."""
    return track_sums(given, _tracked(given, FlowTracker(**_filmed(given))))


def shipped_sums(given: GivenSequence) -> FloatArray:
    """``(83,)`` sums with the costs of pairs that ship, by boxes alone."""
    pairs = Affinity(shipped("affinity_people"), 1)
    return track_sums(given, _tracked(given, FlowTracker(None, pairs, pairs.observation, **_filmed(given))))


def _tracked(given: GivenSequence, tracker: FlowTracker) -> list[Track]:
    for found in given_detections(given):
        tracker.update(found)
    return as_written(tracker.tracks())


def _filmed(given: GivenSequence) -> dict[str, Any]:
    return {"frame_rate": given.rate, "size": given.size if min(given.size) > 0 else None}


@lru_cache(maxsize=40)
def graphs_of_given(given: GivenSequence) -> Graphs:
    """The networks of a sequence, at the tracker's own costs."""
    video = DetectedVideo(given.name, given_detections(given), given_labels(given), **_filmed(given))
    graphs = sequence_graphs(video)
    return Graphs(affordable(graphs.detections), graphs.tracklets)


def write_streets(folder: Path, clips: int, frames: int) -> None:
    """Clips without pictures, ``street-N``: labels, and det.txt of detectors from good to poor, at many rates.

    Args:
        folder: is made.
        clips: how many.
        frames: of each.
    """
    for number in range(clips):
        rng = np.random.default_rng([number, 1])
        settings = StreetSettings(
            width=320,
            height=240,
            frames=frames,
            frame_rate=float(rng.choice([7, 10, 14, 25, 30])),
            people=int(rng.integers(8, 22)),
            occluders=int(rng.integers(3, 11)),
            person_height=(16.0, 90.0),
            samples=1,
        )
        home = folder / f"street-{number:02d}"
        clip = plan_street(settings, number)
        clip.write_truth(home, home.name, [truth for _, truth in clip.frames()])
        truth = read_ground_truth(home / "gt" / "gt.txt")
        # Within what the detections of MOT17, MOT15, KITTI, PETS and TUD are off their labels.
        faults = DetectorFaults(
            jitter=float(rng.uniform(0.02, 0.045)),
            steady=float(rng.uniform(0.7, 0.9)),
            missed=float(rng.uniform(0.03, 0.35)),
            hidden=float(rng.uniform(0.5, 0.95)),
            false_alarms=float(rng.uniform(0.2, 4.0)),
            persistence=float(rng.uniform(0.5, 0.9)),
            doubled=float(rng.uniform(0.0, 0.1)),
        )
        found = simulate_detections(rng, truth, frames, settings.width, settings.height, faults)
        (home / "det").mkdir(parents=True)
        write_detections(home / "det" / "det.txt", found)
