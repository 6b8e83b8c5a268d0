"""Objects of a known colour in video, by particles that look at the image under them; finite-sets paper, section 6."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.colour_region import ColourImage, ColourRange, region_contrast
from tsuiseki.tracking.filters.base import Running, bootstrap
from tsuiseki.tracking.filters.finite_sets.clusters import LabelledParticles
from tsuiseki.tracking.filters.finite_sets.region_births import (
    AnywhereBirths,
    Confirmation,
    ExplainedImage,
    PatchBirths,
    at_patches,
)
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import (
    Calibrated,
    EachAlone,
    Equalised,
    WithoutOthers,
    as_printed,
    boxes_of,
    cluster_means,
)
from tsuiseki.tracking.filters.finite_sets.region_phd import RegionInfo, RegionPhdFilter
from tsuiseki.tracking.filters.motion.points import SteppingBox
from tsuiseki.tracking.filters.particles.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.particles.resampling import weighted_mean
from tsuiseki.tracking.points.estimated_tracks import EstimatedTracks
from tsuiseki.tracking.types import BoolArray, Estimate, FloatArray, Frame, IntArray, Status, Targets, Track

BlobPreset = Literal["calibrated", "paper", "single"]
BIRTHS = 0.05
"""Expected ones a frame with the preset paper, which draws so many times the particles of a target for them (50)."""


@dataclass(frozen=True)
class BlobSettings:
    """Settings of the tracker of coloured objects; lengths in pixels, times in frames.

    Attributes:
        preset: ``calibrated`` follows any number, by the likelihood's ratio to background; ``paper`` does so by the
            printed likelihood, equalised between targets; ``single`` follows one by an ordinary particle filter.
        particles: of each target.
        targets: expected at most; with ``paper`` the number of particles is this times ``particles``.
        size: typical width and height, for births anywhere.
        place_noise: standard deviation of the change of the step, ``tau_x`` and ``tau_y``.
        size_noise: standard deviation of the change of size, ``tau_d`` and ``tau_h``.
        survival: probability that a target goes on, in [0, 1].
        detection: probability that a target looks like itself, in [0, 1].
        margin: of the frame around a box whose colour counts against it, as a share of its sides.
        sharpness: power of the likelihood ratio.
        smallest: least side of a target, and of a patch of colour that may be a new one.
        confirm: with ``calibrated``, a new target is believed once a patch of the colour was at it in so many of its
            first so many frames, and dropped when that cannot be any more; ``(1, 1)`` believes at once.
        lost_below: with ``single``, the target is not seen when the best likelihood is below this.
        patience: with ``single``, frames unseen before the search begins anew.
        min_length: a track of fewer frames is not reported.
    """

    preset: BlobPreset = "calibrated"
    particles: int = 500
    targets: int = 10
    size: tuple[float, float] = (32.0, 32.0)
    place_noise: float = 1.5
    size_noise: float = 1.0
    survival: float = 0.99
    detection: float = 0.95
    margin: float = 0.5
    sharpness: float = 4.0
    smallest: float = 12.0
    confirm: tuple[int, int] = (3, 3)
    lost_below: float = 0.2
    patience: int = 10
    min_length: int = 3

    def __post_init__(self) -> None:
        if self.preset not in ("calibrated", "paper", "single"):
            raise RequestError(f"expected the preset calibrated, paper or single, got {self.preset!r}")
        for name in ("survival", "detection"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise RequestError(f"expected the probability of {name} in [0, 1], got {getattr(self, name)}")
        for name in ("place_noise", "size_noise", "margin", "sharpness", "smallest"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise RequestError(f"expected {name} above 0, got {getattr(self, name)}")
        if self.particles < 1 or self.targets < 1 or min(self.size) < 3:
            raise RequestError("expected at least one particle, one target and a size of 3 pixels")
        if not 1 <= self.confirm[0] <= self.confirm[1]:
            raise RequestError(f"`confirm`: expected M,N with 1 <= M <= N frames, got {self.confirm}")


def region_filter(settings: BlobSettings) -> RegionPhdFilter:
    """The filter of several targets for the preset."""
    motion = SteppingBox(settings.place_noise, settings.size_noise, settings.smallest)
    if settings.preset == "paper":
        births = AnywhereBirths(BIRTHS, max(round(settings.particles * BIRTHS), 1), settings.size)
        equalised = Equalised(as_printed)
        fixed = settings.particles * settings.targets
        return RegionPhdFilter(
            motion, births, EachAlone(settings.margin), equalised, settings.particles, fixed, settings.survival,
            settings.detection,
        )  # fmt: skip
    patches = PatchBirths(smallest=settings.smallest)
    update = Calibrated(settings.sharpness)
    return RegionPhdFilter(
        motion, patches, WithoutOthers(settings.margin), update, settings.particles, 0, settings.survival,
        settings.detection,
    )  # fmt: skip


class BlobTracker:
    """Follows every object of a colour through frames.

    Args:
        colour: theirs.
        settings: see `BlobSettings`; the preset ``single`` has a class of its own.
        seed: of the particles.
    """

    def __init__(self, colour: ColourRange, settings: BlobSettings | None = None, seed: int = 0) -> None:
        self.colour = colour
        self.settings = settings or BlobSettings()
        self.record = EstimatedTracks(self.settings.min_length)
        self.expected: list[float] = []
        self._confirmation = Confirmation(*self.settings.confirm)
        chosen = region_filter(self.settings)
        self._births = chosen.births
        self._running: Running[LabelledParticles, ColourImage, RegionInfo] = Running(
            chosen, chosen.init(np.empty((0, 6))), np.random.default_rng(seed)
        )

    def update(self, frame: Frame) -> Targets:
        """Take the next frame; its targets."""
        image = ColourImage.of(frame.image, self.colour)
        info = self._running.step(image)
        boxes = boxes_of(info.estimates.states)
        observed = np.nan_to_num(info.likelihood) > info.background
        believed = self._confirmed(image, info.estimates.ids)
        self.expected.append(info.expected_count)
        targets = self.record.add(info.estimates.ids, boxes, info.estimates.weights, observed, believed)
        return replace(targets, frame=frame.index)

    def _confirmed(self, image: ColourImage, ids: IntArray) -> BoolArray | None:
        """Which of the estimates ``(N,)`` are believed; what cannot be confirmed leaves the filter."""
        if not isinstance(self._births, PatchBirths):
            return None
        state = self._running.state
        names, _, means = cluster_means(state)
        supported = at_patches(boxes_of(means), self._births.components(image))
        failed = self._confirmation.update(names, supported)
        if len(failed):
            self._running.state = state.select(~np.isin(state.labels, failed))
        return self._confirmation.believes(ids)

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id."""
        return self.record.tracks()


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
