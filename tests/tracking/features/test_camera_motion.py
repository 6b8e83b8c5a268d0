"""Global motion between frames: exact for a still camera, near the truth for a generated flight, used by the flow."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from benchmarks.drone.flow_pairs import FlowPair
from tsuiseki.datamodules.scenes.drone_clip import DroneClip, DroneSceneSettings
from tsuiseki.datamodules.scenes.render.ground import ground_homography
from tsuiseki.tracking.features.camera_motion import camera_motion, undone
from tsuiseki.tracking.features.camera_path import CameraPath, move_boxes
from tsuiseki.tracking.people.flow import FlowTracker
from tsuiseki.tracking.people.motion_compensated import MotionCompensated
from tsuiseki.tracking.people.sort import Sort
from tsuiseki.tracking.types import Detections

IDENTITY = np.eye(3)[:2]


@pytest.fixture(scope="module")
def flight():
    return DroneClip(
        DroneSceneSettings(width=640, height=360, frames=16, people=3, clutter=1, camera="violent"), seed=2
    )


@pytest.fixture(scope="module")
def frames(flight):
    return [(image, truth) for (image,), truth in flight.frames()]


def through(matrix, points):
    moved = np.column_stack([points, np.ones(len(points))]) @ matrix.T
    return moved[:, :2] if moved.shape[1] == 2 else moved[:, :2] / moved[:, 2:]


@pytest.mark.slow
def test_a_flight_is_followed_to_a_pixel(flight, frames):
    points = np.array([[x, y] for x in (120, 320, 520) for y in (80, 180, 280)], dtype=float)
    errors, moves = [], []
    for k, ((before, truth), (after, _)) in enumerate(itertools.pairwise(frames)):
        exact = through(ground_homography(flight.cameras[k], flight.cameras[k + 1]), points)
        found = camera_motion(before, after, people=truth.boxes)
        assert found is not None
        errors.append(np.linalg.norm(through(found, points) - exact, axis=1).max())
        moves.append(np.linalg.norm(exact - points, axis=1).max())
    assert np.median(moves) > 2  # the flight does move
    # A similarity cannot follow the perspective of a tilted view: about a pixel in 640 near the border.
    assert np.median(errors) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "jerk"), [(271, 11), (96, 7)])
def test_a_jerk_by_a_quarter_of_the_width_is_found(seed, jerk):
    settings = DroneSceneSettings(width=640, height=360, frames=16, people=3, clutter=1, camera="violent")
    plan = DroneClip(settings, seed)
    points = np.array([[x, y] for x in (160, 320, 480) for y in (90, 180, 270)], dtype=float)
    path = CameraPath()
    for frame in range(jerk - 2, jerk + 2):
        path.add(plan.draw_frame(frame)[0][0])
    assert len(path.unknown) == 0
    for number, frame in enumerate(range(jerk - 1, jerk + 2), start=1):
        exact = through(ground_homography(plan.cameras[frame - 1], plan.cameras[frame]), points)
        step = path.step(number)
        away = np.linalg.norm(through(step.similarity, points) - exact, axis=1)
        # What a similarity cannot follow, a pixel or two, and what the path says that it may be off.
        assert np.median(away) < 2 + 2 * step.deviation
        assert step.deviation < 10
        if frame == jerk:
            assert np.linalg.norm(exact - points, axis=1).max() > 140


def test_frames_without_anything_in_common_say_nothing():
    rng = np.random.default_rng(0)
    one, other = (np.kron(rng.integers(0, 256, (12, 20, 3)), np.ones((15, 16, 1))).astype(np.uint8) for _ in range(2))
    assert camera_motion(one, other) is None


def test_a_frame_that_shows_nothing_does_not_lose_the_way():
    rng = np.random.default_rng(1)
    scene = cv2.GaussianBlur(rng.integers(0, 256, (240, 420, 3)).astype(np.uint8), (0, 0), 1.5)
    black = np.zeros((180, 320, 3), np.uint8)
    path = CameraPath()
    for image in (scene[30:210, 40:360], black, scene[22:202, 52:372], scene[22:202, 55:375]):
        path.add(image)
    assert list(path.unknown) == [1, 2]
    assert np.isinf(path.step(2).deviation)
    np.testing.assert_allclose(path.transforms[2], [[1, 0, 12], [0, 1, -8]], atol=0.2)
    np.testing.assert_allclose(path.step(3).similarity, [[1, 0, -3], [0, 1, 0]], atol=0.2)
    assert path.step(3).deviation == 0


def test_a_still_camera_gives_exactly_the_identity():
    pair = FlowPair(np.random.default_rng(0), (320, 240), motion=0, noise=3)
    np.testing.assert_array_equal(camera_motion(pair.first, pair.second), IDENTITY)
    path = CameraPath()
    for image in (pair.first, pair.second, pair.first):
        np.testing.assert_array_equal(path.add(image), IDENTITY)


def test_nothing_to_see_says_nothing():
    blank = np.full((120, 160, 3), 128, dtype=np.uint8)
    assert camera_motion(blank, blank) is None
    path = CameraPath()
    path.add(blank)
    path.add(blank)
    assert list(path.unknown) == [1]
    np.testing.assert_array_equal(path.transforms[1], IDENTITY)


def test_frames_of_two_shapes_are_refused():
    with pytest.raises(ValueError, match="expected two frames of one shape"):
        camera_motion(np.zeros((40, 40), np.uint8), np.zeros((40, 50), np.uint8))


def test_a_similarity_is_undone_exactly():
    turn = np.array([[0.9, -0.3, 12.0], [0.3, 0.9, -5.0]])
    boxes = np.array([[10.0, 20, 30, 60], [100, 50, 140, 60]])
    np.testing.assert_allclose(move_boxes(move_boxes(boxes, turn), undone(turn)), boxes, atol=1e-9)


def jumping(path):
    """Two people side by side who stand while the camera jumps by the distance between them in every frame."""
    detections = []
    for frame in range(12):
        shift = 60.0 * (frame % 2)
        path.transforms.append(np.array([[1.0, 0, -shift], [0, 1, 0]]))
        boxes = np.array([[100.0, 100, 130, 170], [160, 100, 190, 170]]) + np.array([shift, 0, shift, 0])
        detections.append(Detections(boxes, np.full(2, 0.99)))
    return detections


@pytest.mark.parametrize("said", [True, False])
def test_gates_open_where_nobody_knows_how_far_the_camera_jumped(said):
    """Two people stand; in one frame the camera jumps by two heights, which the images do not tell."""
    path = CameraPath()
    flow = FlowTracker(camera=path)
    for frame in range(24):
        path.transforms.append(np.eye(3)[:2])
        if said and frame == 12:
            path.unknown.append(frame)
        shift = 140.0 * (frame >= 12)
        boxes = np.array([[100.0, 100, 130, 170], [300, 100, 330, 170]]) + np.array([shift, 0, shift, 0])
        flow.update(Detections(boxes, np.full(2, 0.99)))
    # A camera that is taken to have stood still tears the tracks.
    assert ([len(track) for track in flow.tracks()] == [24, 24]) == said
    assert flow.facts()["camera_unknown"] == ([[13, 13]] if said else [])


def test_compensation_keeps_people_apart_whom_a_jumping_camera_confuses():
    path = CameraPath()
    detections = jumping(path)
    plain, compensated = Sort(), MotionCompensated(Sort(), path)
    flow = FlowTracker(camera=path)
    for found in detections:
        plain.update(found)
        compensated.update(found)
        flow.update(found)
    for tracks in (compensated.tracks(), flow.tracks()):
        assert [len(t) for t in tracks] == [12, 12]
        for track, x in zip(tracks, (100.0, 160.0), strict=True):
            np.testing.assert_allclose(track.boxes[:, 0], [x + 60 * (f % 2) for f in range(12)], atol=1e-6)
    assert not any(np.allclose(t.boxes[:, 0], [100 + 60 * (f % 2) for f in t.frames]) for t in plain.tracks())
