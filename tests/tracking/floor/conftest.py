"""Walkers over a square, and what four cameras find of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from tsuiseki.tracking.cameras.camera_files import Placed
from tsuiseki.tracking.cameras.multicamera import PlacedTruth, StandingPeople
from tsuiseki.tracking.cameras.omnidirectional import OmnidirectionalCamera, OmnidirectionalLens
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.floor.foot_points import HEIGHT
from tsuiseki.tracking.floor.measured_floor import CameraFeed
from tsuiseki.tracking.types import Detections

RATE, LENGTH = 5.0, 40
SIZE = np.array([20, 60])
FLOOR = np.array([-6.0, -6.0, 6.0, 6.0])


def pinhole(x: float, y: float, height: float = 3.0) -> PinholeCamera:
    return PinholeCamera.look_at(np.array([x, y, height]), np.array([0.0, 0.0, 0.5]), 600.0, 960, 720)


def fisheye(height: float = 4.0) -> OmnidirectionalCamera:
    lens = OmnidirectionalLens(
        800, 800, np.array([250.0, 0.0, -0.0012]), np.array([400.0, 400.0]), np.eye(2), np.empty(0), 1.4
    )
    return OmnidirectionalCamera(lens, np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, height]))


def cameras() -> list[Placed]:
    corners = [(-8.0, -8.0), (8.0, -8.0), (8.0, 8.0), (-8.0, 8.0)]
    placed = [Placed(f"corner{k + 1}", pinhole(*at), RATE, 0.0, FLOOR) for k, at in enumerate(corners)]
    return [*placed, Placed("ceiling", fisheye(), RATE, 0.0, FLOOR)]


@dataclass(frozen=True)
class World:
    feeds: list[CameraFeed]
    truth: PlacedTruth


def boxes_of(camera, places) -> np.ndarray:
    """Boxes about the stick from foot to head; the centre of a leaning one is its half height."""
    points = [np.column_stack([places, np.full(len(places), z)]) for z in (0.0, HEIGHT / 2, HEIGHT)]
    foot, middle, head = (camera.project(each)[0] for each in points)
    if isinstance(camera, OmnidirectionalCamera):
        half = np.abs(foot - head) / 2 + 12
        return np.concatenate([middle - half, middle + half], axis=1)
    high = np.linalg.norm(foot - head, axis=1)
    side = np.column_stack([0.18 * high, np.zeros(len(high))])
    return np.concatenate([np.minimum(foot, head) - side, np.maximum(foot, head) + side], axis=1)


def make_world(
    seed: int, people: int = 6, miss: float = 0.2, false: float = 0.5, noise: float = 0.02, offset: float = 0.0
) -> World:
    """People who walk straight lines; `offset` seconds by which the second camera runs late."""
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(-4.5, 4.5, (2, people, 2))
    feeds = []
    for number, placed in enumerate(cameras()):
        camera, late = placed.camera, offset if number == 1 else 0.0
        times, found = late + np.arange(LENGTH) / RATE, []
        for time in times:
            places = start + (goal - start) * time * RATE / LENGTH
            boxes = boxes_of(camera, places)
            seen = (boxes[:, :2] > 3).all(axis=1) & (boxes[:, 2:] < [camera.width - 3, camera.height - 3]).all(axis=1)
            boxes = boxes[seen & (rng.random(people) >= miss)]
            boxes = boxes + noise * (boxes[:, 3:] - boxes[:, 1:2]) * rng.standard_normal(boxes.shape)
            extra = rng.uniform([100, 200], [camera.width - 100, camera.height - 150], (rng.poisson(false), 2))
            boxes = np.concatenate([boxes, np.concatenate([extra - SIZE, extra + SIZE], axis=1)])
            found.append(StandingPeople.of(Detections(boxes, np.ones(len(boxes)))))
        feeds.append(CameraFeed(placed, times, found))
    at = np.arange(LENGTH)[:, None, None] / LENGTH
    places = (start + (goal - start) * at).reshape(-1, 2)
    ids = np.tile(np.arange(1, people + 1), LENGTH)
    return World(feeds, PlacedTruth(np.repeat(np.arange(LENGTH) / RATE, people), ids, places))


@pytest.fixture(scope="session")
def world() -> World:
    return make_world(0)
