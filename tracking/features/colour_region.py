"""How well a rectangle covers a region of a known colour, section 6.1 of the finite-sets paper.

A pixel either has the colour or not; sums over rectangles come from an integral image, so a particle costs the same
whatever its size.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.geometry import grown
from tsuiseki.tracking.types import BoolArray, FloatArray, ImageArray, IntArray

VISIBLE_SHARE = 0.25
"""Of a box, below which what is left uncovered by others is too little to judge it by."""


@dataclass(frozen=True)
class ColourRange:
    """A box in hue, saturation and value.

    Attributes:
        hue: first and last hue in degrees, each in [0, 360]; a first beyond the last runs through 0, as red does.
        saturation: least and greatest, in [0, 1].
        value: least and greatest, in [0, 1].
    """

    hue: tuple[float, float]
    saturation: tuple[float, float] = (0.35, 1.0)
    value: tuple[float, float] = (0.2, 1.0)

    def __post_init__(self) -> None:
        for name, (low, high), top in (
            ("hue", self.hue, 360.0),
            ("saturation", self.saturation, 1.0),
            ("value", self.value, 1.0),
        ):
            if not (0 <= low <= top and 0 <= high <= top) or (name != "hue" and low > high):
                raise RequestError(f"expected a range of {name} within 0 and {top:g}, got {low:g} to {high:g}")


# Hues in degrees, saturations and values in [0, 1] of the colours that have a name.
NAMED_COLOURS = {
    "red": ColourRange((345.0, 15.0), (0.45, 1.0)),
    "orange": ColourRange((15.0, 42.0), (0.5, 1.0), (0.5, 1.0)),
    "yellow": ColourRange((42.0, 70.0), (0.4, 1.0)),
    "green": ColourRange((75.0, 165.0), (0.5, 1.0), (0.25, 1.0)),
    "cyan": ColourRange((165.0, 200.0)),
    "blue": ColourRange((200.0, 265.0)),
    "magenta": ColourRange((265.0, 345.0)),
    "black": ColourRange((0.0, 360.0), (0.0, 1.0), (0.0, 0.2)),
    "white": ColourRange((0.0, 360.0), (0.0, 0.15), (0.8, 1.0)),
}


def parse_colour(text: str) -> ColourRange:
    """A named colour, or ``H1-H2,S1-S2,V1-V2`` with hues in degrees and the rest in [0, 1].

    >>> parse_colour("340-20,0.5-1,0.2-1").hue
    (340.0, 20.0)

    Raises:
        RequestError: it is neither.
    """
    if text in NAMED_COLOURS:
        return NAMED_COLOURS[text]
    try:
        hue, saturation, value = (tuple(float(number) for number in part.split("-")) for part in text.split(","))
        (h1, h2), (s1, s2), (v1, v2) = hue, saturation, value
    except ValueError as error:
        raise RequestError(
            f"expected a colour of {', '.join(NAMED_COLOURS)}, or a range such as 340-20,0.5-1,0.2-1, got {text!r}"
        ) from error
    return ColourRange((h1, h2), (s1, s2), (v1, v2))


def colour_of_box(image: ImageArray, box: FloatArray) -> ColourRange:
    """The range of the commonest colour inside a box ``(4,)`` x1, y1, x2, y2 of an RGB image.

    Raises:
        RequestError: the box covers no pixel, or has no colour (its pixels are grey).
    """
    x1, y1, x2, y2 = _corners(np.asarray(box)[None], image.shape[1], image.shape[0])[0]
    if x2 <= x1 or y2 <= y1:
        got = ",".join(f"{value:g}" for value in box)
        raise RequestError(f"expected a box inside the image of {image.shape[1]}x{image.shape[0]}, got corners {got}")
    hsv = cv2.cvtColor(image[y1:y2, x1:x2], cv2.COLOR_RGB2HSV) * np.array([2.0, 1 / 255, 1 / 255])
    hue, saturation, value = hsv.reshape(-1, 3).T
    vivid = (saturation > 0.2) & (value > 0.15)
    if vivid.mean() < 0.1:
        raise RequestError("expected a coloured object in the box, found grey; give `colour` as an HSV range instead")
    counts = np.bincount((hue[vivid] // 10).astype(np.int64), minlength=36)
    smooth = counts + np.roll(counts, 1) + np.roll(counts, -1)
    peak = 10.0 * float(np.argmax(smooth)) + 5.0
    near = vivid & (np.abs((hue - peak + 180) % 360 - 180) <= 25)
    low_s, low_v = np.quantile(saturation[near], 0.25), np.quantile(value[near], 0.25)
    hues = ((peak - 20) % 360, (peak + 20) % 360)
    return ColourRange(hues, (max(0.0, float(low_s) - 0.15), 1.0), (max(0.0, float(low_v) - 0.15), 1.0))


def colour_pixels(image: ImageArray, colour: ColourRange) -> NDArray[np.uint8]:
    """``(H, W)`` uint8, 255 at the pixels of an RGB image that have the colour and 0 elsewhere."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV)
    low = np.array([0, round(255 * colour.saturation[0]), round(255 * colour.value[0])])
    high = np.array([180, round(255 * colour.saturation[1]), round(255 * colour.value[1])])
    first, last = colour.hue[0] / 2, colour.hue[1] / 2
    ranges = [(first, last)] if first <= last else [(first, 180.0), (0.0, last)]
    masks = [cv2.inRange(hsv, np.array([a, *low[1:]]), np.array([b, *high[1:]])) for a, b in ranges]
    return np.asarray(masks[0] if len(masks) == 1 else cv2.bitwise_or(*masks), dtype=np.uint8)


