"""Place, axis, size and heading of an animal from the pixels that show it.

Legs, and wings that are held out, are fainter than the body: the axis is that of the *core*, the pixels with at least
half of the animal's own contrast. The length is that of the pixels along that axis, no farther from it than the core is
wide, so that a tail as faint as a wing counts and a wing held out does not. Where a body ends is soft: behind it lie
folded wings, a tail, a shadow, each of its own contrast. So the middle is the mean of the middles that the body has at
all levels of contrast from the faintest pixel up to the core. That middle slides with the wings, but the head ends
sharply: `link_animals` holds the place to the ends.

Which end is the head: an animal walks towards its head most of the time, and its contrast and outline are not the same
at both ends. How they differ is learnt from the frames in which animals walk; then each animal's ends are chosen
together for all frames (Viterbi), since between two frames no animal turns by more than a right angle.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tsuiseki.tracking.types import FloatArray, IntArray

# Share of an animal's contrast from which a pixel is its core.
CORE = 0.5
# Quantile of the contrast of its pixels that counts as an animal's own.
PEAK = 0.98
# Half the width of the band along the axis, in half widths of the core.
BAND = 1.25
# Quantiles of the pixels along the axis between which the length lies.
ENDS = (0.01, 0.99)
# Shares of an animal's contrast at which its ends are taken: a sharp end lies at one place in both.
EDGES = (0.3, 0.5)
# Levels of contrast at which the middle is taken.
LEVELS = 8
# Pixels that tell the place of an end, or a core, at least.
FEWEST = 8


@dataclass(frozen=True)
class ExpectedAnimal:
    """An animal as the frames before showed it.

    Attributes:
        core: ``(2,)`` where the middle of its core is expected, pixels.
        axis: radians.
        spread: ``(2,)`` deviations of the pixels of its core along the axis and across, pixels.
        shift: from the middle of the core to that of the body, along the axis, pixels.
        length: of the body, pixels.
        step: ``(2,)`` of the core in the last frame, pixels.
        undetected: frames since it was detected.
    """

    core: FloatArray
    axis: float
    spread: FloatArray
    shift: float
    length: float
    step: FloatArray = field(default_factory=lambda: np.zeros(2))
    undetected: int = 0


@dataclass(frozen=True)
class AnimalPose:
    """An animal in one frame.

    Attributes:
        place: ``(2,)`` x, y of the middle of the body, pixels.
        axis: radians of its long axis; which end is the head is not known, unless ``headed``.
        length: along the axis, pixels.
        width: of the core, across, pixels.
        core: ``(2,)`` middle of its core, pixels.
        spread: ``(2,)`` deviations of the pixels of the core along the axis and across, pixels.
        brightness: mean contrast, grey levels.
        asymmetry: ``(2,)`` where the contrast lies along the axis, and where it is drawn out; of the length.
        contact: another animal touches it, so that its pixels were separated by a fit.
        score: overlap of the ellipse of length and width with the animal's pixels, intersection over union.
        headed: the axis points to the head.
        ends: ``(2, 2)`` at each of `EDGES` the rear and front end along the axis, from the core, pixels; None where
            no detector ran.
        points: ``(K, 2)`` of a skeleton, pixels; None where there is none.
        point_scores: ``(K,)`` in [0, 1].
    """

    place: FloatArray
    axis: float
    length: float
    width: float
    core: FloatArray
    spread: FloatArray
    brightness: float
    asymmetry: FloatArray
    contact: bool = False
    headed: bool = False
    ends: FloatArray | None = None
    points: FloatArray | None = None
    point_scores: FloatArray | None = None
    score: float = 1.0

    @property
    def appearance(self) -> FloatArray:
        """``(3,)`` logarithms of length, width and brightness: what tells one animal from another."""
        return np.log([max(self.length, 1.0), max(self.width, 1.0), max(self.brightness, 1.0)])

    def pointing(self, axis: float) -> tuple[float, float]:
        """Of the two directions of the axis the one nearer to ``axis``, and the shift from core to body along it."""
        direction = self.axis if np.cos(self.axis - axis) >= 0 else self.axis + np.pi
        away = self.place - self.core
        return direction, float(away[0] * np.cos(direction) + away[1] * np.sin(direction))


def pose_of(pixels: FloatArray, contrast: FloatArray, touched: ExpectedAnimal | None = None) -> AnimalPose:
    """The pose of an animal.

    Args:
        pixels: ``(P, 2)`` centres x, y of its pixels.
        contrast: ``(P,)`` how far each stands out, grey levels.
        touched: how it was before, where another animal touches it: its ends may be the other's then, so that length
            and place follow from the core.
    """
    bright = contrast >= CORE * np.quantile(contrast, PEAK)
    core = pixels[bright] if bright.sum() >= FEWEST else pixels
    middle = core.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((core - middle).T) + 1e-6 * np.eye(2))
    along, across = vectors[:, 1], np.array([-vectors[1, 1], vectors[0, 1]])
    spread = np.sqrt(values[::-1])
    half = 2 * float(spread[1]) + 0.5
    band = np.abs((pixels - middle) @ across) <= BAND * half
    weight, along_body = contrast[band], (pixels[band] - middle) @ along
    low, high = np.quantile(along_body, ENDS)
    peak = np.quantile(contrast, PEAK)
    centre, length = _middle(along_body, weight, CORE * peak), float(high - low) + 1.0
    parts = [along_body[weight >= edge * peak] for edge in EDGES]
    ends = np.array([np.quantile(part, ENDS) if len(part) >= FEWEST else (low, high) for part in parts])
    away = along_body - along_body.mean()
    asymmetry = np.array([np.average(away, weights=weight), np.mean(away**3) / length**2]) / length
    if touched is not None:
        same = np.cos(touched.axis) * along[0] + np.sin(touched.axis) * along[1] >= 0
        centre, length = touched.shift if same else -touched.shift, touched.length
        asymmetry = np.zeros(2)
    place = middle + centre * along
    return AnimalPose(
        place=place,
        axis=float(np.arctan2(along[1], along[0])),
        length=length,
        width=2 * half,
        core=middle,
        spread=spread,
        brightness=float(weight.mean()),
        asymmetry=asymmetry,
        contact=touched is not None,
        ends=ends,
        score=_overlap((pixels - place) @ np.stack([along, across], axis=1), length, 2 * half),
    )


def _overlap(away: FloatArray, length: float, width: float) -> float:
    """Intersection over union, in [0, 1], of an ellipse and pixels ``(P, 2)`` from its middle, along and across it."""
    within = int((((away / [length / 2, width / 2]) ** 2).sum(axis=1) <= 1).sum())
    return within / (len(away) + max(np.pi / 4 * length * width, within) - within)


def _middle(along: FloatArray, contrast: FloatArray, core: float) -> float:
    """The mean of the middles between both ends, over levels of contrast from the faintest pixel up to ``core``."""
    order = np.argsort(along)
    along, contrast = along[order], contrast[order]
    parts = [along[contrast >= level] for level in np.linspace(contrast.min(), core, LEVELS, endpoint=False)]
    ends = [part[[round(end * (len(part) - 1)) for end in ENDS]] for part in parts if len(part) >= FEWEST]
    return float(np.mean(ends)) if ends else float(along.mean())


# Lengths of itself that an animal moves within `SPAN`, from which it walks.
WALKING = 0.25
# Time over which a walk is measured, seconds.
SPAN = 0.4
# Evidence of a head that a person labelled: more than a walk of many frames.
LABELLED = 100.0
# Cost of a right angle between two frames; a frame of walking the other way costs up to 1.
TURNED_ROUND = 50.0


def heads(poses: list[AnimalPose], signs: FloatArray, frame_rate: float) -> FloatArray:
    """``(T,)`` headings in radians of one animal in frames that follow each other.

    Args:
        poses: ``T`` of them; their axes point either way.
        signs: ``(2,)`` see `head_signs`.
        frame_rate: frames a second.
    """
    axes = np.array([pose.axis for pose in poses])
    votes = _walk(poses, frame_rate) + 0.5 * np.tanh(_asymmetries(poses) * signs).sum(axis=1)
    votes = np.where([pose.headed for pose in poses], LABELLED, votes)
    flips = _chosen(axes, votes)
    return np.asarray(np.angle(np.exp(1j * (axes + np.pi * flips))))


def head_signs(tracks: list[list[AnimalPose]], frame_rate: float) -> tuple[FloatArray, float]:
    """How each asymmetry tells the head, from animals that walk, and for how long they clearly do.

    Args:
        tracks: poses of each animal.
        frame_rate: frames a second.

    Returns:
        ``(2,)`` sign and strength of each asymmetry, 0 where it does not tell; seconds of walking, all together.
    """
    walks = np.concatenate([_walk(poses, frame_rate) for poses in tracks] or [np.empty(0)])
    asymmetries = np.concatenate([_asymmetries(poses) for poses in tracks] or [np.empty((0, 2))])
    walking = np.abs(walks) > 0.5
    seconds = int(walking.sum()) / frame_rate
    if walking.sum() < 2:
        return np.zeros(2), seconds
    agree = np.sign(walks[walking])[:, None] * asymmetries[walking]
    # The mean over its deviation: an asymmetry that is now here, now there says little.
    scale = np.maximum(np.sqrt(np.mean(agree**2, axis=0)), 1e-9)
    share = agree.mean(axis=0) / scale
    return np.asarray(np.where(np.abs(share) > 0.2, share, 0.0) / scale), seconds


def _asymmetries(poses: list[AnimalPose]) -> FloatArray:
    return np.array([pose.asymmetry for pose in poses]).reshape(-1, 2)


def _walk(poses: list[AnimalPose], frame_rate: float) -> FloatArray:
    """``(T,)`` in [-1, 1]: how clearly an animal walks where its axis points, or the other way."""
    places = np.array([pose.place for pose in poses])
    half = max(1, round(SPAN * frame_rate / 2))
    last = len(places) - 1
    first, second = np.clip(np.arange(last + 1) - half, 0, last), np.clip(np.arange(last + 1) + half, 0, last)
    step = places[second] - places[first]
    axes = np.array([pose.axis for pose in poses])
    lengths = np.array([max(pose.length, 1.0) for pose in poses])
    along = (step[:, 0] * np.cos(axes) + step[:, 1] * np.sin(axes)) / (WALKING * lengths)
    return np.asarray(np.clip(along, -1.0, 1.0) * (np.abs(along) > 0.3))


def _chosen(axes: FloatArray, votes: FloatArray) -> IntArray:
    """``(T,)`` 1 where the axis points to the tail: the cheapest way through all frames."""
    costs = np.stack([-votes, votes], axis=1)
    back = np.zeros((len(axes), 2), dtype=np.int64)
    total = costs[0].copy()
    for t in range(1, len(axes)):
        same = np.cos(axes[t] - axes[t - 1])
        # Rows: before, columns: now. The more the head turns, the dearer.
        turn = TURNED_ROUND * np.maximum(0.0, 1 - np.array([[same, -same], [-same, same]]))
        way = total[:, None] + turn
        back[t] = way.argmin(axis=0)
        total = way.min(axis=0) + costs[t]
    flips = np.zeros(len(axes), dtype=np.int64)
    flips[-1] = int(total.argmin())
    for t in range(len(axes) - 1, 0, -1):
        flips[t - 1] = back[t, flips[t]]
    return flips
