"""How much the colours inside a box are those of the target and not those around it.

Two histograms, one of the target's inner part and one of its surroundings, give each colour a probability of being the
target. The score of a box is the mean of it over the box's inner part. Colours do not depend on shape, so they fail on
other frames than gradients do: a correlation filter that has drifted onto the background keeps a high response, and its
colour score falls.
"""

from __future__ import annotations

import cv2
import numpy as np

from tsuiseki.tracking.single.colour_model import ColourModel, histogram, quantised
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray

INNER = (0.7, 0.8)  # shares of width and height that are target rather than background
AROUND = (1.2, 0.8)  # margins of the surroundings, as shares of width and height, both sides together


class ForegroundColour(ColourModel):
    """The colours of a target's inner part and of its surroundings."""

    @classmethod
    def learn(cls, image: ImageArray, box: FloatArray) -> ForegroundColour | None:
        """From an image ``(H, W, 3)`` and a box ``(4,)``; None where target or surroundings have no pixel."""
        size = box[2:] - box[:2]
        outer = np.concatenate([box[:2] - size * AROUND / 2, box[2:] + size * AROUND / 2])
        x1, y1, x2, y2 = _clipped(outer, image)
        if x2 <= x1 or y2 <= y1:
            return None
        colours = quantised(image[y1:y2, x1:x2])
        inner = _mask(_shrunk(box[None])[0] - [x1, y1, x1, y1], colours.shape)
        outside = ~_mask(box - [x1, y1, x1, y1], colours.shape)
        if not inner.any() or not outside.any():
            return None
        return cls(histogram(colours[inner]), histogram(colours[outside]))

    def score(self, image: ImageArray, boxes: FloatArray) -> FloatArray:
        """``(N,)`` in [0, 1] for boxes ``(N, 4)``; what lies outside the image counts as background."""
        inner = _shrunk(boxes)
        x1, y1, x2, y2 = _clipped(np.concatenate([inner[:, :2].min(axis=0), inner[:, 2:].max(axis=0)]), image)
        if x2 <= x1 or y2 <= y1:
            return np.zeros(len(boxes))
        sums = cv2.integral(self.table.take(quantised(image[y1:y2, x1:x2])))
        whole = np.round(inner).astype(int)
        area = np.maximum((whole[:, 2] - whole[:, 0]) * (whole[:, 3] - whole[:, 1]), 1)
        left, top, right, bottom = np.clip(whole - [x1, y1, x1, y1], 0, [x2 - x1, y2 - y1, x2 - x1, y2 - y1]).T
        total = sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left]
        return np.asarray(total / area)


def _shrunk(boxes: FloatArray) -> FloatArray:
    margin = (boxes[:, 2:] - boxes[:, :2]) * (1 - np.array(INNER)) / 2
    return np.concatenate([boxes[:, :2] + margin, boxes[:, 2:] - margin], axis=1)


def _clipped(box: FloatArray, image: ImageArray) -> tuple[int, int, int, int]:
    height, width = image.shape[:2]
    x1, y1, x2, y2 = (round(float(value)) for value in box)
    return max(x1, 0), max(y1, 0), min(x2, width), min(y2, height)


def _mask(box: FloatArray, shape: tuple[int, ...]) -> BoolArray:
    mask = np.zeros(shape, dtype=np.bool_)
    x1, y1, x2, y2 = (max(round(float(value)), 0) for value in box)
    mask[y1:y2, x1:x2] = True
    return mask
