"""An unknown number of targets, by a finite-set filter: one tracker for what is observed in three ways.

`PointTracker` follows measured points or boxes, `BlobTracker` coloured regions, `MeasurementTracker` a sensor's scans.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np

from tsuiseki.tracking.association.assignment import assign
from tsuiseki.tracking.errors import RequestError, check_choice
from tsuiseki.tracking.features.colour_region import ColourImage, ColourRange, region_contrast
from tsuiseki.tracking.filters.base import SetInfo, TargetEstimates, bootstrap
from tsuiseki.tracking.filters.finite_sets.births import MeasurementBirths, MixtureBirths
from tsuiseki.tracking.filters.finite_sets.clusters import PhdState
from tsuiseki.tracking.filters.finite_sets.labelled_multi_bernoulli import (
    LabelledInfo,
    LabelledMultiBernoulliFilter,
    TrackParticles,
)
from tsuiseki.tracking.filters.finite_sets.phd import PhdFilter, PhdInfo
from tsuiseki.tracking.filters.finite_sets.region_likelihoods import boxes_of, cluster_means
from tsuiseki.tracking.filters.finite_sets.region_phd import (
    AnywhereBirths,
    Confirmation,
    ExplainedImage,
    PatchBirths,
    RegionInfo,
    at_patches,
)
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import weighted_mean
from tsuiseki.tracking.geometry import centres as box_centres
from tsuiseki.tracking.interchange import DetectionsLike, as_detections
from tsuiseki.tracking.points.observed import (
    COLUMNS,
    SetFilter,
    births_a_second,
    box_filter,
    region_filter,
    region_motion,
    scan_filter,
    state_columns,
    with_calm_motion,
)
from tsuiseki.tracking.points.settings import BlobSettings, Lag, PointSettings, SetMethod
from tsuiseki.tracking.types import BoolArray, Estimate, FloatArray, Frame, IntArray, Status, Targets, Track
from tsuiseki.tracking.types.measurements import Scan, SensedTargets, SensedTrack
from tsuiseki.tracking.types.sensing_model import SensingModel
from tsuiseki.tracking.types.tracks import rows_of_each

# Existence above which a target is shown once the next scan is known; 0.4 and 0.6 were no better on seeds 200-209.
REPORT = 0.5
# Frames that a track must have to be reported.
SHORTEST = 3
# Of the preset ``single``: exponent of the likelihood (68).
SHARPNESS = 4.0
# Of the preset ``single``: likelihood below which the object counts as missed.
LOST_BELOW = 0.2
# Of the preset ``single``: frames without support before the search begins anew.
PATIENCE = 10


class FiniteSetTracker:
    """Feeds a finite-set filter with one observation after the other.

    Args:
        columns: length of a state.
        seed: of the particles.

    Attributes:
        state: of the filter; None before the first step.
    """

    def __init__(self, columns: int, seed: int) -> None:
        self._columns = columns
        self._rng = np.random.default_rng(seed)
        self.state: Any = None

    def _step(self, chosen: SetFilter, observation: Any) -> SetInfo:
        """One observation further, by this filter."""
        prior = chosen.init(np.empty((0, self._columns))) if self.state is None else self.state
        self.state, info = chosen.step(prior, observation, self._rng)
        return info


class BoxedSetTracker(FiniteSetTracker):
    """Keeps the boxes of the targets, frame after frame; a label gets an id, from 1, once it was in enough frames."""

    def __init__(self, seed: int) -> None:
        super().__init__(COLUMNS, seed)
        self._frames = 0
        # In how many frames each label without an id was, in the order in which they first appeared.
        self._counts: dict[int, int] = {}
        self._ids: dict[int, int] = {}
        self._names: dict[int, str] = {}
        self._rows: list[tuple[IntArray, IntArray, FloatArray, FloatArray, BoolArray, IntArray]] = []

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._frames} frames, {len(self._ids)} targets so far>"

    def forget(self) -> None:
        """Drop the frames so far from `tracks`; ids go on."""
        self._rows.clear()

    def tracks(self) -> list[Track]:
        """The tracks of all frames so far, by id."""
        if not self._rows:
            return []
        columns = (np.concatenate(part) for part in zip(*self._rows, strict=True))
        frames, labels, boxes, scores, observed, origin = columns
        rows = {int(labels[part[0]]): part for part in rows_of_each(labels)}
        return [
            Track(number, frames[row], boxes[row], scores[row], observed[row], origin[row], self._names)
            for label, number in self._ids.items()
            if (row := rows.get(label)) is not None
        ]

    def _add(
        self,
        estimates: TargetEstimates,
        boxes: FloatArray,
        observed: BoolArray | None = None,
        trusted: BoolArray | None = None,
        origin: IntArray | None = None,
    ) -> Targets:
        """Take the next frame; the targets of it that have an id.

        Args:
            estimates: N targets.
            boxes: ``(N, 4)`` of them, pixels.
            observed: ``(N,)`` False where nothing in the frame supports the box; by default all are supported.
            trusted: ``(N,)`` False where a target is to get no id yet; by default all may.
            origin: ``(N, 2)`` row and class of the detection of each; -1, by default, where none is known.
        """
        labels, count = estimates.ids, len(estimates)
        origin = np.full((count, 2), -1) if origin is None else origin
        supported = np.ones(count, dtype=np.bool_) if observed is None else observed
        self._rows.append((np.full(count, self._frames), labels, boxes, estimates.weights, supported, origin))
        self._frames += 1
        for label in labels.tolist():
            if label not in self._ids:
                self._counts[label] = self._counts.get(label, 0) + 1
        waiting = set((labels if trusted is None else labels[trusted]).tolist())
        for label in [name for name, frames in self._counts.items() if name in waiting and frames >= SHORTEST]:
            del self._counts[label]
            self._ids[label] = len(self._ids) + 1
        ids = np.array([self._ids.get(label, 0) for label in labels.tolist()], dtype=np.int64)
        status = np.where(supported, "tracking", "searching")
        scores = np.where(supported, estimates.weights, 0.0)
        return Targets(self._frames - 1, ids, boxes, scores, status, origin, self._names).select(ids > 0)


class PointTracker(BoxedSetTracker):
    """Targets behind the detections of one frame after the other.

    The model is made from the first boxes, in units of a typical one, so that it needs no setting for another image
    size.

    Args:
        settings: of the filter and its model.
        extent: width and height of the image, pixels.
        seed: of the particles.
    """

    def __init__(self, settings: PointSettings, extent: tuple[float, float], seed: int = 0) -> None:
        sides = np.asarray(extent)
        if sides.shape != (2,) or sides.dtype.kind not in "iuf" or not ((sides > 0) & np.isfinite(sides)).all():
            raise RequestError(f"`extent`: expected width and height of the image in pixels, got {extent}")
        super().__init__(seed)
        self.settings, self._extent = settings, extent
        self._filter: SetFilter | None = None

    def update(self, detections: DetectionsLike) -> Targets:
        """Take the detections of the next frame; its targets."""
        detected = as_detections(detections)
        used = detected.boxes[detected.scores >= 0]
        measured = np.concatenate([box_centres(used), used[:, 2:] - used[:, :2]], axis=1)
        if self._filter is None and len(measured):
            self._filter = box_filter(self.settings, self._extent, float(np.median(measured[:, 3])))
        if self._filter is None:
            nothing = TargetEstimates(np.empty(0, dtype=np.int64), np.empty((0, COLUMNS)), np.empty(0))
            return self._add(nothing, np.empty((0, 4)))
        estimates = self._step(self._filter, measured).estimates
        size, centres = np.maximum(estimates.states[:, 4:6], 1.0), estimates.states[:, [0, 2]]
        boxes = np.concatenate([centres - size / 2, centres + size / 2], axis=1)
        # The nearest detection supports a target that is no farther from it than the target is large.
        away = np.linalg.norm(centres[:, None] - box_centres(detected.boxes)[None], axis=2)
        rows, columns = assign(away / size.max(axis=1, keepdims=True), 1.0)
        origin = np.full((len(boxes), 2), -1)
        origin[rows] = detected.origin[columns]
        self._names |= detected.names
        return self._add(estimates, boxes, origin=origin)


class BlobTracker(BoxedSetTracker):
    """Every object of a colour through frames; the filter takes the image itself (finite-sets paper, section 6).

    Args:
        colour: theirs.
        settings: see `BlobSettings`; the preset ``single`` has a class of its own, `SingleBlobTracker`.
        seed: of the particles.

    Attributes:
        expected: expected number of objects in each frame.
    """

    def __init__(self, colour: ColourRange, settings: BlobSettings, seed: int = 0) -> None:
        super().__init__(seed)
        self.expected: list[float] = []
        self._colour, self._filter = colour, region_filter(settings)
        self._confirmation = Confirmation(*settings.confirm)

    def update(self, frame: Frame) -> Targets:
        """Take the next frame; its targets."""
        image = ColourImage.of(frame.image, self._colour)
        info = self._step(self._filter, image)
        assert isinstance(info, RegionInfo)
        observed = np.nan_to_num(info.likelihood) > info.background
        confirmed = self._confirmed(image, info.estimates.ids)
        self.expected.append(info.expected_count)
        targets = self._add(info.estimates, boxes_of(info.estimates.states), observed, confirmed)
        return replace(targets, frame=frame.index)

    def _confirmed(self, image: ColourImage, ids: IntArray) -> BoolArray | None:
        """Which of the estimates ``(N,)`` are confirmed; what cannot be any more leaves the filter."""
        births = self._filter.births
        if not isinstance(births, PatchBirths):
            return None
        names, _, means = cluster_means(self.state)
        supported = at_patches(boxes_of(means), births.components(image))
        failed = self._confirmation.update(names, supported)
        if len(failed):
            self.state = self.state.select(~np.isin(self.state.labels, failed))
        return self._confirmation.confirmed(ids)


class MeasurementTracker(FiniteSetTracker):
    """Targets from a sensor's scans, each with its time: points in two or three dimensions.

    Before every step the filter gets the time that passed, and the covariances of what was measured.

    Args:
        model: of the sensor and the targets, with a region.
        method: labelled multi-Bernoulli filter, or phd.
        particles: number of particles of each target.
        seed: of the particles.
        lag: 0 answers a scan at once; 1, of the labelled filter, after the next one, which tells whether a target has
            ended or was missed, and better where it was.
        calm: whether a single motion of the labelled filter takes turns with a calm one.

    Attributes:
        log_evidence: logarithm of (11), ``p(Y_1:k)``.

    Raises:
        RequestError: the model has no region, there is no particle, or no such lag.
    """

    def __init__(
        self,
        model: SensingModel,
        method: SetMethod = "labelled",
        particles: int = 1000,
        seed: int = 0,
        lag: Lag = 0,
        calm: bool = True,
    ) -> None:
        check_choice(method, get_args(SetMethod), "method")
        if not 1 <= particles <= 1_000_000:
            raise RequestError(f"`particles`: expected 1 to 1000000, got {particles}")
        if lag not in ((0, 1) if method == "labelled" else (0,)):
            raise RequestError(f"`lag`: expected 0, or 1 with the method labelled, got {lag} with {method}")
        moving = with_calm_motion(model) if calm and method == "labelled" else model
        super().__init__(state_columns(moving), seed)
        self.model, self.lag = model, lag
        self.log_evidence = 0.0
        self._filter = scan_filter(moving, method, particles)
        self._time: float | None = None
        self._targets: list[SensedTargets] = []
        self._unsettled: SensedTargets | None = None

    def update(self, scan: Scan) -> SensedTargets | None:
        """Take the next scan; its targets, or with a lag those of the scan before and None of the first.

        Raises:
            RequestError: it is not later than the last one.
        """
        before = self._time
        info = self._step(self._filter_at(scan), scan.measurements)
        assert isinstance(info, LabelledInfo | PhdInfo)
        newborn = births_a_second(self.model) * (1.0 if before is None else scan.time - before)
        self.log_evidence += info.log_evidence - self.model.clutter - self.model.detection * newborn
        posterior = info.posterior if isinstance(info, PhdInfo) else self.state
        newest = self._sensed(scan.time, info.estimates, posterior)
        if not self.lag:
            self._targets.append(newest)
            return newest
        unsettled, self._unsettled = self._unsettled, newest
        if unsettled is None or isinstance(info, PhdInfo):
            return None
        smoothed = info.smoothing_step.smoothed()
        self._targets.append(self._sensed(unsettled.time, smoothed.likely(REPORT), smoothed))
        return self._targets[-1]

    def _filter_at(self, scan: Scan) -> LabelledMultiBernoulliFilter | PhdFilter:
        """The filter, which is for steps of one second, for the step to a scan."""
        if self._time is not None and not scan.time > self._time:
            raise RequestError(f"expected scans in order of time, got {scan.time:g} s after {self._time:g} s")
        # Before the first scan there is nothing to move: any time will do.
        seconds = 1.0 if self._time is None else scan.time - self._time
        self._time = scan.time
        model, births = self._filter.model, self._filter.births
        sensor = model.sensor if scan.covariances is None else model.sensor.of_scan(scan.covariances)
        if isinstance(births, MeasurementBirths):
            births = replace(births, density=births.density * seconds, sensor=sensor)
        elif isinstance(births, MixtureBirths):
            births = replace(births, masses=births.masses * seconds, sensor=sensor)
        model = replace(model, period=seconds, sensor=sensor, survival=self.model.survival**seconds)
        return replace(self._filter, model=model, births=births)

    def finish(self) -> SensedTargets | None:
        """The targets of the last scan, which no other follows; None without a lag, when they were answered."""
        return self._unsettled

    def tracks(self) -> list[SensedTrack]:
        """The tracks so far, by id."""
        scans = self._targets if self._unsettled is None else [*self._targets, self._unsettled]
        if not scans:
            return []
        number = np.repeat(np.arange(len(scans)), [len(scan.ids) for scan in scans])
        times, ids = np.array([scan.time for scan in scans]), np.concatenate([scan.ids for scan in scans])
        names = "positions", "velocities", "covariances", "existence", "modes"
        columns = [np.concatenate([getattr(scan, name) for scan in scans]) for name in names]
        return [
            SensedTrack(int(ids[rows[0]]), number[rows], times[number[rows]], *(column[rows] for column in columns))
            for rows in rows_of_each(ids)
        ]

    def forget(self) -> None:
        """Drop what `tracks` would give; the filter goes on, and the ids with it."""
        self._targets.clear()

    def _sensed(self, time: float, estimates: TargetEstimates, posterior: PhdState | TrackParticles) -> SensedTargets:
        width = 2 * self.model.sensor.dimensions
        spread, modes = moments(estimates, posterior, len(self.model.motions) if len(self.model.motions) > 1 else 0)
        places, speeds = estimates.states[:, :width:2], estimates.states[:, 1:width:2]
        return SensedTargets(
            time, estimates.ids, places, speeds, spread[:, :width, :width], np.minimum(estimates.weights, 1.0), modes
        )


def moments(
    estimates: TargetEstimates, posterior: PhdState | TrackParticles, modes: int
) -> tuple[FloatArray, FloatArray]:
    """Covariance ``(N, D, D)`` of each estimate's particles, and the shares ``(N, modes)`` of the motions in force."""
    columns = estimates.states.shape[1]
    spread, shares = np.zeros((len(estimates), columns, columns)), np.zeros((len(estimates), modes))
    for k, identity in enumerate(estimates.ids):
        mine = posterior.labels == identity
        particles = posterior.particles[mine].reshape(-1, columns)
        if len(particles) == 0:
            continue
        weights = np.exp(posterior.log_weights[mine].ravel())
        weights /= weights.sum()
        away = particles - weights @ particles
        spread[k] = (weights[:, None] * away).T @ away
        if modes:
            shares[k] = np.bincount(particles[:, -1].astype(np.int64), weights, minlength=modes)
    return spread, shares


