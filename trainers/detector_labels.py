"""What labelled pictures tell about a detector: sizes of its anchors, and what its scores mean.

Hard negative mining teaches a detector on a quarter of people where pictures hold far fewer, and a short training
leaves it unsure, so its scores order detections well and mean little. A logistic regression of "this detection is a
labelled person" on the logit of the score (Platt 1999) gives each score its probability; trackers can then use one
threshold for any detector. The order of detections, and so the average precision, stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit
from sklearn.linear_model import LogisticRegression

from tsuiseki.datamodules.labelled_images import LabelledFrame, labelled_images
from tsuiseki.datamodules.video_pictures import picture_size, read_image
from tsuiseki.models.anchors import propose_anchors, size_iou
from tsuiseki.tracking.association.assignment import assign_overlaps
from tsuiseki.tracking.errors import RequestError
from tsuiseki.tracking.features.exported import Detect
from tsuiseki.tracking.geometry import areas, intersections, iou_matrix
from tsuiseki.tracking.types import BoolArray, FloatArray
from tsuiseki.trainers.detector_network import Resize

# Detections down to this score tell what scores mean.
LOWEST_SCORE = 0.05
# Intersection over union from which a detection is a labelled person; and share of its area on an ignored label from
# which it is left out.
MATCH_OVERLAP = 0.5
# Mean IoU of labels with the best anchor below which a training takes others than those that it starts from.
FITTING = 0.6


def matched_scores(
    detector: Detect, folder: Path, frames: tuple[int, int] | None = None
) -> tuple[FloatArray, BoolArray]:
    """Scores ``(N,)`` of the detections in the labelled pictures of ``folder``, and which are labelled people.

    Detections that lie on an ignored label are left out.

    Args:
        detector: with a low threshold.
        folder: see `labelled_images`.
        frames: first and last frame, 1-based, both included; by default all.
    """
    scores, right = [], []
    for sample in labelled_images(folder, frames):
        detections = detector.detect([read_image(sample.picture)])[0]
        people, ignored = sample.boxes[~sample.ignored], sample.boxes[sample.ignored]
        matched = np.zeros(len(detections), dtype=np.bool_)
        matched[assign_overlaps(iou_matrix(detections.boxes, people), MATCH_OVERLAP)[0]] = True
        inside = intersections(detections.boxes[:, None], ignored[None]) / areas(detections.boxes)[:, None]
        counted = matched | ~(inside > MATCH_OVERLAP).any(axis=1)
        scores.append(detections.scores[counted])
        right.append(matched[counted])
    return np.concatenate(scores), np.concatenate(right)


def fit_calibration(scores: FloatArray, right: BoolArray, steepest: float = np.inf) -> tuple[float, float]:
    """Scale and shift of the logit that turn ``(N,)`` scores in (0, 1) into probabilities of ``(N,)`` being right.

    Args:
        scores: of detections.
        right: whether each is a labelled person.
        steepest: largest scale; where more would fit, the shift alone brings as many right as there are.

    Raises:
        RequestError: all detections are right, or none is.
    """
    if right.all() or not right.any():
        raise RequestError("expected right and wrong detections to calibrate scores on; give more labelled pictures")
    logit = np.log(scores) - np.log1p(-scores)
    fit = LogisticRegression(C=1e6).fit(logit[:, None], right)
    scale = float(fit.coef_[0, 0])
    if scale <= 0:
        raise RequestError("the detector's scores say nothing about these pictures; train it longer")
    if scale > steepest:
        # The mean probability rises with the shift, which passes the share that is right within these bounds.
        far = steepest * float(np.abs(logit).max()) + 50
        return steepest, float(brentq(lambda shift: expit(steepest * logit + shift).mean() - right.mean(), -far, far))
    return scale, float(fit.intercept_[0])


def anchors_for(
    folder: Path,
    height: int,
    width: int,
    frames: tuple[int, int] | None = None,
    resize: Resize = "letterbox",
    per_level: tuple[int, ...] = (3, 2, 1),
    scale: tuple[float, float] = (0.8, 1.5),
    seed: int = 0,
) -> str:
    """The ``anchors:`` entry of a detector's configuration that fits the people labelled in ``folder``.

    Args:
        folder: a MOTChallenge sequence, or a folder of sequences.
        height: of the detector's input, pixels.
        width: of the detector's input, pixels.
        frames: first and last frame, 1-based and both included; by default all.
        resize: how images are fitted into the input.
        per_level: anchors at strides 8, 16, 32 and, with a fourth number, 64.
        scale: range of enlargements in training, by which the boxes are spread.
        seed: of the clustering's start.

    Raises:
        RequestError: no usable labels, or fewer distinct sizes than anchors.
    """
    if not 3 <= len(per_level) <= 4 or min(per_level) < 1:
        raise RequestError(f"expected 3 or 4 numbers of anchors, each at least 1; got {list(per_level)}")
    rng = np.random.default_rng(seed)
    sizes = _sizes_in_input(labelled_images(folder, frames), (height, width), resize)
    spread = sizes * np.exp(rng.uniform(np.log(scale[0]), np.log(scale[1]), len(sizes)))[:, None]
    try:
        levels, fit = propose_anchors(np.concatenate([np.zeros_like(spread), spread], axis=1), per_level, rng)
    except ValueError as error:
        raise RequestError(f"{folder}: {error}; ask for fewer anchors") from error
    lines = [f"# mean IoU with the best anchor {fit:.3f} over {len(sizes)} boxes of {folder}", "anchors:"]
    lines += ["  - [" + ", ".join(f"[{w:g}, {h:g}]" for w, h in level) + "]" for level in levels]
    return "\n".join(lines)


def anchor_choice(
    labels: Sequence[LabelledFrame], anchors: list[list[tuple[float, float]]], size: tuple[int, int]
) -> tuple[list[list[tuple[float, float]]], str]:
    """Anchors for the labels, and a line about it: those of the start, with others for classes that do not fit.

    Where no class fits, all are replaced.

    Args:
        labels: of pictures.
        anchors: of the detector that a training starts from; as many of each level are proposed for all classes, or one
            more for some.
        size: height and width of the input.
    """
    sizes = _sizes_in_input(labels, size, "letterbox")
    kinds = np.concatenate([label.classes[~label.ignored] for label in labels])
    start = np.concatenate([np.array(level, dtype=float) for level in anchors])
    best = size_iou(sizes, start).max(axis=1)
    poor = [kind for kind in np.unique(kinds) if best[kinds == kind].mean() < FITTING]
    misfits, mixed = np.isin(kinds, poor), 0 < len(poor) < len(np.unique(kinds))
    old = f"anchors of the start: mean IoU {best.mean():.2f} with {len(sizes)} labels"
    if not poor:
        return anchors, old
    try:
        boxes = np.concatenate([np.zeros_like(sizes), sizes], axis=1)[misfits]
        counts = [1 if mixed else len(level) for level in anchors]
        proposed, new = propose_anchors(boxes, counts, np.random.default_rng(0))
    except ValueError:
        return anchors, f"{old}, too few for others"
    if mixed:
        chosen = [[*level, *added] for level, added in zip(anchors, proposed, strict=True)]
        line = f"more anchors, for {misfits.sum()} of {len(sizes)} labels"
        return chosen, f"{line}: mean IoU {new:.2f}, with those of the start {best[misfits].mean():.2f}"
    line = f"anchors of the labels: mean IoU {new:.2f} with {len(sizes)} labels"
    return proposed, f"{line}, those of the start {best.mean():.2f}"


def _sizes_in_input(labels: Sequence[LabelledFrame], size: tuple[int, int], resize: Resize) -> FloatArray:
    """``(N, 2)`` widths and heights of the labelled people in input pixels."""
    sizes = [np.empty((0, 2))]
    for label in labels:
        boxes = label.boxes[~label.ignored]
        factors = np.array([size[1], size[0]]) / picture_size(label.picture)
        if resize == "letterbox":
            factors = np.full(2, factors.min())
        sizes.append((boxes[:, 2:] - boxes[:, :2]) * factors)
    return np.concatenate(sizes)
