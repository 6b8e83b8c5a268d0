"""The kernelised correlation filter as a tracker, with scale search; CSK is the same on raw grey values.

Henriques et al., "High-speed tracking with kernelized correlation filters", PAMI 2015; "Exploiting the circulant
structure of tracking-by-detection with kernels", ECCV 2012 (CSK); thesis section 2.2.4.
The score is the greatest response.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from tsuiseki.tracking.filters.kernelised_correlation import (
    ComplexArray,
    FilterBank,
    GaussianKernel,
    blend,
    gaussian_labels,
    respond,
    train,
)
from tsuiseki.tracking.single.response import peak
from tsuiseki.tracking.single.search_windows import Features, WindowShape, window_shape
from tsuiseki.tracking.single.tracker import TargetState, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray

SCALE_WEIGHT = 0.95
"""Factor on the peak of a changed size, at most 1, so that the size does not wander. A background that stands still
around a standing target then holds the size for longer."""


@dataclass(frozen=True)
class KcfSettings:
    """Constants of the filter.

    Attributes:
        padding: side of the search window over the side of the target, > 1.
        template: longer side of the window in template pixels.
        cell: side of a cell in template pixels.
        features: ``hog`` or ``grey``.
        kernel: between windows.
        regularisation: of the ridge regression.
        learning_rate: share of a new frame in the running filter, in [0, 1].
        label_sigma: of the wanted response, as a share of the target's mean side.
        scale_step: ratio of neighbouring sizes that are tried; 1 keeps the size.
        smallest: least relative size.
        largest: greatest relative size.
    """

    padding: float = 2.5
    template: int = 96
    cell: int = 4
    features: Features = "hog"
    kernel: GaussianKernel = field(default_factory=lambda: GaussianKernel(0.6))
    regularisation: float = 1e-4
    learning_rate: float = 0.012
    label_sigma: float = 0.125
    scale_step: float = 1.05
    smallest: float = 0.2
    largest: float = 5.0


THESIS = KcfSettings(scale_step=1.0)
KCF_PAPER = KcfSettings(kernel=GaussianKernel(0.5), learning_rate=0.02, label_sigma=0.1, scale_step=1.0)
CSK = KcfSettings(
    features="grey", cell=1, kernel=GaussianKernel(0.2), learning_rate=0.075, label_sigma=1 / 16, regularisation=1e-2,
    padding=2.0, scale_step=1.0,
)  # fmt: skip


@dataclass(frozen=True)
class Kcf:
    """What is fixed for one target: constants, window and wanted response."""

    settings: KcfSettings
    window: WindowShape
    labels: ComplexArray
    target: FloatArray

    @classmethod
    def of(cls, settings: KcfSettings, width: float, height: float) -> Kcf:
        """For a target of ``width`` x ``height`` pixels in its first frame."""
        window = window_shape(width, height, settings.padding, settings.template, settings.cell, settings.features)
        sigma = np.sqrt(window.rows * window.columns) / settings.padding * settings.label_sigma
        return cls(settings, window, gaussian_labels(window.shape, sigma), np.array([width, height]))

    def learn(self, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> FilterBank:
        """One new filter a place: centres ``(B, 2)`` pixels and relative sizes ``(B,)``."""
        samples = self.window.describe(image, centres, sizes)
        return train(samples, self.labels, self.settings.kernel, self.settings.regularisation)

    def update(self, bank: FilterBank, image: ImageArray, centres: FloatArray, sizes: FloatArray) -> FilterBank:
        """Each filter moved towards what is at its place by the learning rate."""
        return blend(bank, self.learn(image, centres, sizes), self.settings.learning_rate)

    def box(self, centre: FloatArray, size: float) -> FloatArray:
        """``(4,)`` corners."""
        half = self.target * size / 2
        return np.concatenate([centre - half, centre + half])


@dataclass(frozen=True)
class KcfState:
    """Where the target is, and its filter."""

    centre: FloatArray
    size: float
    bank: FilterBank
    peak: float = 1.0


def start(model: Kcf, image: ImageArray, centre: FloatArray) -> KcfState:
    return KcfState(centre, 1.0, model.learn(image, centre[None], np.ones(1)))


def locate(model: Kcf, state: KcfState, image: ImageArray) -> KcfState:
    """The target in the next frame, without learning from it.

    Of the sizes tried the one with the best weighted peak is taken, never two in turn: with one below and one above the
    present size, taking both would change nothing.
    """
    settings = model.settings
    step = settings.scale_step
    sizes = state.size * np.array([1.0, 1 / step, step] if step > 1 else [1.0])
    weights = np.array([1.0, SCALE_WEIGHT, SCALE_WEIGHT])
    windows = model.window.describe(image, np.repeat(state.centre[None], len(sizes), 0), sizes)
    responses = respond(state.bank, windows, settings.kernel)
    best = int(np.argmax(responses.max(axis=(1, 2)) * weights[: len(sizes)]))
    shift, value = peak(responses[best])
    size = float(np.clip(sizes[best], settings.smallest, settings.largest))
    centre = state.centre + shift * model.window.cell_pixels(float(sizes[best]))
    return replace(state, centre=centre, size=size, peak=value)


def step(model: Kcf, state: KcfState, image: ImageArray) -> KcfState:
    found = locate(model, state, image)
    return replace(found, bank=model.update(found.bank, image, found.centre[None], np.array([found.size])))


class KcfTracker:
    """The correlation filter alone.

    Attributes:
        settings: constants.
        lost_below: response at which the target counts as lost; the filter goes on all the same.
    """

    def __init__(self, settings: KcfSettings, lost_below: float = 0.2, seed: int = 0) -> None:
        del seed
        self.settings = settings
        self.lost_below = lost_below

    def start(self, image: ImageArray, box: FloatArray) -> None:
        """See `SingleTracker.start`."""
        width, height = (box[2:] - box[:2]).tolist()
        self._model = Kcf.of(self.settings, width, height)
        self.state = start(self._model, image, box_centre(np.asarray(box)))

    def follow(self, image: ImageArray) -> TargetState:
        """See `SingleTracker.follow`."""
        self.state = step(self._model, self.state, image)
        status = "tracking" if self.state.peak > self.lost_below else "lost"
        return TargetState(self._model.box(self.state.centre, self.state.size), self.state.peak, status)  # type: ignore[arg-type]
