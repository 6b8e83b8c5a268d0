"""Fitting the objectness model to labelled boxes: a linear SVM on normed gradients, then one calibration a size.

Cheng et al., "BING", CVPR 2014, section 3. Stage one learns what an object's 8 x 8 normed gradients look like, whatever
its size. Stage two runs stage one over the training images and fits ``gain * score + offset`` for each size, so that
windows of sizes in which objects are rare rank lower.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tsuiseki.datamodules.scenes.single_clip import ChaseSettings, render_chase
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.objectness import (
    SIDE,
    ObjectnessModel,
    binarise,
    normed_gradients,
    propose,
)
from tsuiseki.tracking.geometry import iou_matrix
from tsuiseki.tracking.types import FloatArray, ImageArray


@dataclass(frozen=True)
class LabelledImage:
    """An image with the boxes ``(N, 4)`` of all objects in it."""

    image: ImageArray
    boxes: FloatArray


@dataclass(frozen=True)
class ObjectnessSettings:
    """How to fit.

    Attributes:
        sides: widths and heights of the windows, pixels; all pairs with a plausible shape are used.
        steepest: greatest ratio of the sides of a window.
        negatives: windows without an object, drawn at random, per image.
        regularisation: C of the SVM of stage one.
        min_examples: sizes with fewer objects among their windows are left out.
        seed: of all draws.
    """

    sides: tuple[int, ...] = (12, 18, 27, 40, 60, 90, 135, 200)
    steepest: float = 4.0
    negatives: int = 50
    regularisation: float = 1.0
    min_examples: int = 20
    seed: int = 0


def generated_images(count: int, seed: int) -> list[LabelledImage]:
    """Images of generated chases with the box of the followed person."""
    rng = np.random.default_rng(seed)
    images: list[LabelledImage] = []
    while len(images) < count:
        size = float(rng.choice([20, 35, 60, 100, 160]))
        settings = ChaseSettings(
            frames=3, person_height=(size, 1.6 * size), passers=0, obstacles=int(rng.integers(0, 3))
        )
        clip = render_chase(rng, settings)
        seen = [k for k in range(settings.frames) if clip.visibility[k] > 0.8]
        images.extend(LabelledImage(clip.images[k], clip.boxes[k : k + 1]) for k in seen)
    return images[:count]


def fit_objectness(images: Sequence[LabelledImage], settings: ObjectnessSettings, trained_on: str) -> ObjectnessModel:
    """The model for what the boxes of ``images`` hold.

    Raises:
        RequestError: there are too few boxes.
    """
    from sklearn.svm import LinearSVC

    rng = np.random.default_rng(settings.seed)
    positives = [g for item in images for g in _gradients(item.image, item.boxes)]
    if len(positives) < settings.min_examples:
        raise RequestError(
            f"expected at least {settings.min_examples} labelled boxes to learn from, got {len(positives)}"
        )
    negatives = [g for item in images for g in _gradients(item.image, _windows_without_object(item, settings, rng))]
    features = np.array(positives + negatives, dtype=np.float64) / 255
    labels = np.repeat([1, 0], [len(positives), len(negatives)])
    svm = LinearSVC(C=settings.regularisation, class_weight="balanced", random_state=settings.seed, max_iter=20000)
    weights = binarise(svm.fit(features, labels).coef_.reshape(SIDE, SIDE))
    return _calibrate(images, weights, settings, trained_on)


def window_sizes(settings: ObjectnessSettings) -> FloatArray:
    """``(S, 2)`` all pairs of sides with a plausible shape."""
    pairs = [(w, h) for w in settings.sides for h in settings.sides if max(w, h) <= settings.steepest * min(w, h)]
    return np.array(pairs, dtype=np.float64)


def _gradients(image: ImageArray, boxes: FloatArray) -> Iterable[FloatArray]:
    """``(64,)`` normed gradients of each box.

    A cell around the box comes along, since an object's outline lies on the border of its box: cut off there, it would
    have no gradient in training and the strongest of all when whole images are searched.
    """
    height, width = image.shape[:2]
    for box in boxes:
        cell = (box[2:] - box[:2]) / SIDE
        low, high = np.round(box[:2] - cell).astype(int), np.round(box[2:] + cell).astype(int)
        if (high - low < SIDE // 2).any():
            continue
        x, y = (np.clip(np.arange(low[k], high[k]), 0, (width, height)[k] - 1) for k in range(2))
        small = cv2.resize(image[y[:, None], x], (SIDE + 2, SIDE + 2), interpolation=cv2.INTER_AREA)
        yield normed_gradients(np.asarray(small, dtype=np.uint8))[1:-1, 1:-1].ravel().astype(np.float64)


def _windows_without_object(item: LabelledImage, settings: ObjectnessSettings, rng: np.random.Generator) -> FloatArray:
    height, width = item.image.shape[:2]
    sizes = window_sizes(settings)
    sizes = sizes[(sizes < [width, height]).all(axis=1)]
    drawn = sizes[rng.integers(len(sizes), size=settings.negatives)] if len(sizes) else np.empty((0, 2))
    corner = rng.random(drawn.shape) * (np.array([width, height]) - drawn)
    boxes = np.concatenate([corner, corner + drawn], axis=1)
    if not len(item.boxes):
        return boxes
    return np.asarray(boxes[iou_matrix(boxes, item.boxes).max(axis=1) < 0.5])


def _calibrate(
    images: Sequence[LabelledImage], weights: FloatArray, settings: ObjectnessSettings, trained_on: str
) -> ObjectnessModel:
    """Stage two: a logistic fit of "is an object" on the score of stage one, size by size."""
    from sklearn.linear_model import LogisticRegression

    kept, gains, offsets = [], [], []
    for size in window_sizes(settings):
        single = ObjectnessModel(weights, size[None], np.ones(1), np.zeros(1), "")
        scores, labels = [], []
        for item in images:
            boxes, values = propose(item.image, single, 30)
            if len(boxes):
                covers = (
                    iou_matrix(boxes, item.boxes).max(axis=1) >= 0.5 if len(item.boxes) else np.zeros(len(boxes), bool)
                )
                scores.append(values)
                labels.append(covers)
        truth = np.concatenate(labels) if labels else np.empty(0, dtype=bool)
        if truth.sum() < settings.min_examples or truth.all():
            continue
        score = np.concatenate(scores)
        scale = float(score.std()) or 1.0
        fit = LogisticRegression().fit((score / scale)[:, None], truth)
        kept.append(size)
        # A size on which the score says nothing keeps the order of its windows: a gain of zero or less would not.
        gains.append(max(float(fit.coef_[0, 0]), 1e-3) / scale)
        offsets.append(float(fit.intercept_[0]))
    if not kept:
        raise RequestError(f"expected {settings.min_examples} labelled boxes of at least one window size, got fewer")
    return ObjectnessModel(weights, np.array(kept), np.array(gains), np.array(offsets), trained_on)
