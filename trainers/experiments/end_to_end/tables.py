"""Tables of gains with intervals, and of what the graph allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tsuiseki.tracking.evaluation.resampling import paired_bootstrap, scores_of
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.association.runs import Result
from tsuiseki.trainers.experiments.experiment import Table

SAMPLES = 2000
GAINS = ("hota", "mota", "idf1")


def gain_table(title: str, results: Sequence[Result], bases: Sequence[str]) -> Table:
    """Scores of all rows, and how far each is above some of them.

    Args:
        title: of the data set.
        results: the rows.
        bases: names of the rows that all others are compared with.
    """
    rows = []
    for result in results:
        found = scores_of(result.sums.sum(axis=0))
        cells = [f"{float(found[name]):.3f}" for name in ("hota", "det_a", "ass_a", "mota", "idf1")]
        cells.append(str(int(found["id_switches"])))
        for name in bases:
            base = next(one for one in results if one.name == name)
            cells += [""] * 4 if base is result else _gains(result.sums, base.sums)
        rows.append([result.name, *cells, result.settings])
    above = [f"{what} − {name}" for name in bases for what in ("HOTA", "MOTA", "IDF1", "switches")]
    return Table("", (title, "HOTA", "DetA", "AssA", "MOTA", "IDF1", "switches", *above, "learnt on"), rows)


def limit_table(title: str, names: Sequence[str], limits: Sequence[Sequence[int]]) -> Table:
    """What becomes of the links of the labels by default, see `lost_links`."""
    every = [*zip(names, limits, strict=True), ("all", [sum(column) for column in zip(*limits, strict=True)])]
    columns = ("all", "not in the graph", "taken", "not taken, an end unused", "wrong links taken")
    rows = [[name, *map(str, counts)] for name, counts in every]
    return Table("", (f"{title}: links of the labels, default", *columns), rows)


def _gains(ours: FloatArray, theirs: FloatArray) -> list[str]:
    found = paired_bootstrap(ours, theirs, SAMPLES, np.random.default_rng(0))
    cells = [f"{found[k].difference:+.3f} [{found[k].low:+.3f}, {found[k].high:+.3f}]" for k in GAINS]
    return [*cells, _fewer(ours, theirs)]


def _fewer(ours: FloatArray, theirs: FloatArray) -> str:
    """The change of the number of switches, a share of theirs."""
    one, other = (np.asarray(scores_of(sums)["id_switches"]) for sums in (ours, theirs))
    count = len(one)
    drawn = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), SAMPLES)
    change = drawn @ one / np.maximum(drawn @ other, 1) - 1
    low, high = np.quantile(change, (0.025, 0.975))
    return f"{one.sum() / max(other.sum(), 1) - 1:+.0%} [{low:+.0%}, {high:+.0%}]"
