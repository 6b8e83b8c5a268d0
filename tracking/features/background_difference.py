"""What stands out from a background that a fixed camera sees behind animals: any colour, brighter or darker.

The background of each pixel is a quantile of its values over the video: the middle one where animals differ in any
way, a low one where they are brighter and a high one where they are darker, so that an animal that rests for most of
the video still stands out. What rests all the time is part of that quantile; where the background itself holds regions
as large and as distinct as the animals, they are painted over from their surroundings. The usual `Shape` of a region
tells one body from two that touch, whatever their size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.source import Source

SAMPLED = 32
"""Frames, spread over the video, that the background is learnt from."""
# Least and most usual areas of a region that tells the usual shape: one body alone.
LONE = (0.5, 1.6)
# Least pixels of such a region, and of whatever tells what stands out.
FEWEST = 20


@dataclass(frozen=True)
class Shape:
    """A region, but for its place, direction and size.

    Attributes:
        aspect: deviation of its pixels along its longer axis over that across, at least 1.
        fill: its area over that of the ellipse with the same deviations: 1 for an ellipse, less for what bends or has
            gaps.
    """

    aspect: float
    fill: float


def shape_of(pixels: FloatArray) -> Shape:
    """The shape of a region.

    Args:
        pixels: ``(P, 2)`` centres of all its pixels, in either order of the columns.
    """
    # A pixel is a square with a deviation of its own, so that a single row has one across.
    low, high = np.linalg.eigvalsh(np.cov(pixels.T) + np.eye(2) / 12)
    return Shape(float(np.sqrt(high / low)), float(len(pixels) / (4 * np.pi * np.sqrt(low * high))))


def usual_shape(masks: Sequence[NDArray[np.bool_]], area: float) -> Shape | None:
    """The median shape of the regions that have about the usual area; None without any.

    Args:
        masks: ``(H, W)`` each.
        area: usual pixels of one body.
    """
    shapes = []
    for mask in masks:
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
        for n in range(1, count):
            if max(LONE[0] * area, FEWEST) <= stats[n, cv2.CC_STAT_AREA] <= LONE[1] * area:
                shape = shape_of(np.argwhere(np.asarray(labels) == n).astype(np.float64))
                shapes.append((shape.aspect, shape.fill))
    return Shape(*np.median(shapes, axis=0).tolist()) if shapes else None


Contrast = Literal["auto", "bright", "dark", "any"]
Grey: TypeAlias = NDArray[np.uint8]

# Quantile in [0, 1] of a pixel's values that lies behind animals that are brighter, darker, or different.
QUANTILES = {"bright": 0.05, "dark": 0.95, "any": 0.5}
# One sign of difference is taken for the animals' where it makes up this share of all that stands out.
ONE_SIDED = 0.75
# Deviations of the noise of a difference below which nothing stands out.
NOISE = 6.0
# Grey levels below which nothing stands out.
LEAST = 8.0
# Sides of the surroundings that a background is compared with, as a share of the image's shorter side.
SURROUNDINGS = 0.25
# A resting animal, or what it never uncovered, is a region of the background from this share of the usual area up to so
# many times.
RESTING = (0.05, 3.0)
# Rounds of the search for resting animals, each with the appearance of the animals known by then.
ROUNDS = 4
# Share of the contrast of animals from which a pixel is of a core.
CORE = 0.5
# Share of it from which a pixel is of an animal.
SHARE = 0.1


@dataclass(frozen=True)
class Background:
    """What a fixed camera sees behind the animals.

    Attributes:
        image: ``(H, W, 3)`` uint8 RGB.
        contrast: how animals differ from it: ``bright``, ``dark`` or ``any``.
        threshold: difference in grey levels from which a pixel belongs to an animal.
        core: difference from which it belongs to its core; legs and wings are fainter.
        area: usual pixels of the core of one animal; 0 where none was found.
        shape: usual shape of such a core; None where none was found.
    """

    image: ImageArray
    contrast: Contrast
    threshold: float
    core: float
    area: float
    shape: Shape | None = None

    def difference(self, image: ImageArray) -> Grey:
        """``(H, W)`` how far an RGB image stands out, grey levels, smoothed over about a pixel.

        Raises:
            RequestError: the image has another size.
        """
        if image.shape != self.image.shape:
            (height, width), (high, wide) = image.shape[:2], self.image.shape[:2]
            raise RequestError(f"expected a frame of {wide}x{high} like the background, got {width}x{height}")
        return _difference(image, self.image, self.contrast)


@dataclass(frozen=True)
class StandingOut:
    """The pixels that stand out from a background, whatever their colour.

    Attributes:
        background: that a fixed camera sees.
        smooth: side in pixels, odd, of the median filter that takes specks away and closes pinholes; 1 leaves it out.
    """

    background: Background
    smooth: int = 5

    def pixels(self, image: ImageArray) -> Grey:
        """``(H, W)`` uint8, 255 where an RGB image stands out and 0 elsewhere."""
        mask = np.where(self.background.difference(image) > self.background.threshold, 255, 0).astype(np.uint8)
        return np.asarray(cv2.medianBlur(mask, self.smooth), dtype=np.uint8) if self.smooth > 1 else mask


def learn_background(
    images: Sequence[ImageArray], contrast: Contrast = "auto", threshold: float | None = None
) -> Background:
    """The background of some frames spread over a video.

    Args:
        images: ``(H, W, 3)`` uint8 RGB, at least one; some twenty are enough.
        contrast: how animals differ from it; ``auto`` measures it.
        threshold: grey levels from which a pixel belongs to an animal; by default `SHARE` of their own contrast.

    Raises:
        RequestError: there is no image, or a threshold out of range.
    """
    if not len(images):
        raise RequestError("expected at least one frame to learn the background from, got none")
    if threshold is not None and not 0 < threshold < 255:
        raise RequestError(f"expected a threshold in (0, 255), got {threshold:g}")
    ordered = np.sort(np.stack(images), axis=0)
    if contrast == "auto":
        contrast = _estimated_contrast(ordered)
    back = _quantile(ordered, contrast)
    surroundings = _surroundings(back)
    apart = [_difference(image, surroundings, contrast) for image in images]
    for done in range(ROUNDS + 1):
        least, peak = _noise_and_peak(images, back, surroundings, contrast)
        level = max(least, SHARE * peak) if threshold is None else threshold
        core = max(level, CORE * peak)
        masks = [_difference(image, back, contrast) > core for image in images]
        area = usual_area(masks)
        # One that moves a little shows only what it uncovers; painted over, it shows what the others look like.
        resting = _resting(back, surroundings, contrast, core, _whole_area(masks, [part > core for part in apart]))
        # Levels are of the background that is kept, also where the last round found somebody.
        if done == ROUNDS or not resting.any():
            break
        grown = cv2.dilate(_filled_up(resting, _difference(back, surroundings, contrast) > level), np.ones((9, 9)))
        back = np.where(grown[..., None] > 0, surroundings, back)
    shape = usual_shape(masks, area)
    return Background(np.ascontiguousarray(back), contrast, float(level), float(core), area, shape)


def usual_area(masks: Sequence[NDArray[np.bool_]]) -> float:
    """Area of the region in which a pixel of ``masks`` ``(H, W)`` usually lies; specks hardly count. 0 without any."""
    areas = [
        cv2.connectedComponentsWithStats(mask.astype(np.uint8))[2][1:, cv2.CC_STAT_AREA] for mask in masks if mask.any()
    ]
    if not areas:
        return 0.0
    sizes = np.sort(np.concatenate(areas)).astype(np.float64)
    return float(sizes[np.searchsorted(np.cumsum(sizes), sizes.sum() / 2)])


def _whole_area(masks: Sequence[NDArray[np.bool_]], apart: Sequence[NDArray[np.bool_]]) -> float:
    """Area of the region, with what is ``apart`` from the surroundings, in which a pixel of ``masks`` usually lies.

    Each ``(H, W)``; 0 without any. An animal that shifts a little stands out from the background by a sliver, from the
    surroundings as a whole.
    """
    areas = []
    for mask, from_surroundings in zip(masks, apart, strict=True):
        _, labels, stats, _ = cv2.connectedComponentsWithStats((mask | from_surroundings).astype(np.uint8))
        areas.append(stats[np.asarray(labels)[mask], cv2.CC_STAT_AREA])
    sizes = np.concatenate(areas)
    return float(np.median(sizes)) if len(sizes) else 0.0


def _quantile(ordered: NDArray[np.uint8], contrast: Contrast) -> ImageArray:
    return np.asarray(ordered[round(QUANTILES[contrast] * (len(ordered) - 1))], dtype=np.uint8)


def _difference(image: ImageArray, back: ImageArray, contrast: Contrast) -> Grey:
    if contrast == "any":
        different = cv2.absdiff(image, back).max(axis=2)
    else:
        grey, grey_back = (cv2.cvtColor(part, cv2.COLOR_RGB2GRAY) for part in (image, back))
        different = cv2.subtract(grey, grey_back) if contrast == "bright" else cv2.subtract(grey_back, grey)
    return np.asarray(cv2.GaussianBlur(different, (0, 0), 1.0), dtype=np.uint8)


def _estimated_contrast(ordered: NDArray[np.uint8]) -> Contrast:
    """Whether animals are brighter or darker than what surrounds them.

    Where something moved, the brightest and the darkest value of a pixel are the animal and what lies behind it; what
    lies behind it is the one that is like its surroundings. Where nothing moved, every pixel counts.
    """
    around = _surroundings(_quantile(ordered, "any"))
    moved = _difference(ordered[-1], ordered[0], "bright") > 3 * LEAST
    if moved.sum() < FEWEST:
        moved[:] = True
    bright, dark = _difference(ordered[-1], around, "bright"), _difference(ordered[0], around, "dark")
    sums = [float(part[moved & (part > 3 * LEAST)].sum(dtype=np.float64)) for part in (bright, dark)]
    if max(sums) < ONE_SIDED * sum(sums) or not sum(sums):
        return "any"
    return "bright" if sums[0] > sums[1] else "dark"


def _noise_and_peak(
    images: Sequence[ImageArray], back: ImageArray, surroundings: ImageArray, contrast: Contrast
) -> tuple[float, float]:
    """A difference above the noise, and the contrast of the animals, grey levels."""
    differences = [_difference(image, back, contrast) for image in images] + [_difference(back, surroundings, contrast)]
    noise = max(float(np.median(part)) * 1.4826 for part in differences[:-1])
    least = max(LEAST, NOISE * noise)
    peaks = [float(np.quantile(part[part > least], 0.9)) for part in differences if (part > least).sum() >= FEWEST]
    return least, max(float(np.median(peaks)), peaks[-1]) if peaks else least


def _surroundings(back: ImageArray) -> ImageArray:
    """The median about each pixel of the background, over an area larger than animals."""
    height, width = back.shape[:2]
    scale = 96 / min(height, width)
    small = cv2.resize(back, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else back
    side = 2 * round(SURROUNDINGS * min(small.shape[:2]) / 2) + 1
    return np.asarray(cv2.resize(cv2.medianBlur(small, max(side, 3)), (width, height)), dtype=np.uint8)


def _resting(back: ImageArray, surroundings: ImageArray, contrast: Contrast, core: float, area: float) -> Grey:
    """``(H, W)`` 1 where the background holds regions as distinct and large as the cores of animals."""
    mask = (_difference(back, surroundings, contrast) > core).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    usual = area or usual_area([mask > 0])
    low, high = RESTING[0] * usual, RESTING[1] * usual
    chosen = [n for n in range(1, count) if low <= stats[n, cv2.CC_STAT_AREA] <= high]
    return np.asarray(np.isin(labels, chosen), dtype=np.uint8)


def _filled_up(cores: Grey, mask: NDArray[np.bool_]) -> Grey:
    """``(H, W)`` 1 in the regions of ``mask`` that hold some of ``cores``."""
    _, labels = cv2.connectedComponents(mask.astype(np.uint8))
    held = np.unique(labels[cores > 0])
    return np.asarray(np.isin(labels, held[held > 0]), dtype=np.uint8)


def video_background(source: Source, contrast: Contrast = "auto", threshold: float | None = None) -> Background:
    """The background of a video, from frames spread over it.

    Raises:
        RequestError: the source is live and cannot be played twice.
    """
    if source.live:
        raise RequestError("expected a video that can be played again, got a live source; record it first")
    images: list[ImageArray] = []
    step = 1
    for number, frame in enumerate(source.frames()):
        if number % step:
            continue
        images.append(frame.image)
        if len(images) == 2 * SAMPLED:
            images, step = images[::2], 2 * step
    chosen = np.unique(np.linspace(0, len(images) - 1, SAMPLED).round().astype(int))
    return learn_background([images[n] for n in chosen], contrast, threshold=threshold)
