"""Fitting the objectness model to labelled boxes: a linear SVM on normed gradients, then one calibration a size.

Cheng et al., "BING", CVPR 2014, section 3. Stage one learns what an object's 8 x 8 normed gradients look like, whatever
its size. Stage two runs stage one over the training images and fits ``gain * score + offset`` for each size, so that
windows of sizes in which objects are rare rank lower.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from pydantic import PositiveInt

from tsuiseki.datamodules.scenes.single_clip import SingleClip, SingleClipSettings
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.objectness import (
    SIDE,
    ObjectnessModel,
    binarise,
    normed_gradients,
    propose,
    recall,
)
from tsuiseki.tracking.fields import HIDDEN, Commas
from tsuiseki.tracking.formats.mot import read_ground_truth
from tsuiseki.tracking.formats.mot_sequence import find_sequences
from tsuiseki.tracking.formats.single import find_single_sequences
from tsuiseki.tracking.geometry import clip_boxes, iou_matrix
from tsuiseki.tracking.report.plots import COLOURS
from tsuiseki.tracking.runs.options import PlottedFile, Seed
from tsuiseki.tracking.types import FloatArray, ImageArray
from tsuiseki.tracking.video.image_folder import read_image

# Widths and heights of windows, pixels, of which all pairs of a plausible shape are used.
SIDES = (12, 18, 27, 40, 60, 90, 135, 200)
# Greatest ratio of the sides of a window.
STEEPEST = 4.0
# Windows without an object, drawn at random, of each image.
NEGATIVES = 50
# C of the SVM of stage one.
REGULARISATION = 1.0
# Sizes with fewer objects among their windows are left out.
MIN_EXAMPLES = 20


@dataclass(frozen=True)
class BoxedImage:
    """An image with the boxes ``(N, 4)`` of all objects in it."""

    image: ImageArray
    boxes: FloatArray


def generated_images(count: int, seed: int) -> list[BoxedImage]:
    """Images of generated clips with the box of the followed person."""
    rng = np.random.default_rng(seed)
    images: list[BoxedImage] = []
    while len(images) < count:
        size = float(rng.choice([20, 35, 60, 100, 160]))
        settings = SingleClipSettings(
            frames=3, person_height=(size, 1.6 * size), passers=0, obstacles=int(rng.integers(0, 3))
        )
        for (image,), truth in SingleClip(settings, rng).frames():
            if truth.visibility[0] > 0.8:
                images.append(BoxedImage(image, truth.boxes))
    return images[:count]


def fit_objectness(images: Sequence[BoxedImage], seed: int, trained_on: str) -> ObjectnessModel:
    """The model for what the boxes of ``images`` hold.

    Raises:
        RequestError: there are too few boxes.
    """
    from sklearn.svm import LinearSVC

    rng = np.random.default_rng(seed)
    positives = [g for item in images for g in _gradients(item.image, item.boxes)]
    if len(positives) < MIN_EXAMPLES:
        raise RequestError(f"expected at least {MIN_EXAMPLES} labelled boxes to learn from, got {len(positives)}")
    negatives = [g for item in images for g in _gradients(item.image, _windows_without_object(item, rng))]
    features = np.array(positives + negatives, dtype=np.float64) / 255
    labels = np.repeat([1, 0], [len(positives), len(negatives)])
    svm = LinearSVC(C=REGULARISATION, class_weight="balanced", random_state=seed, max_iter=20000)
    weights = binarise(svm.fit(features, labels).coef_.reshape(SIDE, SIDE))
    return _calibrate(images, weights, trained_on)


def window_sizes() -> FloatArray:
    """``(S, 2)`` all pairs of sides with a plausible shape."""
    pairs = [(w, h) for w in SIDES for h in SIDES if max(w, h) <= STEEPEST * min(w, h)]
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


def _windows_without_object(item: BoxedImage, rng: np.random.Generator) -> FloatArray:
    height, width = item.image.shape[:2]
    sizes = window_sizes()
    sizes = sizes[(sizes < [width, height]).all(axis=1)]
    drawn = sizes[rng.integers(len(sizes), size=NEGATIVES)] if len(sizes) else np.empty((0, 2))
    corner = rng.random(drawn.shape) * (np.array([width, height]) - drawn)
    boxes = np.concatenate([corner, corner + drawn], axis=1)
    if not len(item.boxes):
        return boxes
    return np.asarray(boxes[iou_matrix(boxes, item.boxes).max(axis=1) < 0.5])


def _calibrate(images: Sequence[BoxedImage], weights: FloatArray, trained_on: str) -> ObjectnessModel:
    """Stage two: a logistic fit of "is an object" on the score of stage one, size by size."""
    from sklearn.linear_model import LogisticRegression

    scales, gains, offsets = [], [], []
    for size in window_sizes():
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
        if truth.sum() < MIN_EXAMPLES or truth.all():
            continue
        score = np.concatenate(scores)
        scale = float(score.std()) or 1.0
        fit = LogisticRegression().fit((score / scale)[:, None], truth)
        scales.append(size)
        # A size on which the score says nothing keeps the order of its windows: a gain of zero or less would not.
        gains.append(max(float(fit.coef_[0, 0]), 1e-3) / scale)
        offsets.append(float(fit.intercept_[0]))
    if not scales:
        raise RequestError(f"expected {MIN_EXAMPLES} labelled boxes of at least one window size, got fewer")
    return ObjectnessModel(weights, np.array(scales), np.array(gains), np.array(offsets), trained_on)


# Numbers of windows for which recall is reported.
WINDOWS = (1, 3, 10, 30, 100, 300, 1000)


def boxed_images(folder: Path, interval: int) -> list[BoxedImage]:
    """Every ``interval``-th image with its boxes, of MOTChallenge sequences or of sequences with one target.

    Raises:
        RequestError: there are neither, or they have no images.
    """
    try:
        sequences = [s for s in find_sequences(folder) if s.ground_truth_path.is_file()]
    except RequestError:
        sequences = []
    boxed: list[tuple[Path, FloatArray]] = []
    for sequence in sequences:
        truth = read_ground_truth(sequence.ground_truth_path)
        truth = truth.select(truth.evaluated & (truth.visibility > 0.5))
        boxed += [(p, truth.boxes[truth.frames == t]) for t, p in enumerate(sequence.images) if t % interval == 0]
    if not sequences:
        for single in find_single_sequences(folder):
            boxed += [(p, single.boxes[[t]]) for t, p in enumerate(single.images) if t % interval == 0]
    if not boxed:
        raise RequestError(f"{folder}: expected labelled sequences with images, found none")
    return [_loaded(path, boxes) for path, boxes in boxed]


def some_images(folders: Sequence[Path] | None, interval: int, count: int, seed: int) -> tuple[list[BoxedImage], str]:
    """Every ``interval``-th image of ``folders``, or ``count`` generated ones; and what they are, in words.

    Raises:
        RequestError: as `boxed_images`.
    """
    if folders:
        images = [item for folder in folders for item in boxed_images(folder, interval)]
        return images, ", ".join(folder.name for folder in folders)
    return generated_images(count, seed), f"{count} images of generated clips, seed {seed}"


def _loaded(path: Path, boxes: FloatArray) -> BoxedImage:
    image = read_image(path)
    inside = clip_boxes(boxes[np.isfinite(boxes).all(axis=1)], image.shape[1], image.shape[0])
    return BoxedImage(image, inside[((inside[:, 2:] - inside[:, :2]) >= 4).all(axis=1)])


def recall_by_windows(images: list[BoxedImage], model: ObjectnessModel) -> dict[int, float]:
    """Share of labelled boxes covered by half or more, by the number of windows, for `WINDOWS`."""
    labelled = [item for item in images if len(item.boxes)]
    proposals = [propose(item.image, model, max(WINDOWS))[0] for item in labelled]
    shares = recall([item.boxes for item in labelled], proposals, list(WINDOWS))
    return dict(zip(WINDOWS, shares.tolist(), strict=True))


def plot_recall(shares: dict[int, float], path: Path) -> None:
    """The recall over the number of windows, on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.5, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.plot(list(shares), [100 * share for share in shares.values()], marker="o", color=COLOURS[0])
    axes.set_xscale("log")
    axes.set_xticks(list(shares), [str(windows) for windows in shares])
    axes.minorticks_off()
    axes.set_ylim(0, 102)
    axes.set_xlabel("Windows")
    axes.set_ylabel("Boxes found, overlap 0.5 [%]")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110, facecolor="white")


