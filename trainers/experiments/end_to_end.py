"""Costs of the flow learnt through the flow, against those by default (`reproduce end-to-end`)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from torch.optim import AdamW

from tsuiseki.models.association_network import AssociationNetwork
from tsuiseki.tracking.association.learnt_costs import LARGEST, Affinity
from tsuiseki.tracking.types import Detections, FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.association.flow_loss import FlowLoss, finite
from tsuiseki.trainers.association.graphs import DetectedVideo, Graphs
from tsuiseki.trainers.association.sequence_graphs import sequence_graphs
from tsuiseki.trainers.association.training import AssociationTraining
from tsuiseki.trainers.association.windows import RandomWindows, affordable
from tsuiseki.trainers.experiments import given_sequences
from tsuiseki.trainers.experiments.given_sequences import (
    DataSet,
    GivenSequence,
    given_detections,
    sums_of,
    write_streets,
)
from tsuiseki.trainers.experiments.study import Bench, Name, Outcome, Study, Table, some_of
from tsuiseki.trainers.networks.modules import Optimisation, WarmupCosine


@dataclass(frozen=True)
class Fit:
    """How an association network is fitted; see `AssociationTraining` for the rest.

    Attributes:
        loss: of the flow.
        trust: share of the change of what detections cost that is taken outside of training.
        flow: weight of the loss of the flow; 0 trains by all other losses alone, to compare with.
        steps: windows that are learnt from.
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


def fitted(module: AssociationTraining, graphs: Sequence[Graphs], fit: Fit) -> AssociationTraining:
    """A module, whatever networks it has, after ``fit.steps`` windows of the graphs of sequences.

    Raises:
        RunError: a loss is no number; names the window.
    """
    module.standardise(graphs)
    windows = RandomWindows(graphs, fit.seconds, fit.steps, lambda: (fit.seed, 0))
    groups = [group for group in module.parameter_groups() if group["params"]]
    how = fit.optimisation
    optimiser = AdamW(groups, lr=how.learning_rate)
    schedule = WarmupCosine(optimiser, how.warmup_steps, max(fit.steps, 11), how.final_share)
    for step in range(fit.steps):
        batch = windows[step]
        if len(batch.detections):
            optimiser.zero_grad()
            objective, others = module.losses(batch, module.loss, np.random.default_rng([fit.seed, step]))
            finite(fit.flow * objective + others, batch.detections.name).backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
            optimiser.step()
        schedule.step()
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
PAIRS = shipped("affinity_people")
# Longest gap that the right links bridge, seconds.
GAP = 2.0
NOTE = (
    "Intervals: paired bootstrap over sequences, 2,000 samples, 95 %. Settings of the fits were chosen on MOT15; "
    "the other sets had no part in that. The default's were tuned on all real sets."
)


Fold: TypeAlias = tuple[tuple[GivenSequence, ...], tuple[GivenSequence, ...]]
"""Sequences that teach, and sequences that are tracked by what was learnt."""


def reproduce(
    bench: Bench,
    data: Path = Path("../shared/data"),
    sets: list[str] = list(FOLDS),  # noqa: B006, the parser shows it and it is never changed
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
    given = given_sequences.find_sets(data, asked) if asked else {}
    unseen = given_sequences.find_sets(data, UNSEEN) if "unseen" in parts else {}
    tables, values = list[Table](), dict[str, Any]()
    streets = list[GivenSequence]()
    if unseen or STREETS.key in sets:
        streets = given_sequences.find_given(bench.store.made("streets", write_streets, 10, 120).parent, STREETS)
    if "given" in parts and STREETS.key in sets:
        given[STREETS] = streets
    found = [(values, one, "", given_rows(bench, one, sequences)) for one, sequences in given.items()]
    if unseen:
        values["unseen"] = {}
        every = _new_clip_rows(bench, streets, unseen)
        found += [(values["unseen"], one, ", learnt on generated streets", rows) for one, rows in every]
    for into, one, how, rows in found:
        into[one.key] = {name: given_sequences.combined_scores(sums) for name, sums in rows.items()}
        tables.append(given_sequences.score_table(f"{one.title}{how}", rows, DEFAULT))
    return Outcome(values, tables, notes=[NOTE])


def given_rows(
    bench: Bench, one: DataSet, sequences: Sequence[GivenSequence], fits: Mapping[Name, Fit] = FITS
) -> dict[str, FloatArray]:
    """``(S, 83)`` sums of each row of a data set; a sequence is tracked by what the other groups taught."""
    count = min(FOLDS[one.key], len(sequences))
    groups = [tuple(sequences[group::count]) for group in range(count)]
    folds = [(tuple(s for s in sequences if s not in tests), tests) for tests in groups]
    found = Study(fits, folds, fold_sums, f"{one.title}, groups").run(bench)
    rows = {DEFAULT: sums_of(bench, flow_sums, [(given,) for given in sequences])}
    for name, by_fold in found.items():
        sums = {given: each for (_, tests), part in zip(folds, by_fold, strict=True)
                for given, each in zip(tests, part, strict=True)}  # fmt: skip
        rows[str(name)] = np.stack([sums[given] for given in sequences])
    rows["right links"] = sums_of(bench, given_sequences.right_sums, [(given, GAP, True) for given in sequences])
    return rows


def _new_clip_rows(
    bench: Bench, streets: Sequence[GivenSequence], sets: Mapping[DataSet, list[GivenSequence]]
) -> Iterator[tuple[DataSet, dict[str, FloatArray]]]:
    """The rows of each set: the default, the costs of pairs that ship, and costs learnt on streets."""
    every = tuple(given for sequences in sets.values() for given in sequences)
    ((learnt,),) = Study({BOTH: UNSEEN_FIT}, [(tuple(streets), every)], fold_sums, "unseen").run(bench).values()
    sums = dict(zip(every, learnt, strict=True))
    for one, sequences in sets.items():
        default, pairs = (sums_of(bench, flow_sums, [(g, trees) for g in sequences]) for trees in (None, PAIRS))
        yield one, {DEFAULT: default, "trees of pairs that ship": pairs, BOTH: np.stack([sums[g] for g in sequences])}


def fold_sums(fit: Fit, fold: Fold) -> list[FloatArray]:
    """``(83,)`` sums of each tested sequence, tracked by costs that were learnt on the others."""
    every = [graphs_of_given(given) for given in fold[0]]
    graphs = [one for one in every if len(one.detections) and len(one.detections.tail)]
    torch.manual_seed(fit.seed)
    module = AssociationTraining(trust=fit.trust, loss=fit.loss, joins=fit.joins, optimisation=fit.optimisation)
    changes = NetworkChanges(fitted(module, graphs, fit).network.eval())
    return [_sums(given, changes=changes) for given in fold[1]]


def flow_sums(given: GivenSequence, trees: Path | None = None) -> FloatArray:
    """``(83,)`` sums by boxes alone, at the tracker's own costs or at those of trees of pairs."""
    pairs = Affinity(trees, 1) if trees else None
    return _sums(given, transition=pairs, observation=pairs and pairs.observation)


def _sums(given: GivenSequence, **costs: Any) -> FloatArray:
    tracks = given_sequences.flow_over(given, **costs).tracks()
    return given_sequences.track_sums(given, given_sequences.as_written(tracks))


@lru_cache(maxsize=40)
def graphs_of_given(given: GivenSequence) -> Graphs:
    """The networks of a sequence, at the tracker's own costs."""
    video = DetectedVideo(given.name, given_detections(given), given_sequences.given_labels(given), **given.filmed)
    graphs = sequence_graphs(video)
    return Graphs(affordable(graphs.detections), graphs.tracklets)
