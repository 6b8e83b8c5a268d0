"""What false boxes do where people have the labelled actions: a person's course in time, at another time."""

import numpy as np
import pytest

from tsuiseki.tracking.drone.observations import Observation
from tsuiseki.tracking.evaluation.action_files import LabelledActions
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.labels import GroundTruth
from tsuiseki.trainers.experiments.drone.borrowed_actions import PLACES, borrowed, done_by_person, place_of
from tsuiseki.trainers.experiments.drone.clips import Clip
from tsuiseki.trainers.experiments.drone.rows import with_labelled_actions

LENGTH = 40
ONE = np.array([100.0, 100, 130, 170])
FALSE = np.array([600.0, 400, 630, 470])


@pytest.fixture
def labels():
    """Person 1 walks (0) and from frame 20 on sits (1); person 2 lies (2), and is out of view in frames 10 to 29."""
    rows = [(t, 1, int(t >= 20)) for t in range(LENGTH)] + [(t, 2, 2) for t in range(LENGTH) if not 10 <= t < 30]
    frames, ids, actions = np.array(sorted(rows)).T
    boxes = np.where((ids == 1)[:, None], ONE, ONE + 300.0)
    sure = np.ones(len(ids), dtype=np.bool_)
    truth = GroundTruth(frames, ids, boxes, sure, ~sure, np.ones(len(ids)))
    return LabelledActions("clip", truth, np.eye(3, dtype=np.bool_)[actions], ("Walking", "Sitting", "Lying"))


def test_what_people_do_is_known_in_every_frame(labels):
    done = done_by_person(labels, LENGTH)
    assert done.shape == (LENGTH, 2, 3)
    np.testing.assert_array_equal(done[:, 0].argmax(axis=1), np.arange(LENGTH) >= 20)
    np.testing.assert_array_equal(done[:, 1].argmax(axis=1), 2)


def test_a_place_acts_as_one_person_from_another_time_on():
    done = np.random.default_rng(0).random((LENGTH, 5, 3))
    like = borrowed(done, np.random.default_rng(1))
    assert like.shape == (LENGTH, PLACES, 3)
    for place in range(0, PLACES, 9):
        found = np.argwhere((done == like[0, place]).all(axis=-1))
        ((later, person),) = found
        assert later > 0
        np.testing.assert_array_equal(like[:, place], np.roll(done[:, person], -later, axis=0))


def test_false_boxes_change_what_they_do_as_seldom_as_people(labels):
    seen = [
        Observation(t, Detections(np.stack([ONE + 1, FALSE]), np.ones(2)), actions=np.zeros((4, 2, 3)))
        for t in range(LENGTH)
    ]
    clip = Clip(None, labels.truth, labels, seen, [], np.zeros(0, dtype=np.int64))
    labelled = with_labelled_actions(clip, np.random.default_rng(3)).seen
    doing = np.stack([one.actions for one in labelled])
    assert (doing == doing[:, :1]).all()  # every stream says the same
    np.testing.assert_array_equal(doing[:, 0, 0].argmax(axis=1), np.arange(LENGTH) >= 20)
    changes = (np.diff(doing[:, 0, 1].argmax(axis=1)) != 0).sum()
    assert changes <= 2  # once where the person changes, once where the clip begins again
    assert (doing[:, 0, 1].sum(axis=1) == 1).all()
    assert 0 <= place_of(FALSE[None])[0] < PLACES
