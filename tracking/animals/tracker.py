"""Several animals before a fixed camera, frame by frame: the regions that stand out become poses.

A region that several animals share is fitted by as many Gaussians of the animals' own sizes, which begin where the
animals were expected: only place and axis are free, so that the larger one stays the larger. Who is who is decided in
the end, by `link_animals`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.animals.linking import Animal, link_animals
from tsuiseki.tracking.animals.pose import AnimalPose, ExpectedAnimal, pose_of
from tsuiseki.tracking.animals.settings import AnimalSettings
from tsuiseki.tracking.features.background_difference import Background, Shape, shape_of
from tsuiseki.tracking.types import FloatArray, Frame, IntArray

# A region of this many usual areas in which no animal was expected holds more than one animal, unless its shape is that
# of one.
SEVERAL = 1.6
# Least fill, least and greatest aspect of such a shape, over the usual ones: two animals side by side fill an ellipse,
# too, but a rounder one, and in line a longer one.
FILLED, ASPECTS = 0.93, (0.75, 1.33)
ROUNDS = 12
FEWEST = 12
# How far from a region an animal expected there may be, in its lengths.
REACH = 0.5


def find_animals(
    difference: NDArray[np.uint8], background: Background, usual: float, smallest: float, expected: list[ExpectedAnimal]
) -> list[AnimalPose]:
    """The animals in a frame, in no particular order.

    Args:
        difference: ``(H, W)`` how far pixels stand out.
        background: says from where on they belong to an animal, and to its core.
        usual: pixels of the core of one animal.
        smallest: share of that from which a region holds one.
        expected: animals of the frames before.
    """
    count, found_labels, stats, _ = cv2.connectedComponentsWithStats(
        (difference > background.threshold).astype(np.uint8)
    )
    labels = np.asarray(found_labels, dtype=np.int32)
    cores = np.bincount(labels[difference > background.core], minlength=count)
    kept = [n for n in range(1, count) if cores[n] >= max(smallest * usual, FEWEST)]
    where = {n: _pixels(labels, np.asarray(stats[n], dtype=np.int32), n) for n in kept}
    inside = _regions_of(where, labels, expected)
    found: list[AnimalPose] = []
    for n, pixels in where.items():
        own = [one for one, region in zip(expected, inside, strict=True) if region == n]
        contrast = np.asarray(difference[pixels[:, 1], pixels[:, 0]], dtype=np.float64)
        points = np.asarray(pixels + 0.5, dtype=np.float64)
        bright = contrast > background.core
        if not own and cores[n] > SEVERAL * usual and not _like_one(points[bright], background.shape):
            own = _apart(points, round(cores[n] / usual))
        if len(own) < 2:
            found.append(pose_of(points, contrast))
            continue
        parts = _assigned_pixels(points, points[bright], own)
        for part, one in enumerate(own):
            if (parts == part).sum() >= FEWEST:
                found.append(pose_of(points[parts == part], contrast[parts == part], one))
    return found


def _pixels(labels: NDArray[np.int32], stats: NDArray[np.int32], label: int) -> IntArray:
    """``(P, 2)`` x, y of a region."""
    left, top, width, height = (int(stats[n]) for n in range(4))
    rows, columns = np.nonzero(labels[top : top + height, left : left + width] == label)
    return np.stack([columns + left, rows + top], axis=1).astype(np.int64)


def _regions_of(where: dict[int, IntArray], labels: NDArray[np.int32], expected: list[ExpectedAnimal]) -> list[int]:
    """The region that each expected animal is in, 0 for none."""
    height, width = labels.shape
    found = []
    for one in expected:
        x, y = np.clip(np.floor(one.core), 0, [width - 1, height - 1]).astype(int)
        label = int(labels[y, x])
        if label not in where:
            away = {n: float(np.linalg.norm(pixels - one.core, axis=1).min()) for n, pixels in where.items()}
            label = min(away, key=away.__getitem__, default=0)
            if label and away[label] > REACH * one.length:
                label = 0
        found.append(label)
    return found


def _like_one(core: FloatArray, usual: Shape | None) -> bool:
    """Whether a core ``(P, 2)`` has the shape of one animal, of whatever size."""
    if usual is None:
        return False
    shape = shape_of(core)
    return shape.fill >= FILLED * usual.fill and ASPECTS[0] <= shape.aspect / usual.aspect <= ASPECTS[1]


def _apart(points: FloatArray, count: int) -> list[ExpectedAnimal]:
    """``count`` animals of equal size in a region in which none was expected."""
    cv2.setRNGSeed(0)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.1)
    _, label, _ = cv2.kmeans(
        points.astype(np.float32), count, np.empty(0, np.int32), criteria, 5, cv2.KMEANS_PP_CENTERS
    )
    parts = [points[label[:, 0] == n] for n in range(count)]
    poses = [pose_of(part, np.ones(len(part))) for part in parts]
    return [ExpectedAnimal(pose.core, pose.axis, pose.spread, 0.0, pose.length) for pose in poses]


def _assigned_pixels(points: FloatArray, core: FloatArray, own: list[ExpectedAnimal]) -> IntArray:
    """``(P,)`` which of the animals each pixel shows, by expectation and maximisation with sizes that stay.

    Args:
        points: ``(P, 2)`` all pixels of the region.
        core: ``(Q, 2)`` those of cores, which alone decide: legs and wings held out do not.
        own: the animals.
    """
    places, axes = np.array([one.core for one in own]), np.array([one.axis for one in own])
    spreads = np.array([one.spread for one in own])
    if len(core) < FEWEST * len(own):
        core = points
    for _ in range(ROUNDS):
        cost = _costs(core, places, axes, spreads)
        # Pixels of a filled body count alike, whatever its size, so that the size takes no part but in the distance.
        weight = np.exp(cost.min(axis=0) - cost)
        weight /= weight.sum(axis=0)
        for n in range(len(own)):
            total = weight[n].sum()
            if total < FEWEST:
                continue
            places[n] = weight[n] @ core / total
            away = core - places[n]
            axes[n] = _nearest_axis((weight[n][:, None] * away).T @ away / total, axes[n])
    return np.asarray(np.argmin(_costs(points, places, axes, spreads), axis=0), dtype=np.int64)


def _costs(points: FloatArray, places: FloatArray, axes: FloatArray, spreads: FloatArray) -> FloatArray:
    """``(K, P)`` half the squared distances of points to animals, in their deviations."""
    along = np.stack([np.cos(axes), np.sin(axes)], axis=1)
    across = np.stack([-np.sin(axes), np.cos(axes)], axis=1)
    away = points[None] - places[:, None]
    first, second = np.einsum("kpd,kd->kp", away, along), np.einsum("kpd,kd->kp", away, across)
    return np.asarray(0.5 * ((first / spreads[:, :1]) ** 2 + (second / spreads[:, 1:]) ** 2))


def _nearest_axis(covariance: FloatArray, before: float) -> float:
    """Angle of the longer axis, of its two directions the one nearer to ``before``."""
    angle = 0.5 * np.arctan2(2 * covariance[0, 1], covariance[0, 0] - covariance[1, 1])
    return float(angle if np.cos(angle - before) >= 0 else angle + np.pi)


# Of the sizes of an animal, how much a frame in which nothing touches it changes what is remembered.
REMEMBERED = 0.1
# Frames that an animal is expected where it was last detected.
PATIENCE = 5


@dataclass
class _RecentAnimal:
    """An animal as the frames before showed it, and how it moved in the last."""

    expected: ExpectedAnimal
    step: FloatArray = field(default_factory=lambda: np.zeros(2))
    undetected: int = 0


class AnimalTracker:
    """Follows animals through frames; the answer comes in the end.

    Args:
        background: what they stand out from.
        settings: see `AnimalSettings`.
        frame_rate: frames a second.
    """

    def __init__(
        self, background: Background, settings: AnimalSettings | None = None, frame_rate: float = 25.0
    ) -> None:
        self.background, self.settings, self.frame_rate = background, settings or AnimalSettings(), frame_rate
        self.frames: list[int] = []
        self.poses: list[list[AnimalPose]] = []
        self._recent: list[_RecentAnimal] = []
        self._area = self.settings.area or background.area

    def update(self, frame: Frame) -> list[AnimalPose]:
        """Take the next frame; returns the animals in it, in no particular order."""
        expected = [replace(one.expected, core=one.expected.core + one.step) for one in self._recent]
        found: list[AnimalPose] = []
        if self._area > 0:
            difference = self.background.difference(frame.image)
            found = find_animals(difference, self.background, self._area, self.settings.smallest, expected)
        self._recent = _remembered(self._recent, expected, found)
        self.frames.append(frame.index)
        self.poses.append(found)
        return found

    def animals(self) -> list[Animal]:
        """The animals of all frames so far, by id."""
        height, width = self.background.image.shape[:2]
        return link_animals(self.poses, self.frames, self.settings, self.frame_rate, (width, height))


def _remembered(
    recent: list[_RecentAnimal], expected: list[ExpectedAnimal], found: list[AnimalPose]
) -> list[_RecentAnimal]:
    """Who is expected in the next frame: animals found, paired with the nearest of those before, and those missed."""
    pairs = []
    if recent and found:
        away = np.array([[np.linalg.norm(one.core - pose.core) for pose in found] for one in expected])
        pairs = [(i, j) for i, j in zip(*linear_sum_assignment(away), strict=True) if away[i, j] < found[j].length]
    before = {j: i for i, j in pairs}
    after = []
    for j, pose in enumerate(found):
        if j not in before:
            axis, shift = pose.pointing(pose.axis)
            after.append(_RecentAnimal(ExpectedAnimal(pose.core, axis, pose.spread, shift, pose.length)))
            continue
        old = recent[before[j]]
        axis, shift = pose.pointing(old.expected.axis)
        # What was separated by a fit to what is remembered teaches nothing.
        share = 0.0 if pose.contact else REMEMBERED
        kept = old.expected
        known = ExpectedAnimal(
            pose.core,
            axis,
            (1 - share) * kept.spread + share * pose.spread,
            (1 - share) * kept.shift + share * shift,
            (1 - share) * kept.length + share * pose.length,
        )
        after.append(_RecentAnimal(known, 0.5 * old.step + 0.5 * (pose.core - kept.core)))
    used = set(before.values())
    for i, old in enumerate(recent):
        if i not in used and old.undetected < PATIENCE:
            after.append(replace(old, step=np.zeros(2), undetected=old.undetected + 1))
    return after
