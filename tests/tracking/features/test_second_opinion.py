"""Two detectors as one: pairs in closed form, properties of any two, and the settings that refuse it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracking.features.tiny_onnx import HEIGHT, WIDTH, save_constant
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.foreign_detector import ForeignDetector
from tsuiseki.tracking.features.foreign_options import DetectorOptions
from tsuiseki.tracking.features.second_opinion import SecondOpinion, together
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.types import Detections

BOXES = np.array([[0.0, 0, 10, 20], [100, 0, 110, 20], [200, 0, 210, 20]])


def test_a_pair_gives_the_weighted_box_and_the_larger_score():
    first = Detections(BOXES[:1], np.array([0.9]))
    second = Detections(BOXES[:1] + np.array([3, 0, 3, 0]), np.array([0.3]))
    both = together(first, second)
    np.testing.assert_allclose(both.boxes, BOXES[:1] + np.array([0.75, 0, 0.75, 0]))
    np.testing.assert_allclose(both.scores, [0.9])


@pytest.mark.parametrize(("score", "added"), [(0.6, 1), (0.5, 1), (0.49, 0)])
def test_what_the_second_reports_alone_is_added_where_it_is_likelier_than_not(score, added):
    first = Detections(BOXES[:2], np.array([0.4, 0.3]))
    second = Detections(BOXES[1:], np.array([0.5, score]))
    both = together(first, second)
    np.testing.assert_allclose(both.boxes, BOXES[[1, 0, 2]][: 2 + added])
    np.testing.assert_allclose(both.scores, [0.5, 0.4, score][: 2 + added])


def test_boxes_are_matched_one_to_one():
    first = Detections(BOXES[[0, 0]] + [[0, 0, 0, 0], [1, 0, 1, 0]], np.array([0.6, 0.7]))
    second = Detections(BOXES[:1], np.array([0.8]))
    assert len(together(first, second)) == 2


@pytest.mark.parametrize("count", [0, 1, 7])
def test_nothing_of_the_first_is_lost_and_no_score_falls(count):
    rng = np.random.default_rng(count)
    corners = rng.uniform(0, 80, (count, 2))
    boxes = np.concatenate([corners, corners + rng.uniform(5, 40, (count, 2))], axis=1)
    first = Detections(boxes, rng.uniform(size=count))
    second = first.select(rng.permutation(count)[: count // 2])
    both = together(first, second)
    assert len(both) == count
    np.testing.assert_allclose(np.sort(both.scores), np.sort(first.scores))
    empty = Detections.empty()
    np.testing.assert_array_equal(together(first, empty).boxes, first.boxes)
    assert len(together(empty, empty)) == 0


def test_the_same_detector_twice_changes_nothing():
    detections = Detections(BOXES, np.array([0.9, 0.5, 0.7]))
    np.testing.assert_allclose(together(detections, detections).boxes, BOXES)


class Fixed:
    """Detects the same in every picture."""

    def __init__(self, detections):
        self.detections = detections

    def detect(self, images):
        return [self.detections for _ in images]


def test_two_detectors_answer_as_one_for_each_picture():
    first, second = Detections(BOXES[:1], np.array([0.9])), Detections(BOXES[1:2], np.array([0.8]))
    detector = SecondOpinion(Fixed(first), Fixed(second))
    images = [np.zeros((40, 300, 3), np.uint8)] * 3
    assert [len(frame) for frame in detector.prepared(images).detect(images)] == [2, 2, 2]


def test_a_second_opinion_adds_people_to_a_run(tmp_path):
    rows = np.zeros((3, 7), np.float32)
    rows[0] = [0, 8, 8, 24, 56, 0, 0.9]
    one = save_constant(tmp_path / "one.onnx", {"output": rows}, plain=("output",))
    rows[1] = [0, 60, 8, 76, 56, 0, 0.8]
    two = save_constant(tmp_path / "two.onnx", {"output": rows}, plain=("output",))
    images = [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 12
    how = {"appearance": "none", "view": 1, "threads": 1, "ground": "off", "frame_rate": 10}
    first, second = (ForeignDetector(file, options=DetectorOptions(person=0), threads=1) for file in (one, two))
    alone = track_people(images, detector=first, **how)
    both = track_people(images, detector=first, second_opinion=second, **how)
    assert (len(alone), len(both)) == (1, 2)


def test_what_does_not_go_with_it_is_refused():
    images = [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 2
    for name, value in (("detections", [[], []]), ("classes", ["person"])):
        with pytest.raises(RequestError, match=f"expected `second_opinion` without `{name}`, got both"):
            track_people(images, second_opinion="people", frame_rate=10, **{name: value})
