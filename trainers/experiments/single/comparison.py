"""The thesis's chapter 3 again: sweeps, comparison, attributes; paper beside here.

The paper's numbers are areas under the success curve with 11 thresholds over the 50 sequences of TB-50; here they are
the same over the sequences that are given, so levels differ and the shapes of the curves are what can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from tsuiseki.tracking.evaluation.single import SequenceScores
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.constants import PRINTED, ROBUST, KcfParticleSettings
from tsuiseki.tracking.single.settings import SingleMethod
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.single.runs import Clip, Entrant, score, seeds_of
from tsuiseki.trainers.experiments.store import Store

BASELINES: tuple[SingleMethod, ...] = (
    "csk", "mosse", "template", "histogram", "kalman", "meanshift", "camshift", "medianflow", "colour-particle", "mil",
)  # fmt: skip


@dataclass(frozen=True)
class Sweep:
    """One parameter, the others at the thesis's values, to the letter.

    Attributes:
        name: of the parameter.
        figure: of the thesis.
        paper: its areas by value, where the text gives them, in percent.
        values: tried here.
        settings: for a value.
    """

    name: str
    figure: str
    paper: Mapping[float, float]
    values: tuple[float, ...]
    settings: Callable[[float], KcfParticleSettings]


SWEEPS = (
    Sweep(
        "epsilon_2", "Fig. 3.6", {0.0: 32.84, 0.03: 37.73}, (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.1),
        lambda v: replace(PRINTED, convergence=v, response_share=1.0, hypotheses=1),
    ),
    Sweep(
        "alpha", "Fig. 3.7", {0.3: 38.60, 1.0: 37.73}, (0.0, 0.1, 0.2, 0.3, 0.5, 0.7, 0.9, 1.0),
        lambda v: replace(PRINTED, response_share=v, hypotheses=1),
    ),
    Sweep(
        "M", "Fig. 3.8", {1: 38.60, 20: 40.64}, (1, 2, 5, 10, 20, 30, 40, 50),
        lambda v: replace(PRINTED, hypotheses=int(v)),
    ),
    Sweep(
        "mu, uniform", "Table 3.4", {0.0: 39.97, 0.25: 39.28, 0.5: 40.64, 0.75: 38.95, 1.0: 38.84},
        (0.0, 0.25, 0.5, 0.75, 1.0), lambda v: replace(PRINTED, past_share=v),
    ),
    Sweep(
        "mu, score", "Table 3.4", {}, (0.0, 0.25, 0.5, 0.75, 1.0),
        lambda v: replace(PRINTED, past_share=v, past="score"),
    ),
)  # fmt: skip


def additions() -> dict[str, Entrant]:
    """Ours, and ours with one addition at a time taken back to the thesis's value."""
    named: dict[str, dict[str, Any]] = {
        "all additions": {},
        "mixture of equal maxima": {"prefers_near": PRINTED.prefers_near},
        "heaviest particle": {"densest": PRINTED.densest},
        "not uphill": {"climbs": PRINTED.climbs},
        "one window": {"reach": PRINTED.reach},
        "S as printed": {"spread": PRINTED.spread},
        "likelihood to the first power": {"sharpness": PRINTED.sharpness},
        "no colours in the likelihood": {"colour": PRINTED.colour},
        "no relative switch": {"relative_switch": PRINTED.relative_switch},
        "no drift switch": {"drift_switch": PRINTED.drift_switch},
        "ends on agreement alone": {"ends_when_sure": PRINTED.ends_when_sure},
        "learns while searching": {"learns_while_searching": PRINTED.learns_while_searching},
        "first filter not kept": {"keeps_first": PRINTED.keeps_first},
        "U = 20, every frame": {"stored": PRINTED.stored, "store_interval": PRINTED.store_interval},
        "past drawn uniformly": {"past": PRINTED.past},
        "H = 50": {"plain_frames": PRINTED.plain_frames},
    }
    return {name: replace(ROBUST, **fields) for name, fields in named.items()}


def compared() -> dict[str, Entrant]:
    """Fig. 3.9: KCF and the combined tracker, the thesis's and ours, and the baselines of chapter 2."""
    return {
        "KCF, fixed size": kcf.THESIS,
        "KCF, scale search": kcf.KcfSettings(),
        "combined, printed": PRINTED,
        "combined, robust, fixed size": replace(ROBUST, kcf=kcf.THESIS),
        "combined, robust": ROBUST,
        **{method: method for method in BASELINES},
    }


GAINS = {
    "combined, printed": "KCF, fixed size",
    "combined, robust, fixed size": "KCF, fixed size",
    "combined, robust": "KCF, scale search",
}


@dataclass(frozen=True)
class Repeated:
    """One tracker over sequences and seeds.

    Attributes:
        scores: per seed, by sequence.
    """

    scores: tuple[Mapping[str, SequenceScores], ...]

    def areas(self, thesis: bool = True, names: Sequence[str] | None = None) -> FloatArray:
        """Mean areas over sequences in percent, one a seed, with 11 (``thesis``) or 21 thresholds."""
        return 100 * np.array(
            [
                np.mean([(s.thesis_auc if thesis else s.auc) for n, s in one.items() if names is None or n in names])
                for one in self.scores
            ]
        )

    def success(self) -> FloatArray:
        """``(21,)`` mean success curve."""
        return np.asarray(np.mean([s.success for one in self.scores for s in one.values()], axis=0))


def repeat(store: Store, clips: Sequence[Clip], entrant: Entrant, seeds: Sequence[int]) -> Repeated:
    """A new tracker for every seed and sequence; one seed where it makes no difference."""
    used = seeds_of(entrant, seeds)
    return Repeated(tuple({c.sequence.name: score(store, c, entrant, seed) for c in clips} for seed in used))


def gains(results: Mapping[str, Repeated], names: Sequence[str] | None = None) -> dict[str, FloatArray]:
    """What the combined tracker gains over the correlation filter it is built on, `GAINS`: points of area, one a seed.

    Args:
        results: from `compare`.
        names: the sequences to take the mean over; all by default.
    """
    return {
        name: results[name].areas(thesis=False, names=names) - results[base].areas(thesis=False, names=names).mean()
        for name, base in GAINS.items()
    }


def run_sweep(store: Store, sweep: Sweep, clips: Sequence[Clip], seeds: Sequence[int]) -> dict[float, Repeated]:
    """Results by value of the parameter."""
    return {value: repeat(store, clips, sweep.settings(value), seeds) for value in sweep.values}


def compare(store: Store, clips: Sequence[Clip], seeds: Sequence[int]) -> dict[str, Repeated]:
    """Results of `compared`."""
    return {name: repeat(store, clips, entrant, seeds) for name, entrant in compared().items()}


def passes(
    store: Store, clips: Sequence[Clip], entrants: Iterable[Entrant], seeds: Sequence[int]
) -> Iterator[Callable[[], object]]:
    """Every single pass that `repeat` asks for, to be run one by one where progress is to be seen."""
    for entrant in entrants:
        for seed in seeds_of(entrant, seeds):
            for clip in clips:
                yield partial(score, store, clip, entrant, seed)


def by_attribute(clips: Sequence[Clip], results: Mapping[str, Repeated]) -> dict[str, dict[str, float]]:
    """Fig. 3.11: mean areas by attribute and tracker, for the attributes that occur."""
    attributes = sorted({a for c in clips for a in c.sequence.attributes})
    names = {a: [c.sequence.name for c in clips if a in c.sequence.attributes] for a in attributes}
    return {a: {t: float(r.areas(names=names[a]).mean()) for t, r in results.items()} for a in attributes}
