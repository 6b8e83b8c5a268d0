"""Pairs of images with known optical flow: a textured ground and people before it, each layer moved by its own map."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.datamodules.scenes.people.person import render_person_sprite
from tsuiseki.datamodules.scenes.render.degrade import sensor_noise
from tsuiseki.datamodules.scenes.render.ground import Ground, ground_colour
from tsuiseki.datamodules.scenes.render.solids import Float32
from tsuiseki.tracking.types import FloatArray, ImageArray


class FlowPair:
    """Two images as from a drone that moves, and what moved between them.

    Args:
        rng: draws everything.
        size: width and height, pixels.
        motion: how far the ground moves at most, about, pixels; people move by up to a third as much besides.
        people: how many.
        noise: standard deviation of the sensor's, grey levels.

    Attributes:
        first: ``(H, W, 3)`` uint8 RGB.
        second: ``(H, W, 3)`` uint8 RGB.
        flow: ``(H, W, 2)`` float32, pixels to the right and down, of what shows in ``first``.
        inside: ``(H, W)`` what is still within the image in ``second``.
    """

    def __init__(
        self, rng: np.random.Generator, size: tuple[int, int], motion: float, people: int = 4, noise: float = 2.0
    ) -> None:
        width, height = size
        grid = np.stack(np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)), -1)
        margin, cell = int(1.5 * motion) + 8, float(rng.uniform(0.008, 0.03))
        x, y = ((np.arange(n + 2 * margin, dtype=np.float32) - n / 2) * np.float32(cell) for n in size)
        xs, ys = np.meshgrid(x, y)
        colour = ground_colour(Ground(rng), xs, ys, np.full(xs.shape, cell, dtype=np.float32))
        ground = np.asarray(255 * np.clip(colour, 0, 1), dtype=np.float32)
        # The camera moves the corners by up to about ``motion`` pixels: mostly together.
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
        angle = rng.uniform(0, 2 * math.pi)
        common = motion * rng.uniform(0.3, 0.8) * np.array([math.cos(angle), math.sin(angle)])
        moved = corners + common + rng.uniform(-0.2, 0.2, (4, 2)) * motion
        away = np.asarray(cv2.getPerspectiveTransform(corners, moved.astype(np.float32)))
        self.flow = np.asarray(cv2.perspectiveTransform(grid.reshape(-1, 1, 2), away)).reshape(grid.shape) - grid
        first = ground[margin : margin + height, margin : margin + width].copy()
        shift = np.array([[1, 0, -margin], [0, 1, -margin], [0, 0, 1.0]])
        second = np.asarray(cv2.warpPerspective(ground, away @ shift, size, flags=cv2.INTER_CUBIC), dtype=np.float32)
        for _ in range(people):
            sprite = render_person_sprite(
                rng, float(rng.uniform(0.12, 0.4) * height), tilt=float(rng.uniform(0.3, 1.3))
            )
            place = np.array([[1, 0, rng.uniform(0, width) - 20], [0, 1, rng.uniform(0, height) - 20], [0, 0, 1.0]])
            # A small turn about the middle, and a step.
            middle = (sprite.shape[1] / 2, sprite.shape[0] / 2)
            turn = np.asarray(cv2.getRotationMatrix2D(middle, rng.normal(0, 2), rng.normal(1, 0.01)), np.float64)
            turn[:, 2] += rng.uniform(-motion / 3, motion / 3, 2)
            next_place = away @ place @ np.vstack([turn, [0, 0, 1]])
            _paste(first, sprite, place)
            if motion:
                _paste(second, sprite, next_place)
                _move(self.flow, sprite, place, next_place)
        goal = grid + self.flow
        self.inside = (goal >= 0).all(axis=2) & (goal <= np.array([width - 1, height - 1])).all(axis=2)
        # What the sensor makes of both.
        grains = (noise * sensor_noise(rng, height, width) if noise else 0 for _ in range(2))
        noisy = (image + grain + 0.5 for image, grain in zip((first, second), grains, strict=True))
        self.first, self.second = (np.clip(image, 0, 255).astype(np.uint8) for image in noisy)


def _paste(image: Float32, sprite: ImageArray, place: FloatArray) -> None:
    """Draw ``sprite`` ``(h, w, 4)``, whose pixels the homography ``place`` ``(3, 3)`` takes into ``image``."""
    values = sprite.astype(np.float32)
    values[..., :3] *= values[..., 3:] / 255
    size = image.shape[1], image.shape[0]
    drawn = cv2.warpPerspective(values, place, size, flags=cv2.INTER_LINEAR)
    image *= 1 - drawn[..., 3:] / np.float32(255)
    image += drawn[..., :3]


def _move(flow: Float32, sprite: ImageArray, place: FloatArray, next_place: FloatArray) -> None:
    """Set the flow where ``sprite`` covers most of a pixel."""
    alpha: NDArray[np.uint8] = np.ascontiguousarray(sprite[..., 3])
    covered = cv2.warpPerspective(alpha, place, (flow.shape[1], flow.shape[0]), flags=cv2.INTER_LINEAR) > 127
    rows, columns = np.nonzero(covered)
    if len(rows):
        points = np.stack([columns, rows], axis=1).astype(np.float64)
        moved = cv2.perspectiveTransform(points.reshape(-1, 1, 2), next_place @ np.linalg.inv(place)).reshape(-1, 2)
        flow[rows, columns] = moved - points


def end_point_error(flow: Float32, pair: FlowPair) -> float:
    """Mean distance of the ends of ``flow`` and the true one, pixels, over what stays within the image."""
    return float(np.linalg.norm(flow - pair.flow, axis=2)[pair.inside].mean())
