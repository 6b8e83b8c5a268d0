"""Clothing colour as an appearance feature: what stands in for a network where there is none.

Two histograms of hue, saturation and value, one of the upper and one of the lower clothing, each blurred over its
bins so that a small change of light moves a colour a little and not to another bin. Their square roots make one
unit-length vector, so the cosine similarity of two features is the Bhattacharyya coefficient of the histograms.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.types import FloatArray, ImageArray

# Parts of a person's box: left, top, right, bottom as shares of its width and height.
UPPER_CLOTHING = (0.25, 0.15, 0.75, 0.5)
LOWER_CLOTHING = (0.25, 0.5, 0.75, 0.85)
BINS = (8, 4, 4)
FINER = 3
VALUES = (180, 256, 256)


class ClothingColour:
    """Describes people by the colours of their clothes.

    ``describe`` has the interface of an appearance network.

    >>> image = np.zeros((40, 20, 3), dtype=np.uint8)
    >>> ClothingColour().describe(image, np.array([[0, 0, 20, 40.0]])).shape
    (1, 256)
    """

    def __init__(self) -> None:
        self._blurs = (_blur(BINS[0], circular=True), _blur(BINS[1]), _blur(BINS[2]))

    @property
    def length(self) -> int:
        """Length of a feature."""
        return 2 * int(np.prod(BINS))

    def describe(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N, D)`` unit-length features of ``(N, 4)`` boxes in pixels of ``(H, W, 3)`` uint8 RGB.

        A box beyond the image is described by the pixels nearest to it.
        """
        features = np.empty((len(boxes), self.length))
        for row, box in zip(features, boxes, strict=True):
            histograms = [self._histogram(_part(image, box, part)) for part in (UPPER_CLOTHING, LOWER_CLOTHING)]
            row[:] = np.concatenate(histograms)
        return features

    def _histogram(self, pixels: ImageArray) -> FloatArray:
        """Root of the blurred histogram, of length 1 / sqrt(2)."""
        colours = cv2.cvtColor(pixels, cv2.COLOR_RGB2HSV)
        limits = [limit for value in VALUES for limit in (0, value)]
        fine = cv2.calcHist([colours], [0, 1, 2], None, [FINER * n for n in BINS], limits)
        coarse = fine
        for blur in self._blurs:
            # Contracts the first axis and appends the blurred one: after three turns the axes are in place again.
            coarse = np.tensordot(coarse, blur, axes=(0, 0))
        coarse = coarse.ravel()
        return np.asarray(np.sqrt(coarse / (2 * coarse.sum())))


def _blur(bins: int, circular: bool = False) -> FloatArray:
    """``(FINER * bins, bins)`` share of each fine bin that goes to each coarse one: linear between their middles."""
    position = (np.arange(FINER * bins) + 0.5) / FINER - 0.5
    if not circular:
        position = np.clip(position, 0, bins - 1)
    distance = np.abs(position[:, None] - np.arange(bins))
    if circular:
        distance = np.minimum(distance, bins - distance)
    return np.asarray(np.clip(1 - distance, 0, None))


def _part(image: ImageArray, box: FloatArray, part: tuple[float, float, float, float]) -> ImageArray:
    """The pixels of a part of a box, at least one."""
    rows, columns = image.shape[:2]
    x, y, width, height = box[0], box[1], box[2] - box[0], box[3] - box[1]
    left = int(np.clip(round(x + part[0] * width), 0, columns - 1))
    top = int(np.clip(round(y + part[1] * height), 0, rows - 1))
    right = int(np.clip(round(x + part[2] * width), left + 1, columns))
    bottom = int(np.clip(round(y + part[3] * height), top + 1, rows))
    return image[top:bottom, left:right]
