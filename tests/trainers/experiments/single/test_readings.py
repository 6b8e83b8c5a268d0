"""Readings of the thesis's text on a tiny clip."""

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.single_clip import ChaseSettings, render_chase
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.trainers.experiments.single.readings import READINGS, readings
from tsuiseki.trainers.experiments.single.runs import Clip
from tsuiseki.trainers.experiments.store import Store


def test_every_reading_is_another_one_and_has_a_row_over_kcf(tmp_path):
    settings = ChaseSettings(frames=6, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    clips = []
    for seed in (1, 2):
        made = render_chase(np.random.default_rng(seed), settings)
        clips.append(Clip(SingleSequence(f"tiny-{seed}", (), made.boxes), list(made.images)))
    assert len(set(READINGS.values())) == len(READINGS)
    outcome = readings(Store(tmp_path), clips, [0])
    assert [row[0] for row in outcome.tables[0].rows] == ["KCF", *READINGS]
    values = outcome.values["readings"]
    gain = np.mean(values["as printed"]) - np.mean(values["KCF"])
    assert float(outcome.tables[0].rows[1][2].split()[0]) == pytest.approx(gain, abs=0.06)
