"""Rules by other witnesses of a loss: what they count, what hindsight allows them, and what each witness says."""

from pathlib import Path

import numpy as np
import pytest

from tsuiseki.trainers.experiments.single import lost_status
from tsuiseki.trainers.experiments.single.other_witnesses import (
    discriminant,
    hindsight,
    labelled,
    other_witnesses,
    replay,
    roc_area,
)
from tsuiseki.trainers.experiments.single.witness_looks import WITNESSES, Looks
from tsuiseki.trainers.experiments.store import Store

NAMES = list(WITNESSES)


def rows(followed, lost, frames=30):
    """A clip that is followed for half of its frames, a look in each, and one witness that says two values."""
    overlap = np.repeat([0.8, 0.0], frames)
    said = np.concatenate([np.broadcast_to(followed, frames), np.broadcast_to(lost, frames)]).astype(float)
    others = np.zeros((2 * frames, len(NAMES) - 1))
    return np.column_stack([overlap, np.zeros((2 * frames, 2)), said, others])


def first(table):
    return table[:, 3]


def test_looks_in_a_row_say_lost_until_one_says_otherwise():
    table = rows(1.0, 1.0, 5)
    said = np.array([1, 0, np.nan, 0, np.nan, np.nan, 1, 0, 0, 1.0])
    assert np.flatnonzero(replay(table, said, 0.5, 2)).tolist() == [3, 4, 5, 8]
    assert np.flatnonzero(replay(table, said, 0.5, 1)).tolist() == [1, 2, 3, 4, 5, 7, 8]
    table[9, 2] = 1  # what the tracker says by itself stays
    assert replay(table, said, -1.0, 1).tolist() == [False] * 9 + [True]


def test_looks_early_in_a_loss_are_told_from_those_at_the_target():
    lost, followed = labelled(rows(1.0, 0.0))
    assert np.flatnonzero(lost).tolist() == list(range(30, 40))
    assert np.flatnonzero(followed).tolist() == list(range(30))


@pytest.mark.parametrize(("followed", "lost", "area"), [(1.0, 0.0, 1.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0)])
def test_the_area_under_the_curve_is_how_often_a_lost_look_says_less(followed, lost, area):
    assert roc_area([rows(followed, lost)], first) == area


def test_hindsight_notices_what_one_rule_can():
    assert hindsight([rows(1.0, 0.5), rows(0.9, 0.1)], first) == 2
    assert hindsight([rows(1.0, 1.0), rows(0.9, 0.1)], first) == 1  # nothing tells the first loss


def test_hindsight_allows_no_more_than_a_twentieth():
    unclear = rows(np.tile([0.0, 1.0], 15), np.tile([0.0, 1.0], 15))  # half of the followed frames look lost
    assert hindsight([unclear], first) == 0
    once = rows(np.append(np.ones(29), 0.0), np.zeros(30))  # one of thirty does
    assert hindsight([once], first) == 1


def test_the_discriminant_joins_witnesses():
    table = rows(0.0, 0.0)
    rng = np.random.default_rng(0)
    hidden = rng.normal(size=60)
    # Neither column tells alone, their difference does.
    table[:, 3], table[:, 4] = hidden + np.repeat([0.2, -0.2], 30), hidden
    joined = discriminant([table])
    assert roc_area([table], joined) == 1
    assert roc_area([table], first) < 0.9


def describe(image, boxes):
    """The mean colour of each box."""
    cuts = [image[max(int(b[1]), 0) : int(b[3]), max(int(b[0]), 0) : int(b[2])] for b in boxes]
    return np.array([c.reshape(-1, 3).mean(axis=0) if c.size else np.ones(3) for c in cuts])


def scene(x, colour=(255, 0, 0)):
    image = np.zeros((120, 200, 3), dtype=np.uint8)
    image[..., 2] = 60
    image[40:80, x : x + 20] = colour
    return image


def box(x):
    return np.array([x, 40.0, x + 20, 80])


def test_witnesses_know_the_target_and_miss_it():
    looks = Looks(describe, scene(20), box(20))
    steps = [dict(zip(NAMES, looks.look(scene(x), box(x)), strict=True)) for x in range(24, 48, 4)]
    there = steps[-1]
    assert there["likeness"] == pytest.approx(1, abs=0.01)
    assert there["gallery"] == there["change"] == there["halves"] == pytest.approx(1)
    assert there["alone"] > 0.5
    assert there["course"] == pytest.approx(0, abs=1e-9)
    away = dict(zip(NAMES, looks.look(scene(48), box(120)), strict=True))
    assert away["halves"] == 0
    assert away["likeness"] < 0.1
    assert away["course"] < -1


def test_the_table_has_a_row_a_witness(tmp_path, monkeypatch):
    monkeypatch.setattr(lost_status, "CHASES", 2)
    monkeypatch.setattr(lost_status, "SEEN", 1)
    monkeypatch.setattr("tsuiseki.trainers.experiments.single.other_witnesses.watch_chase_looks", made_up)
    table = other_witnesses(Store(tmp_path), [0]).tables[0]
    assert [row[0] for row in table.rows] == [
        "as it ships",
        *NAMES,
        "all joined",
        "all joined, with weights of hindsight",
    ]
    assert table.rows[1][3:] == ("1 of 1 · 0.0 %", "1.00", "1 of 1")


def made_up(number: int, _: Path, __: int) -> list[list[float]]:
    """In place of `watch_chase_looks`."""
    return rows(1.0 + 0.1 * number, 0.2).tolist()
