"""Settings of the flow chosen without the data set that they are scored on (`reproduce association --parts choice`).

Candidates are the default and settings in which one of those that matter most is larger or smaller. For each data set
the candidate is taken that does best on the others, by the mean of their HOTA, MOTA and IDF1; its scores on the set
that was left out are what such a choice is worth elsewhere. Footage that is in two sets counts in one of them only.
All other settings are the defaults, which were chosen with all sets in sight.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tsuiseki.tracking.evaluation.resampling import score_sums, scores_of
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.flow_input import FlowSettings
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.labelled import with_labels
from tsuiseki.trainers.experiments.association.sequences import Clip, DataSet
from tsuiseki.trainers.experiments.association.tracks import tracks_by
from tsuiseki.trainers.experiments.experiment import Bench, Table

# The same footage as MOT17-09, -10, -05 and -02, the first of which is kept apart.
TWINS = ("ADL-Rundle-6-first", "ADL-Rundle-8", "ETH-Pedcross2", "Venice-2")
DEFAULT = "default"
SCORES = ("hota", "mota", "idf1")
# HOTA, MOTA and IDF1 on every set.
Scores = Mapping[str, tuple[float, ...]]


def candidates() -> dict[str, FlowSettings]:
    """The settings to choose from, by what is changed."""
    base = FlowSettings()
    costs, link, detection = base.costs, base.costs.link, base.input.detection
    found = {DEFAULT: base}
    for offset in (3.0, 4.0):
        found[f"detection.offset {offset:g}"] = replace(
            base, input=replace(base.input, detection=replace(detection, offset=offset))
        )
    for cost in (4.0, 6.0):
        found[f"entry and exit {cost:g}"] = replace(base, costs=replace(costs, entry=cost, exit=cost))
    links = {f"link.velocity_confidence {share:g}": replace(link, velocity_confidence=share) for share in (0.0, 0.5)}
    links |= {f"link.turn {cost:g}": replace(link, turn=cost) for cost in (4.0, 1000.0)}
    for times in (0.8, 1.25):
        r = tuple(times * value for value in link.motion.measurement)
        links[f"measurement noise × {times:g}"] = replace(
            link, motion=replace(link.motion, measurement=(r[0], r[1], r[2]))
        )
    return found | {name: replace(base, costs=replace(costs, link=one)) for name, one in links.items()}


def candidate_sums(clip: Clip, candidate: str) -> FloatArray:
    """Sums of the scores of a candidate on one sequence."""
    size = clip.size if min(clip.size) > 0 else None
    tracker = FlowTracker(candidates()[candidate], frame_rate=clip.rate, size=size)
    return score_sums(with_labels(clip, tracks_by(clip, tracker)))


def chosen_without(scores: Mapping[str, Scores], left_out: str) -> str:
    """The candidate of the best mean over all sets but one; of equal ones the first.

    >>> chosen_without({"a": {"x": (0.9,), "y": (0.1,)}, "b": {"x": (0.2,), "y": (0.3,)}}, "x")
    'b'
    """
    return max(scores, key=lambda name: float(np.mean([v for key, v in scores[name].items() if key != left_out])))


def choice_table(bench: Bench, sets: Sequence[tuple[DataSet, Sequence[Clip]]]) -> Table:
    """What is chosen without each set, how it does there, and how the default and the best candidate there do.

    Args:
        bench: where it works.
        sets: at least two data sets with their sequences.
    """
    kept = [(one, [clip for clip in clips if clip.name not in TWINS]) for one, clips in sets]
    scores: dict[str, dict[str, tuple[float, ...]]] = {}
    names = list(candidates())
    for name in bench.watch.over(names, "candidates", len(names)):
        for one, clips in kept:
            sums = np.sum([bench.store.recall(candidate_sums, clip, name) for clip in clips], axis=0)
            found = scores_of(sums)
            scores.setdefault(name, {})[one.key] = tuple(float(found[key]) for key in SCORES)
    rows = []
    for one, _ in kept:
        best = max(names, key=lambda name: float(np.mean(scores[name][one.key])))
        told = [[name, _cell(scores[name][one.key])] for name in (chosen_without(scores, one.key), DEFAULT, best)]
        rows.append([one.title, *told[0], told[1][1], *told[2]])
    columns = ("left out", "chosen without it", "HOTA / MOTA / IDF1", "default", "best in sight", "HOTA / MOTA / IDF1")
    return Table("", columns, rows)


def _cell(values: Sequence[float]) -> str:
    return " / ".join(f"{value:.3f}" for value in values)
