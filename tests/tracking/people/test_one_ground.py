"""Scores by people's heights on one ground: in the order of the video, for networks alone, and only where wanted."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import open_detector
from tsuiseki.tracking.features.ground_plane import GroundPlane
from tsuiseki.tracking.features.tiles import parse_view
from tsuiseki.tracking.features.view_choice import ViewedDetector
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.people.api import track_people
from tsuiseki.tracking.people.detections import PeopleInputs, ground_of
from tsuiseki.tracking.types import Detections
from tsuiseki.tracking.types.frame_range import FrameRange
from tsuiseki.tracking.video.source import open_source
from tsuiseki.tracking.weights import PEOPLE_DETECTOR, shipped


class NumberedPeople:
    """Finds people whom the grey level of a frame stands for: eight on one ground, and one box of any height."""

    input_size = None
    score_threshold = 0.3

    def detect(self, images):
        return [self._found(int(image[0, 0, 0])) for image in images]

    def _found(self, seed):
        rng = np.random.default_rng(seed)
        rows = rng.uniform(30, 90, 9)
        heights = 0.5 * rows * np.append(np.ones(8), rng.choice([0.3, 1.0, 2.0]))
        return Detections(np.stack([rows, rows - heights, rows + heights, rows], axis=1), rng.uniform(0.3, 0.99, 9))


@pytest.fixture
def numbered(tmp_path):
    for number in range(24):
        cv2.imwrite(str(tmp_path / f"{number:06d}.png"), np.full((100, 200, 3), 5 * number, np.uint8))
    return tmp_path


def found_with(source, threads, batch_size):
    detect = ViewedDetector(NumberedPeople(), parse_view("1"))
    ground = GroundPlane(source.frame_rate, score_threshold=0.3)
    inputs = PeopleInputs(source, detect, None, batch_size, threads=threads, ground=ground)
    return [found for _, found in inputs.detections()], ground


def test_neither_threads_nor_batches_matter(numbered):
    one, ground = found_with(open_source(numbered), 1, 4)
    many, again = found_with(open_source(numbered), 3, 2)
    assert ground.used > 15
    assert ground.dropped > 0
    assert ground.facts() == again.facts()
    for a, b in zip(one, many, strict=True):
        np.testing.assert_array_equal(a.boxes, b.boxes)
        np.testing.assert_array_equal(a.scores, b.scores)


def test_only_networks_are_weighed_and_only_where_it_is_wanted(numbered):
    source = open_source(numbered)
    network = open_detector(shipped(PEOPLE_DETECTOR), 0.4, threads=1)
    for detect in (network, ViewedDetector(network)):
        ground = ground_of(detect, "auto", source)
        assert ground is not None
        assert ground.score_threshold == 0.4
        assert ground_of(detect, "off", source) is None
    for detect in ([Detections.empty()], NumberedPeople()):
        assert ground_of(detect, "auto", source) is None


def test_any_other_wish_is_refused(numbered):
    with pytest.raises(RequestError, match="`ground`: expected 'auto' or 'off', got 'on'"):
        track_people(numbered, detections=[[]] * 24, ground="on")


@pytest.mark.integration
@pytest.mark.slow
def test_what_is_left_out_in_pets_is_nobody(data_folder):
    sequence = data_folder / "mot" / "PETS09-S2L1-first"
    truth = read_ground_truth(sequence / "gt" / "gt.txt")
    source = open_source(sequence, FrameRange(150, 209))
    detect = ViewedDetector(open_detector(shipped("detector_figures"), 0.3, threads=1), parse_view("1"))
    before = list(PeopleInputs(source, detect).detections())
    ground = ground_of(detect, "auto", source)
    after = [found for _, found in PeopleInputs(source, detect, ground=ground).detections()]
    assert ground.line.explained > 0.8
    assert ground.used >= 55
    assert ground.dropped > 0
    left_out = 0
    for (frame, given), kept in zip(before, after, strict=True):
        gone = given.boxes[~(given.boxes[:, None] == kept.boxes[None]).all(axis=2).any(axis=1)]
        people = truth.boxes[truth.frames == frame]
        assert (iou_matrix(gone, people) < 0.5).all()
        left_out += len(gone)
    assert left_out == ground.dropped
