"""Choosing settings on other sequences than the one that is scored."""

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.single_clip import ChaseSettings, render_chase
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.single.constants import CombinedSettings, RegularisedSettings
from tsuiseki.tracking.single.kcf import KcfSettings
from tsuiseki.trainers.experiments.single import unseen
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.store import Store


def test_a_sequence_has_no_say_in_its_own_settings():
    # "a" owes its mean to the first sequence alone, so that the first is scored with "b"
    chosen = unseen.leave_one_out({"a": np.array([90.0, 10, 10]), "b": np.array([20.0, 30, 30])})
    assert chosen == ["b", "a", "a"]


def test_of_equal_candidates_the_first_is_taken():
    chosen = unseen.leave_one_out({"a": np.array([1.0, 1.0]), "b": np.array([1.0, 1.0])})
    assert chosen == ["a", "a"]


def test_the_interval_of_equal_gains_is_a_point_and_others_hold_their_mean():
    assert unseen.interval(np.full(5, 3.0)) == pytest.approx((3.0, 3.0, 3.0))
    mean, low, high = unseen.interval(np.array([-4.0, 0.0, 2.0, 10.0]))
    assert low < mean == 2.0 < high
    assert low >= -4
    assert high <= 10


def clip(seed):
    settings = ChaseSettings(frames=8, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = render_chase(np.random.default_rng(seed), settings)
    return Clip(SingleSequence(f"tiny-{seed}", (), made.boxes), list(made.images))


def test_the_table_has_a_row_a_sequence_and_their_mean(tmp_path, monkeypatch):
    small = CombinedSettings(filter=RegularisedSettings(sizes=1))
    group = unseen.Group("small", KcfSettings(scale_step=1.0), {"alone": RegularisedSettings(sizes=1)}, {"one": small})
    monkeypatch.setattr(unseen, "groups", lambda _: (group,))
    outcome = unseen.unseen(Store(tmp_path), [clip(1), clip(2)], [0])
    assert [row[0] for row in outcome.tables[0].rows] == ["tiny-1", "tiny-2", "mean", "worst against KCF"]
    values = outcome.values["unseen"]["small"]
    gains = np.array(values[unseen.OURS]) - values["KCF"]
    assert values["gains"][unseen.OURS][0] == pytest.approx(gains.mean())


def test_one_sequence_is_too_few(tmp_path):
    outcome = unseen.unseen(Store(tmp_path), [clip(1)], [0])
    assert not outcome.tables
    assert "two sequences" in outcome.notes[0]
