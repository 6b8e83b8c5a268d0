"""What the particles of a search see of a frame, and how likely it makes each of them, thesis 3.2.3 and 3.2.5.

The text leaves these points open; here:

* (3.4) adds r and v with the shares alpha and 1 - alpha. A search begins where every response is at most epsilon_1 =
  0.2, and v is about 0.5 nearly everywhere. So r as it comes out of the filter adds 0.06 of 0.41 at most, and v alone
  decides. `THESIS` therefore divides r by the greatest response of the frame; `PRINTED` does not.
* (3.5): the displacement is measured from the tracker's box in the frame before, for all particles. So one window
  serves all filters, and one batched transform gives all responses. Outside the window the response is zero. With
  ``windows_of`` "particles" it is measured from where each particle was, in a window of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.features.objectness import ObjectnessModel, propose
from tsuiseki.tracking.filters.correlation.kernelised_correlation import FilterBank, Samples, respond
from tsuiseki.tracking.single import kcf
from tsuiseki.tracking.single.confidence import Confidence
from tsuiseki.tracking.single.kcf_particle_settings import KcfParticleSettings
from tsuiseki.tracking.single.peaks import local_maxima
from tsuiseki.tracking.single.response import ResponseMaps, log_likelihood, object_overlap
from tsuiseki.tracking.types import FloatArray, ImageArray

PROPOSALS = 100
LEAST_RESPONSE = 1e-6
Windows = tuple[Samples, FloatArray]
"""What is in the windows of a frame, and their centres ``(W, 2)`` in pixels."""


@dataclass(frozen=True)
class SearchView:
    """What the particles see of one frame.

    Attributes:
        maps: responses of the filters.
        image: ``(H, W, 3)``.
        proposals: ``(K, 4)`` boxes near the windows that look like an object.
        bank: the filters.
    """

    maps: ResponseMaps
    image: ImageArray
    proposals: FloatArray
    bank: FilterBank


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
        return SearchView(self.maps(windows, bank, size), image, proposals, bank)

    def log_likelihood(self, particles: FloatArray, view: SearchView, size: float, known: Confidence) -> FloatArray:
        """``(N,)`` equation (3.4), sharpened and joined with the colours where the settings say so.

        Args:
            particles: ``(N, 3)`` x, y and number of a filter; or ``(N, 5)``, where each was in the frame before last.
            view: of the frame.
            size: of the target, relative to the first.
            known: the target's colours, and how much like them it usually is.
        """
        settings = self.settings
        half = self.model.target * size / 2
        boxes = np.concatenate([particles[:, :2] - half, particles[:, :2] + half], axis=1)
        own = particles.shape[1] > 3
        numbers = particles[:, 2].astype(np.int64)
        response = self._in_own_windows(particles, view, size) if own else view.maps.at(particles[:, :2], numbers)
        if settings.response_scale == "greatest":
            greatest = max(float(view.maps.maps.max()), float(response.max()) if own else 0.0)
            response = response / max(greatest, LEAST_RESPONSE)
        overlap = object_overlap(boxes, view.proposals) if self.objects is not None else np.zeros(len(boxes))
        result = log_likelihood(response, overlap, settings.response_share)
        if settings.colour and known.colour is not None:
            score = known.colour.score(view.image, boxes)
            usual = known.colours.mean if known.colours.mean is not None else float(score.max())
            result += settings.colour * np.minimum(score - usual, 0)
        return settings.sharpness * result

    def _in_own_windows(self, particles: FloatArray, view: SearchView, size: float) -> FloatArray:
        """``(N,)`` r of (3.5), each in the window about where the particle was."""
        before, which = np.unique(particles[:, 3:], axis=0, return_inverse=True)
        samples = self.model.window.describe(view.image, before, np.full(len(before), size))
        cell, found = self.model.window.cell_pixels(size), np.zeros(len(particles))
        for k in range(len(before)):
            rows = np.flatnonzero(which == k)
            used, numbers = np.unique(particles[rows, 2].astype(np.int64), return_inverse=True)
            maps = respond(view.bank.select(used), samples.select(slice(k, k + 1)), self.settings.kcf.kernel)
            found[rows] = ResponseMaps(maps[None], before[k : k + 1], cell).at(particles[rows, :2], numbers)
        return found


def highest_maxima(maps: ResponseMaps, count: int) -> tuple[FloatArray, FloatArray]:
    """``(M, 2)`` places of the highest maxima of the first filter's responses and their ``(M,)`` heights.

    The highest come first; there are none where it is flat.
    """
    places, values = [], []
    for k, centre in enumerate(maps.centres):
        shifts, heights = local_maxima(maps.maps[k, 0], count)
        found = centre + shifts * maps.cell
        # Windows overlap: a maximum counts in the window whose centre is nearest.
        nearest = np.argmin(((found[:, None] - maps.centres[None]) ** 2).sum(axis=2), axis=1)
        places.append(found[nearest == k])
        values.append(heights[nearest == k])
    order = np.argsort(-np.concatenate(values), kind="stable")[:count]
    return np.asarray(np.concatenate(places)[order]), np.asarray(np.concatenate(values)[order], dtype=np.float64)
