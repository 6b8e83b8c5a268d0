"""What counts as a loss that was noticed, and as a false alarm."""

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.single_clip import ChaseSettings, render_chase
from tsuiseki.tracking.evaluation.single import evaluate_boxes
from tsuiseki.tracking.formats.single import SingleSequence
from tsuiseki.tracking.single.constants import RegularisedSettings
from tsuiseki.tracking.weights import shipped
from tsuiseki.trainers.experiments.single import lost_status
from tsuiseki.trainers.experiments.single.lost_status import LostCounts, Watched, count_losses, watch
from tsuiseki.trainers.experiments.single.runs import Clip, generated_clips, start
from tsuiseki.trainers.experiments.store import Store


def test_losses_and_alarms_are_counted():
    overlaps = np.concatenate([np.full(5, 0.8), np.zeros(9), [0.6], np.zeros(12), [np.nan], np.zeros(10)])
    lost = np.zeros(len(overlaps), dtype=bool)
    lost[2] = True  # followed: an alarm
    lost[8] = True  # nine frames are no loss
    lost[15 + 9] = True  # the tenth frame of the first loss
    assert count_losses(overlaps, lost) == LostCounts(losses=2, noticed=1, followed=6, alarms=1)


def test_a_loss_noticed_later_than_ten_frames_is_not_noticed():
    lost = np.zeros(30, dtype=bool)
    lost[10:] = True
    assert count_losses(np.zeros(30), lost) == LostCounts(losses=1)


def test_the_table_has_given_clips_and_generated_ones(tmp_path, monkeypatch):
    monkeypatch.setattr(lost_status, "CHASES", 2)
    monkeypatch.setattr(lost_status, "SEEN", 1)
    monkeypatch.setattr(lost_status, "FIRST", 0)
    monkeypatch.setattr(lost_status, "TRACKERS", {"kcf": lost_status.Watched(RegularisedSettings(sizes=1))})
    clips = generated_clips(1)
    outcome = lost_status.lost_status(Store(tmp_path), clips, [0])
    first, second, third, both = outcome.tables[0].rows
    assert first[2:] == second[2:]
    assert third[0] == "generated chases 2 to 2"
    assert both[0] == "generated chases 1 to 2"
    boxes = np.array([one.box for one in follow_all(clips[0])])
    scores = evaluate_boxes(clips[0].sequence.boxes, np.concatenate([clips[0].sequence.boxes[:1], boxes]))
    assert float(first[2]) == pytest.approx(100 * scores.auc, abs=0.06)
    assert outcome.values["status"]["kcf, given clips"]["followed"] > 0


def follow_all(clip):
    tracker = start(RegularisedSettings(sizes=1), 0)
    tracker.start(clip.images[0], clip.sequence.boxes[0])
    return [tracker.follow(image) for image in clip.images[1:]]


def test_frames_without_label_are_neither_lost_nor_found():
    settings = ChaseSettings(frames=6, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = render_chase(np.random.default_rng(1), settings)
    boxes = made.boxes.copy()
    boxes[3] = np.nan
    rows = watch(Clip(SingleSequence("tiny", (), boxes), list(made.images)), Watched(RegularisedSettings(sizes=1)), 0)
    assert np.isnan([row[0] for row in rows]).tolist() == [False, False, True, False, False]


def test_the_network_has_a_say_in_the_status_alone():
    settings = ChaseSettings(frames=8, width=120, height=90, person_height=(30, 31), passers=0, obstacles=0)
    made = render_chase(np.random.default_rng(1), settings)
    tiny = Clip(SingleSequence("tiny", (), made.boxes), list(made.images))
    alone = Watched(RegularisedSettings(sizes=1))
    plain, witnessed = (watch(tiny, w, 0) for w in (alone, Watched(alone.entrant, shipped("appearance_people"))))
    assert [row[0] for row in plain] == [row[0] for row in witnessed]