class SingleBlobTracker:
    """Follows one object of a colour, (63)-(68), and searches the whole image again when it is lost.

    Args:
        colour: its.
        settings: see `BlobSettings`.
        seed: of the particles.

    Attributes:
        estimates: one a frame, whose numbers are those of the video.
    """

    def __init__(self, colour: ColourRange, settings: BlobSettings, seed: int = 0) -> None:
        self.estimates: list[Estimate] = []
        self._colour, self._settings = colour, settings
        self._rng = np.random.default_rng(seed)
        self._missed = 0
        self._state: ParticleState | None = None
        self._filter: ParticleFilter[ColourImage] = ParticleFilter(
            bootstrap(region_motion(settings)), self._log_likelihood
        )

    def update(self, frame: Frame) -> Targets:
        """Take the next frame; the target in it, with the id 1."""
        image = ColourImage.of(frame.image, self._colour)
        prior = self._state if self._state is not None else self._anywhere(image)
        state, _ = self._filter.step(prior, image, self._rng)
        mean = weighted_mean(state.particles, state.log_weights)
        box = boxes_of(mean[None])
        score = float(region_contrast(image, box)[0])
        self._missed = 0 if score >= LOST_BELOW else self._missed + 1
        status: Status = "tracking" if self._missed == 0 else "searching" if self._missed <= PATIENCE else "lost"
        # A search that found nothing begins anew from (13): particles that stay where nothing is would never find it.
        tracked = any(estimate.status == "tracking" for estimate in self.estimates[-PATIENCE:])
        self._state = None if status == "lost" or (self._missed and not tracked) else state
        self.estimates.append(Estimate(frame.index, box[0], score, status))
        return Targets(frame.index, np.array([1]), box, np.array([score]), np.array([status]))

    def tracks(self) -> list[Track]:
        """The frames where the target was followed, as one track."""
        tracked = [estimate for estimate in self.estimates if estimate.status == "tracking"]
        if not tracked:
            return []
        frames, boxes, scores = (np.array([getattr(e, name) for e in tracked]) for name in ("frame", "box", "score"))
        return [Track(1, frames, boxes, scores)]

    def _anywhere(self, image: ColourImage) -> ParticleState:
        """Particles of (13), uniform over the image; four times as many, to find a small target."""
        births = AnywhereBirths(mass=1.0, count=4 * self._settings.particles, size=self._settings.size)
        return self._filter.init(births.draw(ExplainedImage(image, np.empty((0, 4))), self._rng).particles)

    def _log_likelihood(self, particles: FloatArray, observation: ColourImage) -> FloatArray:
        """Logarithm of (68), sharpened; a region without the colour is unlikely, not impossible."""
        contrast = region_contrast(observation, boxes_of(particles))
        return np.asarray(SHARPNESS * np.log(np.maximum(contrast, 1e-3)))
