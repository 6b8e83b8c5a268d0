"""Other witnesses of a lost target than those that ship, and how far any threshold on them could go.

All are replayed on the same boxes (`witness_looks`): below a threshold for some looks in a row the status is lost,
beside what the tracker says by itself. Threshold and looks are chosen on the chases that chose the constants of
`recognition`, and counted on the others. The bound takes the threshold and looks that hindsight finds best there, and
of the witnesses joined also the weights.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.single import lost_status
from tsuiseki.trainers.experiments.single.lost_status import FOLLOWED, WITHIN, LostCounts, count_losses
from tsuiseki.trainers.experiments.single.witness_looks import WITNESSES, watch_chase_looks
from tsuiseki.trainers.experiments.store import Store
from tsuiseki.trainers.experiments.study import Outcome, Table

Witness = Callable[[FloatArray], FloatArray]
"""What ``(T,)`` a witness says in the rows of a clip, NaN between looks."""
ALLOWED = 0.05  # of the followed frames may be called lost
_LOOKS = (1, 2, 3)
# Shares of the followed looks that thresholds let fall below them.
_SHARES = np.concatenate([np.linspace(0.002, 0.1, 50), np.linspace(0.11, 0.4, 30)])
_SAID, _OWN = 1, 2  # columns after the overlap
_FIRST = 3  # column of the first witness


def replay(rows: FloatArray, said: FloatArray, threshold: float, looks: int) -> BoolArray:
    """Whether each frame is called lost.

    Args:
        rows: ``(T, 3 + W)`` of `watch_looks`.
        said: ``(T,)`` of one witness, NaN between looks.
        threshold: below it a look says lost.
        looks: in a row.
    """
    lost, row, held = rows[:, _OWN] > 0, 0, False
    for t, value in enumerate(said):
        if np.isfinite(value):
            row = row + 1 if value < threshold else 0
            held = row >= looks
        lost[t] |= held
    return lost


def passes(store: Store, seeds: Sequence[int]) -> Iterator[Callable[[], object]]:
    """Every pass that `other_witnesses` asks for."""
    if lost_status.CHASES <= lost_status.SEEN:
        return
    for number in range(lost_status.CHASES):
        yield partial(store.recall, watch_chase_looks, number, shipped("appearance_people"), seeds[0])


def other_witnesses(store: Store, seeds: Sequence[int]) -> Outcome:
    """A row a witness, and one for all joined by a linear discriminant."""
    if lost_status.CHASES <= lost_status.SEEN:
        return Outcome(notes=["witnesses: expected chases beside those that choose"])
    network, seed = shipped("appearance_people"), seeds[0]
    found = [np.array(store.recall(watch_chase_looks, number, network, seed)) for number in range(lost_status.CHASES)]
    chosen_on, others = found[: lost_status.SEEN], found[lost_status.SEEN :]
    rule = discriminant(chosen_on)
    said = {name: _column(_FIRST + k) for k, name in enumerate(WITNESSES)}
    said |= {"all joined": rule, "all joined, with weights of hindsight": discriminant(others)}
    rows = [
        (
            "as it ships",
            "",
            *(_told(_counts(part, [r[:, _SAID] > 0 for r in part])) for part in (chosen_on, others)),
            "",
            "",
        )
    ]
    values: dict[str, object] = {}
    for name, witness in said.items():
        threshold, looks = _choose(chosen_on, witness)
        counts = [
            _counts(part, [replay(r, witness(r), threshold, looks) for r in part]) for part in (chosen_on, others)
        ]
        bound, area = hindsight(others, witness), roc_area(others, witness)
        losses = counts[1].losses
        rows.append(
            (
                name,
                f"{looks} below {threshold:.2f}",
                *(_told(one) for one in counts),
                f"{area:.2f}",
                f"{bound} of {losses}",
            )
        )
        values[name] = {
            "threshold": threshold,
            "looks": looks,
            "counts": [vars(c) for c in counts],
            "roc": area,
            "bound": bound,
        }
    columns = (
        "witness", "rule", f"chases 1 to {lost_status.SEEN}, which chose",
        f"chases {lost_status.SEEN + 1} to {lost_status.CHASES}", "area under the ROC curve there",
        f"noticed there by the best rule of hindsight, at {100 * ALLOWED:.0f} %",
    )  # fmt: skip
    return Outcome({"witnesses": values}, [Table("Other witnesses of a loss", columns, rows)])


def _column(k: int) -> Witness:
    return lambda rows: rows[:, k]


def _counts(group: Sequence[FloatArray], lost: Sequence[BoolArray]) -> LostCounts:
    return sum((count_losses(rows[:, 0], one) for rows, one in zip(group, lost, strict=True)), LostCounts())


def _told(counts: LostCounts) -> str:
    return f"{counts.noticed} of {counts.losses} · {100 * counts.alarms / max(counts.followed, 1):.1f} %"


def labelled(rows: FloatArray) -> tuple[BoolArray, BoolArray]:
    """``(T,)`` looks in the first ten frames of a loss, and looks while the target is followed."""
    gone = rows[:, 0] <= 0
    starts = np.flatnonzero(gone & ~np.concatenate([[False], gone[:-1]]))
    early = np.zeros(len(rows), dtype=bool)
    for begin in starts:
        if gone[begin : begin + WITHIN].all() and begin + WITHIN <= len(rows):
            early[begin : begin + WITHIN] = True
    looked = np.isfinite(rows[:, _FIRST])
    return early & looked, (rows[:, 0] > FOLLOWED) & looked


def discriminant(group: Sequence[FloatArray]) -> Witness:
    """Least squares of lost and followed looks, both kinds weighing alike, on all witnesses; low is lost."""
    both = [labelled(rows) for rows in group]
    lost = np.concatenate([rows[early, _FIRST:] for rows, (early, _) in zip(group, both, strict=True)])
    fine = np.concatenate([rows[followed, _FIRST:] for rows, (_, followed) in zip(group, both, strict=True)])
    inputs = np.concatenate([lost, fine])
    weight = np.sqrt(np.repeat([1 / max(len(lost), 1), 1 / max(len(fine), 1)], [len(lost), len(fine)]))[:, None]
    design = np.column_stack([inputs, np.ones(len(inputs))]) * weight
    wanted = np.repeat([0.0, 1.0], [len(lost), len(fine)])[:, None] * weight
    solved = np.linalg.lstsq(design, wanted, rcond=None)[0][:, 0]
    return lambda rows: rows[:, _FIRST:] @ solved[:-1] + solved[-1]


def _rules(group: Sequence[FloatArray], witness: Witness) -> list[tuple[float, int]]:
    followed = np.concatenate([witness(rows)[labelled(rows)[1]] for rows in group])
    return [(float(t), looks) for t in np.quantile(followed, _SHARES) for looks in _LOOKS]


def _choose(group: Sequence[FloatArray], witness: Witness) -> tuple[float, int]:
    """The rule that notices most losses with at most `ALLOWED` false alarms; of equal ones that of fewer alarms."""
    rules = _rules(group, witness)
    counts = [_counts(group, [replay(rows, witness(rows), *rule) for rows in group]) for rule in rules]
    allowed = [c.alarms <= ALLOWED * c.followed for c in counts]
    best = max(range(len(rules)), key=lambda k: (allowed[k], counts[k].noticed if allowed[k] else 0, -counts[k].alarms))
    return rules[best]


def hindsight(group: Sequence[FloatArray], witness: Witness) -> int:
    """Most losses that one rule for all chases could have noticed with at most `ALLOWED` false alarms."""
    rule = _choose(group, witness)
    counts = _counts(group, [replay(rows, witness(rows), *rule) for rows in group])
    return counts.noticed if counts.alarms <= ALLOWED * counts.followed else 0


def roc_area(group: Sequence[FloatArray], witness: Witness) -> float:
    """Probability that a look early in a loss has less than one while the target is followed; .5 is chance."""
    lost = np.concatenate([witness(rows)[labelled(rows)[0]] for rows in group])
    fine = np.sort(np.concatenate([witness(rows)[labelled(rows)[1]] for rows in group]))
    if not len(lost) or not len(fine):
        return float("nan")
    above = len(fine) - np.searchsorted(fine, lost, side="right")
    equal = np.searchsorted(fine, lost, side="right") - np.searchsorted(fine, lost)
    return float(np.mean(above + equal / 2) / len(fine))
