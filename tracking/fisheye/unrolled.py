"""A detector of upright people for a ceiling camera: the picture is unrolled into upright views.

A fisheye picture from a ceiling shows people lying outward, and no two directions alike. In the views of `panorama`
everybody stands upright. Rings of tiles show them at several scales, those who are near and those who are farther away;
a view straight down shows who is right below. What is found there goes back to the picture as boxes turned about their
centres, unless it is lower or higher than people are.

`DETECTORS` names the shipped detector for each kind of view.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.cameras.camera_files import AnyCamera
from tsuiseki.tracking.cameras.panorama import CylinderView, DownwardView
from tsuiseki.tracking.cameras.projective import Camera
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.geometry import rotated_intersections
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray, ImageArray

Tile: TypeAlias = CylinderView | DownwardView
# Tiles of each ring: more show people larger. With tiles of 4:3 a ring of n shows those whole who stand farther away
# than n / 6 of the camera's height.
RINGS = (1, 4)
# Share of a tile that the next one shows again.
OVERLAP = 0.25
# Row of a tile that is as high as the camera, as a share of the height.
HORIZON = 0.03
# Overlap from which two turned boxes are one person.
SAME = 0.4
# Share of a box within one of another tile, from which they are one person.
INSIDE = 0.7
# Least and greatest height over the floor that a person's box may reach, metres.
HEIGHTS = (0.7, 2.4)
# A box that ends within this share of a tile's side from its border is taken for cut off.
AT_BORDER = 0.008
# Of a box's diameter, how near to the point below the camera it must lie to be taken from the view down.
BELOW = 0.6
# Most tiles of one call of the detector.
BATCH = 8


class UnrolledDetector:
    """Finds people in the upright views around a camera; see the module.

    Args:
        detector: finds upright people in pictures.
        camera: of the images, over the floor.
        size: height and width of a tile, pixels; best the detector's input.
        rings: number of tiles of each ring about the camera.
    """

    def __init__(self, detector: Detect, camera: Camera, size: tuple[int, int], rings: Sequence[int] = RINGS) -> None:
        self.detector, self.camera = detector, camera
        height, width = size
        self.tiles: list[Tile] = []
        for number in rings:
            scale = number * width * (1 - OVERLAP) / (2 * np.pi)
            for k in range(number):
                middle = -2 * np.pi * k / number
                self.tiles.append(CylinderView(camera.position, middle, scale, HORIZON * height, width, height))
        self.tiles.append(DownwardView(camera.position, 0.0, 0.9 * height, width, height))
        self._maps = [_map(tile, camera) for tile in self.tiles]

    def unroll(self, image: ImageArray) -> list[ImageArray]:
        """The tiles of an image ``(H, W, 3)`` uint8 RGB; black where the camera sees nothing."""
        finer = [image]
        for _ in range(max(level for *_, level in self._maps)):
            finer.append(np.asarray(cv2.pyrDown(finer[-1]), dtype=np.uint8))
        return [
            np.asarray(
                cv2.remap(finer[level], coordinates, fractions, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
            )
            for coordinates, fractions, level in self._maps
        ]

    def detect(self, images: Sequence[ImageArray]) -> list[Detections]:
        """People in ``images``, each ``(H, W, 3)`` uint8 RGB of the camera, with angles."""
        pictures = [tile for image in images for tile in self.unroll(image)]
        detections: list[Detections] = []
        for start in range(0, len(pictures), BATCH):
            detections += self.detector.detect(pictures[start : start + BATCH])
        count = len(self.tiles)
        return [self._rolled(detections[n * count : (n + 1) * count]) for n in range(len(images))]

    def _rolled(self, detections: Sequence[Detections]) -> Detections:
        """The detections in the tiles of one image as detections of the image."""
        rotated, scores, owners = [np.empty((0, 5))], [np.empty(0)], [np.empty(0, dtype=np.int64)]
        for number, (tile, in_tile) in enumerate(zip(self.tiles, detections, strict=True)):
            people = in_tile.select(_whole(tile, in_tile.boxes) & _plausible(tile, in_tile.boxes))
            boxes = _in_image(tile, self.camera, people.boxes)
            usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:4] >= 1).all(axis=1)
            rotated.append(boxes[usable])
            scores.append(people.scores[usable])
            owners.append(np.full(int(usable.sum()), number))
        boxes, score, owner = np.concatenate(rotated), np.concatenate(scores), np.concatenate(owners)
        chosen = _distinct(boxes, score, owner)
        boxes, half = boxes[chosen], boxes[chosen, 2:4] / 2
        corners = np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1)
        return Detections(corners, score[chosen], angles=boxes[:, 4])


def _in_image(tile: Tile, camera: Camera, boxes: FloatArray) -> FloatArray:
    """``(N, 5)`` turned boxes in the camera's image of ``(N, 4)`` upright boxes of a tile; NaN beyond the rim.

    The middle of a box's lower end is the feet and that of its upper end the head. In the view down, where upright
    means nothing, the body lies along the direction away from the point below the camera.
    """
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    top, bottom = middle.copy(), middle.copy()
    left, right = middle.copy(), middle.copy()
    if isinstance(tile, CylinderView):
        top[:, 1], bottom[:, 1] = boxes[:, 1], boxes[:, 3]
        left[:, 0], right[:, 0] = boxes[:, 0], boxes[:, 2]
    else:
        outward = middle - [tile.width / 2, tile.height / 2]
        away = np.linalg.norm(outward, axis=1, keepdims=True)
        outward = np.where(away > 1e-6, outward / np.maximum(away, 1e-6), [0.0, -1.0])
        # An ellipse in the box, cut along and across the direction outward.
        half = (boxes[:, 2:] - boxes[:, :2]) / 2
        along = np.linalg.norm(half * outward, axis=1, keepdims=True) * outward
        across = outward[:, ::-1] * [-1.0, 1.0]
        across = np.linalg.norm(half * across, axis=1, keepdims=True) * across
        top, bottom, left, right = middle + along, middle - along, middle - across, middle + across
    points = np.concatenate([top, bottom, left, right])
    pixels, depth = camera.project(tile.position + tile.rays(points))
    pixels[depth <= 0] = np.nan
    top, bottom, left, right = np.split(pixels, 4)
    upward = top - bottom
    angle = np.arctan2(upward[:, 0], -upward[:, 1])
    size = np.column_stack([np.linalg.norm(right - left, axis=1), np.linalg.norm(upward, axis=1)])
    return np.column_stack([(top + bottom) / 2, size, angle])


def _map(tile: Tile, camera: Camera) -> tuple[NDArray[Any], NDArray[Any], int]:
    """Where in the image each pixel of a tile lies, as ``cv2.remap`` wants it, and how often to halve the image before.

    The image is halved where neighbours in the tile lie two pixels apart, so that no detail is skipped.
    """
    x, y = np.meshgrid(np.arange(tile.width) + 0.5, np.arange(tile.height) + 0.5)
    pixels, depth = camera.project(tile.position + tile.rays(np.column_stack([x.ravel(), y.ravel()])))
    pixels[~(depth > 0)] = np.nan
    places = pixels.reshape(tile.height, tile.width, 2)
    steps = np.linalg.norm(np.diff(places, axis=1), axis=2)
    step = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 1.0
    level = max(int(np.log2(max(step, 1.0)) + 0.3), 0)
    places = np.nan_to_num(places / 2**level - 0.5, nan=-100.0).astype(np.float32)
    coordinates, fractions = cv2.convertMaps(places[..., 0].copy(), places[..., 1].copy(), cv2.CV_16SC2)
    return np.asarray(coordinates), np.asarray(fractions), level


def _whole(tile: Tile, boxes: FloatArray) -> BoolArray:
    """``(N,)`` whether a box is no part of somebody whom another tile shows whole."""
    width, height = tile.width, tile.height
    aside = (boxes[:, 0] > AT_BORDER * width) & (boxes[:, 2] < (1 - AT_BORDER) * width)
    if isinstance(tile, DownwardView):
        middle = (boxes[:, :2] + boxes[:, 2:]) / 2 - [width / 2, height / 2]
        near = np.linalg.norm(middle, axis=1) < BELOW * np.linalg.norm(boxes[:, 2:] - boxes[:, :2], axis=1)
        return np.asarray(aside & near & (boxes[:, 1] > AT_BORDER * height) & (boxes[:, 3] < (1 - AT_BORDER) * height))
    return np.asarray(aside & (boxes[:, 3] < (1 - AT_BORDER) * height))


def _plausible(tile: Tile, boxes: FloatArray) -> BoolArray:
    """``(N,)`` whether boxes are as high over the floor as people may be."""
    if isinstance(tile, DownwardView):
        return np.ones(len(boxes), dtype=np.bool_)
    head, feet = boxes[:, 1] - tile.horizon, boxes[:, 3] - tile.horizon
    # Feet at depression tan b stand H / tan b away, where a row of tan a is H (1 - tan a / tan b) over the floor.
    above = tile.position[2] * (1 - head / np.maximum(feet, 1e-6))
    return np.asarray((feet > 0) & (above >= HEIGHTS[0]) & (above <= HEIGHTS[1]))


def _distinct(boxes: FloatArray, scores: FloatArray, owner: np.ndarray) -> np.ndarray:
    """Rows of the best boxes, from the best on; of two that are one person the worse goes."""
    order = np.argsort(-scores, kind="stable")
    size = boxes[:, 2] * boxes[:, 3]
    best: list[int] = []
    for k in order.tolist():
        shared = rotated_intersections(boxes[k : k + 1], boxes[best])[0]
        overlap = shared / np.maximum(size[k] + size[best] - shared, 1e-9)
        inside = shared / np.maximum(np.minimum(size[k], size[best]), 1e-9)
        same = (overlap > SAME) | ((inside > INSIDE) & (owner[k] != owner[best]))
        if not same.any():
            best.append(k)
    return np.array(best, dtype=np.int64)


CeilingInput: TypeAlias = Literal["unrolled", "image"]
# The shipped detector for each input.
DETECTORS: dict[CeilingInput, str] = {"unrolled": "detector_ceiling", "image": "detector_drone"}
# Height and width of a tile for a network that takes any size, pixels.
TILE = (480, 640)


def ceiling_detector(detector: Detect, camera: AnyCamera, view: CeilingInput, rings: Sequence[int] = RINGS) -> Detect:
    """``detector`` on a ceiling camera's images: as they are, or on the views they unroll into."""
    if view == "image":
        return detector
    # A function does not say the size of its input.
    size: tuple[int, int] | None = getattr(detector, "input_size", None)
    return UnrolledDetector(detector, camera, size or TILE, rings)
