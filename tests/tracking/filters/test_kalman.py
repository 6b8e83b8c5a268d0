"""The batched filters against the textbook recursion and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from tsuiseki.tracking.filters.kalman import (
    BoxMotion,
    Gaussians,
    predict,
    predict_boxes,
    start_boxes,
    update,
    update_boxes,
)


def test_one_dimension_in_closed_form() -> None:
    state = Gaussians(np.array([[2.0]]), np.array([[[4.0]]]))
    predicted = predict(state, np.array([[3.0]]), np.array([[1.0]]))
    assert predicted.mean.tolist() == [[6.0]]
    assert predicted.covariance.tolist() == [[[37.0]]]
    updated = update(predicted, np.array([[10.0]]), np.eye(1), np.array([[3.0]]))
    np.testing.assert_allclose(updated.mean, [[6 + 37 / 40 * 4]])
    np.testing.assert_allclose(updated.covariance, [[[37 * 3 / 40]]])


def test_batch_is_the_textbook_recursion_of_each_track() -> None:
    rng = np.random.default_rng(0)
    n, d, m = 5, 4, 2
    half = rng.normal(size=(n, d, d))
    state = Gaussians(rng.normal(size=(n, d)), half @ half.transpose(0, 2, 1) + np.eye(d))
    transition, observation = rng.normal(size=(d, d)), rng.normal(size=(m, d))
    noise, measurement_noise = np.diag([0.1, 0.2, 0.3, 0.4]), np.array([[1.0, 0.2], [0.2, 0.5]])
    measured = rng.normal(size=(n, m))
    after = update(predict(state, transition, noise), measured, observation, measurement_noise)
    for k in range(n):
        mean, covariance = transition @ state.mean[k], transition @ state.covariance[k] @ transition.T + noise
        gain = covariance @ observation.T @ np.linalg.inv(observation @ covariance @ observation.T + measurement_noise)
        np.testing.assert_allclose(after.mean[k], mean + gain @ (measured[k] - observation @ mean), rtol=1e-9)
        np.testing.assert_allclose(after.covariance[k], (np.eye(d) - gain @ observation) @ covariance, rtol=1e-7)


def test_recursion_is_the_posterior_of_all_measurements_at_once() -> None:
    """Gaussian conditioning on the whole path at once gives what the filter ends with."""
    rng = np.random.default_rng(1)
    transition, noise = np.array([[1.0, 1], [0, 1]]), np.array([[0.25, 0.5], [0.5, 1]]) * 0.3
    measured = rng.normal(size=6)
    state = Gaussians(np.zeros((1, 2)), np.diag([2.0, 3.0])[None])
    blocks, map_from_start = [np.eye(2)], [np.eye(2)]
    prior = np.zeros((14, 14))
    prior[:2, :2] = np.diag([2.0, 3.0])
    for step in range(6):
        state = predict(state, transition, noise)
        state = update(state, measured[None, step : step + 1], np.array([[1.0, 0]]), np.array([[0.7]]))
        map_from_start.append(transition @ map_from_start[-1])
        prior[2 * step + 2 : 2 * step + 4, 2 * step + 2 : 2 * step + 4] = noise
        blocks.append(transition)
    lift = np.zeros((14, 14))
    for row in range(7):
        for column in range(row + 1):
            lift[2 * row : 2 * row + 2, 2 * column : 2 * column + 2] = np.linalg.matrix_power(transition, row - column)
    joint = lift @ prior @ lift.T
    seen = np.arange(2, 14, 2)
    gain = joint[12:, seen] @ np.linalg.inv(joint[np.ix_(seen, seen)] + 0.7 * np.eye(6))
    np.testing.assert_allclose(state.mean[0], gain @ measured, rtol=1e-9)
    np.testing.assert_allclose(state.covariance[0], joint[12:, 12:] - gain @ joint[seen, 12:], rtol=1e-8)


def test_box_filter_is_the_general_filter_of_eight_states() -> None:
    rng = np.random.default_rng(2)
    motion = BoxMotion(measurement=0.07, acceleration=0.02, start_velocity=0.3)
    boxes = rng.uniform(0, 100, (3, 4))
    belief = start_boxes(boxes, motion)
    eye, zero = np.eye(4), np.zeros((4, 4))
    transition = np.block([[eye, eye], [zero, eye]])
    noise = motion.acceleration**2 * np.block([[eye / 4, eye / 2], [eye / 2, eye]])
    start = np.diag([motion.measurement**2] * 4 + [motion.start_velocity**2] * 4)
    general = Gaussians(np.hstack([boxes, np.zeros((3, 4))]), np.tile(start, (3, 1, 1)))
    observation = np.hstack([eye, zero])
    for step in range(8):
        belief, general = predict_boxes(belief, motion), predict(general, transition, noise)
        if step != 4:
            measured = rng.uniform(0, 100, (3, 4))
            belief = update_boxes(belief, measured, motion)
            general = update(general, measured, observation, motion.measurement**2 * eye)
        np.testing.assert_allclose(np.hstack([belief.boxes, belief.velocities]), general.mean, rtol=1e-8)
        for corner in range(4):
            entries = general.covariance[:, [corner, corner, corner + 4], [corner, corner + 4, corner + 4]]
            np.testing.assert_allclose(belief.variance, entries, rtol=1e-7, atol=1e-15)


def test_straight_motion_is_learnt_and_predicted() -> None:
    motion = BoxMotion(acceleration=0.0)
    box, step = np.array([[10.0, 20, 40, 90]]), np.array([[2.0, -1, 2, -1]])
    belief = start_boxes(box, motion)
    for t in range(1, 200):
        belief = update_boxes(predict_boxes(belief, motion), box + t * step, motion)
    # The start's belief in no motion fades as 1 / t^3.
    np.testing.assert_allclose(predict_boxes(belief, motion).boxes, box + 200 * step, atol=1e-2)


def test_nothing_is_written_to_the_input() -> None:
    motion = BoxMotion()
    boxes = np.array([[0.0, 0, 10, 20], [5.0, 5, 15, 25]])
    belief = start_boxes(boxes, motion)
    before = belief.boxes.copy(), belief.velocities.copy(), belief.variance.copy()
    update_boxes(predict_boxes(belief, motion), boxes + 1, motion)
    for now, then in zip((belief.boxes, belief.velocities, belief.variance), before, strict=True):
        np.testing.assert_array_equal(now, then)


def test_select_and_join_keep_tracks_together() -> None:
    motion = BoxMotion()
    belief = predict_boxes(start_boxes(np.arange(12.0).reshape(3, 4), motion), motion)
    again = belief.select(np.array([2])).and_then(belief.select(np.array([0, 1])))
    np.testing.assert_array_equal(again.boxes, belief.boxes[[2, 0, 1]])
    np.testing.assert_array_equal(again.variance, belief.variance[[2, 0, 1]])


@pytest.mark.parametrize("wrong", [{"measurement": 0.0}, {"acceleration": -1.0}, {"measurement": float("nan")}])
def test_noise_must_make_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        BoxMotion(**wrong)
