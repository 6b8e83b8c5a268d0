"""Several animals before a fixed camera, frame by frame: the regions that stand out become poses.

A region that several animals share is fitted by as many Gaussians of the animals' own sizes, which begin where the
animals were expected: only place and axis are free, so that the larger one stays the larger. Who is who is decided in
the end, by `link_animals`.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tsuiseki.tracking.animals.pose import AnimalPose, ExpectedAnimal, pose_of
from tsuiseki.tracking.animals.settings import AnimalSettings
from tsuiseki.tracking.features.background_difference import Background, Shape, shape_of
from tsuiseki.tracking.types import FloatArray, Frame, IntArray

# A region of this many usual areas in which no animal was expected holds more than one animal, unless its shape is that
# of one.
SEVERAL = 1.6
# Least fill of such a shape, over the usual one.
FILLED = 0.93
# Least and greatest aspect of such a shape, over the usual one: two animals side by side fill an ellipse, too, but a
# rounder one, and in line a longer one.
ASPECTS = (0.75, 1.33)
# Of expectation and maximisation.
ROUNDS = 12
# Pixels that are an animal, or decide on one, at least.
FEWEST = 12
# How far from a region an animal expected there may be, in its lengths.
REACH = 0.5


def find_animals(
    difference: NDArray[np.uint8], background: Background, smallest: float, expected: list[ExpectedAnimal]
) -> list[AnimalPose]:
    """The animals in a frame, in no particular order.

    Args:
        difference: ``(H, W)`` how far pixels stand out.
        background: says from where on they belong to an animal and to its core, and how many pixels a core has.
        smallest: share of these from which a region holds one.
        expected: animals of the frames before.
    """
    usual = background.area
    count, found_labels, stats, _ = cv2.connectedComponentsWithStats(
        (difference > background.threshold).astype(np.uint8)
    )
    labels = np.asarray(found_labels, dtype=np.int32)
    cores = np.bincount(labels[difference > background.core], minlength=count)
    regions = [n for n in range(1, count) if cores[n] >= max(smallest * usual, FEWEST)]
    where = {n: _pixels(labels, np.asarray(stats[n], dtype=np.int32), n) for n in regions}
    inside = _regions_of(where, labels, expected)
    poses: list[AnimalPose] = []
    for n, pixels in where.items():
        animals = [animal for animal, region in zip(expected, inside, strict=True) if region == n]
        contrast = np.asarray(difference[pixels[:, 1], pixels[:, 0]], dtype=np.float64)
        points = np.asarray(pixels + 0.5, dtype=np.float64)
        bright = contrast > background.core
        if not animals and cores[n] > SEVERAL * usual and not _like_one(points[bright], background.shape):
            animals = _apart(points, round(cores[n] / usual))
        if len(animals) < 2:
            poses.append(pose_of(points, contrast))
            continue
        parts = _assigned_pixels(points, points[bright], animals)
        for part, animal in enumerate(animals):
            if (parts == part).sum() >= FEWEST:
                poses.append(pose_of(points[parts == part], contrast[parts == part], animal))
    return poses


def _pixels(labels: NDArray[np.int32], stats: NDArray[np.int32], label: int) -> IntArray:
    """``(P, 2)`` x, y of a region."""
    left, top, width, height = (int(stats[n]) for n in range(4))
    rows, columns = np.nonzero(labels[top : top + height, left : left + width] == label)
    return np.stack([columns + left, rows + top], axis=1).astype(np.int64)


def _regions_of(where: dict[int, IntArray], labels: NDArray[np.int32], expected: list[ExpectedAnimal]) -> list[int]:
    """The region that each expected animal is in, 0 for none."""
    height, width = labels.shape
    regions = []
    for animal in expected:
        x, y = np.clip(np.floor(animal.core), 0, [width - 1, height - 1]).astype(int)
        label = int(labels[y, x])
        if label not in where:
            away = {n: float(np.linalg.norm(pixels - animal.core, axis=1).min()) for n, pixels in where.items()}
            label = min(away, key=away.__getitem__, default=0)
            if label and away[label] > REACH * animal.length:
                label = 0
        regions.append(label)
    return regions


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


def _assigned_pixels(points: FloatArray, core: FloatArray, animals: list[ExpectedAnimal]) -> IntArray:
    """``(P,)`` which of the animals each pixel shows, by expectation and maximisation with sizes that stay.

    Args:
        points: ``(P, 2)`` all pixels of the region.
        core: ``(Q, 2)`` those of cores, which alone decide: legs and wings held out do not.
        animals: those in the region.
    """
    places, axes = np.array([animal.core for animal in animals]), np.array([animal.axis for animal in animals])
    spreads = np.array([animal.spread for animal in animals])
    if len(core) < FEWEST * len(animals):
        core = points
    for _ in range(ROUNDS):
        cost = _costs(core, places, axes, spreads)
        # Pixels of a filled body count alike, whatever its size, so that the size takes no part but in the distance.
        weight = np.exp(cost.min(axis=0) - cost)
        weight /= weight.sum(axis=0)
        for n in range(len(animals)):
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


def _nearest_axis(covariance: FloatArray, previous: float) -> float:
    """Angle of the longer axis, of its two directions the one nearer to the ``previous`` one."""
    angle = 0.5 * np.arctan2(2 * covariance[0, 1], covariance[0, 0] - covariance[1, 1])
    return float(angle if np.cos(angle - previous) >= 0 else angle + np.pi)


# Of the sizes of an animal, how much a frame in which nothing touches it changes what is remembered.
REMEMBERED = 0.1
# Frames that an animal is expected where it was last detected.
PATIENCE = 5


class AnimalTracker:
    """Finds the poses of animals in frame after frame; `link_animals` says in the end who is who.

    Args:
        background: what they stand out from.
        settings: see `AnimalSettings`.

    Attributes:
        poses: of each frame, in no particular order.
    """

    def __init__(self, background: Background, settings: AnimalSettings | None = None) -> None:
        self._background, self._smallest = background, (settings or AnimalSettings()).smallest
        self.poses: list[list[AnimalPose]] = []
        self._recent: list[ExpectedAnimal] = []

    def update(self, frame: Frame) -> None:
        """Take the next frame."""
        expected = [replace(animal, core=animal.core + animal.step) for animal in self._recent]
        present: list[AnimalPose] = []
        if self._background.area > 0:
            difference = self._background.difference(frame.image)
            present = find_animals(difference, self._background, self._smallest, expected)
        self._recent = _remembered(self._recent, expected, present)
        self.poses.append(present)


def _remembered(
    recent: list[ExpectedAnimal], expected: list[ExpectedAnimal], present: list[AnimalPose]
) -> list[ExpectedAnimal]:
    """The animals after a frame: those present, each paired with the nearest of those before, and those missed."""
    pairs = []
    if recent and present:
        away = np.array([[np.linalg.norm(animal.core - pose.core) for pose in present] for animal in expected])
        pairs = [(i, j) for i, j in zip(*linear_sum_assignment(away), strict=True) if away[i, j] < present[j].length]
    partners = {j: recent[i] for i, j in pairs}
    remembered = []
    for j, pose in enumerate(present):
        old = partners.get(j)
        axis, shift = pose.pointing(pose.axis if old is None else old.axis)
        new = ExpectedAnimal(pose.core, axis, pose.spread, shift, pose.length)
        if old is not None:
            # What was separated by a fit to what is remembered teaches nothing.
            share = 0.0 if pose.contact else REMEMBERED
            spread, shift, length = (
                (1 - share) * getattr(old, name) + share * getattr(new, name) for name in ("spread", "shift", "length")
            )
            step = 0.5 * old.step + 0.5 * (pose.core - old.core)
            new = replace(new, spread=spread, shift=shift, length=length, step=step)
        remembered.append(new)
    paired = {i for i, _ in pairs}
    missed = [animal for i, animal in enumerate(recent) if i not in paired and animal.undetected < PATIENCE]
    return remembered + [replace(animal, step=np.zeros(2), undetected=animal.undetected + 1) for animal in missed]
