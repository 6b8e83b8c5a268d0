"""Bodies that bend, each followed by its own particle filter; the goldfish paper, sections 3 and 4.

In each frame the coloured region is extracted and its edges found, once for all bodies. Then every body's particles
move, are weighed by the largest distance of their contour to the edges (7), and give the estimate. Where another body
is expected, the image belongs to that one: see `BodyView`. The filter is that of the goldfish paper: the
posterior (1)-(4) by a random walk (5) and particles weighed by (6).
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.bodies.body import Body
from tsuiseki.tracking.bodies.contour import (
    BodyPixels,
    BodyView,
    EdgeImage,
    Points,
    find_starts,
    near_mask,
    within_limits,
)
from tsuiseki.tracking.bodies.settings import DeformableSettings
from tsuiseki.tracking.filters.base import Proposal, bootstrap
from tsuiseki.tracking.filters.body_motion import BodyMotion
from tsuiseki.tracking.filters.particle_filter import ParticleFilter, ParticleState
from tsuiseki.tracking.filters.resampling import weighted_mean
from tsuiseki.tracking.types import FloatArray, Frame, Status
from tsuiseki.tracking.types.tracks import BodyTrack

# A body of which a greater share is hidden counts as missed.
MOSTLY = 0.8
# Frames between two searches of the whole image for a lost body.
SEARCH_EVERY = 5
# Distance in pixels of a contour to the edges beyond which its body counts as missed.
FAR = 15.0


@dataclass(frozen=True)
class BodyTarget:
    """One body.

    Attributes:
        id: from 1.
        particles: of its filter.
        estimate: mean particle ``(D + …,)``; the body's state comes first.
        previous: the estimate of the frame before.
        score: likelihood (7) of the estimate, in [0, 1].
        status: whether it is confirmed.
        undetected: frames in a row in which it was missed.
    """

    id: int
    particles: ParticleState
    estimate: FloatArray
    previous: FloatArray
    score: float = 1.0
    status: Status = "tracking"
    undetected: int = 0


class DeformableTracker:
    """Follows bodies of one kind through frames.

    Args:
        body: theirs.
        motion: how they move.
        extraction: what belongs to them in an image; None where only `update_edges` is used.
        settings: see `DeformableSettings`.
        starts: ``(K, D)`` states in the first frame; None finds the bodies there.
        seed: of the particles.

    Attributes:
        log_evidence: of all frames with edges so far, as in `maximum_likelihood`. (7) counts as a density of the image
            that a body of ``D`` numbers makes, so over the square root of ``spread ** D``.
    """

    def __init__(
        self,
        body: Body,
        motion: BodyMotion,
        extraction: BodyPixels | None,
        settings: DeformableSettings | None = None,
        starts: FloatArray | None = None,
        seed: int = 0,
    ) -> None:
        self.body, self.motion, self.extraction = body, motion, extraction
        self.settings = settings or DeformableSettings()
        self.rng = np.random.default_rng(seed)
        self.targets: list[BodyTarget] = []
        self.log_evidence = 0.0
        self._starts = starts
        self._columns = len(body.fields)
        # Of each body: frame, state, score and status.
        self._rows: defaultdict[int, list[tuple[int, FloatArray, float, Status]]] = defaultdict(list)
        self._move: Proposal[BodyView] = bootstrap(motion)
        self._filter: ParticleFilter[BodyView] = ParticleFilter(self._propose, self._log_likelihood, threshold=1.0)

    def update(self, frame: Frame) -> None:
        """Take the next frame.

        Raises:
            ValueError: the tracker has no extraction.
        """
        self.update_edges(frame.index, self.edges(frame))

    def edges(self, frame: Frame) -> EdgeImage:
        """The edges of the bodies in a frame, for `update_edges`.

        Raises:
            ValueError: the tracker has no extraction.
        """
        if self.extraction is None:
            raise ValueError("expected an extraction to find edges by; give one, or use update_edges")
        return EdgeImage.of(frame.image, self.extraction)

    def update_edges(self, index: int, edges: EdgeImage) -> None:
        """Take the next frame, whose edges are known."""
        if not self.targets:
            self._begin(edges)
        else:
            contours = self._expected_contours()
            for row, target in enumerate(self.targets):
                self.targets[row] = self._step(target, edges, contours)
                # Those that follow see this one where it is, and no longer where it was expected.
                contours[target.id] = self._contour(self.targets[row])
            self._recover(edges)
        for target in self.targets:
            state = target.estimate[: self._columns]
            self._rows[target.id].append((index, state, target.score, target.status))

    def forget(self) -> None:
        """Drop the states so far from `tracks`; ids go on."""
        self._rows.clear()

    def tracks(self) -> list[BodyTrack]:
        """States of all frames so far, by id."""
        tracks = []
        for identity, rows in self._rows.items():
            frames, states, scores, statuses = zip(*rows, strict=True)
            tracks.append(BodyTrack(identity, np.array(frames), np.array(states), np.array(scores), statuses))
        return tracks

    def _propose(
        self, particles: FloatArray, observation: BodyView, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """The motion, in one layer or two; shapes that the body cannot take are moved to its limit."""
        moved, correction = self._move(particles, observation, rng)
        return within_limits(moved, self.body), correction

    def _log_likelihood(self, particles: FloatArray, observation: BodyView) -> FloatArray:
        contours = self.body.contour(particles[:, : self._columns])
        return observation.log_likelihood(contours, self.settings.spread)

    def _begin(self, edges: EdgeImage) -> None:
        """Targets at the given states, or at the bodies that the first frame shows."""
        starts = self._starts
        if starts is None:
            starts = find_starts(edges, self.body, self.rng)
        for state in starts:
            number = len(self.targets) + 1
            self.targets.append(self._assessed(self._placed(number, state), BodyView(edges)))

    def _placed(self, number: int, state: FloatArray) -> BodyTarget:
        """A target whose particles all stand at one state, their motions drawn."""
        states = np.tile(state, (self.settings.particles, 1))
        particles = self._filter.init(self.motion.start(states, self.rng))
        mean = particles.particles.mean(axis=0)
        return BodyTarget(number, particles, mean, mean)

    def _step(self, target: BodyTarget, edges: EdgeImage, expected: dict[int, Points]) -> BodyTarget:
        """One frame further."""
        others = [contour for number, contour in expected.items() if number != target.id]
        view = BodyView(edges, near_mask(edges.size, expected[target.id], others))
        _, (hidden,) = view.visible_distance(expected[target.id][None])
        particles, info = self._filter.step(target.particles, replace(view, hidden=float(hidden)), self.rng)
        if edges.has_edges:
            self.log_evidence += info.log_evidence - 0.5 * self._columns * float(np.log(self.settings.spread))
        moved = replace(
            target,
            particles=particles,
            estimate=weighted_mean(particles.particles, particles.log_weights, self.body.angles),
            previous=target.estimate,
        )
        return self._assessed(moved, view)

    def _assessed(self, target: BodyTarget, view: BodyView) -> BodyTarget:
        """The target with its score and status."""
        (distance,), (hidden,) = view.visible_distance(self._contour(target)[None])
        detected = view.edges.has_edges and distance <= FAR and hidden < MOSTLY
        undetected = 0 if detected else target.undetected + 1
        status: Status = "tracking" if detected else "searching"
        if not view.edges.has_edges or undetected > self.settings.patience:
            status = "lost"
        score = float(np.exp(-(distance**2) / self.settings.spread))
        return replace(target, score=score, status=status, undetected=undetected)

    def _expected_contours(self) -> dict[int, Points]:
        """Contours ``(K, 2)`` where the targets are predicted.

        They go on by their last step, whatever their motion: a random walk would expect a fast body where it was.
        """
        now, previous = (
            np.array([getattr(t, name)[: self._columns] for t in self.targets]) for name in ("estimate", "previous")
        )
        moved = now.copy()
        moved[:, :2] += now[:, :2] - previous[:, :2]
        contours = self.body.contour(moved)
        return {target.id: contour for target, contour in zip(self.targets, contours, strict=True)}

    def _contour(self, target: BodyTarget) -> Points:
        """Contour ``(K, 2)`` of the estimate."""
        return np.asarray(self.body.contour(target.estimate[None, : self._columns])[0], dtype=np.float32)

    def _recover(self, edges: EdgeImage) -> None:
        """Put lost targets onto regions that no other target explains, now and then."""
        patience = self.settings.patience
        waited = {n: target.undetected - patience for n, target in enumerate(self.targets) if target.status == "lost"}
        lost = [n for n, frames in waited.items() if frames > 0 and frames % SEARCH_EVERY == 1]
        if not lost or not edges.has_edges:
            return
        states = np.array([target.estimate[: self._columns] for target in self.targets])
        others = [self.body.contour(states[n : n + 1])[0] for n in range(len(states)) if n not in lost]
        starts = find_starts(edges, self.body, self.rng, others)
        if len(starts) == 0:
            return
        distance = np.linalg.norm(states[lost, None, :2] - starts[None, :, :2], axis=2)
        for row, column in zip(*linear_sum_assignment(distance), strict=True):
            number = lost[row]
            self.targets[number] = self._assessed(
                self._placed(self.targets[number].id, starts[column]), BodyView(edges)
            )
