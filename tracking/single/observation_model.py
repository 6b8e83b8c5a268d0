"""What the particles of a search see of a frame, and how likely it makes each of them, thesis 3.2.3 and 3.2.5.

In (3.5) the displacement is measured from the tracker's box in the frame before, for all particles. So one window
serves all filters, and one batched transform gives all responses. Outside the window the response is zero.

`Confidence` says when the correlation filter is in doubt, 3.2.2, with two more reasons to doubt.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, propose
from tsuiseki.tracking.filters.correlation.kernelised_correlation import FilterBank, Samples, respond
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.colours import ForegroundColour
from tsuiseki.tracking.single.constants import KcfParticleSettings
from tsuiseki.tracking.single.response import ResponseMaps, local_maxima, log_likelihood, object_overlap
from tsuiseki.tracking.types import FloatArray, ImageArray

COLOUR_RATE = 0.04  # of learning new colours, a look


@dataclass(frozen=True)
class RunningMean:
    """A running mean, plain over the first values, and how a new value compares to it."""

    rate: float = 0.05
    mean: float | None = None
    count: int = 0

    def add(self, value: float) -> RunningMean:
        """With one more value."""
        share = max(self.rate, 1 / (self.count + 1))
        return RunningMean(
            self.rate, value if self.mean is None else self.mean + share * (value - self.mean), self.count + 1
        )

    def falls_below(self, share: float, value: float) -> bool:
        """Whether ``value`` is less than ``share`` of the mean so far."""
        return self.mean is not None and value < share * self.mean


@dataclass(frozen=True)
class Confidence:
    """What the target looked like while it was tracked without doubt.

    Attributes:
        peaks: responses, a frame each.
        colours: colour scores, a look each.
        colour: the colours themselves; None where they are not used or where a box covers the whole image.
    """

    peaks: RunningMean = RunningMean()
    colours: RunningMean = RunningMean(rate=0.1)
    colour: ForegroundColour | None = None

    @classmethod
    def start(cls, settings: KcfParticleSettings, image: ImageArray, box: FloatArray) -> Confidence:
        """From the first frame."""
        wanted = settings.colour or settings.drift_switch
        return cls(colour=ForegroundColour.learn(image, box) if wanted else None)

    def doubts(self, settings: KcfParticleSettings, peak: float, colour: float | None) -> bool:
        """Whether the particle filter takes over, or goes on.

        Args:
            settings: hold the thresholds.
            peak: response of the filter at the target.
            colour: colour score there; None where nobody looked.
        """
        if peak <= settings.switch or self.peaks.falls_below(settings.relative_switch, peak):
            return True
        return colour is not None and self.colours.falls_below(settings.drift_switch, colour)

    def learn(self, image: ImageArray, box: FloatArray, peak: float, colour: float | None) -> Confidence:
        """With one more frame without doubt; ``peak`` and ``colour`` as `doubts` had them."""
        after = replace(self, peaks=self.peaks.add(peak))
        if self.colour is None or colour is None:
            return after
        new = ForegroundColour.learn(image, box)
        return replace(
            after,
            colours=self.colours.add(colour),
            colour=self.colour if new is None else self.colour.blend(new, COLOUR_RATE),
        )

    def colour_score(self, image: ImageArray, box: FloatArray) -> float:
        """Of one box ``(4,)``; 1 where colours are not used."""
        return 1.0 if self.colour is None else float(self.colour.score(image, box[None])[0])


PROPOSALS = 100
Windows = tuple[Samples, FloatArray]
"""What is in the windows of a frame, and their centres ``(W, 2)`` in pixels."""


@dataclass(frozen=True)
class SearchView:
    """What the particles see of one frame.

    Attributes:
        maps: responses of the filters.
        image: ``(H, W, 3)``.
        proposals: ``(K, 4)`` boxes near the windows that look like an object.
    """

    maps: ResponseMaps
    image: ImageArray
    proposals: FloatArray


@dataclass(frozen=True)
class ObservationModel:
    """How a frame is looked at in a search.

    Attributes:
        settings: constants.
        model: of the correlation filters.
        objects: objectness of sizes near the target's; None where the settings give it no share.
    """

    settings: KcfParticleSettings
    model: kcf.Kcf
    objects: ObjectnessModel | None

    def windows(self, image: ImageArray, target: kcf.KcfState, reach: int) -> Windows:
        """The window about ``target``, and ``reach`` more to each side of it."""
        if reach == 0:
            return self.model.window.describe(image, target.centre[None], np.array([target.size])), target.centre[None]
        return self.model.window.describe_around(image, target.centre, target.size, reach)

    def maps(self, windows: Windows, bank: FilterBank, size: float) -> ResponseMaps:
        """Responses of all filters in all windows, for a target of relative ``size``."""
        samples, centres = windows
        kernel = self.settings.kcf.kernel
        maps = np.stack([respond(bank, samples.select(slice(k, k + 1)), kernel) for k in range(len(centres))])
        return ResponseMaps(maps, centres, self.model.window.cell_pixels(size))

    def view(self, image: ImageArray, windows: Windows, bank: FilterBank, size: float) -> SearchView:
        """Responses of the filters, and what looks like an object near the windows."""
        proposals, centres = np.empty((0, 4)), windows[1]
        if self.objects is not None:
            half = self.model.target * size * self.settings.kcf.padding / 2
            region = np.concatenate([centres.min(axis=0) - half, centres.max(axis=0) + half])
            proposals, _ = propose(image, self.objects, PROPOSALS, region)
        return SearchView(self.maps(windows, bank, size), image, proposals)

    def log_likelihood(self, particles: FloatArray, view: SearchView, size: float, known: Confidence) -> FloatArray:
        """``(N,)`` equation (3.4), sharpened and joined with the colours where the settings say so.

        Args:
            particles: ``(N, 3)`` x, y and number of a filter.
            view: of the frame.
            size: of the target, relative to the first.
            known: the target's colours, and how much like them it usually is.
        """
        settings = self.settings
        half = self.model.target * size / 2
        boxes = np.concatenate([particles[:, :2] - half, particles[:, :2] + half], axis=1)
        response = view.maps.at(particles[:, :2], particles[:, 2].astype(np.int64))
        overlap = object_overlap(boxes, view.proposals) if self.objects is not None else np.zeros(len(boxes))
        result = log_likelihood(response, overlap, settings.response_share)
        if settings.colour and known.colour is not None:
            score = known.colour.score(view.image, boxes)
            usual = known.colours.mean if known.colours.mean is not None else float(score.max())
            result += settings.colour * np.minimum(score - usual, 0)
        return settings.sharpness * result


def highest_maxima(maps: ResponseMaps, count: int) -> FloatArray:
    """``(M, 2)`` places of the first filter's highest maxima, the highest first; none where it is flat."""
    places, values = [], []
    for k, centre in enumerate(maps.centres):
        shifts, heights = local_maxima(maps.maps[k, 0], count)
        found = centre + shifts * maps.cell
        # Windows overlap: a maximum counts in the window whose centre is nearest.
        nearest = np.argmin(((found[:, None] - maps.centres[None]) ** 2).sum(axis=2), axis=1)
        places.append(found[nearest == k])
        values.append(heights[nearest == k])
    order = np.argsort(-np.concatenate(values), kind="stable")[:count]
    return np.asarray(np.concatenate(places)[order])
