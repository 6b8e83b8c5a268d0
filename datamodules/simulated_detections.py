"""Detections as an imperfect detector would give them, from exact labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsuiseki.tracking.geometry import clip_boxes
from tsuiseki.tracking.types import BoolArray, Detections, FloatArray
from tsuiseki.tracking.types.labels import GroundTruth


@dataclass(frozen=True)
class DetectorFaults:
    """How a simulated detector errs.

    Attributes:
        jitter: scale of the error of the box's centre and of the logarithm of its size, in box sizes. Errors are
            heavy-tailed (Student's t, 3 degrees of freedom): now and then a box misses half of the person.
        steady: share of that jitter that stays from frame to frame, in [0, 1).
        missed: chance to miss somebody fully visible, in a frame.
        hidden: chance to miss somebody of whom a third is visible; it rises smoothly from ``missed``.
        false_alarms: mean number of false boxes in a frame.
        persistence: chance that a false box comes again in the next frame, in [0, 1).
        doubled: chance of a second box on somebody, off to one side.
    """

    jitter: float = 0.06
    steady: float = 0.5
    missed: float = 0.05
    hidden: float = 0.5
    false_alarms: float = 1.0
    persistence: float = 0.8
    doubled: float = 0.05


def simulate_detections(
    rng: np.random.Generator, truth: GroundTruth, length: int, width: int, height: int, faults: DetectorFaults
) -> list[Detections]:
    """One `Detections` a frame: the labelled people moved, missed and added to.

    Scores are high for the clearly visible and lower for the hidden and for false boxes, and overlap as those of a
    real detector do.

    Args:
        rng: the source of all chance.
        truth: labels.
        length: of the video, frames.
        width: of the images, pixels.
        height: of the images, pixels.
        faults: how the detector errs.
    """
    people = truth.select(truth.evaluated)
    offsets = {int(identity): _errors(rng, 1, faults.jitter)[0] for identity in np.unique(people.ids)}
    wrong = np.empty((0, 4))
    result = []
    for frame in range(length):
        rows = people.between(frame, frame)
        for identity in rows.ids.tolist():
            fresh = _errors(rng, 1, faults.jitter)[0]
            # Weights that keep the variance, whatever the share that stays.
            offsets[identity] = faults.steady * offsets[identity] + np.sqrt(1 - faults.steady**2) * fresh
        detected = _detected(rng, rows.visibility, faults)
        boxes = _moved(rows.boxes, np.array([offsets[i] for i in rows.ids.tolist()]).reshape(-1, 4))
        doubled = detected & (rng.random(len(rows)) < faults.doubled)
        extra = _moved(rows.boxes[doubled], rng.normal(0, 0.35, (int(doubled.sum()), 4)))
        wrong = _false_boxes(rng, wrong, people.boxes, width, height, faults)
        scores = [
            _scores(rng, 3.5 - 3 * (1 - rows.visibility[detected])),
            _scores(rng, np.full(len(extra) + len(wrong), 2.0)),
        ]
        result.append(_inside(np.concatenate([boxes[detected], extra, wrong]), np.concatenate(scores), width, height))
    return result


def _errors(rng: np.random.Generator, count: int, scale: float) -> FloatArray:
    """``(count, 4)`` errors of centre and log size; a size never changes by more than a factor of about 2."""
    return np.asarray(np.clip(rng.standard_t(3, (count, 4)), -8, 8) * scale)


def _detected(rng: np.random.Generator, visibility: FloatArray, faults: DetectorFaults) -> BoolArray:
    logit = {share: np.log(share / (1 - share)) for share in (faults.missed, faults.hidden)}
    slope = (logit[faults.hidden] - logit[faults.missed]) / (1 - 1 / 3)
    missed = 1 / (1 + np.exp(-(logit[faults.missed] + slope * (1 - visibility))))
    return np.asarray(rng.random(len(visibility)) >= missed)


def _moved(boxes: FloatArray, offsets: FloatArray) -> FloatArray:
    """Boxes with centres moved and sizes stretched by ``(N, 4)`` offsets in box sizes."""
    size = boxes[:, 2:] - boxes[:, :2]
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2 + offsets[:, :2] * size
    half = size / 2 * np.exp(offsets[:, 2:])
    return np.concatenate([middle - half, middle + half], axis=1)


def _false_boxes(
    rng: np.random.Generator, previous: FloatArray, people: FloatArray, width: int, height: int, faults: DetectorFaults
) -> FloatArray:
    """False boxes that stay and new ones, of people's size anywhere in the picture."""
    persistent = previous[rng.random(len(previous)) < faults.persistence]
    new = people[rng.integers(0, len(people), rng.poisson(faults.false_alarms * (1 - faults.persistence)))]
    corner = rng.uniform(0, 1, (len(new), 2)) * [width, height]
    size = new[:, 2:] - new[:, :2]
    persistent = _moved(persistent, _errors(rng, len(persistent), faults.jitter))
    return np.concatenate([persistent, np.concatenate([corner - size / 2, corner + size / 2], axis=1)])


def _scores(rng: np.random.Generator, clear: FloatArray) -> FloatArray:
    """Scores in (0.3, 1), a noisy logistic function of how ``clear`` a detection is."""
    return np.asarray(0.3 + 0.7 / (1 + np.exp(-rng.normal(clear, 1.5))))


def _inside(boxes: FloatArray, scores: FloatArray, width: int, height: int) -> Detections:
    boxes = clip_boxes(boxes, width, height)
    large_enough = ((boxes[:, 2:] - boxes[:, :2]) >= 2).all(axis=1)
    return Detections(boxes[large_enough], scores[large_enough])
