"""Costs of the flow learnt through the flow, against those by default (`reproduce end-to-end`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.optim import AdamW

from tsuiseki.datamodules.scenes.street_clip import StreetSettings, plan_street
from tsuiseki.datamodules.simulated_detections import DetectorFaults, simulate_detections
from tsuiseki.models.association_network import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import LARGEST, Affinity
from tsuiseki.tracking.formats.mot import read_ground_truth, write_detections
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections, FloatArray, Track
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.flow_loss import FlowLoss, finite
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.training import AssociationTraining
from tsuiseki.trainers.association.windows import RandomWindows, WindowImages, affordable
from tsuiseki.trainers.experiments.given_sequences import (
    DataSet,
    GivenSequence,
    as_written,
    combined_scores,
    find_given,
    find_sets,
    given_detections,
    given_labels,
    right_sums,
    score_table,
    track_sums,
)
from tsuiseki.trainers.experiments.study import Bench, Name, Outcome, Study, Table, some_of
from tsuiseki.trainers.networks.modules import Optimisation, warmup_cosine


@dataclass(frozen=True)
class Fit:
    """How an association network is fitted; see `AssociationTraining` for what is not told here.

    Attributes:
        loss: of the flow.
        trust: share of the change of what detections cost that is taken outside of training.
        flow: weight of the loss of the flow; 0 trains by all other losses alone, to compare with.
        steps: windows that are looked at.
        seconds: length of a window.
        joins: weight of the second level.
        optimisation: how weights are moved.
        seed: of windows, perturbations and first weights.
    """

    loss: FlowLoss = FlowLoss()  # noqa: RUF009
    trust: float = 0.5
    flow: float = 1.0
    steps: int = 120
    seconds: float = 2.0
    joins: float = 0.2
    optimisation: Optimisation = Optimisation(3e-3, 1e-2, warmup_steps=10)  # noqa: RUF009
    seed: int = 0


def fit_network(graphs: Sequence[Graphs], fit: Fit) -> AssociationNetwork:
    """The network after ``fit.steps`` windows.

    Raises:
        RunError: a loss is no number; names the window.
    """
    torch.manual_seed(fit.seed)
    module = AssociationTraining(trust=fit.trust, loss=fit.loss, joins=fit.joins, optimisation=fit.optimisation)
    return fitted(module, graphs, fit).network.eval()


def fitted(
    module: AssociationTraining,
    graphs: Sequence[Graphs],
    fit: Fit,
    images: WindowImages = WindowImages(),  # noqa: B008
) -> AssociationTraining:
    """A module, whatever networks it has, after ``fit.steps`` windows.

    Args:
        module: is changed.
        graphs: of the sequences.
        fit: how long, how fast, on windows of what length.
        images: what its networks see of a window.

    Raises:
        RunError: a loss is no number; names the window.
    """
    module.standardise(graphs)
    windows = RandomWindows(graphs, fit.seconds, fit.steps, lambda: (fit.seed, 0), images)
    groups = [group for group in module.parameter_groups() if group["params"]]
    how = fit.optimisation
    highest = [group.get("lr", how.learning_rate) for group in groups]
    optimiser = AdamW(groups, lr=how.learning_rate)
    for step in range(fit.steps):
        batch = windows[step]
        if not len(batch.detections):
            continue
        for group, rate in zip(optimiser.param_groups, highest, strict=True):
            group["lr"] = rate * warmup_cosine(step, how.warmup_steps, max(fit.steps, 11), how.final_share)
        optimiser.zero_grad()
        objective, others = module.losses(batch, module.loss, np.random.default_rng([fit.seed, step]))
        finite(fit.flow * objective + others, batch.detections.name).backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimiser.step()
    return module


@dataclass(frozen=True)
class NetworkChanges:
    """An association network in torch as the tracker takes it; a `CostChanges`.

    Attributes:
        network: the network.
    """

    network: AssociationNetwork

    def links(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of links."""
        return self._of("links", rows)[:, 0]

    def detections(self, rows: FloatArray) -> FloatArray:
        """``(N, 3)`` changes of the costs of detections, of a track's start and of its end there."""
        return self._of("detections", rows).clip(-LARGEST, LARGEST)

    def joins(self, rows: FloatArray) -> FloatArray:
        """``(P,)`` changes of the costs of joins."""
        return self._of("joins", rows)[:, 0]

    def projected(self, found: Detections) -> Detections:
        """The detections of a frame with their appearance features as they are compared."""
        if self.network.projection is None or found.features is None:
            return found
        with torch.no_grad():
            features: torch.Tensor = self.network.projection(torch.as_tensor(found.features, dtype=torch.float32))
        return found.with_features(features.double().numpy())

    def _of(self, part: str, rows: FloatArray) -> FloatArray:
        with torch.no_grad():
            changes: torch.Tensor = getattr(self.network, part)(torch.as_tensor(rows, dtype=torch.float32))
        return changes.double().numpy()