@dataclass(frozen=True)
class ColourImage:
    """A frame as the region likelihood sees it.

    Attributes:
        mask: ``(H, W)`` pixels of the colour.
        sums: ``(H + 1, W + 1)`` int32 integral image of the mask.
    """

    mask: BoolArray
    sums: IntArray

    @classmethod
    def of(cls, image: ImageArray, colour: ColourRange) -> ColourImage:
        """The colour's pixels in an RGB image."""
        return cls.of_mask(colour_pixels(image, colour) > 0)

    @classmethod
    def of_mask(cls, mask: BoolArray) -> ColourImage:
        """From a mask ``(H, W)``."""
        return cls(mask, cv2.integral(mask.astype(np.uint8)).astype(np.int64))

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.mask.shape[1], self.mask.shape[0]

    def counts(self, boxes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coloured pixels and all pixels ``(N,)`` inside boxes ``(N, 4)``, cut off at the image border."""
        x1, y1, x2, y2 = _corners(boxes, *self.size).T
        inside = self.sums[y2, x2] - self.sums[y1, x2] - self.sums[y2, x1] + self.sums[y1, x1]
        area = (x2 - x1) * (y2 - y1)
        return np.where(area > 0, inside, 0).astype(np.float64), np.maximum(area, 0).astype(np.float64)


def region_contrast(
    image: ColourImage,
    boxes: FloatArray,
    margin: float = 0.5,
    others: FloatArray | None = None,
    in_front: BoolArray | None = None,
) -> FloatArray:
    """``p (1 - q)``, Eq. (68), for boxes ``(N, 4)``, in [0, 1]; NaN for a box that others hide.

    ``p`` is the coloured share of the box, ``q`` that of a frame around it; the box with its frame is ``1 + margin``
    times as wide. What lies outside the image counts as uncoloured in ``p``.

    Args:
        image: where the colour is.
        boxes: ``(N, 4)`` x1, y1, x2, y2 in pixels.
        margin: total growth of the box by its frame, as a share of its sides.
        others: ``(N, K, 4)`` boxes of other targets, of no area where there is none: their pixels in the frame do not
            count in ``q``.
        in_front: ``(N, K)`` the others that cover the target: their pixels in the box do not count in ``p`` either.
            None for all of them.
    """
    wide = grown(boxes, margin)
    inside, visible = image.counts(boxes)
    around, seen_around = image.counts(wide)
    area, area_around = (
        np.maximum(np.prod(np.round(b[:, 2:]) - np.round(b[:, :2]), axis=1), 1.0) for b in (boxes, wide)
    )
    frame, frame_area = around - inside, seen_around - visible
    # Where next to nothing of the frame is in the image, no contrast is to be seen: a box as large as the image.
    contrast = frame_area > 0.1 * (area_around - area)
    hidden = np.zeros(len(boxes), dtype=np.bool_)
    if others is not None and others.shape[1]:
        covered, covered_area = _shared(image, boxes, others)
        covered_around, covered_area_around = _shared(image, wide, others)
        frame = frame - (covered_around - covered).sum(axis=1)
        frame_area = frame_area - (covered_area_around - covered_area).sum(axis=1)
        covering = 1.0 if in_front is None else in_front
        inside, left = inside - (covered * covering).sum(axis=1), area - (covered_area * covering).sum(axis=1)
        hidden, area = left < VISIBLE_SHARE * area, left
    p = np.clip(inside / np.maximum(area, 1.0), 0.0, 1.0)
    q = np.clip(frame / np.maximum(frame_area, 1.0), 0.0, 1.0)
    return np.asarray(np.where(hidden, np.nan, np.where(contrast, p * (1.0 - q), 0.0)))


def _shared(image: ColourImage, boxes: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coloured pixels and all pixels ``(N, K)`` that each box shares with its others."""
    low = np.maximum(boxes[:, None, :2], others[:, :, :2])
    high = np.maximum(np.minimum(boxes[:, None, 2:], others[:, :, 2:]), low)
    coloured, area = image.counts(np.concatenate([low, high], axis=2).reshape(-1, 4))
    shape = others.shape[:2]
    return coloured.reshape(shape), area.reshape(shape)


def _corners(boxes: FloatArray, width: int, height: int) -> IntArray:
    """Boxes at whole pixels inside the image."""
    return np.clip(np.round(boxes), 0, [width, height, width, height]).astype(np.int64)
