"""One target by a Siamese network and particles whose likelihood is its response, thesis (3.5) with a network.

Each frame has one search square. The network's response there weighs particles, which have a place and a velocity.
Several groups of them survive where the response has several peaks, as at a distractor, and the motion carries them
through an occlusion. The map of where particles are expected joins the response; the best cell's box is the target's.
Beside a network of this toolkit a correlation filter votes on place and box (`filter_vote`). A recent template beside
the first one follows a target that changes; it is renewed where the target is certain.

`on_target` says how likely the box is on the target, and the status follows. While the target is not tracked, one more
square a frame is searched, about the place where it was last certain and further away as time passes, as far as the
border where it left the picture. A place there that is likelier than the present one takes over.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.tracking.filters.resampling import systematic
from tsuiseki.tracking.geometry import centres
from tsuiseki.tracking.single.filter_vote import FilterVote, Opinion
from tsuiseki.tracking.single.on_target import RATE, Signs, logit, look, weights_of
from tsuiseki.tracking.single.siamese import Response, SiameseNetwork, Square, Template, size_change, square_side
from tsuiseki.tracking.single.tracker import TargetState, box_about, box_centre
from tsuiseki.tracking.types import FloatArray, ImageArray, Status

# Number of particles, as in the thesis.
PARTICLES = 200
# Standard deviation of a particle's step in a frame, sides of the target.
STEP = 0.08
# Share of particles that jump, for a camera may be jerked.
JUMPS = 0.1
# Standard deviation of a jump, sides of the target.
JUMP = 0.6
# Standard deviation of the change of velocity in a frame, sides of the target.
ACCELERATION = 0.04
# Share of a velocity that is left after a frame.
PERSISTENCE = 0.9
# Distance between a particle and the box of a cell that explains it, sides of the target.
REACH = 0.2
# Highest cells of a response that weigh particles.
CELLS = 32
# Power of the response in the likelihood.
SHARPNESS = 2
# Standard deviation of the map of expected places, sides of the target.
BLUR = 0.75
# Share of that map in what decides, beside the response.
EXPECTED = 0.3
# Factor on the change of size and shape in the penalty's exponent.
PENALTY = 0.055
# Share of a new size, times penalty and score.
SIZE_RATE = 0.37
# Share of the recent template beside the first.
RECENT = 0.3
# Frames between two looks that are kept, and go into the recent template.
INTERVAL = 5
# Share of a new look in the recent template.
RENEWAL = 0.5
# Looks that are kept beside the first.
LOOKS = 5
# Looks of distractors that are kept beside those of the first surroundings.
RIVALS = 10
# Score from which another place is a distractor, in [0, 1].
RIVAL = 0.2
# Where the first surroundings are looked at, in sides of the target.
AROUND = np.array([[-1.0, 0], [1, 0], [0, -1], [0, 1], [-0.8, -0.8], [0.8, 0.8], [-0.8, 0.8], [0.8, -0.8]])
# Smallest side of a box, pixels.
LEAST_SIDE = 3.0
# Probability from which a box is certain: its look is kept, and it is searched about.
CERTAIN = 0.85
# Probability from which the target counts as tracked.
TRACKED = 0.5
# Frames in a row below it after which the target counts as lost.
LOST_AFTER = 5
# Probability from which another place takes over.
TAKEN = 0.7
# Frames for which the target is taken to go on as it did when it was last certain.
DRIFT = 5
# Difference of brightness below which a square shows nothing, of 255.
LEAST_CONTRAST = 12


@dataclass(frozen=True)
class Candidate:
    """A place where the target may be.

    Attributes:
        centre: ``(2,)`` pixels.
        size: ``(2,)`` that the network gives it.
        decisive: score after the penalty for a change of size and shape, in [0, 1].
        template: of this place.
        signs: ``(7,)`` of `Signs`.
        opinion: of the filter; None without one.
        rival: ``(2,)`` the best place elsewhere, where its score makes it a distractor.
    """

    centre: FloatArray
    size: FloatArray
    decisive: float
    template: Template
    signs: FloatArray
    opinion: Opinion | None
    rival: FloatArray | None


class ResponseParticles:
    """Follows one target; the score is the probability that the box is on it.

    Args:
        network: that responds.
        seed: of all random numbers.

    Attributes:
        searched_frames: in how many frames a second square was searched.
        signs: ``(14,)`` of the last frame, and their running means.
    """

    def __init__(self, network: SiameseNetwork, seed: int = 0) -> None:
        self._network, self._rng = network, np.random.default_rng(seed)
        self._weights = weights_of(network)

    def start(self, image: ImageArray, box: FloatArray) -> None:
        self._centre, self._size = box_centre(box), np.asarray(box[2:] - box[:2], dtype=np.float64)
        self._velocity = np.zeros(2)
        self._filter = FilterVote(image, np.asarray(box, dtype=np.float64)) if self._network.filter_share else None
        self._first = self._recent = self._template(image, self._centre, self._size)
        self._first_look = look(self._first)
        self._looks: deque[FloatArray] = deque(maxlen=LOOKS)
        self._surroundings = [self._look(image, self._centre + offset * self._size) for offset in AROUND]
        self._rivals: deque[FloatArray] = deque(maxlen=RIVALS)
        self._certain = self._centre, self._size, self._velocity
        self._particles = self._about(self._centre)
        self._means: FloatArray | None = None
        self._frame = self._doubted = self._tries = self.searched_frames = 0
        self.signs = np.zeros(14)

    def follow(self, image: ImageArray) -> TargetState:
        self._frame += 1
        self._particles = self._moved()
        square = self._network.search_square(self._centre + self._velocity / 2, self._size)
        if _shows_nothing(image, square):
            return self._unseen()
        if self._filter is not None:
            self._filter.locate(image)
        candidate = self._located(image, square)
        chance = self._chance(candidate)
        if self._doubted:
            elsewhere = self._searched(image)
            if elsewhere is not None and (other := self._weights.probability(elsewhere.signs, elsewhere.signs)) > max(
                chance, TAKEN
            ):
                candidate, chance = elsewhere, other
                self._means, self._particles = elsewhere.signs, self._about(elsewhere.centre)
        self._go_on(image, candidate, chance)
        return TargetState(box_about(self._centre, self._size), chance, self._status(chance))

    def _located(self, image: ImageArray, square: Square) -> Candidate:
        """Where particles, response and filter together see the target; particles are weighed and drawn anew."""
        response, boxes = self._response(image, square)
        penalised = response.scores * self._penalty(boxes)
        expected = self._expected(square, len(penalised))
        joined = penalised
        if self._filter is not None:
            vote = self._network.filter_share * self._filter.votes(centres(boxes), self._side)
            joined = (1 - self._network.filter_share) * penalised + vote
        best = int(np.argmax((1 - EXPECTED) * joined + EXPECTED * expected))
        self._weigh(joined, boxes)
        return self._candidate(image, response, penalised, boxes, best)

    def _response(self, image: ImageArray, square: Square) -> tuple[Response, FloatArray]:
        """What the network says by the first template and the recent one together, and boxes in the image."""
        template = self._first + np.float32(RECENT) * (self._recent - self._first)
        (response,) = self._network.respond(image, square, [template])
        return response, self._network.boxes_in_image(response, square)

    def _penalty(self, boxes: FloatArray) -> FloatArray:
        """``(S, S)`` factors in [0, 1] for a change of size and shape; see `siamese_loop`."""
        sizes = np.maximum(boxes[..., 2:] - boxes[..., :2], 1e-3)
        change = size_change(sizes, square_side(self._size), self._size[0] / self._size[1])
        return np.asarray(np.exp(-PENALTY * (change - 1)))

    def _expected(self, square: Square, count: int) -> FloatArray:
        """``(S, S)`` how many particles are about each cell, at most 1."""
        cells = np.floor((self._particles[:, :2] - square.centre) * count / square.side + (count + 1) // 2).astype(int)
        cells = cells[((cells >= 0) & (cells < count)).all(axis=1)]
        counts = np.bincount(cells[:, 1] * count + cells[:, 0], minlength=count**2).reshape(count, count)
        blur = BLUR * self._side * count / square.side
        spread = cv2.GaussianBlur(counts.astype(np.float64), (0, 0), blur, borderType=cv2.BORDER_CONSTANT)
        return np.asarray(spread / max(float(spread.max()), 1e-9))

    def _weigh(self, penalised: FloatArray, boxes: FloatArray) -> None:
        """One step of the particle filter: each particle goes half of the way to the boxes that explain it."""
        cells = np.argpartition(-penalised.ravel(), CELLS)[:CELLS]
        places = centres(boxes).reshape(-1, 2)[cells]
        places_now = self._particles[:, :2]
        squares = ((places_now[:, None] - places) ** 2).sum(axis=2) / (REACH * self._side) ** 2
        votes = np.exp(-0.5 * squares) * penalised.ravel()[cells] ** SHARPNESS
        likelihood = votes.sum(axis=1)
        shift = np.where(
            likelihood[:, None] > 0, (votes @ places) / np.maximum(likelihood, 1e-300)[:, None] - places_now, 0.0
        )
        moved = self._particles + np.concatenate([shift / 2, 0.15 * shift], axis=1)
        self._particles = moved[systematic(likelihood + 1e-6, PARTICLES, self._rng)]

    def _candidate(
        self, image: ImageArray, response: Response, penalised: FloatArray, boxes: FloatArray, cell: int
    ) -> Candidate:
        """The place of a cell, and the signs that it is the target's."""
        box = boxes.reshape(-1, 4)[cell]
        places = centres(boxes)
        centre = np.clip(box_centre(box), 0, image.shape[1::-1])
        size = np.maximum(box[2:] - box[:2], LEAST_SIDE)
        opinion = None
        if self._filter is not None:
            opinion = self._filter.opinion(image, centre, self._size)
            if opinion.agrees:
                centre, size = self._filter.box_between(centre, size)
        apart = (np.abs(places - centre) > 0.6 * self._size).any(axis=-1)
        score = float(penalised.ravel()[cell])
        rate = SIZE_RATE * score
        template = self._template(image, centre, self._size + rate * (size - self._size))
        here = look(template)
        elsewhere = np.where(apart, penalised, 0.0)
        second = int(np.argmax(elsewhere))
        signs = Signs(
            logit(float(response.scores.ravel()[cell])),
            logit(float(elsewhere.ravel()[second])),
            float(np.linalg.norm(self._particles[:, :2] - centre, axis=1).mean()) / self._side,
            max(float(here @ kept) for kept in (self._first_look, *self._looks)),
            max(float(here @ kept) for kept in (*self._surroundings, *self._rivals)),
            1.0 if opinion is None else opinion.response,
            1.0 if opinion is None else opinion.colours,
        )
        rival = places.reshape(-1, 2)[second] if elsewhere.ravel()[second] > RIVAL else None
        return Candidate(centre, size, score, template, signs.row(), opinion, rival)

    def _chance(self, candidate: Candidate) -> float:
        """How likely the candidate is the target, after the frames before."""
        means = candidate.signs if self._means is None else self._means + RATE * (candidate.signs - self._means)
        self._means = means
        return self._weights.probability(candidate.signs, means)

    def _go_on(self, image: ImageArray, candidate: Candidate, chance: float) -> None:
        """Take the candidate for the target, and learn its look where it is certain."""
        assert self._means is not None
        self.signs = np.concatenate([candidate.signs, self._means])
        extent = np.array(image.shape[1::-1], dtype=np.float64)
        self._velocity = (self._velocity + candidate.centre - self._centre) / 2
        self._centre = candidate.centre
        if self._filter is not None and candidate.opinion is not None:
            self._filter.learn(image, candidate.opinion, chance >= CERTAIN)
        rate = SIZE_RATE * candidate.decisive
        self._size = np.clip(self._size + rate * (candidate.size - self._size), LEAST_SIDE, extent)
        self._doubted = self._doubted + 1 if chance < TRACKED else 0
        if chance < CERTAIN:
            return
        self._certain, self._tries = (self._centre, self._size, self._velocity), 0
        if self._frame % INTERVAL == 0:
            self._recent = self._recent + np.float32(RENEWAL) * (candidate.template - self._recent)
            self._looks.append(look(candidate.template))
            if candidate.rival is not None:
                self._rivals.append(self._look(image, candidate.rival))

    def _searched(self, image: ImageArray) -> Candidate | None:
        """The best place in another square: further from where the target was last certain as time passes."""
        centre, size, velocity = self._certain
        square = self._network.search_square(self._next_place(image, centre, size, velocity), size)
        if _shows_nothing(image, square):
            return None
        self.searched_frames += 1
        response, boxes = self._response(image, square)
        present, self._size = self._size, size
        penalised = response.scores * self._penalty(boxes)
        kept, best = self._particles, int(np.argmax(penalised))
        self._particles = self._about(box_centre(boxes.reshape(-1, 4)[best]))
        candidate = self._candidate(image, response, penalised, boxes, best)
        self._size, self._particles = present, kept
        return candidate

    def _next_place(self, image: ImageArray, centre: FloatArray, size: FloatArray, velocity: FloatArray) -> FloatArray:
        """Where is searched next: rounds on a spiral about where the target went, each a step longer than the last."""
        whole = (math.isqrt(8 * self._tries + 1) - 1) // 2
        n = self._tries - whole * (whole + 1) // 2
        self._tries += 1
        extent = np.array(image.shape[1::-1], dtype=np.float64)
        step = self._network.context * self._network.template_side(size) / 2
        # A sunflower: the angle is the golden one, and the area grows evenly.
        angle = n * math.pi * (3 - math.sqrt(5))
        offset = step * math.sqrt(n) * np.array([math.cos(angle), math.sin(angle)])
        return np.asarray(np.clip(centre + velocity * min(self._tries, DRIFT) + offset, 0, extent))

    def _unseen(self) -> TargetState:
        """The picture shows nothing: the target is taken to be where it was."""
        self._doubted += 1
        self._centre, self._size, _ = self._certain
        self._velocity, self._particles = np.zeros(2), self._about(self._centre)
        return TargetState(box_about(self._centre, self._size), 0.0, self._status(0.0))

    def _status(self, chance: float) -> Status:
        if chance >= TRACKED:
            return "tracking"
        return "searching" if self._doubted <= LOST_AFTER else "lost"

    @property
    def _side(self) -> float:
        """The target's side, pixels: of the square of the same area."""
        return float(np.sqrt(np.prod(self._size)))

    def _about(self, centre: FloatArray) -> FloatArray:
        """``(N, 4)`` particles x, y, vx, vy about a place, with the present velocity."""
        places = centre + self._rng.normal(size=(PARTICLES, 2)) * STEP * self._side
        return np.concatenate([places, np.broadcast_to(self._velocity, (PARTICLES, 2))], axis=1)

    def _moved(self) -> FloatArray:
        """The particles a frame later; some jump."""
        jumps = self._rng.random((PARTICLES, 1)) < JUMPS
        noise = self._rng.normal(size=(2, PARTICLES, 2)) * self._side
        velocity = PERSISTENCE * (self._particles[:, 2:] + ACCELERATION * noise[0])
        places = self._particles[:, :2] + velocity + np.where(jumps, JUMP, STEP) * noise[1]
        return np.concatenate([places, velocity], axis=1)

    def _look(self, image: ImageArray, centre: FloatArray) -> FloatArray:
        return look(self._template(image, centre, self._size))

    def _template(self, image: ImageArray, centre: FloatArray, size: FloatArray) -> Template:
        return self._network.template(image, Square.about(centre, self._network.template_side(size)))


def _shows_nothing(image: ImageArray, square: Square) -> bool:
    """Whether a square of the image has no contrast, as a black picture."""
    height, width = image.shape[:2]
    rows = slice(min(max(square.top, 0), height - 1), max(square.top + square.side, 1), 4)
    columns = slice(min(max(square.left, 0), width - 1), max(square.left + square.side, 1), 4)
    part = image[rows, columns]
    return int(part.max()) - int(part.min()) < LEAST_CONTRAST
