"""The kernelised correlation filter as a tracker, with scale search; CSK is the same on raw grey values.

Henriques et al., "High-speed tracking with kernelized correlation filters", PAMI 2015; "Exploiting the circulant
structure of tracking-by-detection with kernels", ECCV 2012 (CSK); thesis section 2.2.4.
The score is the greatest response.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat
from pydantic.dataclasses import dataclass as pydantic_dataclass

from tsuiseki.tracking.bounds import SETTINGS, Share
from tsuiseki.tracking.features.hog import hog
from tsuiseki.tracking.filters.correlation_filters import (
    ComplexArray,
    FilterBank,
    Float32Array,
    GaussianKernel,
    Samples,
    blend,
    cosine_window,
    gaussian_labels,
    respond,
    train,
    transform,
)
from tsuiseki.tracking.single.search_windows import cut, peak, window_grid
from tsuiseki.tracking.single.tracker import TargetState, box_about, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

# Factor on the peak of a changed size, at most 1, so that the size does not wander. A background that stands still
# around a standing target then holds the size for longer.
SCALE_WEIGHT = 0.95
Features = Literal["hog", "grey"]
# Longer side of the window, template pixels.
TEMPLATE = 96
# Cells along each side of the window; fewer leave no room for a shift.
LEAST_CELLS = 4
# Least size of the target, relative to the first.
SMALLEST = 0.2
# Greatest size of the target, relative to the first.
LARGEST = 5.0
# Response at which the target counts as lost; the filter goes on all the same.
LOST_BELOW = 0.2


@pydantic_dataclass(frozen=True, config=SETTINGS)
class KcfSettings:
    """Constants of the filter.

    Attributes:
        padding: side of the search window over the side of the target, > 1.
        cell: side of a cell in template pixels.
        features: ``hog`` or ``grey``.
        kernel: kernel between two windows.
        regularisation: weight λ of the ridge regression.
        learning_rate: share of a new frame in the running filter, in [0, 1].
        label_sigma: standard deviation of the response to learn, as a share of the target's mean side.
        scale_step: ratio of neighbouring sizes that are tried; 1 keeps the size.
    """

    padding: Annotated[float, Field(gt=1, le=100)] = 2.5
    cell: Annotated[int, Field(ge=1, le=100)] = 4
    features: Features = "hog"
    kernel: GaussianKernel = field(default_factory=lambda: GaussianKernel(0.6))
    regularisation: NonNegativeFloat = 1e-4
    learning_rate: Share = 0.012
    label_sigma: PositiveFloat = 0.125
    scale_step: Annotated[float, Field(ge=1, le=10)] = 1.05


# As thesis section 2.2.4 has it: without a search for sizes.
THESIS = KcfSettings(scale_step=1.0)
# As Henriques et al. 2015 publish it.
KCF_PAPER = KcfSettings(kernel=GaussianKernel(0.5), learning_rate=0.02, label_sigma=0.1, scale_step=1.0)
# As Henriques et al. 2012 publish it: on raw grey values.
CSK = KcfSettings(
    features="grey", cell=1, kernel=GaussianKernel(0.2), learning_rate=0.075, label_sigma=1 / 16, regularisation=1e-2,
    padding=2.0, scale_step=1.0,
)  # fmt: skip


@dataclass(frozen=True)
class Kcf:
    """What is fixed for one target, and how its surroundings map to a grid of cells.

    Attributes:
        settings: constants.
        target: ``(2,)`` first width and height, pixels.
        shape: rows and columns of the window.
        scale: image pixels per template pixel when the target has its first size.
        labels: spectrum of the response to learn.
    """

    settings: KcfSettings
    target: FloatArray
    shape: tuple[int, int]
    scale: float
    labels: ComplexArray

    @classmethod
    def of(cls, settings: KcfSettings, width: float, height: float) -> Kcf:
        """For a target of ``width`` x ``height`` pixels in its first frame.

        The window is ``padding`` times the target. Its longer side is `TEMPLATE` pixels for every target, which keeps
        the cost constant. Both sides are an even number of cells.
        """
        padding = settings.padding
        scale = padding * max(width, height) / TEMPLATE
        rows, columns = (
            max(LEAST_CELLS, 2 * round(padding * side / (2 * settings.cell * scale))) for side in (height, width)
        )
        sigma = np.sqrt(rows * columns) / padding * settings.label_sigma
        labels = gaussian_labels((rows, columns), sigma)
        return cls(settings, np.array([width, height]), (rows, columns), scale, labels)

    @cached_property
    def taper(self) -> Float32Array:
        """The cosine window."""
        return cosine_window(self.shape)

    def cell_pixels(self, size: float) -> float:
        """Side of a cell in image pixels for a target of relative ``size``."""
        return self.settings.cell * self.scale * size

    def features_at(
        self, image: ImageArray, centres: FloatArray, sizes: FloatArray, shape: tuple[int, int]
    ) -> Float32Array:
        """``(B, C, *shape)`` features of windows of ``shape`` cells, without the cosine window."""
        cell, hogs = self.settings.cell, self.settings.features == "hog"
        border = 2 if hogs else 0  # the outermost cells only normalise
        height, width = ((count + border) * cell for count in shape)
        patches = cut(image, centres, self.scale * np.asarray(sizes), width, height)
        return hog(patches, cell) if hogs else _grey(patches, cell)

    def describe(self, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> Samples:
        """Samples of the windows around ``centres`` ``(B, 2)`` for targets of relative ``sizes`` ``(B,)``."""
        return transform(self.features_at(image, centres, sizes, self.shape) * self.taper)

    def describe_around(
        self, image: ImageArray, centre: FloatArray, size: float, reach: int
    ) -> tuple[Samples, FloatArray]:
        """Samples of overlapping windows on a grid about ``centre``, described once where they overlap.

        Args:
            image: ``(H, W, C)`` uint8.
            centre: ``(2,)`` of the middle window, pixels.
            size: relative size of the target.
            reach: windows to each side; 1 gives 3 x 3. They stand a target's side apart.

        Returns:
            The windows, the middle one first, and their centres ``((2 reach + 1)^2, 2)``.
        """
        rows, columns = self.shape
        step = np.maximum(np.round(np.array([columns, rows]) * (1 / self.settings.padding)).astype(int), 1)
        wide, high = (np.array([columns, rows]) + 2 * reach * step).tolist()
        everything = self.features_at(image, centre[None], np.array([size]), (high, wide))[0]
        grid = window_grid(reach)
        windows = np.stack([everything[:, y : y + rows, x : x + columns] for x, y in (grid + reach) * step])
        return transform(windows * self.taper), centre + grid * step * self.cell_pixels(size)

    def learn(self, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> FilterBank:
        """One new filter a place: centres ``(B, 2)`` pixels and relative sizes ``(B,)``."""
        samples = self.describe(image, centres, sizes)
        return train(samples, self.labels, self.settings.kernel, self.settings.regularisation)

    def update(self, bank: FilterBank, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> FilterBank:
        """Each filter moved towards what is at its place by the learning rate."""
        return blend(bank, self.learn(image, centres, sizes), self.settings.learning_rate)

    def box(self, centre: FloatArray, size: float) -> FloatArray:
        """``(4,)`` corners of the target at a centre ``(2,)``, pixels, and a scale."""
        return box_about(centre, self.target * size)


def _grey(patches: ImageArray, cell: int) -> Float32Array:
    """``(B, 1, H/cell, W/cell)`` brightness in [-0.5, 0.5]."""
    planes = [cv2.cvtColor(patch, cv2.COLOR_RGB2GRAY) if patch.ndim == 3 else patch for patch in patches]
    grey = np.stack(planes).astype(np.float32) / 255 - 0.5
    count, height, width = grey.shape
    means = grey.reshape(count, 1, height // cell, cell, width // cell, cell).mean(axis=(3, 5), dtype=np.float32)
    return np.asarray(means)


@dataclass(frozen=True)
class KcfState:
    """Where the target is, and its filter."""

    centre: FloatArray
    size: float
    bank: FilterBank
    peak: float = 1.0


def start(model: Kcf, image: ImageArray, centre: FloatArray) -> KcfState:
    """The target of the first frame."""
    return KcfState(centre, 1.0, model.learn(image, centre[None], np.ones(1)))


def locate(model: Kcf, state: KcfState, image: ImageArray) -> KcfState:
    """The target in the next frame, without learning from it.

    Of the sizes tried the one with the best weighted peak is taken, never two in turn: with one below and one above the
    present size, taking both would change nothing.
    """
    step = model.settings.scale_step
    sizes = state.size * np.array([1.0, 1 / step, step] if step > 1 else [1.0])
    weights = np.array([1.0, SCALE_WEIGHT, SCALE_WEIGHT])
    windows = model.describe(image, np.repeat(state.centre[None], len(sizes), 0), sizes)
    responses = respond(state.bank, windows, model.settings.kernel)
    best = int(np.argmax(responses.max(axis=(1, 2)) * weights[: len(sizes)]))
    shift, value = peak(responses[best])
    size = float(np.clip(sizes[best], SMALLEST, LARGEST))
    centre = state.centre + shift * model.cell_pixels(float(sizes[best]))
    return replace(state, centre=centre, size=size, peak=value)


def step(model: Kcf, state: KcfState, image: ImageArray) -> KcfState:
    """The target in the next frame, and its filter after learning there."""
    there = locate(model, state, image)
    return replace(there, bank=model.update(there.bank, image, there.centre[None], np.array([there.size])))


class KcfTracker:
    """The correlation filter alone.

    Attributes:
        settings: constants.
    """

    def __init__(self, settings: KcfSettings) -> None:
        self.settings = settings

    def start(self, image: ImageArray, box: FloatArray) -> None:
        width, height = (box[2:] - box[:2]).tolist()
        self._model = Kcf.of(self.settings, width, height)
        self.state = start(self._model, image, box_centre(np.asarray(box)))

    def follow(self, image: ImageArray) -> TargetState:
        self.state = step(self._model, self.state, image)
        box = self._model.box(self.state.centre, self.state.size)
        return TargetState(box, self.state.peak, "tracking" if self.state.peak > LOST_BELOW else "lost")
