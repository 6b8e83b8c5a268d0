"""One object of a known colour in video, by a particle filter that looks at the image; finite-sets paper, section 6."""

from __future__ import annotations

import numpy as np

from tsuiseki.tracking.features.colour_region import ColourImage, ColourRange, region_contrast
from tsuiseki.tracking.filters.base import bootstrap
from tsuiseki.tracking.filters.finite_sets.region_births import AnywhereBirths, ExplainedImage
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import boxes_of
from tsuiseki.tracking.filters.motion.points import SteppingBox
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.particles.resampling import weighted_mean
from tsuiseki.tracking.points.settings import BlobSettings
from tsuiseki.tracking.types import Estimate, FloatArray, Frame, Status, Targets, Track


class SingleBlobTracker:
    """Follows one object of a colour, (63)-(68), and searches the whole image again when it is lost.

    Args:
        colour: its.
        settings: see `BlobSettings`.
        seed: of the particles.
    """

    def __init__(self, colour: ColourRange, settings: BlobSettings | None = None, seed: int = 0) -> None:
        self.colour = colour
        self.settings = settings or BlobSettings(preset="single")
        self.rng = np.random.default_rng(seed)
        self.estimates: list[Estimate] = []
        self._unseen = 0
        self._state: ParticleState | None = None
        motion = SteppingBox(self.settings.place_noise, self.settings.size_noise, self.settings.smallest)
        self._filter: ParticleFilter[ColourImage] = ParticleFilter(bootstrap(motion), self._log_likelihood)

    def update(self, frame: Frame) -> Targets:
        """Take the next frame; the target in it, with the id 1."""
        image = ColourImage.of(frame.image, self.colour)
        before = self._state if self._state is not None else self._anywhere(image)
        state, _ = self._filter.step(before, image, self.rng)
        mean = weighted_mean(state.particles, state.log_weights)
        box = boxes_of(mean[None])
        score = float(region_contrast(image, box, self.settings.margin)[0])
        self._unseen = 0 if score >= self.settings.lost_below else self._unseen + 1
        status: Status = "tracking" if self._unseen == 0 else "searching"
        if self._unseen > self.settings.patience:
            status = "lost"
        # A search that found nothing begins anew from (13): particles that stay where nothing is would never find it.
        self._state = None if status == "lost" or (self._unseen and not self._was_tracking()) else state
        self.estimates.append(Estimate(frame.index, box[0], score, status))
        return Targets(frame.index, np.array([1]), box, np.array([score]), np.array([status]))

    def tracks(self) -> list[Track]:
        """The frames where the target was followed, as one track."""
        seen = [estimate for estimate in self.estimates if estimate.status == "tracking"]
        if not seen:
            return []
        frames = np.array([estimate.frame for estimate in seen])
        boxes, scores = np.array([e.box for e in seen]), np.array([e.score for e in seen])
        return [Track(1, frames, boxes, scores)]

    def _was_tracking(self) -> bool:
        return any(estimate.status == "tracking" for estimate in self.estimates[-self.settings.patience :])

    def _anywhere(self, image: ColourImage) -> ParticleState:
        """Particles of (13), uniform over the image; four times as many, to find a small target."""
        births = AnywhereBirths(mass=1.0, count=4 * self.settings.particles, size=self.settings.size)
        return self._filter.init(births.draw(ExplainedImage(image, np.empty((0, 4))), self.rng).particles)

    def _log_likelihood(self, particles: FloatArray, observation: ColourImage) -> FloatArray:
        """Logarithm of (68), sharpened; a region without the colour is unlikely, not impossible."""
        contrast = region_contrast(observation, boxes_of(particles), self.settings.margin)
        return np.asarray(self.settings.sharpness * np.log(np.maximum(contrast, 1e-3)))
