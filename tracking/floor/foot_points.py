"""From a detection in one camera to a Gaussian on the floor.

A person is an upright stick of height h. Its foot (x, y, 0) lies at the lower edge of the box, its head (x, y, h) at
the upper edge. Under an omnidirectional camera people lean away from the middle, and half the height lies at the centre
of the box. Detected ankles stand for the foot. With the noise of the pixels and h about `HEIGHT`, the unknowns
(x, y, h) have a Gaussian posterior, found by Gauss and Newton; h is integrated out. An edge at the border of the image
is no evidence, for the person goes on beyond it.
"""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.multicamera import StandingPeople
from tsuiseki.tracking.cameras.projective import PinholeCamera
from tsuiseki.tracking.types import BoolArray, FloatArray

# Mean height of people, metres.
HEIGHT = 1.72
# Standard deviation of the height of people, metres.
HEIGHT_DEVIATION = 0.12
# Of a person, in heights.
WIDTH = 0.36
# Standard deviation of an edge of a box, in heights of the box.
BOX_NOISE = 0.05
# Standard deviation of the middle of both ankles, in heights of the box.
ANKLE_NOISE = 0.03
# Standard deviation of the body from the foot point, and of the calibration, metres.
FLOOR_NOISE = 0.05
# Width of the image's border, pixels: a box that ends there is cut off.
BORDER = 2.0
# Of a numerical derivative, metres.
STEP = 0.02
# Of Gauss and Newton.
ROUNDS = 3