DEFAULT, BOTH = "default", "both losses"
FITS: dict[Name, Fit] = {
    "Fenchel-Young": Fit(FlowLoss("fenchel_young")),
    "hinge": Fit(FlowLoss("hinge")),
    BOTH: Fit(),
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
    """Costs learnt through the flow against those by default: HOTA, MOTA, IDF1, identity switches.

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
    some_of(tuple(FOLDS), sets=sets)
    some_of(PARTS, parts=parts)
    asked = [key for key in FOLDS if key in sets and key != STREETS.key] if "given" in parts else []
    given = find_sets(data, asked) if asked else {}
    unseen = find_sets(data, UNSEEN) if "unseen" in parts else {}
    tables, values = list[Table](), dict[str, Any]()
    streets = list[GivenSequence]()
    if unseen or STREETS.key in sets:
        streets = find_given(bench.store.made("streets", write_streets, 10, 120).parent, STREETS)
    if "given" in parts and STREETS.key in sets:
        given[STREETS] = streets
    for one, sequences in given.items():
        _add(tables, values, one.key, one.title, given_rows(bench, one, sequences))
    if unseen:
        values["unseen"] = {}
        for one, rows in _unseen_rows(bench, streets, unseen):
            _add(tables, values["unseen"], one.key, f"{one.title}, learnt on generated streets", rows)
    return Outcome(values, tables, notes=[NOTE])


def _add(tables: list[Table], values: dict[str, Any], key: str, title: str, rows: Mapping[str, FloatArray]) -> None:
    values[key] = {name: combined_scores(sums) for name, sums in rows.items()}
    tables.append(score_table(title, rows, (DEFAULT,)))


def given_rows(
    bench: Bench, one: DataSet, sequences: Sequence[GivenSequence], fits: Mapping[Name, Fit] = FITS
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of each row of a data set; a sequence is tracked by what the other groups taught."""
    count = min(FOLDS[one.key], len(sequences))
    groups = [tuple(sequences[group::count]) for group in range(count)]
    folds = [Fold(tuple(s for s in sequences if s not in tests), tests) for tests in groups]
    found = Study(fits, folds, fold_sums, f"{one.title}, groups").run(bench)
    rows = {DEFAULT: _default_rows(bench, sequences)}
    for name, by_fold in found.items():
        sums = {given: each for fold, part in zip(folds, by_fold, strict=True)
                for given, each in zip(fold.tests, part, strict=True)}  # fmt: skip
        rows[str(name)] = np.stack([sums[given] for given in sequences])
    rows["right links"] = np.stack([bench.store.recall(right_sums, given, GAP, True) for given in sequences])
    return rows


def _unseen_rows(
    bench: Bench, streets: Sequence[GivenSequence], sets: Mapping[DataSet, list[GivenSequence]]
) -> Iterator[tuple[DataSet, dict[str, FloatArray]]]:
    """The rows of each set: the default, the costs of pairs that ship, and costs learnt on streets."""
    every = tuple(given for sequences in sets.values() for given in sequences)
    ((learnt,),) = Study({BOTH: UNSEEN_FIT}, [Fold(tuple(streets), every)], fold_sums, "unseen").run(bench).values()
    sums = dict(zip(every, learnt, strict=True))
    for one, sequences in sets.items():
        pairs = np.stack([bench.store.recall(shipped_sums, given) for given in sequences])
        own = np.stack([sums[given] for given in sequences])
        yield one, {DEFAULT: _default_rows(bench, sequences), "trees of pairs that ship": pairs, BOTH: own}


def _default_rows(bench: Bench, sequences: Sequence[GivenSequence]) -> FloatArray:
    return np.stack([bench.store.recall(default_sums, given) for given in sequences])


def fold_sums(fit: Fit, fold: Fold) -> list[FloatArray]:
    """``(83,)`` sums of each tested sequence, tracked by costs that were learnt on the others."""
    every = [graphs_of_given(given) for given in fold.train]
    graphs = [one for one in every if len(one.detections) and len(one.detections.tail)]
    changes = NetworkChanges(fit_network(graphs, fit))
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
