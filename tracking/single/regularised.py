"""A correlation filter with memory, colours and a filter over sizes: the filter of the combined tracker.

It has three parts, each published on its own:

* where the target is: a filter of the target alone in a wide window (`filters.correlation_filters`: Li
  2018, Galoogahi 2017);
* the colours of its pixels (`colours.PixelColour`: Bertinetto 2016);
* how large it is: a filter over sizes (`filters.scale_filter`: Danelljan 2014).

The response of a place is

    (1 - share) * filter + share * mean colour probability.

The response of a size is that of the filter over sizes, and the contrast of colours between the box and a frame around
it. A box holds outstretched arms and legs, and the contrast is greatest for less than the box; how much less is
measured in the first frame. The filter over sizes learns what it has found, and sees sizes up to a sixth away. Where
the size is further off, it confirms itself for good. The colours see further: the size follows them to one far from the
present one that they want for several frames in a row. Where they tell the target's pixels clearly, their number tells
the size (the zeroth moment: Bradski 1998), whatever the target's outline does. Else a peak of their contrast does, and
the filter of places has to agree. Nothing is trained.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import cv2
import numpy as np
import scipy.fft
from pydantic import Field
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.features.hog import hog
from tsuiseki.tracking.filters.correlation_filters import (
    ComplexArray,
    Float32Array,
    Support,
    cosine_window,
    gaussian_labels,
    learn,
    regularised_response,
)
from tsuiseki.tracking.filters.scale_filter import ScaleFilter, best_offset, far_area, far_peak
from tsuiseki.tracking.single.colours import PixelColour, coloured_area, shift_response, size_contrast
from tsuiseki.tracking.single.search_windows import SizeLadder, SizeSample, cut, peak
from tsuiseki.tracking.single.tracker import TargetState, box_about, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

# Side of a cell, template pixels.
CELL = 4
# Side of the square window over the geometric mean of the target's sides.
PADDING = 3.0
# Cells along the longer side of the window.
CELLS = 24
# Cells along each side of the window; fewer leave no room for a shift.
LEAST_CELLS = 4
# Standard deviation of the response to learn, as a share of the geometric mean of the target's sides.
LABEL_SIGMA = 1 / 16
# Share of a new frame in the histograms, in [0, 1].
COLOUR_SHARE_LEARNT = 0.04
# Greatest factor on the size in a frame.
SIZE_CHANGE = 1.06
# Least size, relative to the first.
SMALLEST = 0.2
# Greatest size, relative to the first.
LARGEST = 5.0
# Share of a new frame in the size filter, in [0, 1].
SIZE_RATE = 0.025
# Likewise while the size follows one far away.
SIZE_RELEARNING = 0.2
# Weight of the contrast of colours beside the size filter's response.
SIZE_COLOUR = 2.0
# Area of the template of the size filter, pixels.
SIZE_AREA = 512.0
# Ratio of neighbouring sizes.
SIZE_STEP = 1.03
# Steps of size from which a size is far from the present one.
FAR = 4
# Steps of size to each side in which the first frame's contrast is searched.
WIDEST = 8
# How much greater the contrast of colours must be at a far size.
SIZE_MARGIN = 0.03
# For how many frames in a row the contrast must be greater on the same side.
SIZE_PATIENCE = 5
# Steps of size to each side that the colours search.
SIZE_REACH = 24
# Least response of places at a far size, as a share of the present one.
SIZE_AGREEMENT = 0.95
# Contrast of colours from which the number of the target's pixels gives the size.
SIZE_BY_AREA = 0.45
# Share of the first frame's calibration of the contrast that is used.
CALIBRATION = 0.5
# Response under which the target of the filter alone counts as lost; the filter goes on all the same.
LOST_BELOW = 0.25


@pydantic_dataclass(frozen=True, config=SETTINGS)
class RegularisedSettings:
    """Constants.

    Attributes:
        colour_share: share of the colours in the response of a place, in [0, 1].
        sizes: number of sizes tried in a frame, odd; 1 keeps the first size.
    """

    colour_share: Share = 0.3
    sizes: Annotated[int, Field(ge=1, le=99)] = 11


@dataclass(frozen=True)
class Model:
    """What is fixed for one target.

    Attributes:
        settings: constants.
        target: ``(2,)`` first width and height, pixels.
        scale: image pixels per template pixel at the first size.
        shape: rows and columns of the window, cells.
        taper: ``shape`` cosine window.
        labels: spectrum of the response to learn.
        support: the target's cells.
        to_centre: ``(rows, 2 * (columns // 2 + 1))`` signs of real and imaginary parts that bring a window's middle
            to shift zero.
        ladder: of sizes.
    """

    settings: RegularisedSettings
    target: FloatArray
    scale: float
    shape: tuple[int, int]
    taper: Float32Array
    labels: ComplexArray
    support: Support
    to_centre: Float32Array
    ladder: SizeLadder

    @classmethod
    def of(cls, settings: RegularisedSettings, width: float, height: float) -> Model:
        """For a target of ``width`` x ``height`` pixels in its first frame."""
        target = np.array([width, height], dtype=np.float64)
        # A square window: thin targets move as far sideways as lengthwise. It always holds the target.
        sides = np.maximum(PADDING * np.sqrt(width * height), 1.5 * target)
        scale = float(sides.max()) / (CELLS * CELL)
        columns, rows = (max(LEAST_CELLS, 2 * round(float(side) / (2 * CELL * scale))) for side in sides)
        wide, high = target / (scale * CELL)
        # Half a window of an even number of cells is half a turn of every odd frequency.
        signs = 1 - 2 * ((np.arange(rows)[:, None] + np.arange(columns // 2 + 1)) % 2)
        template = np.maximum(np.round(target * np.sqrt(SIZE_AREA / target.prod()) / CELL), 2) * CELL
        return cls(
            settings,
            target,
            scale,
            (rows, columns),
            cosine_window((rows, columns)),
            gaussian_labels((rows, columns), float(np.sqrt(wide * high)) * LABEL_SIGMA),
            Support.of((rows, columns), float(high), float(wide)),
            np.repeat(signs, 2, axis=1).astype(np.float32),
            SizeLadder(target, template.astype(np.int64), CELL, SIZE_STEP, settings.sizes),
        )

    @property
    def sides(self) -> tuple[float, float]:
        """Width and height of the target in template pixels."""
        width, height = (self.target / self.scale).tolist()
        return width, height

    def cell_pixels(self, size: float) -> float:
        """Side of a cell in image pixels for a target of relative ``size``."""
        return CELL * self.scale * size

    def box(self, centre: FloatArray, size: float) -> FloatArray:
        """``(4,)`` corners of the target at a centre ``(2,)``, pixels, and a scale."""
        return box_about(centre, self.target * size)

    def patch(self, image: ImageArray, centre: FloatArray, size: float) -> ImageArray:
        """``(H, W, 3)`` template pixels of the window around ``centre``, with a border of one cell."""
        rows, columns = self.shape
        width, height = (columns + 2) * CELL, (rows + 2) * CELL
        return np.asarray(cut(image, centre[None], np.array([self.scale * size]), width, height)[0])

    def describe(self, patches: Sequence[ImageArray]) -> ComplexArray:
        """``(B, 32, rows, columns // 2 + 1)`` spectra of gradients and brightness, target at shift zero."""
        rows, columns = self.shape
        brightness = np.empty((len(patches), 1, rows, columns), dtype=np.float32)
        for patch, means in zip(patches, brightness, strict=True):
            grey = cv2.cvtColor(patch, cv2.COLOR_RGB2GRAY)[CELL:-CELL, CELL:-CELL].astype(np.float32) / 255 - 0.5
            means[0] = cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_AREA)  # means of cells
        features = np.concatenate([hog(np.stack(patches), CELL), brightness], axis=1)
        features *= self.taper
        for window in features:
            window *= np.float32(1 / np.sqrt(np.vdot(window, window) / window.size + 1e-9))
        spectra = scipy.fft.rfft2(features)
        spectra.view(np.float32)[:] *= self.to_centre
        return np.asarray(spectra)

    def colour_response(self, colour: PixelColour, patch: ImageArray) -> Float32Array:
        """``shape``: `colours.shift_response` of a patch."""
        return shift_response(colour.probabilities(patch), *self.sides, self.shape, CELL)


@dataclass(frozen=True)
class RegularisedTarget:
    """Where the target is, and what is known of it.

    Attributes:
        centre: ``(2,)`` pixels.
        size: relative to the first.
        filters: see `correlation_filters.learn`.
        colour: of its pixels.
        sizes: the size filter; None where one size is tried.
        contrast_at: where the colours' contrast was greatest in the first frame, over the size of the box there.
        peak: response at ``centre``, colours included.
        colour_score: mean colour probability at ``centre``, in [0, 1].
        sample: what `resize` compared, for the `update` of the same frame; None else.
        insisted: for how many frames in a row the colours have wanted a far larger size; negative: a far smaller one.
        area: of the target's colours in the first frame, see `colours.coloured_area`.
    """

    centre: FloatArray
    size: float
    filters: ComplexArray
    colour: PixelColour
    sizes: ScaleFilter | None
    contrast_at: float = 1.0
    peak: float = 1.0
    colour_score: float = 1.0
    sample: SizeSample | None = None
    insisted: int = 0
    area: float = 1.0


def start(model: Model, image: ImageArray, centre: FloatArray) -> RegularisedTarget:
    """The target of the first frame."""
    patch = model.patch(image, centre, 1.0)
    filters = learn(model.describe([patch])[0], model.labels, model.support, None)
    sizes = ScaleFilter.learn(model.ladder.sample(image, centre, 0)) if model.settings.sizes > 1 else None
    colour = PixelColour.learn(patch, *model.sides)
    factors = SIZE_STEP ** np.arange(-WIDEST, WIDEST + 1.0)
    probabilities = colour.probabilities(patch)
    contrast = size_contrast(probabilities, *model.sides, factors)
    contrast_at = SIZE_STEP ** (CALIBRATION * best_offset(contrast))
    area = max(coloured_area(probabilities, *model.sides), 1.0)
    return RegularisedTarget(centre, 1.0, filters, colour, sizes, contrast_at, area=area)


def responses(model: Model, target: RegularisedTarget, image: ImageArray) -> tuple[Float32Array, Float32Array]:
    """Responses ``(rows, columns)`` of places about the target over cyclic shifts, and the colours' share alone."""
    patch = model.patch(image, target.centre, target.size)
    colours = model.colour_response(target.colour, patch)
    filtered = regularised_response(target.filters, model.describe([patch])[0], model.shape)
    return _joined(model, filtered, colours), colours


def responses_at(
    model: Model, target: RegularisedTarget, image: ImageArray, centres: FloatArray, bank: ComplexArray
) -> Float32Array:
    """Responses over cyclic shifts in several windows.

    Args:
        model: of the target.
        target: gives size and colours.
        image: the frame.
        centres: ``(W, 2)`` of the windows, pixels.
        bank: ``(K, D, rows, columns // 2 + 1)`` filters.

    Returns:
        ``(W, K, rows, columns)``.
    """
    patches = [model.patch(image, centre, target.size) for centre in centres]
    colours = np.stack([model.colour_response(target.colour, patch) for patch in patches])
    filtered = np.stack([regularised_response(bank, window, model.shape) for window in model.describe(patches)])
    return _joined(model, filtered, colours[:, None])


def _joined(model: Model, filtered: Float32Array, colours: Float32Array) -> Float32Array:
    """The responses of filters and the mean colour probabilities, in one response."""
    share = np.float32(model.settings.colour_share)
    return np.asarray((1 - share) * filtered + share * colours)


def locate(model: Model, target: RegularisedTarget, image: ImageArray) -> RegularisedTarget:
    """The target in the next frame, without learning from it."""
    response, colours = responses(model, target, image)
    shift, value = peak(response)
    column, row = np.round(shift).astype(int)
    extent = np.array([image.shape[1], image.shape[0]], dtype=np.float64)
    centre = np.clip(target.centre + shift * model.cell_pixels(target.size), 0, extent)
    moved = replace(target, centre=centre, peak=value, colour_score=float(colours[row, column]))
    return resize(model, moved, image)


def resize(model: Model, target: RegularisedTarget, image: ImageArray) -> RegularisedTarget:
    """The target at the size that fits best at its place."""
    if target.sizes is None:
        return target
    middle = round(model.ladder.level(target.size))
    sampled = model.ladder.sample(image, target.centre, middle)
    probabilities = target.colour.probabilities(model.patch(image, target.centre, target.size))
    near = model.settings.sizes // 2
    factors = SIZE_STEP ** (middle + np.arange(-SIZE_REACH, SIZE_REACH + 1.0)) / target.size * target.contrast_at
    contrast = size_contrast(probabilities, *model.sides, factors)
    contrast_near = contrast[SIZE_REACH - near : SIZE_REACH + near + 1]
    best = best_offset(target.sizes.respond(sampled) + SIZE_COLOUR * contrast_near)
    clear = contrast_near.max() >= SIZE_BY_AREA
    if clear:
        area = coloured_area(probabilities, *model.sides)
        far = far_area(area / target.area, SIZE_STEP, FAR)
    else:
        far = far_peak(contrast, FAR, SIZE_MARGIN)
    side = int(np.sign(far))
    insisted = target.insisted + side if side * target.insisted > 0 else side
    if abs(insisted) >= SIZE_PATIENCE:
        step = float(np.clip(far, -near, near))
        best, insisted = (far, insisted) if clear or _agrees(model, target, image, step) else (best, 0)
    factor = SIZE_STEP ** (middle + best) / target.size
    size = target.size * float(np.clip(factor, 1 / SIZE_CHANGE, SIZE_CHANGE))
    size = float(np.clip(size, SMALLEST, LARGEST))
    return replace(target, size=size, sample=sampled, insisted=insisted)


def _agrees(model: Model, target: RegularisedTarget, image: ImageArray, step: float) -> bool:
    """Whether the filter of places responds so many steps of size away nearly as much as at the present size."""
    there = replace(target, size=target.size * SIZE_STEP**step)
    present, away = (peak(responses(model, candidate, image)[0])[1] for candidate in (target, there))
    return away >= SIZE_AGREEMENT * present


def update(model: Model, target: RegularisedTarget, image: ImageArray) -> RegularisedTarget:
    """The target after learning from where it is."""
    patch = model.patch(image, target.centre, target.size)
    colour = target.colour.blend(PixelColour.learn(patch, *model.sides), COLOUR_SHARE_LEARNT)
    filters = learn(model.describe([patch])[0], model.labels, model.support, target.filters)
    sizes = target.sizes
    if sizes is not None:
        level = model.ladder.level(target.size)
        sample = model.ladder.sample(image, target.centre, round(level), target.sample)
        new = ScaleFilter.learn(sample, level - round(level))
        insists = abs(target.insisted) >= SIZE_PATIENCE
        sizes = sizes.blend(new, SIZE_RELEARNING if insists else SIZE_RATE)
    return replace(target, filters=filters, colour=colour, sizes=sizes, sample=None)


class RegularisedTracker:
    """The filter alone; the score is the response at the target.

    Attributes:
        settings: constants.
        target: where the target is.
    """

    def __init__(self, settings: RegularisedSettings | None = None) -> None:
        self.settings = settings or RegularisedSettings()

    def start(self, image: ImageArray, box: FloatArray) -> None:
        width, height = (box[2:] - box[:2]).tolist()
        self._model = Model.of(self.settings, width, height)
        self.target = start(self._model, image, box_centre(np.asarray(box)))

    def follow(self, image: ImageArray) -> TargetState:
        self.target = update(self._model, locate(self._model, self.target, image), image)
        box = self._model.box(self.target.centre, self.target.size)
        return TargetState(box, self.target.peak, "tracking" if self.target.peak > LOST_BELOW else "lost")
