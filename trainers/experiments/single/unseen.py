"""What the combined tracker gains over KCF on sequences that its settings have not seen.

Settings are chosen by leaving a sequence out: of a few candidates the one with the best mean over all *other*
sequences, with the first seed, is scored on it, with all seeds. So no sequence is scored with settings that it helped
to choose. The interval is over sequences (bootstrap, both trackers on the same samples).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.constants import PRINTED, ROBUST, CombinedSettings, RegularisedSettings
from tsuiseki.tracking.types import FloatArray
from tsuiseki.trainers.experiments.single import comparison
from tsuiseki.trainers.experiments.single.contrib import find_contrib
from tsuiseki.trainers.experiments.single.runs import Clip, Entrant, score, seeds_of
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Outcome, Table

SAMPLES = 10_000
OURS = "combined, chosen on the others"


@dataclass(frozen=True)
class Group:
    """Trackers that all try other sizes, or none.

    Attributes:
        name: for the table.
        base: KCF.
        others: rows beside, with the settings that they have.
        candidates: of the combined tracker, to choose from.
    """

    name: str
    base: kcf.KcfSettings
    others: Mapping[str, Entrant]
    candidates: Mapping[str, CombinedSettings]


def groups(contrib: Path | None = None) -> tuple[Group, ...]:
    """With scale search and at fixed size; with CSRT where the Python of OpenCV-contrib's environment is given."""
    # No far sizes, those of the contrast of colours alone, and those of their area, too.
    far = [(0.0, 2.0), (0.9, 2.0), (0.95, 2.0), (0.9, 0.45), (0.95, 0.4), (0.95, 0.45), (0.95, 0.5)]
    scaled = {
        f"far sizes {agreement or 'no'}, area {area if area < 2 else 'no'}": _combined(
            size_agreement=agreement, size_reach=24 if agreement else 0, size_by_area=area
        )
        for agreement, area in far
    } | {"far sizes 0.95, area 0.45, calibration 1": _combined(calibration=1.0)}
    fixed = {
        f"colours {share:g}, certain {certain:g}": replace(_combined(colour_share=share, sizes=1), certain=certain)
        for share in (0.2, 0.3)
        for certain in (0.4, 0.8)
    }
    csrt, csrt_fixed = ({} if contrib is None else {"CSRT": find_contrib(contrib, scales)} for scales in (33, 1))
    return (
        Group(
            "scale search", kcf.KcfSettings(),
            {**csrt, "kcf-particle, robust": ROBUST, "filter alone": RegularisedSettings(),
             "combined as shipped": CombinedSettings()}, scaled,
        ),
        Group(
            "fixed size", kcf.THESIS,
            {**csrt_fixed, "kcf-particle, printed": PRINTED,
             "kcf-particle, robust": replace(ROBUST, kcf=kcf.THESIS), "filter alone": RegularisedSettings(sizes=1),
             "combined as shipped": _combined(sizes=1)}, fixed,
        ),
    )  # fmt: skip


def _combined(**fields: float) -> CombinedSettings:
    return CombinedSettings(filter=RegularisedSettings(**fields))  # type: ignore[arg-type]


def passes(
    store: Store, clips: Sequence[Clip], seeds: Sequence[int], contrib: Path | None
) -> Iterator[Callable[[], object]]:
    """Every pass that `unseen` needs, but those of the chosen settings with other seeds than the first."""
    for group in groups(contrib):
        yield from comparison.passes(store, clips, group.candidates.values(), seeds[:1])
        yield from comparison.passes(store, clips, [group.base, *group.others.values()], seeds)


def unseen(store: Store, clips: Sequence[Clip], seeds: Sequence[int], contrib: Path | None = None) -> Outcome:
    """A table of areas by sequence for each group, with the gains over KCF."""
    found = [_group(store, group, clips, seeds) for group in groups(contrib)] if len(clips) > 1 else []
    notes = [] if found else ["unseen: expected at least two sequences to choose settings on others"]
    return Outcome({"unseen": {name: values for name, values, _ in found}}, [table for *_, table in found], notes=notes)


def _group(
    store: Store, group: Group, clips: Sequence[Clip], seeds: Sequence[int]
) -> tuple[str, dict[str, object], Table]:
    base = areas(store, clips, group.base, seeds)
    candidates = {name: areas(store, clips, one, seeds[:1]) for name, one in group.candidates.items()}
    chosen = leave_one_out(candidates)
    ours = np.array(
        [areas(store, [clip], group.candidates[one], seeds)[0] for clip, one in zip(clips, chosen, strict=True)]
    )
    rows = {name: areas(store, clips, one, seeds) for name, one in group.others.items()} | {OURS: ours}
    names = [clip.sequence.name for clip in clips]
    cells = [
        (name, f"{base[k]:.1f}", *(f"{row[k]:.1f} ({row[k] - base[k]:+.1f})" for row in rows.values()), chosen[k])
        for k, name in enumerate(names)
    ]
    gains = {name: interval(row - base) for name, row in rows.items()}
    cells.append(
        ("mean", f"{base.mean():.1f}",
         *(f"{row.mean():.1f} ({gains[name][0]:+.1f} [{gains[name][1]:.1f}, {gains[name][2]:.1f}])"
           for name, row in rows.items()), "")
    )  # fmt: skip
    cells.append(("worst against KCF", "", *(f"{(row - base).min():+.1f}" for row in rows.values()), ""))
    title = f"Unseen, {group.name}: AUC [%], 21 thresholds (gain over KCF, 95 % interval over sequences)"
    values: dict[str, object] = {
        "sequences": names, "KCF": base.tolist(), "chosen": chosen,
        **{name: row.tolist() for name, row in rows.items()},
        "candidates, first seed": {name: row.tolist() for name, row in candidates.items()},
        "gains": gains,
    }  # fmt: skip
    return group.name, values, Table(title, ("sequence", "KCF", *rows, "settings chosen"), cells)


def areas(store: Store, clips: Sequence[Clip], entrant: Entrant, seeds: Sequence[int]) -> FloatArray:
    """``(S,)`` areas of the sequences in percent, means over the seeds."""
    return np.array(
        [np.mean([100 * score(store, clip, entrant, seed).auc for seed in seeds_of(entrant, seeds)]) for clip in clips]
    )


def leave_one_out(candidates: Mapping[str, FloatArray]) -> list[str]:
    """For each of S > 1 sequences the name of the candidate that is best in the mean of the others.

    Args:
        candidates: ``(S,)`` scores by name; of equal ones the first is taken.
    """
    names, scores = list(candidates), np.array(list(candidates.values()))
    others = scores.sum(axis=1, keepdims=True) - scores
    return [names[k] for k in np.argmax(others, axis=0)]


def interval(gains: FloatArray) -> tuple[float, float, float]:
    """Mean of ``(S,)`` gains and its 95 % bootstrap interval over sequences."""
    rng = np.random.default_rng(0)
    means = gains[rng.integers(len(gains), size=(SAMPLES, len(gains)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(gains.mean()), float(low), float(high)
