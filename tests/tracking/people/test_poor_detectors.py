"""Detectors that miss people and place boxes ill: nobody is thrown away for that."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.association.video_evidence import DetectionCost, VideoEvidence, repeated_detections
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.types import Detections, FloatArray

FRAMES, PEOPLE, RATE = 60, 12, 7.0


def sure(boxes: FloatArray) -> Detections:
    """Boxes that all score the same."""
    return Detections(boxes, np.ones(len(boxes)))


def walkers(missed: float, noise: float) -> list[Detections]:
    """What is found of twelve people who walk 1.2 heights a second every way."""
    rng = np.random.default_rng(0)
    first, velocity = rng.uniform(0, [600, 400], (PEOPLE, 2)), rng.normal(0, 1, (PEOPLE, 2))
    velocity *= 1.2 * 60 / RATE / np.linalg.norm(velocity, axis=1, keepdims=True)
    detections = []
    for frame in range(FRAMES):
        size = np.array([25.0, 60.0]) * np.exp(rng.normal(0, noise, (PEOPLE, 2)))
        centre = first + velocity * frame + rng.normal(0, noise / 2, (PEOPLE, 2)) * 60
        there = rng.random(PEOPLE) > missed
        detections.append(sure(np.concatenate([centre - size / 2, centre + size / 2], axis=1)[there]))
    return detections


@pytest.mark.parametrize(("missed", "noise"), [(0.2, 0.05), (0.2, 0.15), (0.3, 0.1)])
def test_people_that_are_missed_and_placed_ill_are_tracked(missed: float, noise: float) -> None:
    tracker = FlowTracker(frame_rate=RATE)
    for found in walkers(missed, noise):
        tracker.update(found)
    tracks, facts = tracker.tracks(), tracker.facts()
    assert len(tracks) == PEOPLE
    assert facts["detections_rejected"] < facts["detections"] / 8


def test_false_boxes_anywhere_are_no_people_for_that() -> None:
    rng = np.random.default_rng(1)
    tracker = FlowTracker(frame_rate=RATE)
    for _ in range(FRAMES):
        corner = rng.uniform(0, [600, 400], (PEOPLE, 2))
        tracker.update(sure(np.concatenate([corner, corner + np.array([25, 60])], axis=1)))
    assert tracker.tracks() == []


@pytest.mark.parametrize("missed", [0.1, 0.3])
def test_how_often_right_detections_are_found_again_is_known_without_labels(missed: float) -> None:
    found = walkers(missed, 0.0)
    frames = np.repeat(np.arange(FRAMES), [len(one) for one in found])
    boxes = np.concatenate([one.boxes for one in found])
    triples, evidence = repeated_detections(frames, boxes, RATE), VideoEvidence(DetectionCost(), RATE)
    evidence.add(frames, boxes, np.ones(len(frames)), FRAMES - 1)
    assert evidence.rate_of_right() == pytest.approx((1 - missed) ** 2, abs=0.07)
    assert triples.repeated.mean() == pytest.approx((1 - missed) ** 2, abs=0.07)
