"""The filter along chains against the textbook filter, and what hides a person."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.association.chain_motion import MotionNoise, beliefs_along
from tsuiseki.tracking.association.detection_tables import Measurements
from tsuiseki.tracking.association.nearby import Occluders, hidden_parts
from tsuiseki.tracking.association.video_evidence import DetectionCost, VideoEvidence

NOISE = MotionNoise()


def _textbook(times: np.ndarray, values: np.ndarray, noise: np.ndarray, group: int) -> tuple[np.ndarray, np.ndarray]:
    r, q, v = NOISE.measurement[group], NOISE.acceleration[group], NOISE.velocity[group]
    mean, covariance = np.array([values[0], 0.0]), np.diag([(r * noise[0]) ** 2, v**2])
    for k in range(1, len(times)):
        tau = times[k] - times[k - 1]
        step = np.array([[1, tau], [0, 1]])
        mean = step @ mean
        covariance = step @ covariance @ step.T + q**2 * np.array([[tau**3 / 3, tau**2 / 2], [tau**2 / 2, tau]])
        gain = covariance[:, 0] / (covariance[0, 0] + (r * noise[k]) ** 2)
        mean = mean + gain * (values[k] - mean[0])
        covariance = covariance - np.outer(gain, covariance[0])
    return mean, covariance


def test_beliefs_are_those_of_the_textbook_filter() -> None:
    rng = np.random.default_rng(0)
    count = 40
    times = np.sort(rng.choice(200, count, replace=False)) / 30
    labels = np.zeros(count, dtype=np.int64)
    places = np.concatenate([rng.normal(0, 5, (count, 2)) + 100 * times[:, None], rng.normal(4, 0.1, (count, 2))], 1)
    seen = Measurements(times, places, rng.uniform(1, 2, count), np.zeros(count))
    past, future = beliefs_along(labels, seen, NOISE)
    for coordinate, group in ((0, 0), (2, 1), (3, 2)):
        mean, covariance = _textbook(times, places[:, coordinate], seen.noise, group)
        np.testing.assert_allclose([past.place[-1, coordinate], past.velocity[-1, coordinate]], mean, rtol=1e-9)
        np.testing.assert_allclose(past.covariance[-1, group], covariance[[0, 0, 1], [0, 1, 1]], rtol=1e-9)
        mean, covariance = _textbook(-times[::-1], places[::-1, coordinate], seen.noise[::-1], group)
        np.testing.assert_allclose([future.place[0, coordinate], -future.velocity[0, coordinate]], mean, rtol=1e-9)
        np.testing.assert_allclose(future.covariance[0, group, 1], -covariance[0, 1], rtol=1e-9)


def test_blocks_of_long_chains_forget_how_they_started() -> None:
    rng = np.random.default_rng(1)
    times = np.arange(300) / 30
    places = np.cumsum(rng.normal(0, 1, (300, 4)), axis=0)
    seen = Measurements(times, places, np.ones(300), np.zeros(300))
    past, _ = beliefs_along(np.zeros(300, dtype=np.int64), seen, NOISE)
    for end in (100, 200, 299):
        mean, _ = _textbook(times[: end + 1], places[: end + 1, 0], np.ones(300), 0)
        # What a run-up of 20 frames leaves of the start.
        np.testing.assert_allclose(past.place[end, 0], mean[0], atol=0.05)


def test_hidden_parts_are_those_behind_lower_boxes() -> None:
    boxes = np.array([[0.0, 0, 10, 20], [5, 0, 15, 30], [0, 0, 10, 20]])
    np.testing.assert_allclose(hidden_parts(np.array([0, 0, 1]), boxes), [0.5, 0, 0])
    boxes = np.array([[0.0, 0, 10, 20], [-5, 0, 5, 30], [0, 0, 10, 20]])
    frames, tails, heads = np.array([0, 1, 2]), np.array([0]), np.array([2])
    np.testing.assert_allclose(Occluders.of(frames, boxes, None).between(tails, heads), [0.5])
    boxes = np.array([[-5.0, 0, 5, 20], [90, 0, 95, 30], [-5, 0, 5, 20]])
    np.testing.assert_allclose(Occluders.of(frames, boxes, (100, 100)).between(tails, heads), [0.5])


def test_scores_are_worth_how_often_they_are_found_again() -> None:
    rng = np.random.default_rng(2)
    frames = np.repeat(np.arange(200), 4)
    still = np.tile([[0.0, 0, 30, 80], [100, 0, 130, 80]], (200, 1, 1))
    corner = rng.uniform(0, 2000, (200, 2, 2))
    false = np.concatenate([corner, corner + np.array([30, 80])], axis=2)
    boxes = np.concatenate([still, false], axis=1).reshape(-1, 4)
    scores = np.tile([40.0, 40.0, 7.0, 7.0], 200)
    evidence = VideoEvidence(DetectionCost(), 30.0)
    evidence.add(frames, boxes, scores, 199)
    low, high = evidence.probability(np.array([7.0, 40.0]))
    assert low == DetectionCost().least
    assert high == 1 - DetectionCost().least