def on_floor(camera: AnyCamera, people: StandingPeople) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where people stand.

    Args:
        camera: with its pose over the floor.
        people: N detections of one frame, or of several.

    Returns:
        Places ``(N, 2)`` metres, covariances ``(N, 2, 2)``, and ``(N,)`` pixels a square metre there; NaN where a
        detection lies on no floor.
    """
    boxes = people.detections.boxes
    if not len(boxes):
        return np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0)
    pixels, deviations, levels, measured = _measured(camera, people)
    # The middle of a box is that of both ends, which need not lie over each other.
    boxed = np.isnan(people.feet).any(axis=1) & isinstance(camera, PinholeCamera)
    state = _start(camera, pixels, levels, measured)
    prior = np.zeros((3, 3))
    prior[2, 2] = HEIGHT_DEVIATION**-2
    weight = np.where(measured, deviations**-2, 0.0)
    for _ in range(ROUNDS):
        expected, slope = _projected(camera, state, levels)
        for column in (expected[..., 0], slope[:, :, 0]):
            column[boxed] = column[boxed].mean(axis=1, keepdims=True)
        residual = np.where(measured[..., None], pixels - expected, 0.0)
        information = np.einsum("nk,nkai,nkaj->nij", weight, slope, slope) + prior
        pull = np.einsum("nk,nkai,nka->ni", weight, slope, residual)
        pull[:, 2] += prior[2, 2] * (HEIGHT - state[:, 2])
        broken = ~np.isfinite(information).all(axis=(1, 2)) | ~np.isfinite(pull).all(axis=1)
        information[broken], pull[broken] = np.eye(3), np.nan
        information += 1e-9 * np.eye(3)
        state = state + np.linalg.solve(information, pull[..., None])[..., 0]
    covariance = np.linalg.inv(information)[:, :2, :2] + FLOOR_NOISE**2 * np.eye(2)
    behind = ~(camera.project(np.column_stack([state[:, :2], np.zeros(len(state))]))[1] > 0)
    state[behind], covariance[behind] = np.nan, np.nan
    (a, b), (c, d) = np.moveaxis(slope[:, 0, :, :2], 0, -1)
    return state[:, :2], covariance, np.abs(a * d - b * c)


def _measured(camera: AnyCamera, people: StandingPeople) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    """Up to two points of each person: pixels ``(N, 2, 2)``, deviations, levels as shares of h, which are measured."""
    boxes, ankles = people.detections.boxes, np.isfinite(people.feet).all(axis=1)
    middle, height = (boxes[:, 0] + boxes[:, 2]) / 2, boxes[:, 3] - boxes[:, 1]
    levels = np.tile([0.0, 1.0], (len(boxes), 1))
    if not isinstance(camera, PinholeCamera):
        pixels = np.repeat(((boxes[:, :2] + boxes[:, 2:]) / 2)[:, None], 2, axis=1)
        levels[:, 0] = 0.5
        size = np.sqrt((boxes[:, 2] - boxes[:, 0]) * height)
        measured = np.column_stack([np.ones(len(boxes), np.bool_), np.zeros(len(boxes), np.bool_)])
        deviations = np.repeat(BOX_NOISE * size[:, None], 2, axis=1)
    else:
        pixels = np.stack([np.column_stack([middle, boxes[:, 3]]), np.column_stack([middle, boxes[:, 1]])], axis=1)
        # Only a box cut off at the border has its edge there; one that reaches beyond was completed.
        cut = np.abs(boxes[:, [3, 1]] - [camera.height, 0.0]) <= BORDER
        measured, deviations = ~cut, np.repeat(BOX_NOISE * height[:, None], 2, axis=1)
        sides = (np.abs(boxes[:, [0, 2]] - [0.0, camera.width]) <= BORDER).any(axis=1)
        deviations[sides] = np.maximum(deviations[sides], 0.3 * (boxes[sides, 2:3] - boxes[sides, :1]))
    pixels[ankles, 0], levels[ankles, 0] = people.feet[ankles], 0.0
    deviations[ankles, 0], measured[ankles, 0] = ANKLE_NOISE * height[ankles], True
    return pixels, np.maximum(deviations, 0.5), levels, measured


def _start(camera: AnyCamera, pixels: FloatArray, levels: FloatArray, measured: BoolArray) -> FloatArray:
    """``(N, 3)`` where the ray of the first measured point meets its level."""
    state = np.full((len(pixels), 3), np.nan)
    for k in (1, 0):
        for level in np.unique(levels[:, k]):
            which = measured[:, k] & (levels[:, k] == level)
            ground = camera.ground(pixels[which, k], level * HEIGHT)
            there = np.flatnonzero(which)[np.isfinite(ground).all(axis=1)]
            state[there] = np.column_stack([ground[np.isfinite(ground).all(axis=1), :2], np.full(len(there), HEIGHT)])
    return state


def _projected(camera: AnyCamera, state: FloatArray, levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels ``(N, K, 2)`` of the points and their slopes ``(N, K, 2, 3)`` by x, y and h."""
    points = np.stack([np.column_stack([state[:, :2], level * state[:, 2]]) for level in levels.T], axis=1)
    moves = np.zeros((4, *points.shape))
    moves[1, ..., 0] = moves[2, ..., 1] = STEP
    moves[3, ..., 2] = STEP * levels
    pixels = camera.project((points + moves).reshape(-1, 3))[0].reshape(4, *points.shape[:2], 2)
    return pixels[0], np.moveaxis((pixels[1:] - pixels[0]) / STEP, 0, -1)


def expected_boxes(camera: AnyCamera, places: FloatArray) -> FloatArray:
    """``(N, 4)`` boxes of people who stand at ``(N, 2)`` places; NaN where one is not before the camera."""
    ends = np.concatenate([np.column_stack([places, np.full(len(places), z)]) for z in (0.0, HEIGHT)])
    foot, head = camera.project(ends)[0].reshape(2, -1, 2)
    half = WIDTH / 2 * np.linalg.norm(foot - head, axis=1, keepdims=True)
    # A person who stands upright in the image is as high as the stick; one who lies across is as wide.
    along = np.abs(foot - head) / np.maximum(2 * half / WIDTH, 1e-9)
    margin = half * (1 - along[:, [0, 1]])
    return np.concatenate([np.minimum(foot, head) - margin, np.maximum(foot, head) + margin], axis=1)
