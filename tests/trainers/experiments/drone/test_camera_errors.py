"""Errors of the camera's motion on a flight whose motion is known."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tsuiseki.datamodules.scenes.drone_clip import DroneSceneSettings, plan_drone
from tsuiseki.datamodules.scenes.render.ground import ground_homography
from tsuiseki.tracking.features.camera_motion import CameraStep
from tsuiseki.trainers.experiments.drone.camera_errors import _best_similarity, _moved, flight_errors

SCENE = DroneSceneSettings(frames=8, width=320, height=180, camera="violent", people=1)
STILL = CameraStep(np.eye(3)[:2])


def best_steps():
    cameras = plan_drone(SCENE, 5).cameras
    places = np.array([(x, y) for x in np.linspace(20, 300, 9) for y in np.linspace(20, 160, 9)])
    exact = [ground_homography(a, b) for a, b in pairwise(cameras)]
    return [None, *(CameraStep(_best_similarity(places, _moved(one, places))) for one in exact)]


def test_the_best_similarities_are_hardly_off_and_standing_still_is_off_by_the_step():
    good, still = (flight_errors(SCENE, 5, steps) for steps in (best_steps(), [STILL] * 8))
    assert good.median < 0.2 * good.step
    assert good.worst < 2 * good.best + 1
    assert still.median > 0.5 * still.step
    assert (good.unknown, good.steps) == (0, 7)


def test_one_wrong_step_counts_and_an_unknown_one_is_counted_apart():
    steps = best_steps()
    right = flight_errors(SCENE, 5, steps)
    shifted = steps[4].similarity + np.array([[0, 0, 90.0], [0, 0, 0]])
    steps[4] = CameraStep(shifted)
    assert flight_errors(SCENE, 5, steps).median == pytest.approx(90, abs=10)
    steps[4] = replace(steps[4], deviation=np.inf)
    found = flight_errors(SCENE, 5, steps)
    assert found.unknown == 1
    assert found.median <= right.median


def test_similarities_are_recovered():
    matrix = np.array([[0.9, -0.2, 5.0], [0.2, 0.9, -3.0]])
    places = np.random.default_rng(0).uniform(0, 100, (6, 2))
    np.testing.assert_allclose(_best_similarity(places, _moved(matrix, places)), matrix, atol=1e-9)