CHANCE = Seed()


def train_objectness(
    output: PlottedFile,
    chance: Seed = CHANCE,
    data: Commas[list[Path] | None] = None,
    test: Commas[list[Path] | None] = None,
    interval: PositiveInt = 10,
    images: Annotated[PositiveInt, HIDDEN] = 800,
) -> None:
    """Learn binarised normed gradients (BING) from labelled boxes, and report the recall by number of windows.

    Args:
        output.out: file to write, JSON.
        data: folders of labelled sequences (MOTChallenge, OTB, VOT, UAV123), separated by commas; by default generated
            clips.
        test: folders to measure the recall on; by default generated clips of another seed.
        interval: take every so many frames of the folders.
        images: number of generated images, where nothing is given.
        output.plot: also plot the recall to this file (PNG, SVG or PDF).
    """
    training, described = some_images(data, interval, images, chance.seed)
    model = fit_objectness(training, chance.seed, described)
    held_out, _ = some_images(test, interval, max(1, images // 4), chance.seed + 1)
    shares = recall_by_windows(held_out, model)
    output.write(output.out, model.write)
    output.draw(lambda path: plot_recall(shares, path))
    print(f"{len(model.sizes)} window sizes, learnt from {described}: {output.out}")
    print("windows  boxes found (overlap 0.5)")
    for windows, share in shares.items():
        print(f"{windows:7d}  {100 * share:5.1f} %")
